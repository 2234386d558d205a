"""MoveIt's planning scenes and motion plan requests: their solids, allowed pairs, start and goal.

A kind of solid is its number or its name; a matrix has rows, or maps with `enabled`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import is_number
from tubeplanner.errors import ProblemError, shown
from tubeplanner.fields import check_fields
from tubeplanner.geometry.solids import placement_of
from tubeplanner.orientation import quaternion_of_matrix
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.moveit_messages import (
    Frames,
    Message,
    frames_of,
    is_scene,
    notes_on_unread,
    pose_of,
    read_message,
)
from tubeplanner.task.problem_format import AttachedFields, ObstacleFields

# ---- Solids of a scene.

# Names by their numbers in shape_msgs/SolidPrimitive, and how many sizes they have.
_PRIMITIVES = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone", 5: "prism"}
_SIZE_COUNTS = {"box": 3, "sphere": 1, "cylinder": 2}
_ADD, _APPEND = 0, 2  # operations of an object


@dataclass(frozen=True)
class SceneSolids:
    """What a problem takes from a planning scene."""

    obstacles: tuple[ObstacleFields, ...]  # in the base frame
    attached: tuple[AttachedFields, ...]  # in the tool frame
    allowed_pairs: tuple[tuple[str, str], ...]  # names of links and solids that may touch
    notes: tuple[str, ...]  # on what is not used


def solids_of_scene(path: Path, robot: RobotModel) -> SceneSolids:
    """Return the solids of the file of a planning scene around a robot, with allowed pairs.

    Raises:
        ProblemError: The file is malformed, or has what cannot be used: an octree, a plane, a cone,
            an object in the frame of a moving link.
    """
    message = read_message(path)
    if not is_scene(message):
        raise ProblemError(f"{path}: this is no planning scene: it has no world")
    solids = scene_solids(message, robot, frames_of(robot, message))
    _ = message.part("robot_state").value("joint_state")  # the start is the problem's
    return replace(solids, notes=(*solids.notes, *notes_on_unread(message)))


def scene_solids(message: Message, robot: RobotModel, frames: Frames) -> SceneSolids:
    """Return the solids of a scene, without notes on what was not read."""
    world, notes = message.part("world"), list[str]()
    _ = message.text("name"), message.text("robot_model_name"), message.value("is_diff")
    _ = message.part("robot_state").value("is_diff")
    octomap = world.part("octomap").part("octomap")
    if octomap.says("data"):
        raise ProblemError(
            f"{octomap.label}.data is an octree, which is not read; give its points as an obstacle "
            "{name: ..., points: FILE, size: ...}"
        )
    names = _Names(robot, notes)
    obstacles = [
        check_fields(ObstacleFields, fields, each.label)
        for each in world.parts("collision_objects")
        for fields in _object_fields(each, frames.pose, names)
    ]
    attached = _attached_solids(message.part("robot_state"), frames, names)
    standing = {each.name for each in obstacles}
    pairs = [
        pair
        for pair in _allowed_pairs(message, [*robot.urdf.links, *names.names], names)
        if not standing.issuperset(pair)
    ]
    return SceneSolids(tuple(obstacles), tuple(attached), tuple(pairs), tuple(notes))


class _Names:
    """Names of the solids by the identifiers of their objects, which may have several solids."""

    def __init__(self, robot: RobotModel, notes: list[str]) -> None:
        self.notes, self.names = notes, list[str]()
        self.of: dict[str, list[str]] = {}
        self._taken = set(robot.link_body)

    def of_object(self, identifier: str, count: int) -> list[str]:
        """Return new names for the solids of an object."""
        name = identifier
        if name in self._taken:
            name = f"{name}_object"
            self.notes.append(f"the object '{identifier}' has a link's name; here it is '{name}'")
        names = [name] if count == 1 else [f"{name}_{k + 1}" for k in range(count)]
        self.of.setdefault(name, []).extend(names)
        self.names += names
        return names


def solids_of_state(state: Message, frames: Frames) -> SceneSolids:
    """Return the attached objects of a robot's state alone."""
    notes = list[str]()
    attached = _attached_solids(state, frames, _Names(frames.robot, notes))
    return SceneSolids((), tuple(attached), (), tuple(notes))


def _attached_solids(state: Message, frames: Frames, names: _Names) -> list[AttachedFields]:
    """Return the attached objects of a robot's state, in the tool frame."""
    result = []
    for each in state.parts("attached_collision_objects"):
        link, solid = each.text("link_name"), each.part("object")
        touching = list(dict.fromkeys([link, *each.texts("touch_links")]))
        own = {"": link}

        def pose(name: str, label: str, own: dict[str, str] = own) -> FloatArray:
            return frames.in_tool_frame(own.get(name, name), label)

        for fields in _object_fields(solid, pose, names):
            unknown = [name for name in touching if name not in frames.robot.link_body]
            if unknown:
                names.notes.append(f"{each.label}: touch_links without a link: {unknown}")
            fields["touch_links"] = [name for name in touching if name not in unknown]
            result.append(check_fields(AttachedFields, fields, each.label))
    return result


def _object_fields(message: Message, frame_of: Any, names: _Names) -> Iterator[dict[str, Any]]:
    """Yield the fields of the solids of an object, its frames by a function of name and label."""
    identifier = message.text("id")
    label = f"{message.label} '{identifier}'"
    if not identifier:
        raise ProblemError(f"{message.label}.id is required: the name of the object")
    if message.value("operation", _ADD) not in (_ADD, _APPEND, "\x00", "\x02"):
        raise ProblemError(f"{label}: operation is to remove or move it; give the whole scene")
    if message.says("planes"):
        raise ProblemError(f"{label}: planes are no solids; give a box")
    for key in ("subframe_names", "subframe_poses", "type"):
        message.value(key)
    frame = frame_of(message.part("header").text("frame_id"), label) @ pose_of(message.part("pose"))
    solids = [*_placed_parts(message, "primitives", "primitive_poses", label)]
    shapes = [_primitive(each, label) for each, _ in solids]
    meshes = [*_placed_parts(message, "meshes", "mesh_poses", label)]
    shapes += [{"mesh": _mesh(each)} for each, _ in meshes]
    if not shapes:
        raise ProblemError(f"{label} has no primitives and no meshes; give its solids")
    poses = [frame @ pose for _, pose in [*solids, *meshes]]
    own = names.of_object(identifier, len(shapes))
    for name, shape, pose in zip(own, shapes, poses, strict=True):
        yield {
            "name": name,
            **shape,
            "position": pose[:3, 3].tolist(),
            "quaternion": quaternion_of_matrix(pose[:3, :3]).tolist(),
        }


def _placed_parts(
    message: Message, key: str, poses: str, label: str
) -> Iterator[tuple[Message, FloatArray]]:
    """Yield the solids of an object of one kind with their poses (4, 4)."""
    solids, placements = message.parts(key), message.parts(poses)
    # A single solid may have no pose: it is at the object's.
    if len(placements) != len(solids) and (placements or len(solids) > 1):
        raise ProblemError(f"{label} has {len(solids)} {key} and {len(placements)} {poses}")
    for k, solid in enumerate(solids):
        yield solid, pose_of(placements[k]) if placements else np.eye(4)


def _primitive(message: Message, label: str) -> dict[str, Any]:
    kind = message.value("type")
    kind = _PRIMITIVES.get(kind, kind) if is_number(kind) else kind
    kind = kind.lower() if isinstance(kind, str) else kind
    if not isinstance(kind, str) or kind not in _SIZE_COUNTS:
        raise ProblemError(
            f"{label}: a primitive of type {shown(kind)} is not read, only "
            f"{', '.join(_SIZE_COUNTS)}; give a mesh"
        )
    sizes = message.numbers("dimensions")
    if len(sizes) != _SIZE_COUNTS[kind]:
        raise ProblemError(
            f"{label}: a {kind} has {_SIZE_COUNTS[kind]} dimensions, not {len(sizes)}"
        )
    if kind == "cylinder":
        return {kind: sizes[::-1]}  # in messages the height comes first
    return {kind: sizes if kind == "box" else sizes[0]}


def _mesh(message: Message) -> dict[str, Any]:
    triangles = [
        each.get("vertex_indices") if isinstance(each, dict) else each
        for each in message.values("triangles")
    ]
    return {"vertices": message.rows("vertices", "xyz"), "triangles": triangles}


# ---- The allowed collision matrix.


def _allowed_pairs(
    scene: Message, known: Sequence[str], names: _Names
) -> Iterator[tuple[str, str]]:
    """Yield the pairs of known names that a scene's matrix allows to touch.

    As in MoveIt: an entry of a pair holds before the defaults of its names; where both have one,
    both must allow it. Names without a solid are noted.
    """
    matrix = scene.part("allowed_collision_matrix")
    entries = matrix.texts("entry_names")
    rows: list[Any] = [
        row.get("enabled") if isinstance(row, dict) else row
        for row in matrix.values("entry_values")
    ]
    is_square = all(isinstance(row, list) and len(row) == len(entries) for row in rows)
    if not is_square or len(rows) != len(entries):
        raise ProblemError(
            f"{matrix.label}: entry_values must be {len(entries)} rows of {len(entries)} values, "
            "as many as entry_names"
        )
    with_default = matrix.texts("default_entry_names")
    values = matrix.values("default_entry_values")
    if len(values) != len(with_default):
        raise matrix.fault("default_entry_values", values, f"{len(with_default)} values")
    defaults = dict(zip(with_default, values, strict=True))
    solids = {name: object_ for object_, each in names.of.items() for name in each}
    unknown = [n for n in dict.fromkeys((*entries, *defaults)) if n not in {*known, *names.of}]
    if unknown:
        listed = ", ".join(unknown)
        names.notes.append(f"{matrix.label} names what is neither a link nor an object: {listed}")
    number = {name: k for k, name in enumerate(entries)}
    for first, second in combinations(known, 2):
        one, other = solids.get(first, first), solids.get(second, second)
        if one in number and other in number:
            is_allowed = bool(rows[number[one]][number[other]])
        else:
            own = [defaults[name] for name in (one, other) if name in defaults]
            is_allowed = bool(own) and all(own)
        if is_allowed:
            yield first, second


# ---- Motion plan requests: start, goal, scaling factors.


def state_joints(state: Message) -> dict[str, float]:
    """Return the positions of joints in a robot's state, by name [rad or m]."""
    joints = state.part("joint_state")
    names, positions = joints.texts("name"), joints.numbers("position")
    if len(names) != len(positions):
        raise ProblemError(f"{joints.label} has {len(names)} names and {len(positions)} positions")
    return dict(zip(names, positions, strict=True))


def scale_of_request(request: Message) -> dict[str, float]:
    """Return the scaling factors of velocity and acceleration that are not 0, as 0 means 1."""
    factors = {}
    for quantity in ("velocity", "acceleration"):
        key = f"max_{quantity}_scaling_factor"
        value = request.value(key, 0)
        if not is_number(value) or not 0 <= value <= 1:
            raise request.fault(key, value, "a number from 0 to 1")
        if value not in (0, 1):
            factors[quantity] = float(value)
    return factors


def goal_of_request(
    request: Message, robot: RobotModel, frames: Frames
) -> tuple[dict[str, Any] | None, list[str]]:
    """Return the fields of a request's goal, None without one, and notes.

    Of several goals the first counts. Joint constraints are a goal of joints; a position and an
    orientation are a pose of the tool; a position alone is a ball.
    """
    goals = request.parts("goal_constraints")
    if not goals:
        return None, []
    goal, notes = goals[0], list[str]()
    if len(goals) > 1:
        notes.append(f"{request.label}: goal_constraints has {len(goals)} goals; the first is used")
        request.value("goal_constraints")
    joints = {each.text("joint_name"): each for each in goal.parts("joint_constraints")}
    _ = goal.text("name")
    if joints:
        missing = [name for name in robot.joint_names if name not in joints]
        if missing:
            raise ProblemError(
                f"{goal.label}.joint_constraints has no joint {', '.join(missing)}; all joints of "
                f"the planning group are needed: {', '.join(robot.joint_names)}"
            )
        values = {name: joints[name].number("position") for name in robot.joint_names}
        others = [name for name in joints if name not in robot.joint_names]
        if others:
            notes.append(f"{goal.label}: not planned are the joints {', '.join(others)}")
        return {"joints": values}, notes
    positions, rotations = goal.parts("position_constraints"), goal.parts("orientation_constraints")
    if len(positions) != 1 or len(rotations) > 1:
        raise ProblemError(
            f"{goal.label} has {len(positions)} position and {len(rotations)} orientation "
            "constraints; needed are joint constraints, or one position and at most one orientation"
        )
    position = positions[0]
    center, tolerance = _center(position, frames)
    offset = np.array(position.numbers("target_point_offset", "xyz") or [0.0, 0.0, 0.0])
    link = position.text("link_name") or robot.tool_frame
    in_tool = frames.in_tool_frame(link, position.label)
    tool = placement_of(robot.tool_offset.position, robot.tool_offset.rpy)
    if not rotations:
        target = (in_tool @ [*offset, 1.0])[:3]
        if abs(target - tool[:3, 3]).max() > _SAME_POINT:
            raise ProblemError(
                f"{position.label} is of another point of '{link}' than the tool centre point; "
                f"give robot.tool_offset: {{position: {target.round(9).tolist()}}}"
            )
        return {"position": center.tolist(), "tolerance": tolerance}, notes
    if tolerance:
        notes.append(f"{position.label}: the goal is the centre of its region, without tolerance")
    rotation = rotations[0]
    if (other := rotation.text("link_name") or link) != link:
        raise ProblemError(f"{rotation.label} is of the link '{other}', the position of '{link}'")
    pose = frames.pose(rotation.part("header").text("frame_id"), rotation.label) @ pose_of(rotation)
    pose[:3, 3] = center - pose[:3, :3] @ offset
    pose = pose @ np.linalg.inv(in_tool) @ tool
    fields = {"position": pose[:3, 3].tolist()}
    return {"pose": fields | {"quaternion": quaternion_of_matrix(pose[:3, :3]).tolist()}}, notes


_SAME_POINT = 1e-6  # [m]


def _center(position: Message, frames: Frames) -> tuple[FloatArray, float]:
    """Return the centre (3,) of a position constraint's region, and its tolerance [m]."""
    region = position.part("constraint_region")
    solids = [*_placed_parts(region, "primitives", "primitive_poses", region.label)]
    if len(solids) != 1 or region.says("meshes"):
        raise ProblemError(f"{region.label} must have one primitive: a sphere or a box")
    shape = _primitive(solids[0][0], region.label)
    frame = frames.pose(position.part("header").text("frame_id"), position.label)
    sizes = [2 * shape["sphere"]] if "sphere" in shape else shape.get("box")
    if sizes is None:
        raise ProblemError(f"{region.label} must have one primitive: a sphere or a box")
    return (frame @ solids[0][1])[:3, 3], min(sizes) / 2
