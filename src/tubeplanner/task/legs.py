"""Leg: moves without a stop between them; open ends, rests and their labels."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError, shown
from tubeplanner.geometry.tube.points import SEGMENT_NUMBERS
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import Location
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Holding
from tubeplanner.task.steps import Attach, Detach, Event, Move, Step

StopStep: TypeAlias = Event | Attach | Detach


@dataclass(frozen=True, eq=False)
class Stop:
    """Steps while the arm is at rest at a junction, between legs."""

    steps: tuple[StopStep, ...]  # events, attaching and detaching, in order
    # the arm with its payload, before the first step and after each step
    arms: tuple[RobotModel, ...]
    # what holds attached objects at these times
    holdings: tuple[tuple[Holding, ...], ...]

    @property
    def duration(self) -> float:
        """Sum of the dwells of events [s]."""
        return sum(step.dwell for step in self.steps if isinstance(step, Event))

    @property
    def handed_over(self) -> tuple[str, ...]:
        """Names of the objects that are attached or detached."""
        return tuple(step.name for step in self.steps if not isinstance(step, Event))


@dataclass(frozen=True, eq=False)
class Leg:
    """Run of moves without a stop."""

    moves: tuple[Move, ...]  # at least one; all but the first pass through
    before: Stop  # the rest before the leg
    joined: Move  # all moves as one move, over all their segments
    robot: RobotModel  # the arm with its payload in this leg

    @property
    def holding(self) -> tuple[Holding, ...]:
        """What holds attached objects and the parts of its moves."""
        return (*self.before.holdings[-1], *self.joined.holding)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its moves."""
        return tuple(move.name for move in self.moves)

    @property
    def name(self) -> str:
        """Names of its moves, for messages."""
        return ", ".join(self.names)

    @property
    def first_segments(self) -> tuple[int, ...]:
        """Number of the first segment of each move in the joined tube."""
        counts = [int(move.tube.numbers[-1]) for move in self.moves]
        return tuple(int(first) for first in np.cumsum([0, *counts[:-1]]))

    def move_of(self, segment: int) -> tuple[Move, int]:
        """Return the move of a segment of the joined tube, and the segment's number in the move."""
        k = int(np.searchsorted(self.first_segments, segment, side="right")) - 1
        return self.moves[k], segment - self.first_segments[k]

    def segments_of_move(self, first: int, last: int | None) -> tuple[Move, int, int]:
        """Return the move of joined segments, and their first and last number in the move."""
        move, number = self.move_of(first)
        end = number if last is None else number + last - first
        return move, number, min(end, int(move.tube.numbers[-1]) - 1)

    def in_cycle(self, where: Location, begin: float) -> Location:
        """Return a place in the leg, which begins at a time [s], as a place in the cycle."""
        name, segment = self.name, where.segment
        if segment is not None:
            move, segment = self.move_of(segment)
            name = move.name
        time = None if where.time is None else begin + where.time
        return replace(where, time=time, move=name, segment=segment)


def legs_of(steps: Sequence[Step], *, closed: bool = False) -> tuple[tuple[Leg, ...], Stop]:
    """Return the legs of steps, and the rest after the last leg, which the first leg may follow.

    Raises:
        ProblemError: There is no move, a move passes through where the arm rests, or moves do not
            join.
    """
    runs, stops = _runs(steps)
    if not runs:
        raise ProblemError("a cycle has at least one move; give one with a name and a tube")
    loads, legs = _Loads(), []
    for k, (run, stop_steps) in enumerate(zip(runs, stops[:-1], strict=True)):
        stop, joined = loads.stop(stop_steps, run[0]), joined_moves(run)
        after = runs[(k + 1) % len(runs)][0] if k + 1 < len(runs) or closed else None
        if after is not None:
            joined = ending_for(joined, after)
        legs.append(Leg(tuple(run), stop, joined, stop.arms[-1]))
    return tuple(legs), loads.stop(stops[-1], runs[-1][0])


def _runs(steps: Sequence[Step]) -> tuple[list[list[Move]], list[list[StopStep]]]:
    """Return the runs of moves without a stop, and the steps before, between and after runs."""
    runs: list[list[Move]] = []
    stops: list[list[StopStep]] = [[]]
    for k, step in enumerate(steps):
        if not isinstance(step, Move):
            stops[-1].append(step)
        elif not step.passes_through:
            runs.append([step])
            stops.append([])
        elif k == 0 or not isinstance(steps[k - 1], Move):
            before = "nothing" if k == 0 else f"{type(steps[k - 1]).__name__.lower()}, at rest,"
            raise ProblemError(
                f"move '{step.name}': pass_through: {before} comes before it, not a move; leave "
                "pass_through out"
            )
        else:
            runs[-1].append(step)
    return runs, stops


class _Loads:
    """Payloads of the robot, and what holds them, from step to step."""

    def __init__(self) -> None:
        self._attached: dict[str, Attach] = {}
        # One arm per payload: arms keep computed values.
        self._arms: dict[tuple[RobotModel, tuple[Payload, ...]], RobotModel] = {}

    def stop(self, steps: Sequence[StopStep], move: Move) -> Stop:
        """Apply the steps of a rest before, or after, a move, and return the rest."""
        arms, holdings = [self._loaded_arm(move)], [self._holding()]
        for step in steps:
            if isinstance(step, Attach):
                self._attached[step.name] = step
            elif isinstance(step, Detach):
                self._attached.pop(step.name, None)
            arms.append(self._loaded_arm(move))
            holdings.append(self._holding())
        return Stop(tuple(steps), tuple(arms), tuple(holdings))

    def _holding(self) -> tuple[Holding, ...]:
        return tuple(holding for step in self._attached.values() for holding in step.holding)

    def _loaded_arm(self, move: Move) -> RobotModel:
        """Return a move's arm with its current payload."""
        each = (step.payload for step in self._attached.values())
        loads = tuple(load for load in each if load is not None)
        if not loads:
            return move.robot
        key = (move.robot, loads)
        if key not in self._arms:
            total = loads[0] if move.robot.payload is None else move.robot.payload.plus(loads[0])
            for load in loads[1:]:
                total = total.plus(load)
            self._arms[key] = move.robot.with_payload(total)
        return self._arms[key]


def stop_text(stop: Stop) -> str:
    """Return the text of a rest: "gripper 'close' (0.15 s), attach part"."""
    return ", ".join(map(step_text, stop.steps)) or "nothing"


def step_text(step: StopStep) -> str:
    """Return the text of a step of a rest: "attach part"."""
    if not isinstance(step, Event):
        return f"{type(step).__name__.lower()} {step.name}"
    setting = "" if step.setting is None else f" {shown(step.setting)}"
    return f"{step.name}{setting}" + (f" ({step.dwell:g} s)" if step.dwell else "")


# ---- Moves joined to one, and bounds of open ends.

# Neighbouring tubes meet up to these differences of points [m] and of quaternions.
_MAX_GAP, _MAX_ROTATION_GAP = 1e-6, 1e-6
_SAME_IN_TUBES = ("tool_radius", "visit", "pass_through_points", "process")


def joined_moves(moves: Sequence[Move]) -> Move:
    """Return a move over all segments of moves; all moves but the first pass through.

    Raises:
        ProblemError: The moves differ in a field that must be the same, or do not meet.
    """
    joined = moves[0]
    for move in moves[1:]:
        _require_joinable(joined, move)
        joined = replace(
            joined,
            tube=_joined_tube(joined, move),
            goal=move.goal,
            contacts=tuple(
                replace(contact, ends=(end,))
                for part, end in ((joined, "start"), (move, "goal"))
                for contact in part.contacts
                if end in contact.ends
            ),
        )
    return joined


def _require_joinable(first: Move, second: Move) -> None:
    here = f"move '{second.name}': pass_through"
    for move in (first, second):
        if move.tube.is_anywhere:
            raise ProblemError(
                f"{here}: move '{move.name}' has no tube, and so begins and ends at rest; leave "
                "pass_through out, or give it a tube"
            )
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
        "holding": first.holding == second.holding,
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
    if gap > _MAX_GAP:
        raise ProblemError(
            f"{here}: its tube begins {gap:.3g} m from where the tube before ends; give both the "
            "same point"
        )


def _joined_tube(first: Move, second: Move) -> Tube:
    tubes = (first.tube, second.tube)
    counts = [tube.segment_count for tube in tubes]
    sections = None
    if any(tube.cross_section is not None for tube in tubes):
        rows = [
            np.zeros((tube.segment_count, 5)) if tube.cross_section is None else tube.cross_section
            for tube in tubes
        ]
        sections = np.vstack(rows)
    by_segment: dict[str, Any] = {
        "radius": [radius for tube in tubes for radius in tube.radius],
        "joint_signs": [signs for tube in tubes for signs in tube.joint_signs],
        **{
            name: _filled([getattr(tube, name) for tube in tubes], counts)
            for name in SEGMENT_NUMBERS
        },
        "clearance": _clearances((first, second)),
        "cross_section": sections,
        # Segments keep their numbers, by which messages name them, although points are left out.
        "numbers": [*first.tube.numbers, *(first.tube.numbers[-1] + second.tube.numbers[1:])],
    }
    return Tube(
        np.vstack([first.tube.points, second.tube.points[1:]]),
        by_segment.pop("radius"),
        **by_segment,
        **_rotations(second.name, tubes, counts),
        events=[
            *first.tube.events,
            *(
                replace(each, segment=each.segment + int(first.tube.numbers[-1]))
                for each in second.tube.events
            ),
        ],
        **{name: getattr(first.tube, name) for name in _SAME_IN_TUBES},
    )


def _filled(values: Sequence[FloatArray | None], counts: Sequence[int]) -> list[float] | None:
    """Return the numbers of all segments, infinite for a missing row; None if all are missing."""
    if all(value is None for value in values):
        return None
    rows = [
        np.full(count, np.inf) if value is None else value
        for value, count in zip(values, counts, strict=True)
    ]
    return [float(number) for row in rows for number in row]


def _clearances(moves: Sequence[Move]) -> list[float] | None:
    """Return the clearance of every segment, or of its move; None: the first move's for all.

    The joined move has the clearance of the first.
    """
    has_none = all(move.tube.clearance is None for move in moves)
    if has_none and moves[0].clearance == moves[1].clearance:
        return None
    clearances = []
    for move in moves:
        own = _filled([move.tube.clearance], [move.tube.segment_count])
        own = own or [np.inf] * move.tube.segment_count
        clearances += [value if np.isfinite(value) else move.clearance for value in own]
    return clearances


def _rotations(name: str, tubes: Sequence[Tube], counts: Sequence[int]) -> dict[str, Any]:
    """Return orientations and rotation tolerances of two tubes; empty if neither has any.

    A tube without orientations gets those of the junction, with infinite tolerances.
    """
    first, second = (tube.orientations for tube in tubes)
    if first is None and second is None:
        return {}
    if first is None:
        assert second is not None
        first = np.tile(second[:1], (counts[0] + 1, 1))
    elif second is None:
        second = np.tile(first[-1:], (counts[1] + 1, 1))
    elif _quaternion_distance(first[-1], second[0]) > _MAX_ROTATION_GAP:
        raise ProblemError(
            f"move '{name}': pass_through: tube.orientations begins turned otherwise than the "
            "tube before ends; give both the same orientation"
        )
    free = [np.inf] * 3
    bounds: list[Any] = [
        bound
        for tube, count in zip(tubes, counts, strict=True)
        for bound in tube.rotation_tolerance or [free] * count
    ]
    return {
        "orientations": np.vstack([first, second[1:]]),
        "rotation_tolerance": [list(bound) if np.ndim(bound) else bound for bound in bounds],
    }


def ending_for(move: Move, after: Move) -> Move:
    """Return a move whose open end has the rotation bound at the start of the next move.

    Unchanged if both tubes have an orientation there and these differ.
    """
    orientations, bounds = after.tube.orientations, after.tube.rotation_tolerance
    tube, goal = move.tube, move.endpoint.region
    if goal is None or orientations is None or bounds is None or after.tube.rotation is None:
        return move
    if tube.orientations is None:
        free = ((np.inf, np.inf, np.inf),) * tube.segment_count
        constant = np.tile(orientations[:1], (len(tube.points), 1))
        tube = replace(tube, orientations=constant, rotation_tolerance=free)
    elif _quaternion_distance(tube.orientations[-1], orientations[0]) > _MAX_ROTATION_GAP:
        return move
    if goal.rotation_tolerance is None:
        goal = replace(goal, rotation_tolerance=bounds[0])
    return replace(move, tube=tube, goal=goal)


def _quaternion_distance(first: FloatArray, second: FloatArray) -> float:
    """Return the norm of the difference of two quaternions, q and -q being equivalent."""
    return min(float(np.linalg.norm(first - sign * second)) for sign in (1, -1))
