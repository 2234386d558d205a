"""A cycle file as the outside judge reads it: its steps, its cell, its legs as problems.

What it does not know, it refuses by name.
"""

import json
import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from outside.arm import Arm, placed, solid_geometry
from outside.distances import Poses, signed_distance
from outside.files import BadInput, placement_of, read_document, require_known
from outside.problem import CLEARANCE, SOLID, Problem, problem_of
from outside.tube_fields import bounds_of, with_points

FORMAT = "tubeplanner/cycle"
TOP = {"format", "version", "robot", "start", "obstacles", "clearance", "collision"}
TOP |= {"closed", "moves", "objective"}  # of an objective nothing is asked
MOVE = {"name", "tube", "goal", "limits", "clearance", "contacts", "collision", "pass_through"}
MOVE |= {"objective", "holding"}
STEPS = {
    "move": MOVE,
    "event": {"event", "set", "dwell"},
    "attach": {"attach", "payload", "shape", "holding"},
    "detach": {"detach", "leave_as_obstacle"},
}
TOUCHING = 1e-3  # [m]: links that are nearer to what is attached may touch it
SAME = 1e-6  # [m] and of quaternions: tubes meet
SHARED = {"tool_radius": 0.0, "visit": "ordered", "pass_through_points": "corners"}


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


@dataclass(frozen=True)
class Times:
    """When the legs of a cycle and the steps between them begin and end.

    Attributes:
        legs: Begin and end of each leg [s].
        rests: Likewise, of each step of each rest.
    """

    legs: list[tuple[float, float]]
    rests: list[list[tuple[float, float]]]

    def junction(self, junction: int, duration: float) -> tuple[float, float]:
        """Return when a seam begins and ends [s]."""
        ends = [0.0, *(end for _, end in self.legs)]
        begins = [*(begin for begin, _ in self.legs), duration]
        return ends[junction], begins[junction]


def read_times(path: Path, cycle: Cycle, duration: float) -> Times:
    """Read the marks of a trajectory file of so many seconds, which must be those of a cycle.

    Raises:
        BadInput: There are none, they are not those of its steps, or not in order.
    """
    marks = json.loads(path.read_text("utf-8-sig")).get("marks")
    if not isinstance(marks, list) or len(marks) != len(cycle.steps):
        raise BadInput(f"{path}: marks are not one for each of {len(cycle.steps)} steps")
    for mark, step in zip(marks, cycle.steps, strict=True):
        if mark != {"time": mark.get("time"), **_required(step)}:
            raise BadInput(f"{path}: the mark {mark} is not that of {_required(step)}")
    begins = [float(mark["time"]) for mark in marks]
    ends = [*begins[1:], duration]
    steps = list(zip(begins, ends, strict=True))
    if begins[0] < 0 or any(end < begin for begin, end in steps):
        raise BadInput(f"{path}: marks are not in the order of time")
    last = [leg.first + len(leg.moves) - 1 for leg in cycle.legs]
    legs = [(begins[leg.first], ends[k]) for leg, k in zip(cycle.legs, last, strict=True)]
    firsts = [0, *(k + 1 for k in last)]
    both = zip(firsts, cycle.rests, strict=True)
    return Times(legs, [steps[first : first + len(rest)] for first, rest in both])


@dataclass(frozen=True)
class Cell:
    """What stands in the cell, and what the tool carries.

    Attributes:
        cycle: Of what file.
        obstacles: Fields of solids in the base frame.
        attached: Fields of solids in the tool frame.
        loads: Payloads that were attached, by name.
        held: What holds attached objects, by their names.
    """

    cycle: Cycle
    obstacles: list[dict[str, Any]]
    attached: list[dict[str, Any]]
    loads: dict[str, dict[str, Any]] = field(default_factory=dict)
    held: dict[str, list[dict[str, Any]]] = field(default_factory=dict)

    @property
    def holding(self) -> list[dict[str, Any]]:
        """What holds attached objects, as a problem's field."""
        return [each for contacts in self.held.values() for each in contacts]

    @staticmethod
    def of(cycle: Cycle) -> "Cell":
        """Return the cell in which a cycle begins."""
        attached = cycle.header["robot"].get("attached") or []
        return Cell(cycle, cycle.header.get("obstacles") or [], attached)

    @property
    def names(self) -> set[str]:
        """Names of all solids."""
        return {str(solid["name"]) for solid in [*self.obstacles, *self.attached]}

    def after(self, step: Step, arm: Arm, q: np.ndarray) -> "Cell":
        """Return the cell after a step.

        Args:
            step: What happens.
            arm: Any of the cycle's.
            q: The configuration in which the arm rests, shape (n,).
        """
        if step.kind == "attach":
            return self._with(step, arm, q)
        if step.kind == "detach":
            return self._without(step, self._tool_frame(arm, q))
        return self

    @property
    def payload(self) -> dict[str, Any] | None:
        """What the robot's own payload and all loads are as one body."""
        given = [self.cycle.header["robot"].get("payload"), *self.loads.values()]
        bodies = [_inertia(each) for each in given if each is not None and each["mass"] > 0]
        if not bodies:
            return None
        total = bodies[0]
        for body in bodies[1:]:
            total = total + body
        rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
        inertia = total.inertia[rows, columns].tolist()
        return {"mass": total.mass, "com": total.lever.tolist(), "inertia": inertia}

    def _with(self, step: Step, arm: Arm, q: np.ndarray) -> "Cell":
        payload, shape = step.fields.get("payload"), step.fields.get("shape")
        loads = self.loads if payload is None else self.loads | {step.name: payload}
        held = self.held | {step.name: _held_by(step.fields.get("holding"), payload)}
        standing = [each for each in self.obstacles if each["name"] != step.name]
        taken = [each for each in self.obstacles if each["name"] == step.name]
        if taken:
            solid = _moved(taken[0], self._tool_frame(arm, q).inverse())
        elif shape is not None:
            solid = {**shape, "name": step.name}
        else:
            return replace(self, loads=loads, held=held)
        solid["touch_links"] = self._touching(solid, arm, q)
        return Cell(self.cycle, standing, [*self.attached, solid], loads, held)

    def _without(self, step: Step, frame: pin.SE3) -> "Cell":
        loads = {name: load for name, load in self.loads.items() if name != step.name}
        held = {name: contacts for name, contacts in self.held.items() if name != step.name}
        kept = [each for each in self.attached if each["name"] != step.name]
        gone = [each for each in self.attached if each["name"] == step.name]
        if not step.fields.get("leave_as_obstacle", True):
            gone = []
        left = [_moved(each, frame) for each in gone]
        return Cell(self.cycle, [*self.obstacles, *left], kept, loads, held)

    def _tool_frame(self, arm: Arm, q: np.ndarray) -> pin.SE3:
        rotation, position = arm.tool(q[None])
        offset = placement_of(self.cycle.header["robot"].get("tool_offset") or {})
        return pin.SE3(rotation[0], position[0]) * offset.inverse()

    def _touching(self, solid: dict[str, Any], arm: Arm, q: np.ndarray) -> list[str]:
        """Return the links that something attached touches, or nearly."""
        folder = self.cycle.folder
        folders = [folder / each for each in self.cycle.header["robot"].get("package_dirs") or []]
        geometry, placement = solid_geometry(solid, folder, folders)
        there = self._tool_frame(arm, q) * placement
        held = placed(solid["name"], "obstacle", 0, there, geometry)
        poses = Poses(*arm.poses(q[None]))
        links = [each for each in arm.solids if each.kind == "link"]
        near = [each for each in links if signed_distance((each, held), poses, 0) < TOUCHING]
        return sorted({each.owner for each in near})


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
        "holding": [*cell.holding, *_held_by(leg.moves[0].get("holding"), None)],
    }
    return problem_of(fields, cycle.folder)


def _held_by(holding: Any, payload: dict[str, Any] | None) -> list[dict[str, Any]]:
    """Return contacts as a list; parts that they do not have are a payload."""
    contacts = holding if isinstance(holding, list) else [holding] * bool(holding)
    return [
        each if payload is None or "liquid" in each else {"part": payload} | each
        for each in contacts
    ]


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


def joined_tubes(tubes: list[dict[str, Any]], folder: Path) -> dict[str, Any]:
    """Return several tubes' fields as one's.

    Raises:
        BadInput: They do not meet, or differ in what a tube has once.
    """
    tubes = [with_points(tube, folder) for tube in tubes]
    if len(tubes) == 1:
        return tubes[0]
    for tube in tubes[1:]:
        if any(tube.get(k, v) != tubes[0].get(k, v) for k, v in SHARED.items()):
            raise BadInput("tubes without a stop between them differ in what they have once")
    joined = {key: tubes[0].get(key, default) for key, default in SHARED.items()}
    joined["points"] = _chained([tube["points"] for tube in tubes])
    for key in ("radius", "tool_speed", "tool_acceleration", "cross_section"):
        rows = [row for tube in tubes for row in _per_segment(tube.get(key), count_of(tube), None)]
        if any(row is not None for row in rows):
            joined[key] = rows
    signs = [_per_segment(tube.get("joint_signs"), count_of(tube), {}) for tube in tubes]
    joined["joint_signs"] = [row for rows in signs for row in rows]
    return joined | _rotations(tubes)


def count_of(tube: dict[str, Any]) -> int:
    """Return how many segments a tube has in its file."""
    return len(tube["points"]) - 1


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


def _required(step: Step) -> dict[str, Any]:
    setting = step.fields.get("set") if step.kind == "event" else None
    return {step.kind: step.name} | ({} if setting is None else {"set": setting})


def _moved(solid: dict[str, Any], by: pin.SE3) -> dict[str, Any]:
    """Return a solid's fields, its pose seen from elsewhere."""
    pose = by * placement_of(solid)
    kept = {key: solid[key] for key in solid if key not in ("rpy", "touch_links")}
    turn = pin.Quaternion(pose.rotation).coeffs().tolist()
    return kept | {"position": pose.translation.tolist(), "quaternion": turn}


def _inertia(payload: dict[str, Any]) -> pin.Inertia:
    xx, yy, zz, xy, xz, yz = payload.get("inertia", [0.0] * 6)
    about_com = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
    com = np.array(payload.get("com", [0.0] * 3), dtype=float)
    return pin.Inertia(float(payload["mass"]), com, about_com)


def _clearance(cycle: Cycle, leg: Leg, cell: Cell, counts: list[int]) -> dict[str, Any]:
    segments: list[float] = []
    pairs: list[list[Any]] = []
    for move, count in zip(leg.moves, counts, strict=True):
        asked = cycle.header.get("clearance", 0.0)
        if move.get("clearance") is not None:
            asked = merged(asked, move["clearance"])
        asked = asked if isinstance(asked, dict) else {"default": asked}
        require_known(asked, CLEARANCE, "clearance.")
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


def _per_segment(given: Any, count: int, empty: Any) -> list[Any]:
    rows = given if isinstance(given, list) else [given] * count
    return [empty if row is None else row for row in rows]


def _chained(parts: list[list[list[float]]]) -> list[list[float]]:
    chain = list(parts[0])
    for part in parts[1:]:
        if np.abs(np.subtract(chain[-1], part[0])).max() > SAME:
            raise BadInput("tubes without a stop between them do not meet")
        chain += part[1:]
    return chain


def _rotations(tubes: list[dict[str, Any]]) -> dict[str, Any]:
    """Return orientations and bounds of all; where a tube has none, it is free."""
    given = [tube.get("orientations") for tube in tubes]
    known = [k for k, each in enumerate(given) if each is not None]
    if not known:
        return {}
    for k, tube in enumerate(tubes):
        if given[k] is None:
            nearest = min(known, key=lambda other: abs(other - k))
            each = given[nearest][-1 if nearest < k else 0]
            given[k] = [each] * (count_of(tube) + 1)
    turned = list(given[0])
    for part in given[1:]:
        away = [np.abs(np.subtract(turned[-1], np.multiply(s, part[0]))).max() for s in (1, -1)]
        if min(away) > SAME:
            raise BadInput("tubes without a stop between them are turned differently")
        turned += part[1:]
    bounds = [_bounds(tube) for tube in tubes]
    return {"orientations": turned, "rotation_tolerance": [row for rows in bounds for row in rows]}


def _bounds(tube: dict[str, Any]) -> list[Any]:
    tolerance = tube.get("rotation_tolerance")
    if tolerance is None:
        return [[math.inf] * 3] * count_of(tube)
    rows = bounds_of(tolerance, count_of(tube))
    return [float(row[3]) if np.isfinite(row[3]) else row[:3].tolist() for row in rows]
