"""A start or goal that a problem file gives without joint values: by a pose, a name or a file."""

from pathlib import Path

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.obstacle import placement_of
from tubeplanner.errors import ProblemError, RobotError, TrajectoryError
from tubeplanner.problem.joint_values import configuration_of
from tubeplanner.problem.pose_fields import PoseFields
from tubeplanner.problem.problem_format import EndpointFields
from tubeplanner.problem.tool_pose import ToolPose
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.srdf import read_group_state
from tubeplanner.trajectory.trajectory_file import read_trajectory

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
