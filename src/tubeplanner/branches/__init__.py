"""Joint-space lines whose hand follows the reference path: inverse kinematics."""
