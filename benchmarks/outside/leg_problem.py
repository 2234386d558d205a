"""A leg of a cycle as a problem of its own, in the cell as it is then."""

from typing import Any

import numpy as np

from outside.cell import Cell
from outside.cycle import Cycle, Leg
from outside.files import BadInput
from outside.joined_tubes import count_of, joined_tubes
from outside.problem import Problem, problem_of, with_points


def leg_problem(cycle: Cycle, leg: Leg, cell: Cell, start: dict[str, Any]) -> Problem:
    """Return what a leg asks that begins at `start`, fields of a problem's section.

    Raises:
        BadInput: A field is not known here, or moves without a stop differ in what is asked once.
    """
    tubes = [with_points(move["tube"], cycle.folder) for move in leg.moves]
    fields = {
        "robot": robot_of(cycle, leg, cell) | {"attached": cell.attached},
        "tube": joined_tubes(tubes, cycle.folder),
        "start": start,
        "goal": leg.moves[-1].get("goal"),
        "obstacles": cell.obstacles,
        "clearance": _clearance(cycle, leg, cell, [count_of(tube) for tube in tubes]),
        "collision": _collision(cycle, leg, cell),
        "contacts": _contacts(cycle, leg, cell, [count_of(tube) for tube in tubes]),
    }
    return problem_of(fields, cycle.folder)


def robot_of(cycle: Cycle, leg: Leg, cell: Cell) -> dict[str, Any]:
    """Return the section `robot` of a leg, with its limits and what it carries."""
    robot = cycle.header["robot"]
    limits = merged(robot.get("limits") or {}, leg.moves[0].get("limits") or {})
    return robot | {"limits": limits, "payload": cell.payload, "attached": []}


def merged(below: Any, above: Any) -> Any:
    """Return maps merged key by key, all else as it is above."""
    if not (isinstance(below, dict) and isinstance(above, dict)):
        return above
    shared = {key: merged(below[key], above[key]) for key in below.keys() & above.keys()}
    return below | above | shared


def _clearance(cycle: Cycle, leg: Leg, cell: Cell, counts: list[int]) -> dict[str, Any]:
    segments: list[float] = []
    pairs: list[list[Any]] = []
    for move, count in zip(leg.moves, counts, strict=True):
        asked = cycle.header.get("clearance", 0.0)
        if move.get("clearance") is not None:
            asked = merged(asked, move["clearance"])
        asked = asked if isinstance(asked, dict) else {"default": asked}
        if unknown := set(asked) - {"default", "pairs", "segments"}:
            raise BadInput(f"clearance.{unknown.pop()} is not known here, so it cannot be judged")
        own = asked.get("segments") or [None] * count
        if len(own) != count:
            raise BadInput(f"clearance.segments has {len(own)} entries for {count} segments")
        segments += [asked.get("default", 0.0) if value is None else value for value in own]
        pairs.append(asked.get("pairs") or [])
    if any(each != pairs[0] for each in pairs):
        raise BadInput(f"'{leg.name}' passes through, and its clearance.pairs differ")
    there = [pair for pair in pairs[0] if _is_there(cycle, cell, pair["links"])]
    return {"segments": segments, "pairs": there}


def _collision(cycle: Cycle, leg: Leg, cell: Cell) -> dict[str, Any]:
    given = cycle.header.get("collision") or {}
    own = leg.moves[0].get("collision") or {}
    pairs = [*(given.get("ignore") or []), *(own.get("ignore") or [])]
    return given | {"ignore": [pair for pair in pairs if _is_there(cycle, cell, pair)]}


def _contacts(cycle: Cycle, leg: Leg, cell: Cell, counts: list[int]) -> list[dict[str, Any]]:
    """Return the contacts of where the first move begins and of where the last one ends."""
    if len(leg.moves) == 1:
        given = leg.moves[0].get("contacts") or []
    else:
        last = sum(counts) - 1
        given = [
            *_at_end(leg.moves[0].get("contacts") or [], 0, counts[0] - 1, 0),
            *_at_end(leg.moves[-1].get("contacts") or [], counts[-1] - 1, 0, last),
        ]
    return [contact for contact in given if _is_there(cycle, cell, contact["links"])]


def _at_end(
    contacts: list[dict[str, Any]], wanted: int, other: int, segment: int
) -> list[dict[str, Any]]:
    """Return contacts of one end of a move, as of a segment of the joined tube.

    Args:
        contacts: Of the move.
        wanted: Its segment at that end.
        other: Its segment at the other end.
        segment: What the joined tube calls the wanted one.
    """
    last = max(wanted, other)
    found = []
    for contact in contacts:
        chosen = contact.get("segments") or [wanted]
        if wanted in [last if k == -1 else k for k in chosen]:
            found.append(contact | {"segments": [segment]})
    return found


def _is_there(cycle: Cycle, cell: Cell, names: Any) -> bool:
    """Return whether those of some names that come and go are in the cell."""
    comes_and_goes = {step.name for step in cycle.steps if step.kind == "attach"}
    return all(name in cell.names for name in np.ravel(names) if name in comes_and_goes)
