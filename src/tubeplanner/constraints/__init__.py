"""What the planners share to test a trajectory at samples: limits and tube."""
