"""A problem file as the outside judge reads it. What it does not know, it refuses by name."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from outside.box import Section, radii, read_sections
from outside.distances import Distances, read_distances
from outside.files import BadInput
from outside.line import distinct, joined, passing
from outside.points import read_points

SOLID = {"name", *("box", "sphere", "cylinder", "capsule", "mesh"), "scale"}
SOLID |= {"position", "rpy", "quaternion"}
LIMITS = {"effort", "velocity", "position", "acceleration", "jerk", "effort_rate", "scale"}
LIMITS |= {"tool_speed"}
LIMITS |= {"velocity_by_position", "point_speed"}
MOTORS = {"armature", "viscous_friction", "coulomb_friction", "saturation_effort"}
MOTORS |= {"no_load_velocity", "friction_from_urdf", "friction_uncertainty"}
ROBOT = {"urdf", "package_dirs", "srdf", "tool_frame", "tool_offset", "joints", "locked_joints"}
ROBOT |= {"base", "gravity", "payload", "attached", "limits", "motors", "preset", "limits_file"}
ROBOT |= {"xacro_args"}  # of an .xacro file, which the judge does not read
TUBE = {"points", "radius", "tool_radius", "joint_signs", "orientations", "rotation_tolerance"}
TUBE |= {"tool_speed", "visit", "pass_through_points", "cross_section"}
TOP = {"format", "version", "robot", "tube", "start", "goal", "obstacles", "clearance", "collision"}
TOP |= {"contacts"}
BALL = {"position", "tolerance", "rotation_tolerance"}
POSE = {"position", "rpy", "quaternion"}
SIGNS = {"+": (0.0, math.inf), "-": (-math.inf, 0.0), "0": (-math.inf, math.inf)}
SIGNS_BY_NUMBER = {1: "+", -1: "-", 0: "0"}


@dataclass(frozen=True, eq=False)
class TubeFields:
    """What a problem asks of the tool between start and goal.

    Attributes:
        points: Reference points, base frame, shape (m+1, 3) [m].
        radius: What the tool centre point may be off each segment, shape (m,) [m]; in a box, half
            of the smaller side.
        ranges: Per segment: joint name to (lower, upper) [rad or m].
        orientations: At the points, quaternions x y z w, shape (m+1, 4), or None.
        bounds: On the components and the length of log(R_ref^T R), shape (m, 4) [rad], or None.
        speed: What the tool's speed must not exceed in each segment, infinite where it is free:
            shape (m,) [m/s]. The robot's own limit is not in it.
        clearance: Of links from obstacles in each segment, shape (m,) [m].
        is_ordered: Whether segments are visited one after the other.
        passing: Indices of inner points that must be passed within the smaller radius beside them.
        numbers: What the file calls the points: those on straight lines and repeated ones are left
            out.
        sections: Width and height [m] and what is upward, None for a disc, for each segment; None:
            discs alone.
        tool_radius: What is taken off the radii, and to be taken off the boxes [m].
    """

    points: np.ndarray
    radius: np.ndarray
    ranges: list[dict[str, tuple[float, float]]]
    orientations: np.ndarray | None
    bounds: np.ndarray | None
    speed: np.ndarray
    clearance: np.ndarray
    is_ordered: bool
    passing: list[int]
    numbers: list[int]
    sections: list[Section | None] | None = None
    tool_radius: float = 0.0

    def some(self, kept: list[int]) -> "TubeFields":
        """Return the tube with some of its points; each segment is the one that ends there."""
        # Of segments that are one, any will do; of a repeated point, the segment to it goes.
        segments = [k - 1 for k in kept[1:]]
        return TubeFields(
            self.points[kept],
            self.radius[segments],
            [self.ranges[k] for k in segments],
            None if self.orientations is None else self.orientations[kept],
            None if self.bounds is None else self.bounds[segments],
            self.speed[segments],
            self.clearance[segments],
            self.is_ordered,
            [],
            [self.numbers[k] for k in kept],
            None if self.sections is None else [self.sections[k] for k in segments],
            self.tool_radius,
        )

    def same(self, one: int, other: int) -> bool:
        """Return whether two segments ask the same."""
        bounds = self.bounds
        return bool(
            self.radius[one] == self.radius[other]
            and (self.sections is None or self.sections[one] == self.sections[other])
            and self.ranges[one] == self.ranges[other]
            and self.speed[one] == self.speed[other]
            and self.clearance[one] == self.clearance[other]
            and (bounds is None or (bounds[one] == bounds[other]).all())
        )


@dataclass(frozen=True, eq=False)
class Problem:
    """A problem file.

    Attributes:
        folder: Where its relative paths start.
        robot: Its section `robot`, keys checked.
        tube: Its tube.
        start: Its section `start`: `joints`, `seed` or `pose`.
        goal: Likewise, or the keys of a ball, or empty.
        obstacles: Solids in the base frame, keys checked.
        distances: What is asked of distances between solids.
        checks_links: Whether links are held against each other.
        ignored: Pairs of names that may touch.
    """

    folder: Path
    robot: dict[str, Any]
    tube: TubeFields
    start: dict[str, Any]
    goal: dict[str, Any]
    obstacles: list[dict[str, Any]]
    distances: Distances
    checks_links: bool
    ignored: list[tuple[str, str]]


def read_problem(path: Path) -> Problem:
    """Read a problem file.

    Raises:
        BadInput: It cannot be read, is incomplete, or has a field that this judge does not know.
    """
    try:
        return problem_of(read_document(path), path.resolve().parent)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise BadInput(f"{path}: {type(error).__name__}: {error}") from error


def read_document(path: Path) -> Any:
    """Return what a YAML or JSON file holds.

    Raises:
        BadInput: It cannot be read.
    """
    try:
        text = path.read_text("utf-8-sig")
        return (
            json.loads(text)
            if path.suffix == ".json"
            else YAML(typ="safe", pure=True).load(text)  # YAML 1.2, as other readers of the file
        )
    except (OSError, ValueError, YAMLError) as error:
        raise BadInput(f"{path} cannot be read: {error}") from error


def problem_of(fields: Any, folder: Path) -> Problem:
    """Return the problem that a file's fields are, whose relative paths start at a folder.

    Raises:
        BadInput: A field is not known here.
    """
    require_known(fields, TOP, "")
    if fields.get("format", "tubeplanner/problem") != "tubeplanner/problem":
        raise BadInput(f"format {fields['format']} is unknown")
    if fields.get("version", 1) != 1:
        raise BadInput(f"version {fields['version']} is unknown")
    robot = fields["robot"]
    require_known(robot, ROBOT, "robot.")
    require_known(robot.get("tool_offset") or {}, {"position", "rpy"}, "robot.tool_offset.")
    require_known(robot.get("base") or {}, POSE, "robot.base.")
    require_known(robot.get("payload") or {}, {"mass", "com", "inertia"}, "robot.payload.")
    require_known(robot.get("limits") or {}, LIMITS, "robot.limits.")
    require_known(robot.get("motors") or {}, MOTORS, "robot.motors.")
    scale = (robot.get("limits") or {}).get("scale") or {}
    require_known(scale, {"effort", "velocity", "acceleration"}, "robot.limits.scale.")
    for solid in robot.get("attached") or []:
        require_known(solid, SOLID | {"touch_links"}, "robot.attached.")
    for solid in fields.get("obstacles") or []:
        require_known(solid, SOLID, "obstacles.")
    collision = fields.get("collision") or {}
    require_known(collision, {"self", "ignore"}, "collision.")
    for end in ("start", "goal"):
        known = {"joints", "seed", "pose"} | (BALL if end == "goal" else set())
        given = fields.get(end) or {}
        require_known(given, known, f"{end}.")
        require_known(given.get("pose") or {}, POSE, f"{end}.pose.")
    tube = with_points(fields["tube"], folder)
    asked = (fields.get("clearance", 0.0), fields.get("contacts"))
    distances = read_distances(*asked, len(tube["points"]) - 1)
    return Problem(
        folder,
        robot,
        _tube(tube, distances.segments),
        fields["start"],
        fields.get("goal") or {},
        fields.get("obstacles") or [],
        distances,
        bool(collision.get("self", True)),
        [(first, second) for first, second in collision.get("ignore") or []],
    )


def require_known(fields: Any, known: set[str], where: str) -> None:
    """Raise BadInput, which names the field, if there is one that is not known."""
    if not isinstance(fields, dict):
        raise BadInput(f"{where.rstrip('.') or 'the file'} must be a map")
    for key in fields:
        if key not in known:
            raise BadInput(f"{where}{key} is not known here, so it cannot be judged")


def with_points(fields: Any, folder: Path) -> Any:
    """Return a tube's fields with those of its file of points, if it names one."""
    if not isinstance(fields.get("points"), str):
        return fields
    read = read_points(folder / fields["points"])
    if twice := [key for key in read if key != "points" and fields.get(key) is not None]:
        raise BadInput(f"tube.{twice[0]} is given twice: here and in {fields['points']}")
    return fields | read


def _tube(fields: Any, clearance: np.ndarray) -> TubeFields:
    require_known(fields, TUBE, "tube.")
    points = np.array(fields["points"], dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise BadInput("tube.points must be two or more positions")
    count = len(points) - 1
    sections = read_sections(fields.get("cross_section"), count)
    radius = radii(fields.get("radius"), sections)
    tool_radius = float(fields.get("tool_radius", 0.0))
    signs = fields.get("joint_signs") or {}
    maps = [signs] * count if isinstance(signs, dict) else signs
    if len(maps) != count:
        raise BadInput(f"tube.joint_signs has {len(maps)} maps for {count} segments")
    visit = fields.get("visit", "ordered")
    if visit not in ("ordered", "any"):
        raise BadInput(f"tube.visit {visit} is not known here")
    orientations = fields.get("orientations")
    if orientations is not None and np.shape(orientations) != (count + 1, 4):
        raise BadInput("tube.orientations must be one quaternion per point")
    tolerance = fields.get("rotation_tolerance")
    tube = TubeFields(
        points,
        radius - tool_radius,
        [{name: _range(sign) for name, sign in (row or {}).items()} for row in maps],
        None if orientations is None else np.array(orientations, dtype=float),
        None if tolerance is None else bounds_of(tolerance, count),
        _speeds(fields.get("tool_speed"), count),
        clearance,
        visit == "ordered",
        [],
        list(range(count + 1)),
        sections,
        tool_radius,
    )
    return _reduced(tube, fields.get("pass_through_points", "corners"))


def _reduced(tube: TubeFields, rule: Any) -> TubeFields:
    """Return what of a tube counts, with the points that must be passed."""

    def turned() -> np.ndarray | None:
        is_free = tube.bounds is None or not np.isfinite(tube.bounds).any()
        return None if is_free else tube.orientations

    tube = tube.some(distinct(tube.points, tube.same, turned()))
    if rule != "all":
        tube = tube.some(joined(tube.points, tube.same, turned()))
    return replace(tube, passing=passing(tube.points, tube.radius, rule))


def _range(sign: Any) -> tuple[float, float]:
    if isinstance(sign, list):
        lower, upper = sign
        return float(lower), float(upper)
    return SIGNS[SIGNS_BY_NUMBER.get(sign, sign)]


def bounds_of(tolerance: Any, count: int) -> np.ndarray:
    """Return what `rotation_tolerance` bounds in so many segments, as `TubeFields.bounds`."""
    entries = tolerance if isinstance(tolerance, list) else [tolerance] * count
    if count != 3 and len(entries) == 3 and not any(isinstance(entry, list) for entry in entries):
        entries = [entries]  # one triple for all; of three segments, each has its angle
    if len(entries) == 1 and isinstance(entries[0], list):
        entries = entries * count
    if len(entries) != count:
        raise BadInput(f"tube.rotation_tolerance has {len(entries)} entries for {count} segments")
    bounds = np.full((count, 4), math.inf)
    for row, entry in zip(bounds, entries, strict=True):
        if isinstance(entry, list):
            row[:3] = entry
        else:
            row[3] = entry
    return bounds


def speed_of(value: Any, name: str) -> float:
    """Return a limit on the tool's speed [m/s], infinite if there is none.

    Raises:
        BadInput: It is no positive number.
    """
    if value is None:
        return math.inf
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise BadInput(f"{name} is {value}")
    return float(value)


def _speeds(given: Any, count: int) -> np.ndarray:
    entries = given if isinstance(given, list) else [given] * count
    if len(entries) != count:
        raise BadInput(f"tube.tool_speed has {len(entries)} entries for {count} segments")
    return np.array([speed_of(value, "tube.tool_speed") for value in entries])
