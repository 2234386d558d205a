"""Verify: the independent judge of trajectories, its conditions and the Certificate."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType
from typing import Any

from tubeplanner.certificate.clearance_conditions import (
    clearance_margin,
    judge_obstacles,
    judge_self_collision,
)
from tubeplanner.certificate.effort_conditions import (
    judge_effort,
    judge_effort_rate,
    judge_motor_curve,
)
from tubeplanner.certificate.joint_conditions import (
    judge_acceleration,
    judge_continuity,
    judge_goal,
    judge_jerk,
    judge_joint_signs,
    judge_position,
    judge_rest,
    judge_start,
    judge_velocity,
)
from tubeplanner.certificate.judged_motion import RELATIVE, JudgedCondition, JudgedMotion, Tolerance
from tubeplanner.certificate.other_speeds import Braking, OtherSpeeds, SlowerRun
from tubeplanner.certificate.segment_margins import MarginMaker
from tubeplanner.certificate.tool_conditions import (
    judge_point_speed,
    judge_points,
    judge_rotation,
    judge_tool_speed,
    judge_tube,
    tool_speed_margin,
)
from tubeplanner.certificate.tube_visits import Visit
from tubeplanner.checks import checked_options
from tubeplanner.geometry.collision_checker import LeftOutPair
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# The conditions of a certificate in its order, and the function that judges each.
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
# Margins of segments, beside those of tool and joints, by which switching times are chosen.
# Of a failed trajectory in turn: a slower run mends the speed, and nothing else.
SEGMENT_MARGINS: tuple[MarginMaker, ...] = (clearance_margin, tool_speed_margin)
_OF_SEGMENTS = (
    *("tool_speed", "tube", "joint_signs", "rotation", "points"),
    *("obstacles", "self_collision"),
)

_TOLERANCE = Tolerance()

# Limits that a slower run keeps if the trajectory does.
_SPEED_LIMITS = ("velocity", "acceleration", "jerk", "tool_speed", "point_speed")
# Conditions that a bound on braking presupposes.
_BRAKING_CONDITIONS = frozenset(
    ("velocity", "acceleration", "effort", "motor_curve", "rest", "continuity")
)


@dataclass(frozen=True)
class Certificate:
    """The judgement of a trajectory: all conditions with margins, locations and coverage.

    Attributes:
        conditions: By name, in the order of `CONDITION_NAMES`.
        tolerance: Largest violation that counts as none.
        left_out: Pairs of solids that were not checked against each other, with the reasons.
        other_speeds: The trajectory at other speeds; None: not known.
    """

    conditions: Mapping[str, JudgedCondition]
    tolerance: Tolerance
    left_out: tuple[LeftOutPair, ...] = ()
    other_speeds: OtherSpeeds | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        ordered = {name: self.conditions[name] for name in CONDITION_NAMES}
        object.__setattr__(self, "conditions", MappingProxyType(ordered))

    def __reduce__(self) -> tuple[Any, ...]:
        return Certificate, (
            dict(self.conditions),
            self.tolerance,
            self.left_out,
            self.other_speeds,
        )

    def __repr__(self) -> str:
        required = [name for name, each in self.conditions.items() if each.margin is not None]
        failed = self.failures()
        return (
            f"<Certificate {'fails ' + ', '.join(failed) if failed else 'passed'}: "
            f"{len(required)} of {len(self.conditions)} conditions required>"
        )

    @property
    def passed(self) -> bool:
        """True if every condition holds."""
        return not self.failures()

    def failures(self) -> list[str]:
        """Return the names of the conditions that do not hold."""
        return [
            name
            for name, condition in self.conditions.items()
            if not condition.holds(self.tolerance)
        ]

    @property
    def slower(self) -> bool | None:
        """True if the trajectory keeps all limits at any lower speed; None if not known.

        Informative: `passed` does not depend on it.
        """
        return None if self.other_speeds is None else self.slower_failure is None

    @property
    def slower_failure(self) -> SlowerRun | None:
        """A slower run that breaks a limit; None if no slower run does, or if not known."""
        if self.other_speeds is None:
            return None
        for name in _SPEED_LIMITS:
            condition = self.conditions[name]
            if not condition.holds(self.tolerance):
                return SlowerRun(name, condition.margin or 0.0, 1.0, condition.where)
        tightest = self.other_speeds.slower
        if tightest is None or tightest.margin >= -self.tolerance.relative:
            return None
        return tightest

    @property
    def braking(self) -> Braking | None:
        """Bounds on time and distance of braking along the path; informative.

        None where nothing limits efforts and accelerations, where the trajectory itself fails a
        condition that the bound presupposes, or if not known.
        """
        if self.other_speeds is None or not _BRAKING_CONDITIONS.isdisjoint(self.failures()):
            return None
        return self.other_speeds.braking

    def describe(self, name: str) -> str:
        """Return a line about a condition: margin, unit, location."""
        condition = self.conditions[name]
        if condition.margin is None:
            return f"{name}: not required ({condition.coverage})"
        unit = "" if condition.unit == RELATIVE else f" {condition.unit}"
        location = str(condition.where)
        return f"{name}: margin {condition.margin:.3g}{unit}" + (
            f" ({location})" if location else ""
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate as JSON values."""
        failure, braking = self.slower_failure, self.braking
        return {
            "passed": self.passed,
            "tolerance": {"absolute": self.tolerance.absolute, "relative": self.tolerance.relative},
            "conditions": {
                name: condition.as_dict(self.tolerance)
                for name, condition in self.conditions.items()
            },
            "slower": self.slower,
            "slower_failure": None if failure is None else asdict(failure),
            "braking": None if braking is None else asdict(braking),
            "left_out": [
                {"links": list(pair.links), "reason": pair.reason} for pair in self.left_out
            ],
        }


def verify(
    problem: PlanningProblem, trajectory: JointTrajectory, tolerance: Tolerance | None = None
) -> Certificate:
    """Judge a trajectory.

    Uses robot, tube, collision geometry and the trajectory's polynomials, and nothing of the code
    that made the trajectory. Of a trajectory that fails, segments are visited so that what is named
    is broken itself, and not for the sake of another condition.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        tolerance: Largest violation that counts as none; default: 1e-6 m, rad and relative.

    Raises:
        ProblemError: The problem is none.
        TrajectoryError: The trajectory is none, or moves other joints than the problem's.
        OptionError: The tolerance is none.
    """
    PlanningProblem.require(problem)
    JointTrajectory.require(trajectory)
    tolerance = checked_options(tolerance, Tolerance, "the tolerance is")
    certificate = quick_certificate(problem, trajectory, tolerance)
    if certificate.passed or set(certificate.failures()).isdisjoint(_OF_SEGMENTS):
        return certificate
    motion = _motion(problem, trajectory, tolerance, is_telling=True)
    telling = {name: JUDGED[name](motion) for name in _OF_SEGMENTS}
    named = replace(certificate, conditions={**certificate.conditions, **telling})
    return certificate if named.passed else named


def quick_certificate(
    problem: PlanningProblem, trajectory: JointTrajectory, tolerance: Tolerance = _TOLERANCE
) -> Certificate:
    """Return a certificate with the verdict of `verify`, for planners.

    Of a trajectory that fails, a condition of segments that holds may be named with a broken one.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        tolerance: Largest violation that counts as none.
    """
    motion = _motion(problem, trajectory, tolerance)
    conditions = {name: judge(motion) for name, judge in JUDGED.items()}
    speeds = OtherSpeeds(problem.robot, motion.trajectory, tolerance.relative)
    return Certificate(conditions, tolerance, problem.collision.left_out, speeds)


def _motion(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tolerance: Tolerance,
    *,
    is_telling: bool = False,
) -> JudgedMotion:
    trajectory = trajectory.reordered(problem.robot.joint_names)
    return JudgedMotion(problem.joined, trajectory, tolerance, SEGMENT_MARGINS, is_telling)


def judged_visits(problem: PlanningProblem, trajectory: JointTrajectory) -> list[Visit]:
    """Return the visits of segments by a trajectory, as in `verify`.

    Args:
        problem: The planning problem; the segments are those of `PlanningProblem.joined`.
        trajectory: Of the problem's joints, in any order.
    """
    return _motion(problem, trajectory, Tolerance()).visits
