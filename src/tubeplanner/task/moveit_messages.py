"""Messages of MoveIt as files: maps that know what was read of them, poses, frames.

The files are the messages of ROS as YAML or JSON, as `ros2 topic echo` prints them or as MoveIt's
benchmarks store them: a vector or a quaternion is a list or a map of x, y, z, w.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import is_number
from tubeplanner.documents import DocumentError, parse_json, parse_yaml, read_text
from tubeplanner.errors import ProblemError, faults_of, shown, unknown_name
from tubeplanner.geometry.solids import placement_of
from tubeplanner.robot.model import RobotModel

_MAX_BYTES = 100_000_000  # a scene has its meshes in itself
_SCENE_KEYS = ("world", "robot_model_name", "allowed_collision_matrix", "fixed_frame_transforms")
_REQUEST_KEYS = ("goal_constraints", "start_state", "group_name")
# Keys of answers of services around a message.
_AROUND = ("scene", "planning_scene", "motion_plan_request", "request")

# ---- Messages, which know what was read of them.


class Message:
    """A map of a message.

    Attributes:
        label: The file and the field, in errors.
    """

    def __init__(self, content: object, label: str, field: str = "") -> None:
        self.label = f"{label}: {field}" if field else label
        if not isinstance(content, dict):
            raise ProblemError(f"{self.label} is {shown(content)}; it must be a map")
        self._content, self._source, self._field = content, label, field
        self._read: set[str] = set()
        self._parts: dict[str, Message] = {}

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def says(self, key: str) -> bool:
        """Return True if a key has more than what a message has where nobody wrote anything."""
        return _says_something(self._content.get(key))

    def value(self, key: str, default: Any = None) -> Any:
        """Return the value of a key."""
        self._read.add(key)
        value = self._content.get(key)
        return default if value is None else value

    def text(self, key: str) -> str:
        """Return the text of a key; empty without."""
        value = self.value(key, "")
        if not isinstance(value, str):
            raise self.fault(key, value, "text")
        return value

    def part(self, key: str) -> "Message":
        """Return the map of a key; empty without."""
        return self._part(self.value(key, {}), self._path(key))

    def values(self, key: str) -> list[Any]:
        """Return the list of a key; empty without."""
        items = self.value(key, [])
        if not isinstance(items, list):
            raise self.fault(key, items, "a list")
        return items

    def parts(self, key: str) -> "list[Message]":
        """Return the maps of the list of a key; none without."""
        items = enumerate(self.values(key))
        return [self._part(item, f"{self._path(key)}[{k}]") for k, item in items]

    def texts(self, key: str) -> list[str]:
        """Return the list of texts of a key; empty without."""
        items = self.values(key)
        if not all(isinstance(each, str) for each in items):
            raise self.fault(key, items, "a list of texts")
        return items

    def number(self, key: str) -> float:
        """Return the number of a key; 0 without."""
        value = self.value(key, 0.0)
        if not is_number(value):
            raise self.fault(key, value, "a number")
        return float(value)

    def numbers(self, key: str, names: str = "") -> list[float]:
        """Return the numbers of a list, or of a map with some names of one letter; empty without.

        Numbers of a map that are left out are 0.
        """
        return self._row(key, self.value(key, []), names)

    def rows(self, key: str, names: str) -> list[list[float]]:
        """Return the rows of the list of a key, each as `numbers`."""
        items = enumerate(self.values(key))
        return [self._row(f"{key}[{k}]", item, names) for k, item in items]

    def _row(self, key: str, items: Any, names: str) -> list[float]:
        if names and isinstance(items, dict) and not set(items) - set(names):
            items = [items.get(name, 0) for name in names]
        is_row = isinstance(items, list) and all(map(is_number, items))
        if not is_row or (names and len(items) not in (0, len(names))):
            raise self.fault(key, items, f"{len(names) or 'a list of'} numbers")
        return [float(each) for each in items]

    def fault(self, key: str, value: object, needed: str) -> ProblemError:
        """Return the error of a value that must be something else."""
        return ProblemError(
            f"{self._source}: {self._path(key)} is {shown(value)}; it must be {needed}"
        )

    def unread(self) -> Iterator[str]:
        """Yield the fields that say something and were not read; numbers of items left out."""
        for key, value in self._content.items():
            if key not in self._read and _says_something(value):
                yield re.sub(r"\[\d+\]", "", self._path(str(key)))
        for part in self._parts.values():
            yield from part.unread()

    def _part(self, content: object, field: str) -> "Message":
        if field not in self._parts:
            self._parts[field] = Message(content, self._source, field)
        return self._parts[field]

    def _path(self, key: str) -> str:
        return f"{self._field}.{key}" if self._field else key


def _says_something(value: object) -> bool:
    """Return True unless a value is what a message has where nobody wrote anything."""
    if isinstance(value, dict | list):
        return any(map(_says_something, value.values() if isinstance(value, dict) else value))
    return bool(value)


def read_message(path: Path) -> Message:
    """Return the message of a file.

    Raises:
        ProblemError: The file cannot be read, or has no map.
    """
    with faults_of(f"{path} cannot be read", DocumentError):
        text = read_text(path, _MAX_BYTES)
    with faults_of(f"{path} is malformed", DocumentError):
        # `ros2 topic echo` ends a message by the mark of a document.
        end = text.rstrip().removesuffix("---")
        content = parse_json(text) if path.suffix == ".json" else parse_yaml(end)
    while isinstance(content, dict) and len(content) == 1 and next(iter(content)) in _AROUND:
        content = next(iter(content.values()))
    return Message(content, str(path))


def is_scene(message: Message) -> bool:
    """Return True if a message is a planning scene."""
    return any(key in message for key in _SCENE_KEYS)


def is_request(message: Message) -> bool:
    """Return True if a message is a motion plan request."""
    return any(key in message for key in _REQUEST_KEYS)


def notes_on_unread(message: Message) -> list[str]:
    """Return a note on the fields of a message that were not read, if any."""
    fields = list(dict.fromkeys(message.unread()))
    return [f"{message.label}: not read: {', '.join(fields)}"] * bool(fields)


# ---- Poses and frames.


def pose_of(message: Message, position: str = "position", rotation: str = "orientation") -> Any:
    """Return the pose (4, 4) of a message; without numbers, or with a zero quaternion, the unit."""
    quaternion = message.numbers(rotation, "xyzw")
    with faults_of(message.label, ProblemError):
        return placement_of(
            message.numbers(position, "xyz") or (0.0, 0.0, 0.0),
            quaternion=quaternion if any(quaternion) else None,
        )


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames by name, as poses (4, 4) in the base frame of a robot."""

    robot: RobotModel
    planning: str  # name of the frame of what names no frame
    others: Mapping[str, FloatArray]  # poses in the base frame by name

    def pose(self, name: str, label: str) -> FloatArray:
        """Return the pose of a frame; the label begins errors."""
        name = name.removeprefix("/") or self.planning
        if name in self.others:
            return self.others[name]
        robot = self.robot
        if name not in robot.link_body:
            known = [*dict.fromkeys((self.planning, *self.others, *robot.link_body))]
            raise ProblemError(f"{label}: {unknown_name('frame', name, known)}")
        if robot.link_body[name] != 0:
            raise ProblemError(
                f"{label}: the frame '{name}' is a link that joints move; give the pose in the "
                f"frame '{self.planning}'"
            )
        return robot.link_placement[name]

    def in_tool_frame(self, name: str, label: str) -> FloatArray:
        """Return the pose of a link in the tool frame, of which joints must not move it."""
        robot, tool = self.robot, self.robot.tool_frame
        if name not in robot.link_body:
            raise ProblemError(f"{label}: {unknown_name('link', name, robot.link_body)}")
        if robot.link_body[name] != robot.link_body[tool]:
            raise ProblemError(
                f"{label}: joints move the link '{name}' against the tool frame '{tool}'; only "
                "what is fixed to the tool is carried: choose another tool_frame"
            )
        return np.linalg.inv(robot.link_placement[tool]) @ robot.link_placement[name]


def frames_of(robot: RobotModel, scene: Message | None) -> Frames:
    """Return the frames of a scene around a robot.

    The scene's planning frame is the base frame if the robot has a base, and else lies where the
    scene's state has the root link.
    """
    planning, transforms = "world", dict[str, FloatArray]()
    root: FloatArray = np.eye(4)
    if scene is not None:
        for each in scene.parts("fixed_frame_transforms"):
            planning = each.text("child_frame_id").removeprefix("/") or planning
            name = each.part("header").text("frame_id").removeprefix("/")
            pose = pose_of(each.part("transform"), "translation", "rotation")
            transforms[name] = pose
        floating = scene.part("robot_state").part("multi_dof_joint_state")
        names = floating.texts("joint_names")
        for name, each in zip(names, floating.parts("transforms"), strict=False):
            pose = pose_of(each, "translation", "rotation")
            if name not in robot.urdf.joints:  # the virtual joint under the root link
                root = pose
    world: FloatArray
    if planning in robot.link_body:
        world = Frames(robot, planning, {}).pose(planning, "")
    else:
        world = np.array(np.linalg.inv(root) if robot.base is None else np.eye(4), dtype=np.float64)
    poses = {name: world @ pose for name, pose in transforms.items() if name}
    return Frames(robot, planning, {planning: world} | poses)
