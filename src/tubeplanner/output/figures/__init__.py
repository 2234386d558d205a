"""Figures of motions, runs and studies; matplotlib is imported on use."""
