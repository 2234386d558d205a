"""What controllers make of a trajectory: what they refuse, what they run otherwise."""
