"""Phase 1: trajectories through points of the reference path, timed to the limits."""
