"""Problems from files and dictionaries: load_problem, parse_problem; their parts from fields."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import checked_path
from tubeplanner.errors import ProblemError, RobotError, TrajectoryError, faults_of
from tubeplanner.fields import Section
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, placement_of
from tubeplanner.geometry.tube.points import given_route
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.resources import PackageDirs, find_limits_file, find_mesh, find_problem
from tubeplanner.robot.joint_limits import LimitLayer
from tubeplanner.robot.loader import load_robot, package_folders
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.notes import angles_of, doubts
from tubeplanner.robot.overrides import LimitOverrides, MotorOverrides, limits_of
from tubeplanner.robot.pinocchio_model import BasePose, Payload, ToolOffset
from tubeplanner.task.demands import Objective, Robustness
from tubeplanner.task.endpoints import GoalRegion, Seed, ToolPose, configuration_of
from tubeplanner.task.field_changes import checked_layers, read_problem_fields
from tubeplanner.task.holding import require_carried
from tubeplanner.task.includes import ProblemLayers
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import (
    AttachedFields,
    EndpointFields,
    JointValues,
    ObstacleFields,
    PoseFields,
    ProblemFields,
    RobotFields,
    RobustnessFields,
    TriangleFields,
    TubeFields,
    clearances_of,
    contacts_of,
    holdings_from,
    segment_clearances,
)
from tubeplanner.task.side_files import read_limits_file, read_points, read_preset, read_robustness

_Value = TypeVar("_Value")


def load_problem(
    name: str | Path,
    directory: str | Path = ".",
    *,
    reads_tube: bool | None = True,
    changes: Mapping[str, Any] | None = None,
) -> PlanningProblem:
    """Read a problem file, its robot and its robot's collision geometry.

    Args:
        name: A path, or `example:ROBOT/NAME` for a bundled problem.
        directory: Where a relative path starts.
        reads_tube: False: a tube of the file is ignored, the tool may be anywhere, and the goal may
            be a tool position, the tube's last point. None: the same for a file without a tube,
            which then needs no goal.
        changes: Other values by field path, such as `{"obstacles.wall.position": [0.6, 0, 0.2]}`;
            "x0.5" scales every number below the path.

    Raises:
        ProblemError: The file contradicts its format, itself or its robot.
        RobotError: The robot cannot be planned with.
    """
    path = find_problem(name, checked_path("directory", directory))
    label = f"{path.resolve().parent.name}/{path.stem}"
    fields = read_problem_fields(path, changes)
    return build_problem(fields, path.parent, label, str(path), _tube_reader(fields, reads_tube))


def parse_problem(
    data: Mapping[str, Any],
    directory: str | Path = ".",
    name: str = "problem",
    *,
    reads_tube: bool | None = True,
    changes: Mapping[str, Any] | None = None,
) -> PlanningProblem:
    """Build a problem from the content of a problem file, as dictionaries and lists.

    Args:
        data: Content of a problem file.
        directory: Where its relative paths start.
        name: Name in messages and plots.
        reads_tube: As for `load_problem`.
        changes: As for `load_problem`.

    Raises:
        ProblemError: As `load_problem`.
        RobotError: As `load_problem`.
    """
    folder = checked_path("directory", directory)
    fields: ProblemFields = checked_layers(ProblemLayers.of(data, folder, name), changes)
    return build_problem(fields, folder, name, name, _tube_reader(fields, reads_tube))


def _tube_reader(
    fields: ProblemFields, reads_tube: bool | None
) -> Callable[[ProblemFields, RobotModel, Path], Tube] | None:
    """Return the reader of a problem's tube, as `load_problem` says of `reads_tube`."""
    needs_tube = fields.tube is not None if reads_tube is None else reads_tube
    return None if needs_tube else partial(tube_anywhere, needs_goal=reads_tube is not None)


def build_problem(
    fields: ProblemFields,
    directory: Path,
    name: str,
    source: str,
    tube_of: Callable[[ProblemFields, RobotModel, Path], Tube] | None = None,
    like: PlanningProblem | None = None,
    *,
    is_part: bool = False,
) -> PlanningProblem:
    """Build a problem from fields, with its collision geometry.

    Robot and solids are those of the problem `like`, if any; without `tube_of` the tube is the
    file's. The source begins messages. A part is a move, at whose ends the arm may not stop.
    """
    try:
        robot = robot_of(fields, directory) if like is None else like.robot
        tube = (tube_of or _tube)(fields, robot, directory)
        segments = int(tube.numbers[-1]) if tube_of is None else None
        solids = solids_of(fields, robot, directory) if like is None else dict(like.solids)
        notes, holding = solids.pop("notes", ()), holdings_from(fields.holding)
        require_carried(holding, robot.payload, "robot.payload")
        problem = PlanningProblem(
            robot=robot,
            tube=tube,
            start=end_of("start", fields.start, robot, directory),
            goal=end_of("goal", fields.goal, robot, directory),
            **clearances_of(fields.clearance),
            contacts=contacts_of(fields.contacts, segments),
            **solids,
            objective=_built(Objective, fields.objective),
            period=fields.period,
            robustness=_robustness(fields.robustness, directory),
            holding=holding,
            name=name,
            notes=(*doubts(angles_of(fields.model_dump())), *notes),
            _is_part=is_part,
        )
        _ = problem.collision  # built here, so that planning starts with loaded geometry
    except (ProblemError, RobotError) as error:
        raise error.within(source) from None
    return problem


def _built(kind: type[_Value], fields: Section | None) -> _Value | None:
    """Return the value of a kind with the arguments of fields; None without fields."""
    return None if fields is None else kind(**fields.model_dump())


def _robustness(fields: RobustnessFields | None, directory: Path) -> Robustness | None:
    """Return the errors and the controller of fields, above those of their preset."""
    if fields is None:
        return None
    below = {} if fields.preset is None else read_robustness(fields.preset, directory)
    return Robustness(**(below | fields.model_dump(exclude={"preset"}, exclude_unset=True)))


# ---- The robot.


def robot_of(problem: ProblemFields, directory: Path) -> RobotModel:
    """Return the arm of a problem file whose relative paths start in a directory."""
    return load_robot(**robot_arguments(problem.robot, directory))


def robot_arguments(fields: RobotFields, directory: Path) -> dict[str, Any]:
    """Return the arguments of `load_robot` and `robot_info` for the arm of a problem file."""
    return {
        "urdf": fields.urdf,
        "tool_frame": fields.tool_frame,
        "joints": fields.joints,
        "locked_joints": fields.locked_joints,
        "tool_offset": ToolOffset(**fields.tool_offset.model_dump()),
        "base": _built(BasePose, fields.base),
        "gravity": fields.gravity,
        "payload": _built(Payload, fields.payload),
        "limits": _limit_layers(fields, directory),
        "motors": _built(MotorOverrides, fields.motors),
        "package_dirs": fields.package_dirs,
        "xacro_args": fields.xacro_args,
        "srdf": fields.srdf,
        "directory": directory,
    }


def _limit_layers(fields: RobotFields, directory: Path) -> list[LimitOverrides | LimitLayer]:
    """Return the layers of limits, later layers above."""
    folders = package_folders(fields.package_dirs, directory)
    layers: list[LimitOverrides | LimitLayer] = []
    if fields.limits_file is not None:
        layers.append(read_limits_file(find_limits_file(fields.limits_file, directory, folders)))
    presets = [fields.preset] if isinstance(fields.preset, str) else fields.preset or []
    layers += [read_preset(name, directory) for name in presets]
    return [*layers, limits_of(fields.limits)]


def points_of(fields: TubeFields, directory: Path) -> dict[str, Any]:
    """Return points, radius and orientations of a tube, from its fields or its file of points."""
    arguments: dict[str, Any] = {"radius": fields.radius, "orientations": fields.orientations}
    points: Any = fields.points
    if isinstance(points, str):
        file = read_points(directory / points)
        for key, values in (("radius", file.radius), ("orientations", file.orientations)):
            if values is not None and arguments[key] is not None:
                raise ProblemError(
                    f"tube.{key} is given, and {points} has it too; leave out one of them"
                )
            arguments[key] = arguments[key] if values is None else values
        if file.has_axes and fields.rotation_tolerance is None:
            raise ProblemError(
                f"tube.rotation_tolerance is required beside the tool axes of {points}; "
                "[0.1, 0.1, .inf] lets the tool lean by 0.1 rad and turn freely about its axis"
            )
        points = file.points
    if arguments["radius"] is None and not fields.cross_section:
        raise ProblemError(
            f"tube.radius is required: give it here or as a column radius of {fields.points}"
        )
    return {"points": points, **arguments}


# Fields that a tube may have beside a route.
_BESIDE_ROUTE = ("route", "joint_signs", "tool_speed", "tool_acceleration")


def _tube(fields: ProblemFields, robot: RobotModel, directory: Path) -> Tube:
    if fields.tube is None:
        raise ProblemError(
            "tube is required; `tubeplanner route` finds one from start, goal and obstacles"
        )
    if fields.tube.route is not None:
        own = fields.tube.model_dump(exclude_defaults=True)
        for key in own.keys() - set(_BESIDE_ROUTE):
            raise ProblemError(
                f"tube.{key} does not go with tube.route, along which the tool may be anywhere; "
                "leave out one of them"
            )
        rows = enumerate(fields.tube.route)
        corners = [configuration_of(robot, f"tube.route[{k}]", q).tolist() for k, q in rows]
        route = given_route(corners)
        return Tube.anywhere(*robot.tool_position(route[[0, -1]]), **own | {"route": route})
    if fields.goal is not None and None not in (fields.goal.position, fields.goal.seed):
        raise ProblemError(
            "goal.seed beside goal.position is for `tubeplanner route`, which finds joints for it; "
            "in a tube they are open: leave out the seed"
        )
    arguments = fields.tube.model_dump() | points_of(fields.tube, directory)
    return Tube(**arguments, clearance=segment_clearances(fields.clearance))


def tube_anywhere(
    fields: ProblemFields,
    robot: RobotModel,
    directory: Path,
    *,
    needs_goal: bool = True,
    begin: FloatArray | None = None,
) -> Tube:
    """Return the unbounded tube from the tool's position at the start to that at the goal.

    `begin` is the position (3,) at the start [m]; None: the one of the fields.
    """
    if segment_clearances(fields.clearance) is not None:
        raise ProblemError(
            "clearance.segments belongs to a tube, and one is to be found here; give "
            "clearance.default, and clearance.pairs where it is not the same"
        )
    start = _tool_at("start", fields.start, robot, directory) if begin is None else begin
    if fields.goal is None:
        if not needs_goal:
            return Tube.anywhere(start, start)
        raise ProblemError("goal is required: joints, or the position of the tool")
    return Tube.anywhere(start, _tool_at("goal", fields.goal, robot, directory))


def _tool_at(end: str, fields: EndpointFields, robot: RobotModel, directory: Path) -> FloatArray:
    """Return the tool's position (3,) [m] at a start or goal, which is no seed alone."""
    value = end_of(end, fields, robot, directory)
    if fields.position is not None:
        return np.array(fields.position)
    if fields.pose is not None:
        return np.array(value.position)
    if fields.seed is not None and end == "start":
        raise ProblemError("start.joints is required: a seed belongs to the first point of a tube")
    if fields.seed is not None:
        raise ProblemError("goal.seed belongs to a position; give goal.position or goal.joints")
    return robot.tool_position(configuration_of(robot, end, value)[None])[0]


# ---- Start and goal.

_ALONE = ("pose", "group_state", "trajectory")
_OTHERS = ("joints", "seed", "position")


def end_of(end: str, fields: EndpointFields | None, robot: RobotModel, directory: Path) -> Any:
    """Return the argument start or goal of a `PlanningProblem`; None: an open goal."""
    if fields is None:
        return None
    if fields.position is None and (fields.tolerance or fields.rotation_tolerance is not None):
        key = "tolerance" if fields.tolerance else "rotation_tolerance"
        raise ProblemError(f"{end}.{key} is for goal.position, which is not given; leave it out")
    keys = [key for key in (*_ALONE, *_OTHERS) if getattr(fields, key) is not None]
    if set(_ALONE) & set(keys):
        if [key for key in keys if key != "seed" or "pose" not in keys] != keys[:1]:
            raise ProblemError(
                f"{end} takes one of joints, seed, {', '.join(_ALONE)}; it has {', '.join(keys)} "
                "(what an included file gives counts: null takes it away)"
            )
        if fields.pose is not None:
            return _tool_pose(end, fields.pose, fields.seed, robot)
        if fields.group_state is not None:
            return _group_state(f"{end}.group_state", fields.group_state, robot)
        return _last_configuration(f"{end}.trajectory", directory / str(fields.trajectory), robot)
    if "position" in keys and (end == "start" or "joints" in keys):
        reason = "start takes joints" if end == "start" else "it is the one of goal.joints"
        raise ProblemError(f"{end}.position is not to be given: {reason}")
    if keys == ["position"]:
        return GoalRegion(np.array(fields.position), fields.tolerance, fields.rotation_tolerance)
    if len({"joints", "seed"} & set(keys)) != 1:
        raise ProblemError(
            f"{end} takes either joints or seed (or pose, group_state, trajectory); it has "
            f"{'both' if keys else 'neither'}"
        )
    q: Any = fields.seed if fields.joints is None else fields.joints
    q = q if isinstance(q, dict) else np.array(q, dtype=float)
    return q if fields.joints is not None else Seed(q)


def _tool_pose(end: str, pose: PoseFields, seed: JointValues | None, robot: RobotModel) -> ToolPose:
    if (pose.rpy is None) == (pose.quaternion is None):
        number = "neither" if pose.rpy is None else "both"
        raise ProblemError(f"{end}.pose takes either quaternion or rpy; it has {number}")
    with faults_of(f"{end}.pose", ProblemError):
        placement = placement_of(pose.position, pose.rpy, pose.quaternion)
    q = None if seed is None else configuration_of(robot, f"{end}.seed", seed)
    return ToolPose(placement, q)


def _group_state(what: str, name: str, robot: RobotModel) -> FloatArray:
    """Return the configuration (n,) of a named state of the SRDF."""
    if robot.urdf.srdf is None:
        raise ProblemError(f"{what} '{name}' is one of an SRDF; give robot.srdf")
    with faults_of(what, RobotError):
        values = robot.urdf.srdf.group_state(name, robot.joint_names)
    return configuration_of(robot, what, values)


def _last_configuration(what: str, path: Path, robot: RobotModel) -> FloatArray:
    """Return the configuration (n,) at the end of a trajectory file."""
    from tubeplanner.trajectory.reader import read_trajectory_file

    with faults_of(what, TrajectoryError):
        trajectory = read_trajectory_file(path, robot.joint_names).trajectory
    columns = {name: k for k, name in enumerate(trajectory.joint_names)}
    missing = [name for name in robot.joint_names if name not in columns]
    if missing:
        raise ProblemError(
            f"{what}: {path} has no joint {', '.join(missing)}; its joints are {', '.join(columns)}"
        )
    end = trajectory.position(trajectory.duration)
    return end[[columns[name] for name in robot.joint_names]]


# ---- Solids.


def solids_of(fields: ProblemFields, robot: RobotModel, directory: Path) -> dict[str, Any]:
    """Return the arguments of a problem for its solids, and notes on the files of scenes."""
    folders = robot.package_dirs
    obstacles, attached = list[Obstacle](), list[AttachedSolid]()
    pairs, notes = list(fields.collision.ignore), list[str]()
    for each in fields.obstacles:
        if isinstance(each, ObstacleFields):
            obstacles.append(obstacle_of(each, directory, folders))
            continue
        from tubeplanner.task.moveit_files import solids_of_scene

        with faults_of("obstacles: moveit_scene", ProblemError):
            solids = solids_of_scene(directory / each.moveit_scene, robot)
        obstacles += [obstacle_of(own, directory) for own in solids.obstacles]
        attached += [attached_of(own, directory) for own in solids.attached]
        pairs += solids.allowed_pairs
        notes += solids.notes
    attached[:0] = [attached_of(each, directory, folders) for each in fields.robot.attached]
    srdf = robot.urdf.srdf
    pairs += [] if srdf is None else srdf.allowed_pairs(robot.urdf.links)
    return {
        "obstacles": tuple(obstacles),
        "attached": tuple(attached),
        "self_collision": fields.collision.self_,
        "ignore_collisions": tuple(pairs),
        "notes": tuple(notes),
    }


def obstacle_of(
    fields: ObstacleFields, directory: Path, folders: PackageDirs = (), field: str | None = None
) -> Obstacle:
    """Return the solid of fields, called as a field in messages; None: an obstacle of its name."""
    field = field or f"obstacles: '{fields.name}'"
    kinds = ("box", "sphere", "cylinder", "capsule", "mesh", "points")
    shapes = [kind for kind in kinds if getattr(fields, kind) is not None]
    if len(shapes) != 1:
        raise ProblemError(
            f"{field} must have exactly one of {', '.join(kinds)}; "
            f"it has {', '.join(shapes) or 'none'}"
        )
    with faults_of(field, ProblemError):
        placement = placement_of(fields.position, fields.rpy, fields.quaternion)
    if (fields.points is None) != (fields.size is None):
        reason = "points is" if fields.points is None else "size, the side of the boxes [m], is"
        raise ProblemError(f"{field}: {reason} required beside the other; points take both")
    if isinstance(fields.mesh, TriangleFields):
        triangles = (
            np.array(fields.mesh.vertices, dtype=np.float64).reshape(-1, 3),
            np.array(fields.mesh.triangles, dtype=np.int64).reshape(-1, 3),
        )
        with faults_of(field, RobotError):
            return Obstacle.mesh(fields.name, triangles, placement, fields.scale)
    if fields.mesh is not None:
        with faults_of(field, RobotError):
            path = find_mesh(fields.mesh, directory / "the problem file", folders)
            return Obstacle.mesh(fields.name, path, placement, fields.scale)
    if fields.scale != 1.0:
        raise ProblemError(f"{field}: scale belongs to a mesh alone; remove it")
    if fields.points is not None and fields.size is not None:
        with faults_of(field, ProblemError):
            path = directory / fields.points
            return Obstacle.points(fields.name, path, fields.size, placement)
    sizes = getattr(fields, shapes[0])
    sizes = sizes if shapes[0] in ("cylinder", "capsule") else (sizes,)
    return getattr(Obstacle, shapes[0])(fields.name, *sizes, placement)


def attached_of(
    fields: AttachedFields, directory: Path, folders: PackageDirs = (), field: str | None = None
) -> AttachedSolid:
    """Return the attached solid of fields of a file; arguments as `obstacle_of`."""
    field = field or f"robot.attached: '{fields.name}'"
    solid = obstacle_of(fields, directory, folders, field)
    return AttachedSolid(solid.name, solid.shapes, tuple(fields.touch_links), solid.contents)
