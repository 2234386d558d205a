"""Shapes of links and obstacles, and lower bounds on the distances between them."""
