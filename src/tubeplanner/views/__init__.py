"""Figures and pages. They take a problem and trajectories, never a solver's object."""
