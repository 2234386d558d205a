"""Piecewise polynomials in time."""
