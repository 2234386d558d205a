"""Verify_cycle: each leg by `verify`, and the junctions."""

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
from tubeplanner.checks import given_options
from tubeplanner.errors import ProblemError, TrajectoryError, shown
from tubeplanner.outcome import Place
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_motion import CycleMotion
from tubeplanner.task.legs import Rest
from tubeplanner.task.steps import Event
from tubeplanner.trajectory.parts import part_of

# ---- The judgement of a cycle: a certificate of every move, and what must hold where they meet.


@dataclass(frozen=True)
class CycleCertificate:
    """The judgement of the motion of a cycle.

    Attributes:
        moves: By name; moves that run without a stop have one together, under each name.
        seams: By what happens there and when: conditions by name.
        refused: Moves that begin where their problem has no place, by name, and why.
        tolerance: How far below zero margins may lie.
    """

    moves: Mapping[str, Certificate]
    seams: Mapping[str, Mapping[str, JudgedCondition]]
    refused: Mapping[str, str]
    tolerance: Tolerance

    def __repr__(self) -> str:
        failed = self.failures()
        return (
            f"<CycleCertificate {'fails ' + ', '.join(failed) if failed else 'passed'}: "
            f"{len(self.moves)} moves, {len(self.seams)} seams>"
        )

    @property
    def passed(self) -> bool:
        """Whether every condition of every move and seam holds."""
        return not self.failures()

    def failures(self) -> list[str]:
        """Return what does not hold, as "MOVE: CONDITION" or "SEAM: CONDITION"."""
        found = [f"{move}: start" for move in self.refused]
        found += [f"{move}: {c}" for move, each in self.moves.items() for c in each.failures()]
        for seam, conditions in self.seams.items():
            failed = [n for n, each in conditions.items() if not each.holds(self.tolerance)]
            found += [f"{seam}: {name}" for name in failed]
        return found

    def describe(self, failure: str) -> str:
        """Return one line about something that does not hold, as `failures` calls it."""
        where, name = failure.rsplit(": ", 1)
        if where in self.refused:
            return f"{where}: {self.refused[where]}"
        if where in self.moves:
            return f"{where}: {self.moves[where].describe(name)}"
        condition = self.seams[where][name]
        unit = "" if condition.unit == RELATIVE else f" {condition.unit}"
        return f"{where}: {name}: margin {condition.margin:.3g}{unit} ({condition.coverage})"

    def place(self, failure: str) -> Place:
        """Return where something does not hold, as `failures` calls it; it names the move."""
        where, name = failure.rsplit(": ", 1)
        if where in self.refused:
            return Place(move=where)
        conditions = self.moves[where].conditions if where in self.moves else self.seams[where]
        return conditions[name].where

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate as JSON values."""
        moves = {name: certificate.as_dict() for name, certificate in self.moves.items()}
        tolerance = {"absolute": self.tolerance.absolute, "relative": self.tolerance.relative}
        return {
            "passed": self.passed,
            "tolerance": tolerance,
            "moves": {**moves, **{name: _refusal(why) for name, why in self.refused.items()}},
            "seams": {
                seam: {name: each.as_dict(self.tolerance) for name, each in conditions.items()}
                for seam, conditions in self.seams.items()
            },
        }


def _refusal(why: str) -> dict[str, Any]:
    return {"passed": False, "refused": why, "conditions": {}}


# ---- The judge of whole cycles: every leg by `verify`, and the seams between them.


def verify_cycle(
    cycle: Cycle, motion: CycleMotion, tolerance: Tolerance | None = None
) -> CycleCertificate:
    """Judge the motion of a cycle.

    Every leg is judged as the motion of its planning problem, the cell as the motion itself leaves
    it. Where it rests, it must stay where it is for as long as events take, and the motors must
    hold the arm with and without what is taken or let go.

    Args:
        cycle: The cycle.
        motion: Its motion.
        tolerance: How far below zero margins may lie; None: as for our own trajectories.

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
    tolerance = given_options(tolerance, Tolerance, "the tolerance is")
    moves: dict[str, Certificate] = {}
    refused: dict[str, str] = {}
    for k, leg in enumerate(cycle.legs):
        try:
            judged = _judged_leg(cycle, motion, k, tolerance)
        except ProblemError as error:
            refused |= {move.name: str(error) for move in leg.moves}
        else:
            moves |= {move.name: judged for move in leg.moves}
    return CycleCertificate(moves, dict(_judged_seams(cycle, motion)), refused, tolerance)


def _judged_leg(cycle: Cycle, motion: CycleMotion, k: int, tolerance: Tolerance) -> Certificate:
    """Return the certificate of a leg, its times those of the whole motion.

    Raises:
        ProblemError: It begins where its problem has no place.
    """
    begin, end = motion.leg_times[k]
    problem = cycle.problem(k, motion.seams[: k + 2])
    if k == 0:
        problem = replace(problem, start=cycle.start)
    judged = verify(problem, part_of(motion.trajectory, begin, end), tolerance)
    conditions = {
        name: replace(each, where=cycle.legs[k].in_cycle(each.where, begin))
        for name, each in judged.conditions.items()
    }
    return replace(judged, conditions=conditions)


def _judged_seams(
    cycle: Cycle, motion: CycleMotion
) -> Iterator[tuple[str, Mapping[str, JudgedCondition]]]:
    """Yield the conditions of every seam, after what it is called."""
    names = ["start", *(leg.name for leg in cycle.legs), "end"]
    times = [0.0, *(time for leg in motion.leg_times for time in leg), motion.trajectory.duration]
    for k, name in enumerate(pairwise(names)):
        begin, end = times[2 * k], times[2 * k + 1]
        yield (
            " - ".join(name),
            {
                "continuity": _judged_stay(motion, k, begin, end),
                "dwell": _judged_dwell(motion, k),
                "effort": _judged_hold(cycle.rest_at(k), motion.trajectory.position(end), end),
            },
        )
    if cycle.closed:
        yield "closed", {"continuity": _judged_return(cycle, motion)}


def _judged_stay(motion: CycleMotion, seam: int, begin: float, end: float) -> JudgedCondition:
    """Judge how far joints move at a seam, between two times [s], where they must not at all."""
    legs = motion.legs
    stops = [leg.position(leg.duration) for leg in legs[:seam][-1:]]
    starts = [leg.position(0.0) for leg in legs[seam : seam + 1]]
    travelled = [np.zeros_like(q) for q in (*stops, *starts)]
    if begin < end:
        part = part_of(motion.trajectory, begin, end)
        powers = np.arange(len(part.coefficients))[::-1, None, None]
        travel = abs(part.coefficients) * np.diff(part.breakpoints)[:, None] ** powers
        travelled[len(stops) : len(stops)] = travel[:-1].sum(axis=0)
        starts = [*part.coefficients[-1], *starts]
    if len(travelled) < 2:
        return not_required("rad", "the arm does not dwell here")
    places = np.array([*stops, *starts])
    moved = (abs(places - places[0]) + travelled).max(axis=0)
    return _judged_gap(motion.cycle.robot, moved, begin, FOR_ALL_TIMES)


def _judged_dwell(motion: CycleMotion, seam: int) -> JudgedCondition:
    """Judge whether the arm rests at a seam for as long as each event takes."""
    cycle = motion.cycle
    first = sum(len(leg.before.steps) + len(leg.moves) for leg in cycle.legs[:seam])
    spans = motion.step_times[first:]
    spare = [
        (end - begin - step.dwell, begin)
        for step, (begin, end) in zip(cycle.rest_at(seam).steps, spans, strict=False)
        if isinstance(step, Event) and step.dwell > 0
    ]
    if not spare:
        return not_required("s", "no event takes time here")
    margin, begin = min(spare)
    return JudgedCondition(margin, "s", Place(time=begin), "every event against its dwell")


def _judged_hold(rest: Rest, q: FloatArray, time: float) -> JudgedCondition:
    """Judge whether the motors hold the arm in a configuration (n,), whatever it carries there."""
    arms = list(dict.fromkeys(rest.arms))
    margins = np.array([_hold_margin(arm, q) for arm in arms])
    if np.isinf(margins).all():
        return not_required(RELATIVE, "no joint has this limit")
    arm, joint = np.unravel_index(int(margins.argmin()), margins.shape)
    place = Place(time=time, joint=arms[arm].joint_names[joint])
    coverage = "at rest, with and without what is taken or let go"
    return JudgedCondition(float(margins[arm, joint]), RELATIVE, place, coverage)


def _hold_margin(arm: RobotModel, q: FloatArray) -> FloatArray:
    """Return which share of each motor's effort is left at rest, shape (n,)."""
    effort = arm.gravity_effort(q)
    allowed = np.where(effort > 0, arm.limits.effort_at(q, 1), arm.limits.effort_at(q, -1))
    margin: FloatArray = np.where(np.isfinite(allowed), 1 - abs(effort) / allowed, np.inf)
    return margin


def _judged_return(cycle: Cycle, motion: CycleMotion) -> JudgedCondition:
    """Judge whether the motion ends in the configuration in which it begins."""
    off = abs(motion.seams[-1] - motion.seams[0])
    return _judged_gap(cycle.robot, off, motion.trajectory.duration, "the end against the start")


def _judged_gap(robot: RobotModel, gap: FloatArray, time: float, coverage: str) -> JudgedCondition:
    """Return the judgement of how far joints are, (n,) [rad or m], from where they must be."""
    joint = int(gap.argmax())
    unit = "rad" if robot.revolute[joint] else "m"
    place = Place(time=time, joint=robot.joint_names[joint])
    return JudgedCondition(0.0 - float(gap[joint]), unit, place, coverage)
