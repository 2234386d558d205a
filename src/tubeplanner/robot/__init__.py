"""From a URDF to kinematics, dynamics and limits, for many samples at once."""
