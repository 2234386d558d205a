"""Torque-speed lines of the motors: the faster they turn, the less effort they have."""

import numpy as np

from tubeplanner.verification.directed_peak import judged_both_ways
from tubeplanner.verification.judged_condition import RELATIVE, JudgedCondition, not_required
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_motor_curve(motion: JudgedMotion) -> JudgedCondition:
    """Judge the torque-speed lines, by polynomials that enclose the efforts.

    Margins are relative to the saturation efforts. Both ways count: a motor that brakes has more
    than its saturation effort.
    """
    motors = motion.robot.motors
    if not motors.has_curve.any():
        return not_required(RELATIVE, "no motor has a torque-speed line")
    efforts = motion.efforts_of(np.flatnonzero(motors.has_curve))
    saturation = motors.saturation_effort[efforts.joint]
    lost = saturation / motors.no_load_velocity[efforts.joint] * efforts.velocity
    excess = np.array([efforts.most(way) + way * lost for way in (1.0, -1.0)])
    excess[:, -1] -= saturation
    return judged_both_ways(motion, efforts, excess, saturation)
