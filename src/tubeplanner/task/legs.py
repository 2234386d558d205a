"""Leg: moves without a stop between them; open ends, rests and their labels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError, shown
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import Place
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.steps import Attach, Detach, Event, Move, Step

# ---- What the beginning of a move asks of the one before, where that one's end is left open.

_SAME_TURN = 1e-6  # of quaternions


def ending_for(move: Move, after: Move) -> Move:
    """Return a move whose open end is turned as the next one must begin, if that is bounded.

    Where both tubes have an orientation there and these differ, it stays as it is.
    """
    turned, bounds = after.tube.orientations, after.tube.rotation_tolerance
    tube, goal = move.tube, move.endpoint.region
    if goal is None or turned is None or bounds is None or after.tube.rotation is None:
        return move
    if tube.orientations is None:
        free = ((np.inf, np.inf, np.inf),) * tube.segment_count
        everywhere = np.tile(turned[:1], (len(tube.points), 1))
        tube = replace(tube, orientations=everywhere, rotation_tolerance=free)
    elif min(np.linalg.norm(tube.orientations[-1] - s * turned[0]) for s in (1, -1)) > _SAME_TURN:
        return move
    if goal.rotation_tolerance is None:
        goal = replace(goal, rotation_tolerance=bounds[0])
    return replace(move, tube=tube, goal=goal)


# ---- The moves that the arm runs without stopping as one.

# Neighbouring tubes meet in a point [m], their tools turned the same way [of a quaternion].
_SAME_PLACE, _MAX_TURN = 1e-6, 1e-6
_SAME_IN_TUBES = ("tool_radius", "visit", "pass_through_points")


def joined_moves(moves: Sequence[Move]) -> Move:
    """Return moves of which all but the first pass through as one move over all segments.

    Raises:
        ProblemError: They differ in what must be the same all along, or do not meet.
    """
    joined = moves[0]
    for move in moves[1:]:
        _require_joinable(joined, move)
        joined = replace(
            joined,
            tube=_joined_tube(joined, move),
            goal=move.goal,
            contacts=_contacts(joined, move),
        )
    return joined


def _require_joinable(first: Move, second: Move) -> None:
    here = f"move '{second.name}': pass_through"
    region = first.endpoint.region
    if region is None or region.tolerance > 0:
        raise ProblemError(
            f"{here}: the move before it has a goal, where the arm would stop; leave its goal out"
        )
    pairs = {
        "limits": first.robot is second.robot,
        "objective": first.objective == second.objective,
        "collision.ignore": set(first.ignore_collisions) == set(second.ignore_collisions),
        "clearance.pairs": first.pair_clearances == second.pair_clearances,
    }
    for name in _SAME_IN_TUBES:
        pairs[f"tube.{name}"] = getattr(first.tube, name) == getattr(second.tube, name)
    for field, is_same in pairs.items():
        if not is_same:
            raise ProblemError(
                f"{here}: {field} differs from the move's before; it must be the same where the "
                "arm does not stop"
            )
    gap = float(np.linalg.norm(second.tube.points[0] - first.tube.points[-1]))
    if gap > _SAME_PLACE:
        raise ProblemError(
            f"{here}: its tube begins {gap:.3g} m from where the tube before ends; give both the "
            "same point"
        )


def _contacts(first: Move, second: Move) -> tuple[Any, ...]:
    """Return contacts of the first move's start and the second one's end."""
    kept = [(first, "start"), (second, "goal")]
    return tuple(
        replace(contact, ends=(end,))
        for move, end in kept
        for contact in move.contacts
        if end in contact.ends
    )


def _joined_tube(first: Move, second: Move) -> Tube:
    tubes = (first.tube, second.tube)
    counts = [tube.segment_count for tube in tubes]
    by_segment: dict[str, Any] = {
        "radius": [radius for tube in tubes for radius in tube.radius],
        "joint_signs": [signs for tube in tubes for signs in tube.joint_signs],
        "tool_speed": _filled([tube.tool_speed for tube in tubes], counts),
        "clearance": _clearances((first, second)),
        "cross_section": _sections(tubes),
        # Points that were left out keep their numbers, by which segments are told apart.
        "numbers": [*first.tube.numbers, *(first.tube.numbers[-1] + second.tube.numbers[1:])],
    }
    return Tube(
        np.vstack([first.tube.points, second.tube.points[1:]]),
        by_segment.pop("radius"),
        **by_segment,
        **_rotations(second.name, tubes, counts),
        **{name: getattr(first.tube, name) for name in _SAME_IN_TUBES},
    )


def _filled(values: Sequence[FloatArray | None], counts: Sequence[int]) -> list[float] | None:
    """Return numbers by segment of both, infinite where one has none; None if both have none."""
    if all(value is None for value in values):
        return None
    rows = [
        np.full(count, np.inf) if value is None else value
        for value, count in zip(values, counts, strict=True)
    ]
    return [float(number) for row in rows for number in row]


def _clearances(moves: Sequence[Move]) -> list[float] | None:
    """Return the clearance of every segment, that of its move where it has none; None: all alike.

    The first move's is that of what is joined.
    """
    has_none = all(move.tube.clearance is None for move in moves)
    if has_none and moves[0].clearance == moves[1].clearance:
        return None
    found = []
    for move in moves:
        own = _filled([move.tube.clearance], [move.tube.segment_count])
        own = own or [np.inf] * move.tube.segment_count
        found += [value if np.isfinite(value) else move.clearance for value in own]
    return found


def _sections(tubes: Sequence[Tube]) -> FloatArray | None:
    """Return the boxes of all segments; None if there are none."""
    if all(tube.cross_section is None for tube in tubes):
        return None
    rows = [
        np.zeros((tube.segment_count, 5)) if tube.cross_section is None else tube.cross_section
        for tube in tubes
    ]
    return np.vstack(rows)


def _rotations(name: str, tubes: Sequence[Tube], counts: Sequence[int]) -> dict[str, Any]:
    """Return orientations and rotation tolerances of both; where one has none it is free.

    A tool that is free is referred to as it is turned where it begins or ends to be bound.
    """
    first, second = (tube.orientations for tube in tubes)
    if first is None and second is None:
        return {}
    if first is not None and second is not None:
        apart = min(np.linalg.norm(first[-1] - s * second[0]) for s in (1, -1))
        if apart > _MAX_TURN:
            raise ProblemError(
                f"move '{name}': pass_through: tube.orientations begins turned otherwise than the "
                "tube before ends; give both the same orientation"
            )
    if first is None:
        assert second is not None
        first = np.tile(second[:1], (counts[0] + 1, 1))
    if second is None:
        second = np.tile(first[-1:], (counts[1] + 1, 1))
    free = [np.inf] * 3
    bounds = [
        bound
        for tube, count in zip(tubes, counts, strict=True)
        for bound in tube.rotation_tolerance or [free] * count
    ]
    return {
        "orientations": np.vstack([first, second[1:]]),
        "rotation_tolerance": [_as_given(bound) for bound in bounds],
    }


def _as_given(bound: Any) -> Any:
    return list(bound) if np.ndim(bound) else bound


# ---- What the arm moves without stopping: a move, and those after it that pass through.

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
    def duration(self) -> float:
        """How long it takes [s]: as long as events dwell."""
        return sum(step.dwell for step in self.steps if isinstance(step, Event))

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


# ---- What happens at rest, in words.


def rest_text(rest: Rest) -> str:
    """Return what happens in a rest, such as "gripper 'close' (0.15 s), attach part"."""
    return ", ".join(map(step_text, rest.steps)) or "nothing"


def step_text(step: RestStep) -> str:
    """Return what happens in one step of a rest, likewise."""
    if not isinstance(step, Event):
        return f"{type(step).__name__.lower()} {step.name}"
    setting = "" if step.setting is None else f" {shown(step.setting)}"
    return f"{step.name}{setting}" + (f" ({step.dwell:g} s)" if step.dwell else "")
