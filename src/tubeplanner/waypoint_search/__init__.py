"""Phase 1: motions through points of the reference path, timed to the limits."""
