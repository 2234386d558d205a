"""A problem file as the outside judge reads it. What it does not know, it refuses by name."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from outside.files import BadInput, read_document, require_known
from outside.tube_fields import TubeFields, tube_of, with_points

CLEARANCE = {"default", "pairs", "segments"}
PAIR = {"links", "clearance"}
CONTACT = {"links", "segments", "within"}
SOLID = {"name", *("box", "sphere", "cylinder", "capsule", "mesh"), "scale"}
SOLID |= {"position", "rpy", "quaternion"}
LIMITS = {"effort", "velocity", "position", "acceleration", "jerk", "effort_rate", "scale"}
LIMITS |= {"tool_speed", "tool_acceleration", "position_margin"}
LIMITS |= {"velocity_by_position", "point_speed"}
LIMITS |= {"velocity_tolerance"}  # of simulated runs: nothing that a trajectory must keep
MOTORS = {"armature", "viscous_friction", "coulomb_friction", "saturation_effort"}
MOTORS |= {"no_load_velocity", "friction_from_urdf", "friction_uncertainty"}
ROBOT = {"urdf", "package_dirs", "srdf", "tool_frame", "tool_offset", "joints", "locked_joints"}
ROBOT |= {"base", "gravity", "payload", "attached", "limits", "motors", "preset", "limits_file"}
ROBOT |= {"xacro_args"}  # of an .xacro file, which the judge does not read
TOP = {"format", "version", "robot", "tube", "start", "goal", "obstacles", "clearance", "collision"}
TOP |= {"contacts", "holding", "objective"}  # of an objective nothing is asked
BALL = {"position", "tolerance", "rotation_tolerance"}
POSE = {"position", "rpy", "quaternion"}


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
    require_known(fields, CLEARANCE, "clearance.")
    default = float(fields.get("default", 0.0))
    segments = fields.get("segments") or [None] * count
    if len(segments) != count:
        raise BadInput(f"clearance.segments has {len(segments)} entries for {count} segments")
    pairs = {}
    for row in fields.get("pairs") or []:
        require_known(row, PAIR, "clearance.pairs.")
        pairs[_names(row["links"])] = float(row["clearance"])
    each = [default if value is None else float(value) for value in segments]
    return Distances(np.array(each), pairs, [_contact(row, count) for row in contacts or []])


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
        holding: Its section `holding`, not looked into.
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
    holding: Any = None


def read_problem(path: Path) -> Problem:
    """Read a problem file.

    Raises:
        BadInput: It cannot be read, is incomplete, or has a field that this judge does not know.
    """
    try:
        return problem_of(read_document(path), path.resolve().parent)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise BadInput(f"{path}: {type(error).__name__}: {error}") from error


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
        tube_of(tube, distances.segments),
        fields["start"],
        fields.get("goal") or {},
        fields.get("obstacles") or [],
        distances,
        bool(collision.get("self", True)),
        [(first, second) for first, second in collision.get("ignore") or []],
        fields.get("holding"),
    )


def _contact(fields: Any, count: int) -> Contact:
    require_known(fields, CONTACT, "contacts.")
    given = fields.get("segments")
    chosen = {0, count - 1} if given is None else {count - 1 if k == -1 else k for k in given}
    if not chosen <= {0, count - 1}:
        raise BadInput(f"contacts: segments {given} are neither the first nor the last")
    within = float(fields["within"])
    return Contact(_names(fields["links"]), within, 0 in chosen, count - 1 in chosen)


def _names(links: Any) -> frozenset[str]:
    first, second = links
    return frozenset((str(first), str(second)))
