"""Planning problems read from files and from nested dictionaries."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arguments import given_path
from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.problem.clearance_fields import (
    clearances_of,
    contacts_of,
    segment_clearances,
)
from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.problem.joint_values import configuration_of
from tubeplanner.problem.limit_values import limits_of, motors_of
from tubeplanner.problem.moveit_limits import read_limits_file
from tubeplanner.problem.named_endpoint import named_endpoint
from tubeplanner.problem.objective import Objective
from tubeplanner.problem.point_file import read_points
from tubeplanner.problem.presets import read_preset
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.problem.problem_fields import checked_layers, read_problem_fields
from tubeplanner.problem.problem_format import (
    EndpointFields,
    JointValues,
    ObjectiveFields,
    ProblemFields,
    RobotFields,
    RobustnessFields,
    TubeFields,
)
from tubeplanner.problem.problem_layers import ProblemLayers
from tubeplanner.problem.robustness import Robustness
from tubeplanner.problem.solid_fields import attached_of, obstacle_of
from tubeplanner.problem.tool_pose import ToolPose
from tubeplanner.resources import find_description, find_limits_file, find_problem
from tubeplanner.robot.base_pose import BasePose
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
