"""Planning whole cycles: move after move, then all together."""
