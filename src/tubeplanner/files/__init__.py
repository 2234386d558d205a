"""Trajectories on disk: read, written whole or not at all."""
