"""Trajectories as text: our JSON, CSV, ROS."""

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OutputError, shown
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.trajectory_file import TRAJECTORY_FORMAT, TRAJECTORY_VERSION

_FORMULA_BEGINS = ("=", "+", "-", "@")


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


def trajectory_csv(
    joint_names: Sequence[str], samples: TrajectorySamples, effort: FloatArray | None = None
) -> str:
    """Return samples as CSV: time, positions, velocities, accelerations and, if given, efforts.

    Args:
        joint_names: In the order of the samples.
        samples: What to write.
        effort: At the samples, shape (N, n) [N m or N]; None: no columns of them.

    Raises:
        OutputError: A joint's name would be a formula to spreadsheets.
    """
    require_no_formula(joint_names)
    columns = {
        "position": samples.position,
        "velocity": samples.velocity,
        "acceleration": samples.acceleration,
    }
    if effort is not None:
        columns["effort"] = effort
    header = ["time"] + [f"{name}.{what}" for what in columns for name in joint_names]
    table = np.column_stack([samples.time, *columns.values()])
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerow(header)
    stream.writelines(",".join(map(repr, row)) + "\n" for row in table.tolist())
    return stream.getvalue()


def require_no_formula(joint_names: Sequence[str]) -> None:
    """Raise unless spreadsheets take all names of joints, as columns of a CSV file, for text.

    Raises:
        OutputError: A name begins as a formula does, which they would run.
    """
    for name in joint_names:
        if name.lstrip().startswith(_FORMULA_BEGINS):
            raise OutputError(
                f"CSV: the column of joint {shown(name)} would begin with '{name.lstrip()[0]}', "
                "a formula to spreadsheets; rename the joint, or write JSON or ROS"
            )


def trajectory_ros(joint_names: Sequence[str], samples: TrajectorySamples, *comments: str) -> str:
    """Return samples as a trajectory_msgs/JointTrajectory in YAML, without efforts.

    Args:
        joint_names: In the order of the samples.
        samples: What to write.
        comments: Sentences that come first, as YAML comments.
    """
    lines = [f"# {comment}" for comment in comments]
    lines += ["joint_names:", *(f"- {json.dumps(name)}" for name in joint_names)]
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
