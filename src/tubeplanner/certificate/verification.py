"""Verify and verify_cycle: the independent judge of trajectories and of whole cycles."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from itertools import pairwise
from operator import itemgetter
from types import MappingProxyType
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate import (
    clearance_conditions,
    effort_conditions,
    holding_conditions,
    joint_conditions,
    tool_conditions,
)
from tubeplanner.certificate.holding_conditions import AT_REST, HeldPart
from tubeplanner.certificate.judged_motion import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    JudgedMotion,
    Tolerance,
    not_required,
)
from tubeplanner.certificate.other_speeds import Braking, OtherSpeeds, SlowerRun
from tubeplanner.certificate.segment_margins import MarginMaker
from tubeplanner.certificate.tube_visits import Visit
from tubeplanner.checks import checked_options
from tubeplanner.errors import FormerName, ProblemError, TrajectoryError, shown
from tubeplanner.geometry.collision_checker import LeftOutPair
from tubeplanner.outcome import Location
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.legs import Stop
from tubeplanner.task.motion import CycleMotion, Motion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Event
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import part_of

# The conditions of a certificate in its order, and the function that judges each.
JUDGED: Mapping[str, Callable[[JudgedMotion], JudgedCondition]] = MappingProxyType(
    {
        "position": joint_conditions.judge_position,
        "velocity": joint_conditions.judge_velocity,
        "acceleration": partial(joint_conditions.judge_rate, "acceleration"),
        "jerk": partial(joint_conditions.judge_rate, "jerk"),
        "effort": effort_conditions.judge_effort,
        "motor_curve": effort_conditions.judge_motor_curve,
        "effort_rate": effort_conditions.judge_effort_rate,
        "tool_speed": tool_conditions.judge_tool_speed,
        "tool_acceleration": tool_conditions.judge_tool_acceleration,
        "point_speed": tool_conditions.judge_point_speed,
        "holding": holding_conditions.judge_holding,
        "tube": tool_conditions.judge_tube,
        "joint_signs": joint_conditions.judge_joint_signs,
        "rotation": tool_conditions.judge_rotation,
        "points": tool_conditions.judge_points,
        "start": joint_conditions.judge_start,
        "goal": joint_conditions.judge_goal,
        "rest": joint_conditions.judge_rest,
        "continuity": joint_conditions.judge_continuity,
        "obstacles": clearance_conditions.judge_obstacles,
        "self_collision": clearance_conditions.judge_self_collision,
    }
)
CONDITION_NAMES = tuple(JUDGED)
# Margins of segments, beside those of tool and joints, by which switching times are chosen.
# Of a failed trajectory in turn: a slower run mends the speed, and nothing else.
SEGMENT_MARGINS: tuple[MarginMaker, ...] = (
    clearance_conditions.clearance_margin,
    tool_conditions.tool_speed_margin,
    tool_conditions.tool_acceleration_margin,
)
_OF_SEGMENTS = (
    *("tool_speed", "tool_acceleration", "tube", "joint_signs", "rotation", "points"),
    *("obstacles", "self_collision"),
)

_TOLERANCE = Tolerance()

# Limits that a slower run keeps if the trajectory does. Holding is judged at rest, too: wrenches at
# lower speeds lie between those at rest and at speed.
_SPEED_LIMITS = (
    *("velocity", "acceleration", "jerk", "tool_speed", "tool_acceleration", "point_speed"),
    "holding",
)
_AT_STOP = "with and without what is taken or let go"
# Conditions that a bound on braking presupposes.
_BRAKING_CONDITIONS = frozenset(
    ("velocity", "acceleration", "effort", "motor_curve", "rest", "continuity")
)
# The least speed that counts, as a fraction of a band's floor.
_STANDING = 1e-9


@dataclass(frozen=True)
class Certificate:
    """The judgement of a trajectory: all conditions with margins, locations and coverage.

    Attributes:
        conditions: By name, in the order of `CONDITION_NAMES`.
        tolerance: Largest violation that counts as none.
        left_out: Pairs of solids that were not checked against each other, with the reasons.
        other_speeds: The trajectory at other speeds; None: not known.
        from_speed: Fraction of its speed from which on the trajectory keeps the required bands of
            the tool's speed; None: none is required.
    """

    conditions: Mapping[str, JudgedCondition]
    tolerance: Tolerance
    left_out: tuple[LeftOutPair, ...] = ()
    other_speeds: OtherSpeeds | None = field(default=None, repr=False, compare=False)
    from_speed: float | None = None

    def __post_init__(self) -> None:
        ordered = {name: self.conditions[name] for name in CONDITION_NAMES}
        object.__setattr__(self, "conditions", MappingProxyType(ordered))

    def __reduce__(self) -> tuple[Any, ...]:
        return Certificate, (
            dict(self.conditions),
            self.tolerance,
            self.left_out,
            self.other_speeds,
            self.from_speed,
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
                is_at_rest = (condition.where.contact or "").endswith(AT_REST)
                speed = 0.0 if is_at_rest else 1.0
                return SlowerRun(name, condition.margin or 0.0, speed, condition.where)
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
        failures = self.failures()
        if self.other_speeds is None or not _BRAKING_CONDITIONS.isdisjoint(failures):
            return None
        braking = self.other_speeds.braking
        if braking is not None and "holding" in failures:
            return replace(braking, drops=None, holding=None)
        return braking

    def describe(self, name: str) -> str:
        """Return a line about a condition: margin, unit, location."""
        condition = self.conditions[name]
        if condition.margin is None:
            return f"{name}: not required ({condition.coverage})"
        location = f" ({condition.where})" if str(condition.where) else ""
        return f"{name}: {condition.shown_margin}{location}"

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate as JSON values."""
        failure, braking = self.slower_failure, self.braking
        return {
            "passed": self.passed,
            "tolerance": asdict(self.tolerance),
            "conditions": {
                name: condition.as_dict(self.tolerance)
                for name, condition in self.conditions.items()
            },
            "slower": self.slower,
            "from_speed": self.from_speed,
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
    """
    motion = _motion(problem, trajectory, tolerance)
    conditions = {name: judge(motion) for name, judge in JUDGED.items()}
    held = problem.robot, motion.trajectory, tolerance.relative, problem.holding
    speeds = OtherSpeeds(*held)
    left_out = problem.collision.left_out
    return Certificate(conditions, tolerance, left_out, speeds, _from_speed(motion))


def longest_duration(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return the longest duration in which a trajectory, run slower, keeps its speed bands [s].

    Infinite where none is required.
    """
    fraction = _from_speed(_motion(problem, trajectory, _TOLERANCE))
    return trajectory.duration / fraction if fraction else np.inf


def _from_speed(motion: JudgedMotion) -> float | None:
    """Return the fraction of its speed from which on a motion keeps its bands; None: it has none.

    More than 1 if the motion itself is too slow somewhere.
    """
    lower = tool_conditions.judge_least_speed(motion)
    return None if lower is None or lower.margin is None else 1 / max(1 + lower.margin, _STANDING)


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
    """Return the visits of the joined segments by a trajectory, as in `verify`."""
    return _motion(problem, trajectory, Tolerance()).visits


# ---- The judge of whole cycles: each leg by `verify`, and the junctions.


@dataclass(frozen=True)
class CycleCertificate:
    """The judgement of the motion of a cycle.

    Attributes:
        moves: Certificates by name; moves that run without a stop share a certificate.
        junctions: Conditions by name, at each junction, by its name.
        refused: Reasons by name of the moves whose start their problem refuses.
        tolerance: Largest violation that counts as none.
    """

    moves: Mapping[str, Certificate]
    junctions: Mapping[str, Mapping[str, JudgedCondition]]
    refused: Mapping[str, str]
    tolerance: Tolerance

    place = FormerName("location")
    seams = FormerName("junctions")

    def __repr__(self) -> str:
        failed = self.failures()
        return (
            f"<CycleCertificate {'fails ' + ', '.join(failed) if failed else 'passed'}: "
            f"{len(self.moves)} moves, {len(self.junctions)} junctions>"
        )

    @property
    def passed(self) -> bool:
        """True if every condition of every move and junction holds."""
        return not self.failures()

    def failures(self) -> list[str]:
        """Return the failed conditions, as "MOVE: CONDITION" or "JUNCTION: CONDITION"."""
        failures = [f"{move}: start" for move in self.refused]
        failures += [f"{move}: {c}" for move, each in self.moves.items() for c in each.failures()]
        for junction, conditions in self.junctions.items():
            failed = [n for n, each in conditions.items() if not each.holds(self.tolerance)]
            failures += [f"{junction}: {name}" for name in failed]
        return failures

    def describe(self, failure: str) -> str:
        """Return a line about a failure, named as in `failures`."""
        where, name = failure.rsplit(": ", 1)
        if where in self.refused:
            return f"{where}: {self.refused[where]}"
        if where in self.moves:
            return f"{where}: {self.moves[where].describe(name)}"
        condition = self.junctions[where][name]
        return f"{where}: {name}: {condition.shown_margin} ({condition.coverage})"

    def location(self, failure: str) -> Location:
        """Return the location of a failure, named as in `failures`, with the move."""
        where, name = failure.rsplit(": ", 1)
        if where in self.refused:
            return Location(move=where)
        conditions = self.moves[where].conditions if where in self.moves else self.junctions[where]
        return conditions[name].where

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate as JSON values."""
        moves = {name: certificate.as_dict() for name, certificate in self.moves.items()}
        refused = {
            name: {"passed": False, "refused": why, "conditions": {}}
            for name, why in self.refused.items()
        }
        return {
            "passed": self.passed,
            "tolerance": asdict(self.tolerance),
            "moves": {**moves, **refused},
            "seams": {
                junction: {name: each.as_dict(self.tolerance) for name, each in conditions.items()}
                for junction, conditions in self.junctions.items()
            },
        }


def verify_cycle(
    cycle: Cycle, motion: CycleMotion, tolerance: Tolerance | None = None
) -> CycleCertificate:
    """Judge the motion of a cycle.

    Every leg is judged as the motion of its planning problem, in the cell as the motion itself
    leaves it. At junctions the arm must stay in its configuration for as long as events take, and
    motors and contacts must hold with and without the parts that are taken or let go.

    Args:
        cycle: The cycle.
        motion: Its motion.
        tolerance: Largest violation that counts as none; None: as for our own trajectories.

    Raises:
        ProblemError: The cycle is none.
        TrajectoryError: The motion is none.
        OptionError: The tolerance is none.
    """
    Cycle.require(cycle)
    if not isinstance(motion, CycleMotion):
        raise TrajectoryError(
            f"the motion is {shown(motion)}; give a CycleMotion, as plan_cycle returns"
        )
    tolerance = checked_options(tolerance, Tolerance, "the tolerance is")
    moves: dict[str, Certificate] = {}
    refused: dict[str, str] = {}
    for k, leg in enumerate(cycle.legs):
        try:
            problem = cycle.problem(k, motion.junctions[: k + 2])
            if k == 0:
                problem = replace(problem, start=cycle.start)
            judged = verify(problem, motion.legs[k], tolerance)
        except ProblemError as error:
            refused |= dict.fromkeys(leg.names, str(error))
            continue
        begin = motion.leg_times[k][0]  # conditions have times of the whole motion
        conditions = {
            name: replace(each, where=leg.in_cycle(each.where, begin))
            for name, each in judged.conditions.items()
        }
        moves |= dict.fromkeys(leg.names, replace(judged, conditions=conditions))
    return CycleCertificate(moves, dict(_judged_junctions(cycle, motion)), refused, tolerance)


def verify_motion(
    motion: Motion, tolerance: Tolerance | None = None
) -> Certificate | CycleCertificate:
    """Judge the motion of a problem or a cycle, as `verify` or `verify_cycle`."""
    if isinstance(motion, CycleMotion):
        return verify_cycle(motion.cycle, motion, tolerance)
    return verify(motion.task, motion.trajectory, tolerance)


def _judged_junctions(
    cycle: Cycle, motion: CycleMotion
) -> Iterator[tuple[str, Mapping[str, JudgedCondition]]]:
    """Yield name and conditions of every junction."""
    names = ["start", *(leg.name for leg in cycle.legs), "end"]
    times = [0.0, *(time for leg in motion.leg_times for time in leg), motion.trajectory.duration]
    for k, name in enumerate(pairwise(names)):
        begin, end = times[2 * k], times[2 * k + 1]
        yield (
            " - ".join(name),
            {
                "continuity": _judged_stay(motion, k, begin, end),
                "dwell": _judged_dwell(motion, k),
                "effort": _judged_hold(cycle.stop_at(k), motion.trajectory.position(end), end),
                "holding": _judged_contacts(cycle.stop_at(k), motion.trajectory.position(end), end),
            },
        )
    if cycle.closed:
        off, end = abs(motion.junctions[-1] - motion.junctions[0]), motion.trajectory.duration
        gap = _judged_gap(cycle.robot, off, end, "the end against the start")
        yield "closed", {"continuity": gap}


def _judged_stay(motion: CycleMotion, junction: int, begin: float, end: float) -> JudgedCondition:
    """Judge the travel of joints at a junction, between two times [s], where none may move."""
    legs = motion.legs
    stops = [leg.position(leg.duration) for leg in legs[:junction][-1:]]
    starts = [leg.position(0.0) for leg in legs[junction : junction + 1]]
    travelled = [np.zeros_like(q) for q in (*stops, *starts)]
    if begin < end:
        part = part_of(motion.trajectory, begin, end)
        powers = np.arange(len(part.coefficients))[::-1, None, None]
        travel = abs(part.coefficients) * np.diff(part.breakpoints)[:, None] ** powers
        travelled[len(stops) : len(stops)] = travel[:-1].sum(axis=0)
        starts = [*part.coefficients[-1], *starts]
    if len(travelled) < 2:
        return not_required("rad", "the arm does not dwell here")
    q = np.array([*stops, *starts])
    farthest = (abs(q - q[0]) + travelled).max(axis=0)
    return _judged_gap(motion.cycle.robot, farthest, begin, FOR_ALL_TIMES)


def _judged_dwell(motion: CycleMotion, junction: int) -> JudgedCondition:
    """Judge the time that the arm rests at a junction, against the dwell of each event."""
    cycle = motion.cycle
    first = sum(len(leg.before.steps) + len(leg.moves) for leg in cycle.legs[:junction])
    spans = motion.step_times[first:]
    spare = [
        (end - begin - step.dwell, begin)
        for step, (begin, end) in zip(cycle.stop_at(junction).steps, spans, strict=False)
        if isinstance(step, Event) and step.dwell > 0
    ]
    if not spare:
        return not_required("s", "no event takes time here")
    margin, begin = min(spare)
    return JudgedCondition(margin, "s", Location(time=begin), "every event against its dwell")


def _judged_hold(stop: Stop, q: FloatArray, time: float) -> JudgedCondition:
    """Judge the motors' efforts at rest in a configuration (n,), with every load carried there."""
    arms = list(dict.fromkeys(stop.arms))
    fractions = []  # of each motor's effort limit, free at rest
    for arm in arms:
        effort = arm.gravity_effort(q)
        allowed = np.where(effort > 0, arm.limits.effort_at(q, 1), arm.limits.effort_at(q, -1))
        fractions.append(np.where(np.isfinite(allowed), 1 - abs(effort) / allowed, np.inf))
    margins = np.array(fractions)
    if np.isinf(margins).all():
        return not_required(RELATIVE, "no joint has this limit")
    row, joint = np.unravel_index(int(margins.argmin()), margins.shape)
    location = Location(time=time, joint=arms[row].joint_names[joint])
    return JudgedCondition(float(margins[row, joint]), RELATIVE, location, f"at rest, {_AT_STOP}")


def _judged_contacts(stop: Stop, q: FloatArray, time: float) -> JudgedCondition:
    """Judge the contacts at rest in a configuration (n,), with every part held there."""
    judged = []
    for arm, holdings in zip(stop.arms, stop.holdings, strict=True):
        for holding in holdings:
            part, cones = HeldPart(arm, holding), np.arange(len(holding.cones))
            margins = part.margin(part.wrench(np.tile(q, (len(cones), 1))), cones)
            contact = f"{holding.kind} {holding.cones[int(margins.argmin())].name}{AT_REST}"
            judged.append((float(margins.min()), Location(time=time, contact=contact)))
    if not judged:
        return not_required(RELATIVE, "nothing is held here")
    margin, location = min(judged, key=itemgetter(0))
    return JudgedCondition(margin, RELATIVE, location, f"{location.contact}, {_AT_STOP}")


def _judged_gap(robot: RobotModel, gap: FloatArray, time: float, coverage: str) -> JudgedCondition:
    """Judge gaps of joints, (n,) [rad or m], by the largest."""
    joint = int(gap.argmax())
    unit = "rad" if robot.revolute[joint] else "m"
    location = Location(time=time, joint=robot.joint_names[joint])
    return JudgedCondition(0.0 - float(gap[joint]), unit, location, coverage)
