"""From a problem to a certified trajectory, or to the reason why there is none."""
