"""The conditions of a certificate: their names, in its order, and what judges each."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from tubeplanner.verification.judged.clearance import (
    clearance_margin,
    judge_obstacles,
    judge_self_collision,
)
from tubeplanner.verification.judged.continuity import judge_continuity
from tubeplanner.verification.judged.effort import judge_effort
from tubeplanner.verification.judged.effort_rate import judge_effort_rate
from tubeplanner.verification.judged.endpoints import judge_goal, judge_start
from tubeplanner.verification.judged.joint_rates import (
    judge_acceleration,
    judge_jerk,
    judge_velocity,
)
from tubeplanner.verification.judged.joint_signs import judge_joint_signs
from tubeplanner.verification.judged.motor_curve import judge_motor_curve
from tubeplanner.verification.judged.point_speed import judge_point_speed
from tubeplanner.verification.judged.points import judge_points
from tubeplanner.verification.judged.position import judge_position
from tubeplanner.verification.judged.rest import judge_rest
from tubeplanner.verification.judged.rotation import judge_rotation
from tubeplanner.verification.judged.tool_speed import judge_tool_speed, tool_speed_margin
from tubeplanner.verification.judged.tube import judge_tube
from tubeplanner.verification.judged_condition import JudgedCondition
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.segment_margins import MarginMaker

JUDGED: Mapping[str, Callable[[JudgedMotion], JudgedCondition]] = MappingProxyType(
    {
        "position": judge_position,
        "velocity": judge_velocity,
        "acceleration": judge_acceleration,
        "jerk": judge_jerk,
        "effort": judge_effort,
        "motor_curve": judge_motor_curve,
        "effort_rate": judge_effort_rate,
        "tool_speed": judge_tool_speed,
        "point_speed": judge_point_speed,
        "tube": judge_tube,
        "joint_signs": judge_joint_signs,
        "rotation": judge_rotation,
        "points": judge_points,
        "start": judge_start,
        "goal": judge_goal,
        "rest": judge_rest,
        "continuity": judge_continuity,
        "obstacles": judge_obstacles,
        "self_collision": judge_self_collision,
    }
)
CONDITION_NAMES = tuple(JUDGED)
# Of those that segments ask, what the judge's switching times must know beside tool and joints.
SEGMENT_MARGINS: tuple[MarginMaker, ...] = (tool_speed_margin, clearance_margin)
