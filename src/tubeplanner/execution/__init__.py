"""Trajectories executed in MuJoCo by arms that differ from the model."""
