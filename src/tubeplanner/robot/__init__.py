"""URDF, limits, motors, base and payload to kinematics and dynamics of N samples at once."""
