"""What becomes of a cycle's promises when it is executed: seen in n runs, not proved."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.short_repr import short_repr
from tubeplanner.simulation.executed_legs import ExecutedLeg, executed_legs
from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.simulation.execution import Execution
from tubeplanner.simulation.handover_errors import HandoverErrors, handover_errors
from tubeplanner.simulation.judged_runs import JudgedRun, judged_runs

_LARGEST = ("tube", "rotation", "points", "tracking", "tool_tracking", "position", "velocity")


@dataclass(frozen=True, eq=False)
class JudgedCycle:
    """The executed motions of a cycle, at every control period.

    Attributes:
        legs: Every run of each leg, by the names of its moves; times and places in the cycle.
        runs: Every run of the whole.
        handovers: Where the tools are when something changes hands.
    """

    legs: dict[tuple[str, ...], list[JudgedRun]]
    runs: list[JudgedRun]
    handovers: list[HandoverErrors]

    __repr__ = short_repr


def judged_cycle(
    motion: CycleMotion, execution: Execution, checkpoint: Callable[[], None] = lambda: None
) -> JudgedCycle:
    """Judge the executed motions of a cycle.

    Every leg is judged as the motion of its planning problem, as `executed_legs` cuts it out. Of
    the whole, a run has the worst of all its legs; motors count from first to last.

    Args:
        motion: What was to be executed.
        execution: What was.
        checkpoint: Called before every run of every leg; may raise to end the work.

    Raises:
        ProblemError: A leg begins or ends where its problem has no place.
    """
    legs = {
        tuple(move.name for move in each.leg.moves): _judged(each, checkpoint)
        for each in executed_legs(motion, execution)
    }
    saturated = execution.is_saturated.any(axis=2).mean(axis=1)
    runs = [
        replace(_whole(run), saturated=float(share))
        for run, share in zip(zip(*legs.values(), strict=True), saturated, strict=True)
    ]
    return JudgedCycle(legs, runs, list(handover_errors(motion, execution)))


def _judged(leg: ExecutedLeg, checkpoint: Callable[[], None]) -> list[JudgedRun]:
    """Return the runs of a leg, their times and places those of the cycle."""
    runs = judged_runs(leg.problem, leg.trajectory, leg.execution, checkpoint)
    return [_in_cycle(run, leg) for run in runs]


def _in_cycle(run: JudgedRun, leg: ExecutedLeg) -> JudgedRun:
    placed: dict[str, Any] = {
        name: replace(found, place=leg.leg.in_cycle(found.place, leg.begin))
        for name, found in vars(run).items()
        if isinstance(found, Extreme)
    }
    return replace(run, **placed)


def _whole(legs: Sequence[JudgedRun]) -> JudgedRun:
    """Return a run of the whole: of every quantity the worst of all legs."""
    worst: dict[str, Any] = {name: _most(legs, name) for name in _LARGEST}
    # The distance that is least beside what its own move asks.
    near = [leg for leg in legs if leg.obstacles is not None]
    nearest = min(near, key=_spare, default=legs[0])
    folded = [leg.self_collision for leg in legs if leg.self_collision is not None]
    return replace(
        legs[0],
        **worst,
        obstacles=nearest.obstacles,
        clearance=nearest.clearance,
        self_collision=min(folded, key=lambda found: found.value, default=None),
        tube_by_segment=np.concatenate([leg.tube_by_segment for leg in legs]),
        rotation_by_segment=np.concatenate([leg.rotation_by_segment for leg in legs]),
        position_by_joint=np.max([leg.position_by_joint for leg in legs], axis=0),
    )


def _most(legs: Sequence[JudgedRun], name: str) -> Extreme | None:
    """Return the largest of a quantity of all legs; None where none is asked it."""
    found = [getattr(leg, name) for leg in legs]
    return max(
        (extreme for extreme in found if extreme is not None),
        key=lambda extreme: extreme.value,
        default=None,
    )


def _spare(leg: JudgedRun) -> float:
    assert leg.obstacles is not None
    return leg.obstacles.value - leg.clearance
