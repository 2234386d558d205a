"""Tubes from obstacles, zones, trails, or start and goal alone."""
