"""Load_problem, parse_problem: fields to robot, solids, tube, endpoints, problem."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import given_path
from tubeplanner.errors import ProblemError, RobotError, TrajectoryError
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, placement_of
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.resources import find_description, find_limits_file, find_mesh, find_problem
from tubeplanner.robot.limit_layers import LimitLayer
from tubeplanner.robot.loader import load_robot
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.overrides import LimitOverrides
from tubeplanner.robot.pinocchio_model import BasePose, Payload, ToolOffset
from tubeplanner.robot.ros_files import read_allowed_pairs, read_group_state
from tubeplanner.task.demands import Objective, Robustness
from tubeplanner.task.endpoints import GoalRegion, Seed, ToolPose, configuration_of
from tubeplanner.task.field_changes import checked_layers, read_problem_fields
from tubeplanner.task.fields import (
    PoseFields,
    clearances_of,
    contacts_of,
    limits_of,
    motors_of,
    segment_clearances,
)
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import (
    AttachedFields,
    EndpointFields,
    JointValues,
    ObjectiveFields,
    ObstacleFields,
    ProblemFields,
    RobotFields,
    RobustnessFields,
    TubeFields,
)
from tubeplanner.task.side_files import read_limits_file, read_points, read_preset
from tubeplanner.trajectory.reader import read_trajectory

# ---- Solids as problem files have them.


def obstacle_of(
    fields: ObstacleFields, directory: Path, folders: tuple[Path, ...], field: str | None = None
) -> Obstacle:
    """Return a solid as a file has it.

    Args:
        fields: Of the file.
        directory: Where its relative paths start.
        folders: That hold the packages of `package://` names.
        field: What messages call the field; None: an obstacle of its name.

    Raises:
        ProblemError: It has not exactly one shape, or a number is out of its bounds.
    """
    field = field or f"obstacles: '{fields.name}'"
    kinds = ("box", "sphere", "cylinder", "capsule", "mesh")
    given = [kind for kind in kinds if getattr(fields, kind) is not None]
    if len(given) != 1:
        raise ProblemError(
            f"{field} must have exactly one of {', '.join(kinds)}; "
            f"it has {', '.join(given) or 'none'}"
        )
    try:
        placement = placement_of(fields.position, fields.rpy, fields.quaternion)
    except ProblemError as error:
        raise ProblemError(f"{field}: {error}") from None
    if fields.mesh is not None:
        try:
            path = find_mesh(fields.mesh, directory / "the problem file", folders)
            return Obstacle.mesh(fields.name, path, placement, fields.scale)
        except RobotError as error:
            raise ProblemError(f"{field}: {error}") from None
    if fields.scale != 1.0:
        raise ProblemError(f"{field}: scale belongs to a mesh alone; remove it")
    sizes = getattr(fields, given[0])
    if given[0] in ("cylinder", "capsule"):
        return getattr(Obstacle, given[0])(fields.name, *sizes, placement)
    return getattr(Obstacle, given[0])(fields.name, sizes, placement)


def attached_of(
    fields: AttachedFields, directory: Path, folders: tuple[Path, ...], field: str | None = None
) -> AttachedSolid:
    """Return a solid that the tool carries, as a file has it; arguments as `obstacle_of`."""
    field = field or f"robot.attached: '{fields.name}'"
    solid = obstacle_of(fields, directory, folders, field)
    return AttachedSolid(solid.name, solid.shapes, tuple(fields.touch_links), solid.contents)


# ---- A start or goal that a problem file gives without joint values: by a pose, a name or a file.

_ALONE = ("pose", "group_state", "trajectory")
_OTHERS = ("joints", "seed", "position")


def named_endpoint(
    end: str, fields: EndpointFields, robot: RobotModel, srdf: Path | None, directory: Path
) -> FloatArray | ToolPose | None:
    """Return what a pose, a group state or a trajectory file gives for an end.

    Args:
        end: What messages call it: start or goal.
        fields: What the problem file has for it.
        robot: The arm.
        srdf: The file that has group states; None: there is none.
        directory: Where relative paths start.

    Returns:
        A configuration (n,) [rad or m], a pose, or None if there is nothing of the three.

    Raises:
        ProblemError: More than one thing is given, or it does not give all joints.
    """
    given = [key for key in (*_ALONE, *_OTHERS) if getattr(fields, key) is not None]
    if not set(_ALONE) & set(given):
        return None
    if [key for key in given if key != "seed" or "pose" not in given] != given[:1]:
        raise ProblemError(
            f"{end} takes one of joints, seed, {', '.join(_ALONE)}; it has {', '.join(given)} "
            "(what an included file gives counts: null takes it away)"
        )
    if fields.pose is not None:
        return _tool_pose(end, fields.pose, fields, robot)
    if fields.group_state is not None:
        return _group_state(end, fields.group_state, robot, srdf)
    return _last_configuration(f"{end}.trajectory", directory / str(fields.trajectory), robot)


def _tool_pose(end: str, pose: PoseFields, fields: EndpointFields, robot: RobotModel) -> ToolPose:
    if (pose.rpy is None) == (pose.quaternion is None):
        number = "neither" if pose.rpy is None else "both"
        raise ProblemError(f"{end}.pose takes either quaternion or rpy; it has {number}")
    seed = fields.seed
    try:
        placement = placement_of(pose.position, pose.rpy, pose.quaternion)
    except ProblemError as error:
        raise ProblemError(f"{end}.pose: {error}") from None
    return ToolPose(
        placement, None if seed is None else configuration_of(robot, f"{end}.seed", seed)
    )


def _group_state(end: str, name: str, robot: RobotModel, srdf: Path | None) -> FloatArray:
    if srdf is None:
        raise ProblemError(f"{end}.group_state '{name}' is one of an SRDF; give robot.srdf")
    try:
        values = read_group_state(srdf, name, robot.joint_names)
    except RobotError as error:
        raise ProblemError(f"{end}.group_state: {error}") from None
    return configuration_of(robot, f"{end}.group_state", values)


def _last_configuration(what: str, path: Path, robot: RobotModel) -> FloatArray:
    """Return where a trajectory file ends: exactly what its trajectory has at its duration."""
    try:
        trajectory = read_trajectory(path)
    except TrajectoryError as error:
        raise ProblemError(f"{what}: {error}") from None
    columns = {name: k for k, name in enumerate(trajectory.joint_names)}
    missing = [name for name in robot.joint_names if name not in columns]
    if missing:
        raise ProblemError(
            f"{what}: {path} has no joint {', '.join(missing)}; its joints are {', '.join(columns)}"
        )
    last: FloatArray = trajectory.position(trajectory.duration)
    return last[[columns[name] for name in robot.joint_names]]


# ---- Planning problems read from files and from nested dictionaries.


def load_problem(
    name: str | Path,
    directory: str | Path = ".",
    *,
    reads_tube: bool = True,
    changes: Mapping[str, Any] | None = None,
) -> PlanningProblem:
    """Read a problem file, its robot and its robot's collision geometry.

    Args:
        name: A path, or `example:ROBOT/NAME` for a bundled problem.
        directory: Where a relative path starts.
        reads_tube: False: whether the file has a tube or not, the tool may be anywhere, and the
            goal may be a tool position, the tube's last point.
        changes: Other values by field path, such as `{"obstacles.wall.position": [0.6, 0, 0.2]}`;
            "x0.5" scales every number there.

    Raises:
        ProblemError: The file contradicts its format, itself or its robot.
        RobotError: The robot cannot be planned with.
    """
    path = find_problem(name, given_path("directory", directory))
    called = f"{path.resolve().parent.name}/{path.stem}"
    tube_of = None if reads_tube else _tube_anywhere
    return build_problem(
        read_problem_fields(path, changes), path.parent, called, str(path), tube_of
    )


def parse_problem(
    data: Mapping[str, Any],
    directory: str | Path = ".",
    name: str = "problem",
    *,
    reads_tube: bool = True,
    changes: Mapping[str, Any] | None = None,
) -> PlanningProblem:
    """Build a problem from what a problem file holds, as dictionaries and lists.

    Args:
        data: The contents of a problem file.
        directory: Where its relative paths start.
        name: What messages and plots call it.
        reads_tube: As for `load_problem`.
        changes: As for `load_problem`.

    Raises:
        ProblemError: As `load_problem`.
        RobotError: As `load_problem`.
    """
    tube_of = None if reads_tube else _tube_anywhere
    folder = given_path("directory", directory)
    layers = ProblemLayers.of(data, folder, name)
    return build_problem(checked_layers(layers, changes), folder, name, name, tube_of)


def build_problem(
    fields: ProblemFields,
    directory: Path,
    name: str,
    source: str,
    tube_of: Callable[[ProblemFields, RobotModel, Path], Tube] | None = None,
    like: PlanningProblem | None = None,
) -> PlanningProblem:
    """Build a problem of the fields of its file, with its collision geometry.

    Args:
        fields: What the file holds.
        directory: Where its relative paths start.
        name: What messages and plots call it.
        source: What messages about its fields begin with.
        tube_of: Makes the tube; None: it is the file's.
        like: A problem of the same robot among the same solids, which are shared; None: they are
            built.

    Raises:
        ProblemError: As `load_problem`.
        RobotError: As `load_problem`.
    """
    try:
        robot = robot_of(fields, directory) if like is None else like.robot
        tube = (tube_of or _tube)(fields, robot, directory)
        segments = int(tube.numbers[-1]) if tube_of is None else None
        problem = PlanningProblem(
            robot=robot,
            tube=tube,
            start=end_of("start", fields.start, fields, robot, directory),
            goal=end_of("goal", fields.goal, fields, robot, directory),
            **clearances_of(fields.clearance),
            contacts=contacts_of(fields.contacts, segments),
            **(solids_of(fields, robot, directory) if like is None else like.solids),
            objective=_objective(fields.objective),
            period=fields.period,
            robustness=_robustness(fields.robustness),
            name=name,
        )
        _ = problem.collision  # built here: planning starts from loaded geometry
    except (ProblemError, RobotError) as error:
        raise error.within(source) from None
    return problem


def solids_of(fields: ProblemFields, robot: RobotModel, directory: Path) -> dict[str, Any]:
    """Return the arguments of a problem on what may collide.

    Raises:
        ProblemError: A mesh cannot be read, or a solid contradicts itself.
    """
    folders = robot.package_dirs
    return {
        "obstacles": tuple(obstacle_of(each, directory, folders) for each in fields.obstacles),
        "attached": tuple(attached_of(each, directory, folders) for each in fields.robot.attached),
        "self_collision": fields.collision.self_,
        "ignore_collisions": (*fields.collision.ignore, *_srdf_pairs(fields, robot, directory)),
    }


def robot_of(problem: ProblemFields, directory: Path) -> RobotModel:
    """Return the arm of a problem file whose relative paths start in a directory.

    Raises:
        RobotError: It cannot be planned with.
    """
    return load_robot(**robot_arguments(problem.robot, directory))


def points_of(fields: TubeFields, directory: Path) -> dict[str, Any]:
    """Return points, radius and orientations, from the problem file or from its file of points.

    Args:
        fields: What the problem file holds.
        directory: Where its relative paths start.

    Raises:
        ProblemError: One of them is given in neither, or in both.
    """
    given: dict[str, Any] = {"radius": fields.radius, "orientations": fields.orientations}
    points: Any = fields.points
    if isinstance(points, str):
        read = read_points(directory / points)
        for key, values in (("radius", read.radius), ("orientations", read.orientations)):
            if values is not None and given[key] is not None:
                raise ProblemError(
                    f"tube.{key} is given, and {points} has it too; leave out one of them"
                )
            given[key] = given[key] if values is None else values
        points = read.points
    if given["radius"] is None and not fields.cross_section:
        raise ProblemError(
            f"tube.radius is required: give it here or as a column radius of {fields.points}"
        )
    return {"points": points, **given}


def robot_arguments(fields: RobotFields, directory: Path) -> dict[str, Any]:
    """Return the arguments by which `load_robot` and `robot_info` take the arm of a problem file.

    Raises:
        RobotError: A number is out of its bounds, or a file of limits is missing or malformed.
    """
    payload = None if fields.payload is None else Payload(**fields.payload.model_dump())
    return {
        "urdf": fields.urdf,
        "tool_frame": fields.tool_frame,
        "joints": fields.joints,
        "locked_joints": fields.locked_joints,
        "tool_offset": ToolOffset(**fields.tool_offset.model_dump()),
        "base": None if fields.base is None else BasePose(**fields.base.model_dump()),
        "gravity": fields.gravity,
        "payload": payload,
        "limits": _given_limits(fields, directory),
        "motors": motors_of(fields.motors),
        "package_dirs": fields.package_dirs,
        "xacro_args": fields.xacro_args,
        "directory": directory,
    }


def _given_limits(fields: RobotFields, directory: Path) -> list[LimitOverrides | LimitLayer]:
    """Return what is given of limits, the later ones above."""
    folders = tuple(directory / folder for folder in fields.package_dirs)
    given: list[LimitOverrides | LimitLayer] = []
    if fields.limits_file is not None:
        given.append(read_limits_file(find_limits_file(fields.limits_file, directory, folders)))
    presets = [fields.preset] if isinstance(fields.preset, str) else fields.preset or []
    given += [read_preset(name, directory) for name in presets]
    return [*given, limits_of(fields.limits)]


def _tube(fields: ProblemFields, robot: RobotModel, directory: Path) -> Tube:
    if fields.tube is None:
        raise ProblemError(
            "tube is required; `tubeplanner route` finds one from start, goal and obstacles"
        )
    if fields.goal is not None and None not in (fields.goal.position, fields.goal.seed):
        raise ProblemError(
            "goal.seed beside goal.position is for `tubeplanner route`, which finds joints for it; "
            "in a tube they are open: leave out the seed"
        )
    clearance = segment_clearances(fields.clearance)
    given = fields.tube.model_dump() | points_of(fields.tube, directory)
    return Tube(**given, clearance=clearance)


def _tube_anywhere(fields: ProblemFields, robot: RobotModel, directory: Path) -> Tube:
    """Return the tube that lets the tool be anywhere, from its start to its goal."""
    if segment_clearances(fields.clearance) is not None:
        raise ProblemError(
            "clearance.segments belongs to a tube, and one is to be found here; give "
            "clearance.default, and clearance.pairs where it is not the same"
        )
    start = _tool_at("start", end_of("start", fields.start, fields, robot, directory), robot)
    if fields.goal is None:
        raise ProblemError("goal is required: joints, or the position of the tool")
    goal = end_of("goal", fields.goal, fields, robot, directory)
    if isinstance(goal, Seed | GoalRegion):
        if fields.goal.position is None:
            raise ProblemError("goal.seed belongs to a position; give goal.position or goal.joints")
        return Tube.anywhere(start, np.array(fields.goal.position))
    return Tube.anywhere(start, _tool_at("goal", goal, robot))


def _tool_at(end: str, given: Any, robot: RobotModel) -> FloatArray:
    """Return where the tool is (3,) [m] at a start or goal that is a configuration or a pose."""
    if isinstance(given, Seed):
        raise ProblemError(f"{end}.joints is required: a seed belongs to the first point of a tube")
    if isinstance(given, ToolPose):
        return given.position
    return robot.tool_position(configuration_of(robot, end, given)[None])[0]


def _objective(fields: ObjectiveFields | None) -> Objective | None:
    return None if fields is None else Objective(**fields.model_dump())


def _robustness(fields: RobustnessFields | None) -> Robustness | None:
    return None if fields is None else Robustness(**fields.model_dump())


def end_of(
    end: str,
    given: EndpointFields | None,
    fields: ProblemFields,
    robot: RobotModel,
    directory: Path,
) -> Any:
    """Return start or goal as a `PlanningProblem` takes it; None: it is left open.

    Args:
        end: Which of them: start or goal.
        given: What the file has for it.
        fields: All that the file holds.
        robot: Its arm.
        directory: Where its relative paths start.

    Raises:
        ProblemError: It is given in several ways or in none, or what it names is not there.
    """
    if given is None:
        return None
    if given.position is None and (given.tolerance or given.rotation_tolerance is not None):
        which = "tolerance" if given.tolerance else "rotation_tolerance"
        raise ProblemError(f"{end}.{which} is for goal.position, which is not given; leave it out")
    named = named_endpoint(end, given, robot, _srdf(fields, directory), directory)
    return _endpoint(end, given) if named is None else named


def _endpoint(end: str, fields: EndpointFields) -> Any:
    given = [key for key in ("joints", "seed") if getattr(fields, key) is not None]
    if fields.position is not None and (end == "start" or "joints" in given):
        why = "start takes joints" if end == "start" else "it is the one of goal.joints"
        raise ProblemError(f"{end}.position is not to be given: {why}")
    if fields.position is not None and not given:
        return GoalRegion(np.array(fields.position), fields.tolerance, fields.rotation_tolerance)
    if len(given) != 1:
        raise ProblemError(
            f"{end} takes either joints or seed (or pose, group_state, trajectory); it has "
            f"{'both' if given else 'neither'}"
        )
    return _values(fields.joints) if fields.joints is not None else Seed(_values(fields.seed))


def _values(values: JointValues | None) -> Any:
    return values if isinstance(values, dict) else np.array(values, dtype=float)


def _srdf_pairs(fields: ProblemFields, robot: RobotModel, directory: Path) -> list[tuple[str, str]]:
    """Return the pairs that the SRDF allows to touch, of links that this robot has."""
    path = _srdf(fields, directory)
    if path is None:
        return []
    return [pair for pair in read_allowed_pairs(path) if set(pair) <= robot.link_body.keys()]


def _srdf(fields: ProblemFields, directory: Path) -> Path | None:
    """Return the path of the SRDF, if there is one."""
    if fields.robot.srdf is None:
        return None
    folders = tuple(directory / folder for folder in fields.robot.package_dirs)
    return find_description(fields.robot.srdf, directory, folders)
