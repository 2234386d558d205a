"""Changes of what stands around the arm: where obstacles are, and how near links may come."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.explanation.change import Change, Proposal, exact, figures, from_to
from tubeplanner.explanation.directions import AXES, along
from tubeplanner.explanation.question import Question
from tubeplanner.problem.clearance_fields import ClearanceFields

_FARTHEST = 1.0  # [m] that an obstacle is moved
_TENTH = 0.1  # [m]


def cell_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that keep obstacles out of the way."""
    yield from obstacle_changes(question)
    yield from _attached_changes(question)
    yield from clearance_changes(question, -1)


def obstacle_changes(question: Question) -> Iterator[Change]:
    """Yield the moves of each obstacle along the axes of the base frame."""
    for obstacle in question.fields.obstacles:
        about = frozenset({f"obstacle {obstacle.name}"})
        path = f"obstacles.{obstacle.name}.position"
        yield from _moves("obstacle", obstacle.name, path, obstacle.position, about)


def _attached_changes(question: Question) -> Iterator[Change]:
    """Yield the moves of each solid that the tool carries along the axes of its frame."""
    for solid in question.fields.robot.attached:
        about = frozenset({f"link {solid.name}"})
        path = f"robot.attached.{solid.name}.position"
        yield from _moves("attached", solid.name, path, solid.position, about)


def _moves(
    kind: str, solid: str, path: str, position: Sequence[float], about: frozenset[str]
) -> Iterator[Change]:
    for name, direction in AXES:
        yield Change(
            kind=kind,
            field=path,
            before=list(position),
            unit="m",
            scale=_TENTH,
            most=_FARTHEST,
            propose=partial(_moved, kind, solid, path, np.array(position), name, direction),
            about=about,
        )


def _moved(
    kind: str,
    solid: str,
    path: str,
    position: FloatArray,
    name: str,
    way: FloatArray,
    size: float,
) -> Proposal:
    after = along(position, way, size)
    frame = " of the tool frame" if kind == "attached" else ""
    what = "attached solid" if kind == "attached" else kind
    text = f"move {what} '{solid}' by {figures(size, 'm')} {name}{frame}"
    return Proposal({path: after}, after, text, figures(size, "m"))


def clearance_changes(question: Question, way: int) -> Iterator[Change]:
    """Yield the changes of each clearance, more or (-1) less."""
    for path, name, before, about in _clearances(question):
        if way > 0 or before > 0:
            yield Change(
                kind="clearance",
                field=path,
                before=before,
                unit="m",
                scale=before or _TENTH,
                most=_FARTHEST if way > 0 else before,
                propose=partial(_clearance, path, name, before, way),
                about=about,
                is_loss=way < 0,
            )


def _clearances(question: Question) -> Iterator[tuple[str, str, float, frozenset[str]]]:
    """Yield path, name and value of each clearance, and what it is about."""
    given = question.fields.clearance
    if not isinstance(given, ClearanceFields):
        yield "clearance", "clearance", given, frozenset()
        return
    yield "clearance.default", "clearance", given.default, frozenset()
    for k, pair in enumerate(given.pairs):
        about = frozenset(f"{kind} {name}" for kind in ("link", "obstacle") for name in pair.links)
        name = f"clearance of {pair.links[0]} and {pair.links[1]}"
        yield f"clearance.pairs.{k}.clearance", name, pair.clearance, about
    for k, value in enumerate(given.segments or []):
        if value is not None:
            about = frozenset({f"segment {k}"})
            yield f"clearance.segments.{k}", f"clearance of segment {k}", value, about


def _clearance(path: str, name: str, before: float, way: int, size: float) -> Proposal:
    after = max(exact(before + way * size), 0.0)  # sizes are rounded
    changes: Mapping[str, Any] = {path: after}
    text = f"{name} {from_to(before, after, 'm')}"
    return Proposal(changes, after, text, figures(after, "m"))
