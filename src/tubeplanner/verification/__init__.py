"""The judge: shares no code with what makes the trajectories that it judges."""
