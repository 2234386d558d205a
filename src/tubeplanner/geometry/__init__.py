"""Shapes of links and obstacles; lower bounds on their distances."""
