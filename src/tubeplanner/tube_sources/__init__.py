"""Where tubes come from: measured among obstacles, from a recorded trail, from start and goal."""
