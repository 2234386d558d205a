"""Trajectories executed in MuJoCo: wrong plants, controllers, and what becomes of tolerances."""
