"""The outside judge of whole cycles: every leg as a problem of its own, and what is between."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from outside.arm import Arm
from outside.cell import Cell
from outside.changing_hands import with_usual_contacts
from outside.cycle import Cycle, Step, read_cycle
from outside.files import BadInput
from outside.judge import Judge
from outside.leg_problem import leg_problem, robot_of
from outside.marks import read_times
from outside.parts import part_of
from outside.seams import judge_dwell, judge_hold, judge_return, judge_stay
from outside.trajectory import Trajectory, read_trajectory
from outside.verdict import Condition

HANDING = ("attach", "detach")


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
            seam = f"{names[k]} - {names[k + 1]}"
            yield from _called(seam, self._seam(k, rest))
            if k < len(legs):
                judged = self._leg(k, {step.name for step in rest if step.kind in HANDING})
                yield from _called(legs[k].name, judged)
        if self._cycle.header.get("closed", False):
            ends = self._begins[0], self._ends[-1]
            closing = judge_return(self._arm(0), *ends, self._times.legs[-1][1])
            yield from _called("closed", {"continuity": closing})

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
        begin, end = self._times.seam(k, self._motion.duration)
        stop, start = self._ends[:k][-1:], self._begins[k : k + 1]
        q = (start or stop)[0]
        leg = min(k, len(self._cycle.legs) - 1)
        arms = [self._arm(leg)]
        for step in rest:
            self._cell = self._cell.after(step, arms[0], q)
            arms.append(self._arm(leg))
        stay = part_of(self._motion, begin, end) if begin < end else None
        return {
            "continuity": judge_stay(arms[0], stop, stay, start, begin),
            "dwell": judge_dwell(rest, self._times.rests[k]),
            "effort": judge_hold(arms, q, end),
        }

    def _arm(self, k: int) -> Arm:
        """Return the arm of a leg with what the cell now says that it carries."""
        robot = robot_of(self._cycle, self._cycle.legs[k], self._cell)
        key = json.dumps(robot, sort_keys=True)
        if key not in self._arms:
            leg = leg_problem(self._cycle, self._cycle.legs[k], self._cell, {})
            self._arms[key] = Arm(replace(leg, robot=robot))
        return self._arms[key]


def _called(part: str, found: dict[str, Condition]) -> Iterator[tuple[str, Condition]]:
    """Yield the conditions of a part of a cycle that are asked, the part before their names."""
    for name, each in found.items():
        if each.margin is not None:
            yield f"{part}: {name}", each
