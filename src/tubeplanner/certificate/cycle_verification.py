"""Verify_cycle: the judge of whole cycles, each leg by `verify`, and the junctions."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.judged_motion import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    Tolerance,
    not_required,
)
from tubeplanner.certificate.verification import Certificate, verify
from tubeplanner.checks import checked_options
from tubeplanner.errors import FormerName, ProblemError, TrajectoryError, shown
from tubeplanner.outcome import Location
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.legs import Stop
from tubeplanner.task.motion import CycleMotion
from tubeplanner.task.steps import Event
from tubeplanner.trajectory.parts import part_of


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
        """Return the failed conditions, as "MOVE: CONDITION" or "SEAM: CONDITION"."""
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
        unit = "" if condition.unit == RELATIVE else f" {condition.unit}"
        return f"{where}: {name}: margin {condition.margin:.3g}{unit} ({condition.coverage})"

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
        tolerance = {"absolute": self.tolerance.absolute, "relative": self.tolerance.relative}
        return {
            "passed": self.passed,
            "tolerance": tolerance,
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
    the motors must hold the arm with and without the parts that are taken or let go.

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
            begin, end = motion.leg_times[k]
            problem = cycle.problem(k, motion.junctions[: k + 2])
            if k == 0:
                problem = replace(problem, start=cycle.start)
            judged = verify(problem, part_of(motion.trajectory, begin, end), tolerance)
            # With times of the whole motion.
            conditions = {
                name: replace(each, where=leg.in_cycle(each.where, begin))
                for name, each in judged.conditions.items()
            }
            judged = replace(judged, conditions=conditions)
        except ProblemError as error:
            refused |= {move.name: str(error) for move in leg.moves}
        else:
            moves |= {move.name: judged for move in leg.moves}
    return CycleCertificate(moves, dict(_judged_junctions(cycle, motion)), refused, tolerance)


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
    locations = np.array([*stops, *starts])
    farthest = (abs(locations - locations[0]) + travelled).max(axis=0)
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
    coverage = "at rest, with and without what is taken or let go"
    return JudgedCondition(float(margins[row, joint]), RELATIVE, location, coverage)


def _judged_gap(robot: RobotModel, gap: FloatArray, time: float, coverage: str) -> JudgedCondition:
    """Judge gaps of joints, (n,) [rad or m], by the largest."""
    joint = int(gap.argmax())
    unit = "rad" if robot.revolute[joint] else "m"
    location = Location(time=time, joint=robot.joint_names[joint])
    return JudgedCondition(0.0 - float(gap[joint]), unit, location, coverage)
