"""The compiled numerics, and how they are built and loaded; all of it has a numpy counterpart."""
