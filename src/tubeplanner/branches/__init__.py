"""Joint-space lines whose tool follows the reference path: inverse kinematics."""
