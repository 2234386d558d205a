"""Phase 2: path and speed optimised together, by sequential linear programs."""
