"""What a problem file asks of distances between solids, and which may touch at its ends."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from outside.files import BadInput

CLEARANCE = {"default", "pairs", "segments"}
PAIR = {"links", "clearance"}
CONTACT = {"links", "segments", "within"}


@dataclass(frozen=True)
class Contact:
    """Two solids that may be nearer than their clearance while the tool is near an end.

    Attributes:
        links: Their names.
        within: How far the tool may be from where it is at that end [m].
        at_start: Whether the end may be the start.
        at_goal: Whether it may be the goal.
    """

    links: frozenset[str]
    within: float
    at_start: bool
    at_goal: bool


@dataclass(frozen=True, eq=False)
class Distances:
    """What is asked of distances.

    Attributes:
        segments: Of links from obstacles in each segment, shape (m,) [m].
        pairs: Of single pairs, by their names, instead of it [m].
        contacts: Who may be nearer at an end.
    """

    segments: np.ndarray
    pairs: dict[frozenset[str], float]
    contacts: list[Contact]


def read_distances(clearance: Any, contacts: Any, count: int) -> Distances:
    """Return what the fields `clearance` and `contacts` ask of a tube of so many segments.

    Raises:
        BadInput: They are not what they must be.
    """
    fields = clearance if isinstance(clearance, dict) else {"default": clearance}
    _require_known(fields, CLEARANCE, "clearance")
    default = float(fields.get("default", 0.0))
    segments = fields.get("segments") or [None] * count
    if len(segments) != count:
        raise BadInput(f"clearance.segments has {len(segments)} entries for {count} segments")
    pairs = {}
    for row in fields.get("pairs") or []:
        _require_known(row, PAIR, "clearance.pairs")
        pairs[_names(row["links"])] = float(row["clearance"])
    each = [default if value is None else float(value) for value in segments]
    return Distances(np.array(each), pairs, [_contact(row, count) for row in contacts or []])


def _contact(fields: Any, count: int) -> Contact:
    _require_known(fields, CONTACT, "contacts")
    given = fields.get("segments")
    chosen = {0, count - 1} if given is None else {count - 1 if k == -1 else k for k in given}
    if not chosen <= {0, count - 1}:
        raise BadInput(f"contacts: segments {given} are neither the first nor the last")
    within = float(fields["within"])
    return Contact(_names(fields["links"]), within, 0 in chosen, count - 1 in chosen)


def _names(links: Any) -> frozenset[str]:
    first, second = links
    return frozenset((str(first), str(second)))


def _require_known(fields: Any, known: set[str], where: str) -> None:
    if unknown := set(fields) - known:
        raise BadInput(f"{where}.{unknown.pop()} is not known here, so it cannot be judged")
