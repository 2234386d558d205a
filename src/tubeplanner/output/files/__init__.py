"""Trajectories and problems on disk."""
