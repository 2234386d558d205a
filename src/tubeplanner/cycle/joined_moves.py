"""The moves that the arm runs without stopping as one."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.cycle.steps import Move
from tubeplanner.errors import ProblemError
from tubeplanner.tube.tube import Tube

# Neighbouring tubes meet in a point [m], their tools turned the same way [of a quaternion].
_SAME_PLACE, _SAME_TURN = 1e-6, 1e-6
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
    if not first.ends_openly or getattr(first.goal, "tolerance", 0.0) > 0:
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
        if apart > _SAME_TURN:
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
