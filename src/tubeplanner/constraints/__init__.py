"""What a trajectory must keep, as those who plan test it: limits and tube, at samples."""
