"""Planning problems read from files and from nested dictionaries."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.collision.obstacle import AttachedSolid, Obstacle, placement_of
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.problem.joint_values import configuration_of
from tubeplanner.problem.limit_values import limits_of, motors_of
from tubeplanner.problem.moveit_limits import read_limits_file
from tubeplanner.problem.objective import Objective
from tubeplanner.problem.point_file import read_points
from tubeplanner.problem.presets import read_preset
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.problem.problem_fields import changed_problem, read_problem_fields
from tubeplanner.problem.problem_format import (
    AttachedFields,
    EndpointFields,
    JointValues,
    ObjectiveFields,
    ObstacleFields,
    ProblemFields,
    RobotFields,
    RobustnessFields,
    TubeFields,
    check_problem_fields,
)
from tubeplanner.problem.robustness import Robustness
from tubeplanner.resources import find_description, find_limits_file, find_mesh, find_problem
from tubeplanner.robot.limit_layers import LimitLayer
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.pinocchio_model import Payload, ToolOffset
from tubeplanner.robot.robot_loader import load_robot
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.srdf import read_allowed_pairs
from tubeplanner.tube.tube import Tube


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
    path = find_problem(name, Path(directory))
    called = f"{path.resolve().parent.name}/{path.stem}"
    tube_of = _tube if reads_tube else _tube_anywhere
    return _build(read_problem_fields(path, changes), path.parent, called, str(path), tube_of)


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
    tube_of = _tube if reads_tube else _tube_anywhere
    fields = check_problem_fields(changed_problem(data, changes), name)
    return _build(fields, Path(directory), name, name, tube_of)


def _build(
    fields: ProblemFields,
    directory: Path,
    name: str,
    source: str,
    tube_of: Callable[[ProblemFields, RobotModel, Path], Tube],
) -> PlanningProblem:
    try:
        robot = robot_of(fields, directory)
        problem = PlanningProblem(
            robot=robot,
            tube=tube_of(fields, robot, directory),
            start=_endpoint("start", fields.start),
            goal=None if fields.goal is None else _endpoint("goal", fields.goal),
            obstacles=tuple(
                _obstacle(obstacle, directory, robot.package_dirs) for obstacle in fields.obstacles
            ),
            attached=tuple(
                _attached(solid, directory, robot.package_dirs) for solid in fields.robot.attached
            ),
            clearance=fields.clearance,
            self_collision=fields.collision.self_,
            ignore_collisions=(*fields.collision.ignore, *_srdf_pairs(fields, robot, directory)),
            objective=_objective(fields.objective),
            period=fields.period,
            robustness=_robustness(fields.robustness),
            name=name,
        )
        _ = problem.collision  # built here: planning starts from loaded geometry
    except (ProblemError, RobotError) as error:
        raise type(error)(f"{source}: {error}") from None
    return problem


def robot_of(problem: ProblemFields, directory: Path) -> RobotModel:
    """Return the arm of a problem file whose relative paths start in a directory.

    Raises:
        RobotError: It cannot be planned with.
    """
    return load_robot(**robot_arguments(problem.robot, directory))


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
        "gravity": fields.gravity,
        "payload": payload,
        "limits": _given_limits(fields, directory),
        "motors": motors_of(fields.motors),
        "package_dirs": fields.package_dirs,
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
    if fields.goal is not None and fields.goal.position is not None:
        raise ProblemError("goal.position is for `tubeplanner route`, which finds joints for it")
    return Tube(**(fields.tube.model_dump() | _points(fields.tube, directory)))


def _points(fields: TubeFields, directory: Path) -> dict[str, Any]:
    """Return points, radius and orientations, from the problem file or from its file of points.

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


def _tube_anywhere(fields: ProblemFields, robot: RobotModel, directory: Path) -> Tube:
    """Return the tube that lets the tool be anywhere, from its start to its goal."""
    if fields.start.joints is None:
        raise ProblemError("start.joints is required: a seed belongs to the first point of a tube")
    if fields.goal is None:
        raise ProblemError("goal is required: joints, or the position of the tool")
    if fields.goal.joints is None and fields.goal.position is None:
        raise ProblemError("goal.seed belongs to a position; give goal.position or goal.joints")
    begin = configuration_of(robot, "start", _values(fields.start.joints))
    if fields.goal.joints is None:
        return Tube.anywhere(robot.tool_position(begin[None])[0], np.array(fields.goal.position))
    end = configuration_of(robot, "goal", _values(fields.goal.joints))
    return Tube.anywhere(*robot.tool_position(np.array([begin, end])))


def _objective(fields: ObjectiveFields | None) -> Objective | None:
    return None if fields is None else Objective(**fields.model_dump())


def _robustness(fields: RobustnessFields | None) -> Robustness | None:
    return None if fields is None else Robustness(**fields.model_dump())


def _endpoint(end: str, fields: EndpointFields) -> Any:
    given = [key for key in ("joints", "seed") if getattr(fields, key) is not None]
    if fields.position is not None and (end == "start" or "joints" in given):
        why = "start takes joints" if end == "start" else "it is the one of goal.joints"
        raise ProblemError(f"{end}.position is not to be given: {why}")
    if fields.position is not None and not given:
        return None
    if len(given) != 1:
        raise ProblemError(
            f"{end} takes either joints or seed; it has {'both' if given else 'neither'}"
        )
    return _values(fields.joints) if fields.joints is not None else Seed(_values(fields.seed))


def _values(values: JointValues | None) -> Any:
    return values if isinstance(values, dict) else np.array(values, dtype=float)


def _srdf_pairs(fields: ProblemFields, robot: RobotModel, directory: Path) -> list[tuple[str, str]]:
    """Return the pairs that the SRDF allows to touch, of links that this robot has."""
    if fields.robot.srdf is None:
        return []
    folders = tuple(directory / folder for folder in fields.robot.package_dirs)
    path = find_description(fields.robot.srdf, directory, folders)
    return [pair for pair in read_allowed_pairs(path) if set(pair) <= robot.link_body.keys()]


def _attached(fields: AttachedFields, directory: Path, folders: tuple[Path, ...]) -> AttachedSolid:
    solid = _obstacle(fields, directory, folders)
    return AttachedSolid(solid.name, solid.shapes, tuple(fields.touch_links), solid.contents)


def _obstacle(fields: ObstacleFields, directory: Path, folders: tuple[Path, ...]) -> Obstacle:
    kinds = ("box", "sphere", "cylinder", "capsule", "mesh")
    given = [kind for kind in kinds if getattr(fields, kind) is not None]
    if len(given) != 1:
        raise ProblemError(
            f"obstacles: '{fields.name}' must have exactly one of {', '.join(kinds)}; "
            f"it has {', '.join(given) or 'none'}"
        )
    try:
        placement = placement_of(fields.position, fields.rpy, fields.quaternion)
    except ProblemError as error:
        raise ProblemError(f"obstacles: '{fields.name}': {error}") from None
    if fields.mesh is not None:
        try:
            path = find_mesh(fields.mesh, directory / "the problem file", folders)
            return Obstacle.mesh(fields.name, path, placement, fields.scale)
        except RobotError as error:
            raise ProblemError(f"obstacles: '{fields.name}': {error}") from None
    if fields.scale != 1.0:
        raise ProblemError(f"obstacles: '{fields.name}': scale belongs to a mesh alone; remove it")
    sizes = getattr(fields, given[0])
    if given[0] in ("cylinder", "capsule"):
        return getattr(Obstacle, given[0])(fields.name, *sizes, placement)
    return getattr(Obstacle, given[0])(fields.name, sizes, placement)
