"""Trajectories as text: our JSON, CSV, ROS; and our JSON read back."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import TrajectoryError
from tubeplanner.robot import RobotModel
from tubeplanner.trajectory import JointTrajectory

TRAJECTORY_FORMAT = "tubeplanner/trajectory"
TRAJECTORY_VERSION = 1
_DURATION_TOLERANCE = 1e-9  # [s]


def trajectory_json(trajectory: JointTrajectory, **more: Any) -> str:
    """Return a trajectory file.

    Args:
        trajectory: What to write.
        more: Further keys, such as `method`.
    """
    fields = {
        "format": TRAJECTORY_FORMAT,
        "version": TRAJECTORY_VERSION,
        "joint_names": list(trajectory.joint_names),
        "duration": trajectory.duration,
        "breakpoints": trajectory.breakpoints.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
        **more,
    }
    return json.dumps(fields, allow_nan=False) + "\n"


def read_trajectory(path: Path) -> JointTrajectory:
    """Read a trajectory file.

    Raises:
        TrajectoryError: It cannot be read, is no trajectory file, or contradicts itself.
    """
    fields = _read_fields(path)
    try:
        trajectory = JointTrajectory(
            _names(fields), _numbers(fields, "breakpoints"), _numbers(fields, "coefficients")
        )
        duration = float(_numbers(fields, "duration").item()) if "duration" in fields else None
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    except ValueError:
        raise TrajectoryError(f"{path}: duration must be one number") from None
    if duration is not None and not abs(duration - trajectory.duration) <= _DURATION_TOLERANCE:
        raise TrajectoryError(
            f"{path}: duration {duration} s contradicts the last breakpoint, "
            f"{trajectory.duration} s"
        )
    return trajectory


def _read_fields(path: Path) -> dict[str, Any]:
    try:
        fields = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise TrajectoryError(f"trajectory file {path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise TrajectoryError(
            f"trajectory file {path} is no JSON ({error}); only tubeplanner's own JSON is read"
        ) from error
    if not isinstance(fields, dict) or fields.get("format") != TRAJECTORY_FORMAT:
        raise TrajectoryError(f"{path} is no trajectory file: format must be {TRAJECTORY_FORMAT}")
    version = fields.get("version")
    if version != TRAJECTORY_VERSION or isinstance(version, bool):
        raise TrajectoryError(f"{path}: version is {version!r}; {TRAJECTORY_VERSION} can be read")
    return fields


def _names(fields: dict[str, Any]) -> list[str]:
    names = fields.get("joint_names")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TrajectoryError(f"joint_names is {names!r:.60}; it must be a list of names")
    return names


def _numbers(fields: dict[str, Any], key: str) -> FloatArray:
    """Return a field as an array of numbers; texts, truth values and gaps are no numbers."""
    try:
        array = np.array(fields.get(key))
    except ValueError:
        raise TrajectoryError(f"{key} has rows of different lengths") from None
    if array.dtype.kind not in "iuf" or array.size == 0:
        raise TrajectoryError(f"{key} is {fields.get(key)!r:.60}; it must be numbers")
    return array.astype(np.float64)


def trajectory_csv(robot: RobotModel, trajectory: JointTrajectory, rate: float) -> str:
    """Return samples as CSV: time, positions, velocities, accelerations, efforts.

    Args:
        robot: For the efforts.
        trajectory: In the robot's joint order.
        rate: [Hz].
    """
    samples = trajectory.sample(rate)
    effort = robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    quantities = ("position", "velocity", "acceleration", "effort")
    header = ["time"] + [f"{name}.{what}" for what in quantities for name in robot.joint_names]
    table = np.column_stack(
        [samples.time, samples.position, samples.velocity, samples.acceleration, effort]
    )
    rows = [",".join(map(repr, row)) for row in table.tolist()]
    return "\n".join([",".join(header), *rows]) + "\n"


def trajectory_ros(trajectory: JointTrajectory, rate: float) -> str:
    """Return samples as a trajectory_msgs/JointTrajectory in YAML, without efforts.

    Args:
        trajectory: What to write.
        rate: [Hz].
    """
    samples = trajectory.sample(rate)
    lines = ["joint_names:", *(f"- {json.dumps(name)}" for name in trajectory.joint_names)]
    lines.append("points:")
    rows = zip(
        samples.time.tolist(),
        samples.position.tolist(),
        samples.velocity.tolist(),
        samples.acceleration.tolist(),
        strict=True,
    )
    for time, position, velocity, acceleration in rows:
        nanoseconds = round(time * 1e9)
        lines.append(f"- positions: {_ros_list(position)}")
        lines.append(f"  velocities: {_ros_list(velocity)}")
        lines.append(f"  accelerations: {_ros_list(acceleration)}")
        seconds, rest = divmod(nanoseconds, 10**9)
        lines.append(f"  time_from_start: {{sec: {seconds}, nanosec: {rest}}}")
    return "\n".join(lines) + "\n"


def _ros_list(values: list[float]) -> str:
    # YAML 1.1 readers take 1e-05 for a string: a number needs its point.
    words = [repr(value) for value in values]
    words = [word if "." in word else word.replace("e", ".0e") for word in words]
    return "[" + ", ".join(words) + "]"
