"""The outside judge of a cycle: its legs as problems of their own, and the seams between them."""

import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from outside.arm import Arm
from outside.conditions import RELATIVE, Condition
from outside.cycle import Cell, Cycle, Step, leg_problem, read_cycle, read_times, robot_of
from outside.distances import Pair, Poses, owners_of, signed_distance
from outside.files import BadInput
from outside.holding import judge_holding, read_holding
from outside.judge import Judge
from outside.problem import Contact, Problem
from outside.trajectory import Trajectory, part_of, read_trajectory

HANDING = ("attach", "detach")
SAMPLES = 200
WITHIN = 0.03  # [m]


def judge_cycle(path: Path, trajectory: Path) -> dict[str, Condition]:
    """Return what is asked of a cycle's motion, by leg or seam and condition, as `to_pick: tube`.

    Raises:
        BadInput: A file cannot be judged.
    """
    cycle, motion = read_cycle(path), read_trajectory(trajectory)
    try:
        return dict(_CycleJudge(cycle, motion, trajectory).conditions())
    except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        raise BadInput(f"{path}: {type(error).__name__}: {error}") from error


def judge_stay(
    arm: Arm, stop: list[np.ndarray], rest: Trajectory | None, start: list[np.ndarray], time: float
) -> Condition:
    """Return how far joints move at a seam, where they must not.

    Args:
        arm: The arm.
        stop: Where the leg before ends, shape (n,); nothing if there is none.
        rest: What the motion does there; None: it does not rest.
        start: Where the leg after begins; nothing if there is none.
        time: When the seam begins [s].
    """
    places = [*stop, *([] if rest is None else rest.at(rest.samples(SAMPLES))), *start]
    if len(places) < 2:
        return Condition(None, "rad")
    moved = abs(np.array(places) - places[0]).max(axis=0)
    return _of_joints(arm, -moved, time)


def judge_dwell(rest: list[Step], times: list[tuple[float, float]]) -> Condition:
    """Return how much longer than asked the arm rests for the events at a seam."""
    spare = [
        (end - begin - step.dwell, begin)
        for step, (begin, end) in zip(rest, times, strict=True)
        if step.dwell > 0
    ]
    margin, begin = min(spare, default=(None, None))
    return Condition(margin, "s", begin)


def judge_hold(arms: list[Arm], q: np.ndarray, time: float) -> Condition:
    """Return what motors have left that hold the arm in a configuration (n,), with every load.

    Of their efforts, and of torque-speed lines where these begin.
    """
    margin, where = math.inf, ""
    for arm in arms:
        still = np.zeros((1, len(q)))
        efforts = arm.efforts(q[None], still, still)[0]
        for j, limit in enumerate(arm.limits.by_place):
            allowed = float(limit.allowed(q[j : j + 1], 1 if efforts[j] > 0 else -1)[0])
            allowed = min(allowed, float(arm.motors.stall[j]))
            own = 1 - abs(efforts[j]) / allowed
            if own < margin and math.isfinite(allowed):
                margin, where = own, f"joint {arm.joint_names[j]}"
    if not where:
        return Condition(None, RELATIVE)
    return Condition(float(margin), RELATIVE, time, where)


def judge_return(arm: Arm, first: np.ndarray, last: np.ndarray, time: float) -> Condition:
    """Return how far from where it began the arm ends."""
    return _of_joints(arm, -abs(last - first), time)


def with_usual_contacts(
    judge: Judge, start: np.ndarray, goal: np.ndarray, taken: set[str], given: set[str]
) -> Problem:
    """Return a leg's problem with the contacts of what changes hands where it begins and ends.

    Args:
        judge: Of the leg.
        start: Configuration in which it begins, shape (n,).
        goal: In which it ends.
        taken: Names of what changed hands before it.
        given: Names of what changes hands after it.
    """
    problem = judge.problem
    contacts = problem.distances.contacts
    at_start = {contact.links for contact in contacts if contact.at_start}
    at_goal = {contact.links for contact in contacts if contact.at_goal}
    is_open = not {"joints", "seed", "pose"} & set(problem.goal)
    ending = _of_tool(judge, given) if is_open else _near(judge, given, goal)
    usual = [
        *(Contact(pair, WITHIN, True, False) for pair in _near(judge, taken, start) - at_start),
        *(Contact(pair, WITHIN, False, True) for pair in ending - at_goal),
    ]
    return replace(problem, distances=replace(problem.distances, contacts=[*contacts, *usual]))


class _CycleJudge:
    """Judges one motion of one cycle, leg by leg, as the cell changes."""

    def __init__(self, cycle: Cycle, motion: Trajectory, path: Path) -> None:
        self._cycle = cycle
        self._robot = cycle.header["robot"]
        self._arms: dict[str, Arm] = {}
        self._cell = Cell.of(cycle)
        motion = motion.ordered(self._arm(0).joint_names)
        self._motion, self._times = motion, read_times(path, cycle, motion.duration)
        self._parts = [part_of(motion, *span) for span in self._times.legs]
        ends = [part.at(part.samples(2))[[0, -1]] for part in self._parts]
        self._begins, self._ends = ([end[k] for end in ends] for k in (0, 1))

    def conditions(self) -> Iterator[tuple[str, Condition]]:
        """Yield all conditions that are asked, after what they are called."""
        legs = self._cycle.legs
        names = ["start", *(leg.name for leg in legs), "end"]
        for k, rest in enumerate(self._cycle.rests):
            junction = f"{names[k]} - {names[k + 1]}"
            yield from _label(junction, self._seam(k, rest))
            if k < len(legs):
                judged = self._leg(k, {step.name for step in rest if step.kind in HANDING})
                yield from _label(legs[k].name, judged)
        if self._cycle.header.get("closed", False):
            ends = self._begins[0], self._ends[-1]
            closing = judge_return(self._arm(0), *ends, self._times.legs[-1][1])
            yield from _label("closed", {"continuity": closing})

    def _leg(self, k: int, changed: set[str]) -> dict[str, Condition]:
        leg, begin = self._cycle.legs[k], self._times.legs[k][0]
        start = self._cycle.header["start"]
        if k > 0:
            start = {"joints": self._begins[k].tolist()}
        judge = Judge(leg_problem(self._cycle, leg, self._cell, start))
        after = {step.name for step in self._cycle.rests[k + 1] if step.kind in HANDING}
        ends = self._begins[k], self._ends[k]
        judge.problem = with_usual_contacts(judge, *ends, changed, after)
        found = judge.judge(self._parts[k])
        return {
            name: each if each.time is None else replace(each, time=each.time + begin)
            for name, each in found.items()
        }

    def _seam(self, k: int, rest: list[Step]) -> dict[str, Condition]:
        """Return the conditions of a seam, and leave the cell as its steps do."""
        begin, end = self._times.junction(k, self._motion.duration)
        stop, start = self._ends[:k][-1:], self._begins[k : k + 1]
        q = (start or stop)[0]
        leg = min(k, len(self._cycle.legs) - 1)
        arms, holding = [self._arm(leg)], [*self._cell.holding]
        for step in rest:
            self._cell = self._cell.after(step, arms[0], q)
            arms.append(self._arm(leg))
            holding += self._cell.holding
        stay = part_of(self._motion, begin, end) if begin < end else None
        return {
            "continuity": judge_stay(arms[0], stop, stay, start, begin),
            "dwell": judge_dwell(rest, self._times.rests[k]),
            "effort": judge_hold(arms, q, end),
            "holding": self._held(holding, q, end),
        }

    def _held(self, holding: list[dict[str, Any]], q: np.ndarray, time: float) -> Condition:
        """Return what contacts have left at rest in a configuration (n,)."""
        still = Trajectory(self._arm(0).joint_names, np.array([0.0, 1.0]), q[None, None])
        found = judge_holding(read_holding(holding), self._arm(0), still, still.samples(2))
        return found if found.time is None else replace(found, time=time)

    def _arm(self, k: int) -> Arm:
        """Return the arm of a leg with what the cell now says that it carries."""
        robot = robot_of(self._cycle, self._cycle.legs[k], self._cell)
        key = json.dumps(robot, sort_keys=True)
        if key not in self._arms:
            leg = leg_problem(self._cycle, self._cycle.legs[k], self._cell, {})
            self._arms[key] = Arm(replace(leg, robot=robot))
        return self._arms[key]


def _label(part: str, found: dict[str, Condition]) -> Iterator[tuple[str, Condition]]:
    """Yield the conditions of a part of a cycle that are asked, the part before their names."""
    for name, each in found.items():
        if each.margin is not None:
            yield f"{part}: {name}", each


def _of_joints(arm: Arm, margins: np.ndarray, time: float) -> Condition:
    joint = int(margins.argmin())
    unit = "m" if arm.slides[joint] else "rad"
    return Condition(float(margins[joint]), unit, time, f"joint {arm.joint_names[joint]}")


def _near(judge: Judge, names: set[str], q: np.ndarray) -> set[frozenset[str]]:
    """Return the pairs of some names that are nearer than any segment asks."""
    distances = judge.problem.distances
    everywhere = float(distances.segments.max())
    poses = Poses(*judge.arm.poses(q[None]))
    found = set()
    for pair in _with_names(judge, names):
        asked = distances.pairs.get(owners_of(pair), everywhere)
        if signed_distance(pair, poses, 0) < asked:
            found.add(owners_of(pair))
    return found


def _of_tool(judge: Judge, names: set[str]) -> set[frozenset[str]]:
    """Return the pairs of some names that are of what moves with the tool."""
    joint = judge.arm.tool_joint
    return {owners_of(pair) for pair in _with_names(judge, names) if pair[0].joint == joint}


def _with_names(judge: Judge, names: set[str]) -> list[Pair]:
    pairs = judge.clearance.obstacle_pairs
    return [pair for pair in pairs if owners_of(pair) & names]
