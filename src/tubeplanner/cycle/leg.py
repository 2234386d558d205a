"""What the arm moves without stopping: a move, and those after it that pass through."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.cycle.joined_moves import joined_moves
from tubeplanner.cycle.open_ends import ending_for
from tubeplanner.cycle.steps import Attach, Detach, Event, Move, Step
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Place
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.robot.robot_model import RobotModel

RestStep: TypeAlias = Event | Attach | Detach


@dataclass(frozen=True, eq=False)
class Rest:
    """What happens while the arm is at rest: at a seam, between legs.

    Attributes:
        steps: What happens, in order.
        arms: The arm with what it carries, before all steps and after each.
    """

    steps: tuple[RestStep, ...]
    arms: tuple[RobotModel, ...]

    @property
    def handed_over(self) -> tuple[str, ...]:
        """Names of what is taken or let go."""
        return tuple(step.name for step in self.steps if not isinstance(step, Event))


@dataclass(frozen=True, eq=False)
class Leg:
    """What the arm moves without stopping.

    Attributes:
        moves: At least one; all but the first pass through.
        before: The rest before it, after the leg before.
        joined: All of them as one move, over the segments of all.
        robot: The arm with what it carries.
    """

    moves: tuple[Move, ...]
    before: Rest
    joined: Move
    robot: RobotModel

    @property
    def name(self) -> str:
        """What messages call it: its moves."""
        return ", ".join(move.name for move in self.moves)

    @property
    def first_segments(self) -> tuple[int, ...]:
        """The segment in which each move begins, of the joined tube as it was given."""
        counts = [int(move.tube.numbers[-1]) for move in self.moves]
        return tuple(int(first) for first in np.cumsum([0, *counts[:-1]]))

    def move_of(self, segment: int) -> tuple[Move, int]:
        """Return the move of a segment of the joined tube, and which one of its own it is."""
        k = int(np.searchsorted(self.first_segments, segment, side="right")) - 1
        return self.moves[k], segment - self.first_segments[k]

    def in_cycle(self, where: Place, begin: float) -> Place:
        """Return a place in the leg, whose times begin at one of the cycle [s], as one in that."""
        move, segment = self.name, where.segment
        if segment is not None:
            found, segment = self.move_of(segment)
            move = found.name
        time = None if where.time is None else begin + where.time
        return replace(where, time=time, move=move, segment=segment)


def legs_of(steps: Sequence[Step], *, closed: bool = False) -> tuple[tuple[Leg, ...], Rest]:
    """Return the legs that steps make, and the rest after the last.

    Args:
        steps: Of a cycle.
        closed: Whether the first follows the last.

    Raises:
        ProblemError: There is no move, one passes through where the arm rests, or moves do not
            join.
    """
    runs, rests = _runs(steps)
    if not runs:
        raise ProblemError("a cycle has at least one move; give one with a name and a tube")
    loads, legs = _Loads(), []
    for k, (run, at_rest) in enumerate(zip(runs, rests[:-1], strict=True)):
        rest, joined = loads.rest(at_rest, run[0]), joined_moves(run)
        after = runs[(k + 1) % len(runs)][0] if k + 1 < len(runs) or closed else None
        if after is not None:
            joined = ending_for(joined, after)
        legs.append(Leg(tuple(run), rest, joined, rest.arms[-1]))
    return tuple(legs), loads.rest(rests[-1], runs[-1][0])


def _runs(steps: Sequence[Step]) -> tuple[list[list[Move]], list[list[RestStep]]]:
    """Return the moves that run without a stop, together, and what is before, between and after."""
    runs: list[list[Move]] = []
    rests: list[list[RestStep]] = [[]]
    for k, step in enumerate(steps):
        if not isinstance(step, Move):
            rests[-1].append(step)
        elif not step.passes_through:
            runs.append([step])
            rests.append([])
        elif k == 0 or not isinstance(steps[k - 1], Move):
            what = "nothing" if k == 0 else f"{type(steps[k - 1]).__name__.lower()}, at rest,"
            raise ProblemError(
                f"move '{step.name}': pass_through: {what} comes before it, not a move; leave "
                "pass_through out"
            )
        else:
            runs[-1].append(step)
    return runs, rests


class _Loads:
    """What the robot carries, from step to step."""

    def __init__(self) -> None:
        self._payloads: dict[str, Payload | None] = {}
        # Arms that carry the same share what is computed of them once.
        self._arms: dict[tuple[RobotModel, tuple[Payload, ...]], RobotModel] = {}

    def rest(self, steps: Sequence[RestStep], move: Move) -> Rest:
        """Return a rest before, or after, a move; take and let go what it does."""
        arms = [self._carried_by(move)]
        for step in steps:
            self._change(step)
            arms.append(self._carried_by(move))
        return Rest(tuple(steps), tuple(arms))

    def _change(self, step: RestStep) -> None:
        if isinstance(step, Attach):
            self._payloads[step.name] = step.payload
        elif isinstance(step, Detach):
            self._payloads.pop(step.name, None)

    def _carried_by(self, move: Move) -> RobotModel:
        """Return a move's arm with what it carries now."""
        loads = tuple(load for load in self._payloads.values() if load is not None)
        if not loads:
            return move.robot
        key = (move.robot, loads)
        if key not in self._arms:
            total = loads[0] if move.robot.payload is None else move.robot.payload.plus(loads[0])
            for load in loads[1:]:
                total = total.plus(load)
            self._arms[key] = move.robot.with_payload(total)
        return self._arms[key]
