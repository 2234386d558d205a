"""Where tubes come from: a recorded trail, or a route found from start, goal and obstacles."""
