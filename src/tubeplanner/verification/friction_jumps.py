"""Where joints reverse, and how far Coulomb friction jumps there, in words."""

import numpy as np

from tubeplanner.arrays import BoolArray
from tubeplanner.outcome import Place
from tubeplanner.verification.judged_motion import JudgedMotion


def friction_jumps(motion: JudgedMotion, joints: BoolArray) -> str:
    """Return how often friction jumps, and the most at which place; empty where there is none.

    Args:
        motion: Of joints that may reverse.
        joints: Whose friction counts, shape (n,).
    """
    robot, trajectory, stretches = motion.robot, motion.trajectory, motion.stretches
    motors = robot.motors
    jump = motors.backwards_friction + motors.forwards_friction
    jump = np.where(joints, jump * (1 + motors.friction_uncertainty), 0.0)
    if not jump.any():
        return ""
    moving = np.flatnonzero(stretches.direction)
    before, after = moving[:-1], moving[1:]
    reverses = stretches.direction[before] != stretches.direction[after]
    reverses &= stretches.joint[before] == stretches.joint[after]
    at = after[reverses & (jump[stretches.joint[after]] > 0)]
    if len(at) == 0:
        return "Coulomb friction does not jump: no joint reverses"
    worst = at[jump[stretches.joint[at]].argmax()]
    joint, piece = stretches.joint[worst], stretches.piece[worst]
    time = trajectory.breakpoints[piece] + stretches.start[worst] * trajectory.widths[piece]
    unit = "N m" if robot.revolute[joint] else "N"
    place = Place(time=float(time), joint=robot.joint_names[joint])
    return (
        f"Coulomb friction, which is apart, jumps at {len(at)} reversal{'s'[: len(at) > 1]}, by "
        f"at most {jump[joint]:.3g} {unit} ({place})"
    )
