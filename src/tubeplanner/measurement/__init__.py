"""Tubes measured from obstacles: radii and joint ranges in which nothing collides."""
