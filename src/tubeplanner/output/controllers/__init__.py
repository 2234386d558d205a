"""Verdicts of robot controllers on a trajectory: refusals, altered execution."""
