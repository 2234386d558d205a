"""Problem or cycle to a certified trajectory, or to the reason of its absence."""
