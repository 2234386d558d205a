"""Tubes from what users have: zones of a controller, a trail, start and goal."""
