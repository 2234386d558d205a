"""Trajectory files: JSON, CSV, ROS. An output file is replaced whole or not at all."""

import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

from tubeplanner.errors import OutputError, TrajectoryError
from tubeplanner.robot import RobotModel
from tubeplanner.trajectory import JointTrajectory

TRAJECTORY_FORMAT = "tubeplanner/trajectory"
TRAJECTORY_VERSION = 1


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
    try:
        fields = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise TrajectoryError(f"trajectory file {path} cannot be read as JSON: {error}") from error
    if not isinstance(fields, dict) or fields.get("format") != TRAJECTORY_FORMAT:
        raise TrajectoryError(f"{path} is no trajectory file: format must be {TRAJECTORY_FORMAT}")
    if fields.get("version") != TRAJECTORY_VERSION:
        raise TrajectoryError(
            f"{path}: version {fields.get('version')} cannot be read; this is version "
            f"{TRAJECTORY_VERSION}"
        )
    for key in ("joint_names", "breakpoints", "coefficients"):
        if not isinstance(fields.get(key), list):
            raise TrajectoryError(f"{path}: {key} is missing or no list")
    try:
        trajectory = JointTrajectory(*(fields[key] for key in _PARTS))
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    if abs(fields.get("duration", trajectory.duration) - trajectory.duration) > 1e-9:
        raise TrajectoryError(
            f"{path}: duration {fields['duration']} s contradicts the last breakpoint, "
            f"{trajectory.duration} s"
        )
    return trajectory


_PARTS = ("joint_names", "breakpoints", "coefficients")


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


def require_writable(path: Path) -> None:
    """Raise unless a file could be written there, before work is spent on its contents.

    Raises:
        OutputError: The folder does not exist or cannot be written to, or the path is a folder.
    """
    if path.is_dir():
        raise OutputError(f"output {path} is a folder; name a file")
    if not path.parent.is_dir():
        raise OutputError(f"output {path}: the folder {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"output {path}: the folder {path.parent} cannot be written to")


def write_text(path: Path, text: str) -> None:
    """Replace a file by a text, whole or not at all.

    Raises:
        OutputError: It could not be written; what was there before is untouched.
    """
    write_whole(path, lambda stream: stream.write(text.encode()))


def write_whole(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Replace a file by what `write` puts into a stream, whole or not at all.

    Raises:
        OutputError: As `write_text`.
    """
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(
            dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as stream:
            temporary = Path(stream.name)
            write(stream)
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"output {path} could not be written: {error}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _ros_list(values: list[float]) -> str:
    # YAML 1.1 readers take 1e-05 for a string: a number needs its point.
    words = [repr(value) for value in values]
    words = [word if "." in word else word.replace("e", ".0e") for word in words]
    return "[" + ", ".join(words) + "]"
