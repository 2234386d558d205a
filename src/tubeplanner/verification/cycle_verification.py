"""The judge of whole cycles: every leg by `verify`, and the seams between them."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tubeplanner.arguments import given_options
from tubeplanner.arrays import FloatArray
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.leg import Rest
from tubeplanner.cycle.steps import Event
from tubeplanner.errors import ProblemError, TrajectoryError, shown
from tubeplanner.outcome import Place
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.parts import part_of
from tubeplanner.verification.certificate import Certificate
from tubeplanner.verification.cycle_certificate import CycleCertificate
from tubeplanner.verification.judged_condition import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    Tolerance,
    not_required,
)
from tubeplanner.verification.verification import verify


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
