"""Motions without an optimiser: branches, waypoints, stops, baselines, the method of 1988."""
