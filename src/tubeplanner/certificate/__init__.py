"""The judge: imports no module that makes trajectories."""
