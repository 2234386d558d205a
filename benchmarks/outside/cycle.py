"""A cycle file as the outside judge reads it. What it does not know, it refuses by name."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from outside.files import BadInput
from outside.problem import SOLID, read_document, require_known

FORMAT = "tubeplanner/cycle"
TOP = {"format", "version", "robot", "start", "obstacles", "clearance", "collision"}
TOP |= {"closed", "moves", "objective"}  # of an objective nothing is asked
MOVE = {"name", "tube", "goal", "limits", "clearance", "contacts", "collision", "pass_through"}
MOVE |= {"objective"}
STEPS = {
    "move": MOVE,
    "event": {"event", "set", "dwell"},
    "attach": {"attach", "payload", "shape"},
    "detach": {"detach", "leave_as_obstacle"},
}


@dataclass(frozen=True)
class Step:
    """A step of a cycle.

    Attributes:
        kind: move, event, attach or detach.
        name: Of the move, the event or what changes hands.
        fields: What the file has.
    """

    kind: str
    name: str
    fields: dict[str, Any]

    @property
    def dwell(self) -> float:
        """How long the arm rests for it [s]."""
        return float(self.fields.get("dwell", 0.0))


@dataclass(frozen=True)
class Leg:
    """Moves without a stop.

    Attributes:
        moves: Their fields.
        before: What happens at rest before them.
        first: Which step of the cycle the first move is.
    """

    moves: list[dict[str, Any]]
    before: list[Step]
    first: int

    @property
    def name(self) -> str:
        """Its moves' names."""
        return ", ".join(str(move["name"]) for move in self.moves)


@dataclass(frozen=True)
class Cycle:
    """A cycle file.

    Attributes:
        folder: Where its relative paths start.
        header: What the file has beside its moves.
        steps: All of them.
        legs: What is moved without a stop.
        after: What happens at rest after the last leg.
    """

    folder: Path
    header: dict[str, Any]
    steps: list[Step]
    legs: list[Leg]
    after: list[Step]

    @property
    def rests(self) -> list[list[Step]]:
        """What happens before, between and after the legs."""
        return [*(leg.before for leg in self.legs), self.after]


def read_cycle(path: Path) -> Cycle:
    """Read a cycle file.

    Raises:
        BadInput: It cannot be read, is incomplete, or has a field that this judge does not know.
    """
    try:
        return _cycle(read_document(path), path.resolve().parent)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise BadInput(f"{path}: {type(error).__name__}: {error}") from error


def _cycle(fields: Any, folder: Path) -> Cycle:
    require_known(fields, TOP, "")
    if (fields["format"], fields.get("version", 1)) != (FORMAT, 1):
        raise BadInput(f"{fields['format']} {fields.get('version')} is no cycle of version 1")
    steps = [_step(k, each) for k, each in enumerate(fields["moves"])]
    _require_held(steps, fields)
    legs: list[Leg] = []
    waiting: list[Step] = []
    for k, step in enumerate(steps):
        if step.kind != "move":
            waiting.append(step)
        elif not step.fields.get("pass_through", False):
            legs.append(Leg([step.fields], waiting, k))
            waiting = []
        elif not legs or waiting:
            raise BadInput(f"move '{step.name}' passes through where the arm rests")
        else:
            legs[-1].moves.append(step.fields)
    if not legs:
        raise BadInput("moves has no move")
    for leg in legs:
        for before, move in pairwise(leg.moves):
            _require_one_motion(before, move)
    return Cycle(folder, {k: fields[k] for k in fields if k != "moves"}, steps, legs, waiting)


def _step(k: int, fields: Any) -> Step:
    kinds = [kind for kind in ("event", "attach", "detach") if kind in fields] or ["move"]
    require_known(fields, STEPS[kinds[0]], f"moves.{k}.")
    if shape := fields.get("shape"):
        require_known(shape, SOLID - {"name"}, f"moves.{k}.shape.")
    if payload := fields.get("payload"):
        require_known(payload, {"mass", "com", "inertia"}, f"moves.{k}.payload.")
    require_known(fields.get("collision") or {}, {"ignore"}, f"moves.{k}.collision.")
    return Step(kinds[0], str(fields["name" if kinds[0] == "move" else kinds[0]]), fields)


def _require_held(steps: list[Step], header: dict[str, Any]) -> None:
    """Raise unless what is taken is free, what is let go is held, and a closed cycle keeps none."""
    held: set[str] = set()
    for step in steps:
        if step.kind == "attach" and step.name in held:
            raise BadInput(f"'{step.name}' is attached twice")
        if step.kind == "detach" and step.name not in held:
            raise BadInput(f"'{step.name}' is let go and was not attached")
        if step.kind == "attach":
            held.add(step.name)
        elif step.kind == "detach":
            held.remove(step.name)
    if header.get("closed", False) and held:
        raise BadInput(f"'{held.pop()}' is still attached where the cycle closes")


def _require_one_motion(before: dict[str, Any], move: dict[str, Any]) -> None:
    name = move["name"]
    if before.get("goal") is not None:
        raise BadInput(f"move '{name}' passes through a goal")
    for key in ("limits", "collision"):
        if (before.get(key) or {}) != (move.get(key) or {}):
            raise BadInput(f"move '{name}' passes through, and its {key} are others")
