"""From a problem to a certified motion, or to the reason why there is none."""
