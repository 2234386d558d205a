"""Path and speed together, by sequential linear programs on ever finer knots."""
