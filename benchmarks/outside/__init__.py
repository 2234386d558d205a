"""A second judge of trajectories: Pinocchio, coal and numpy, not a line of tubeplanner."""
