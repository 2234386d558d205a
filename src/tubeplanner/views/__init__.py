"""Figures and pages. They take a problem and motions, never a solver's object."""
