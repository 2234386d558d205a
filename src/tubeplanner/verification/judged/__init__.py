"""The conditions of a certificate, a module for each or for a few that are judged alike."""
