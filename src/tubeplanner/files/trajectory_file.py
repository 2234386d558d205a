"""Trajectory files read back: our JSON, and CSV and ROS messages made anywhere.

Our JSON holds the polynomials themselves. The others hold samples, which are joined by polynomials;
`interpolation` states how.
"""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BPoly, CubicSpline, PPoly

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import TrajectoryError
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

TRAJECTORY_FORMAT = "tubeplanner/trajectory"
TRAJECTORY_VERSION = 1
_DURATION_TOLERANCE = 1e-9  # [s]
_QUANTITIES = ("position", "velocity", "acceleration")
_ROS_FIELDS = dict(zip(_QUANTITIES, ("positions", "velocities", "accelerations"), strict=True))
_SECONDS = (("sec", "nanosec"), ("secs", "nsecs"))
# Velocities that differ from the slope of the positions by more than this factor have another unit.
_MAX_UNIT_RATIO = 10.0


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    """A trajectory and where it comes from.

    Attributes:
        trajectory: The trajectory.
        interpolation: How samples were joined; None if the file holds polynomials.
        problem_hash: Of the problem it was made for; None if the file does not say.
        robot_hash: Of the robot it was made for; likewise.
    """

    trajectory: JointTrajectory
    interpolation: str | None = None
    problem_hash: str | None = None
    robot_hash: str | None = None


def read_trajectory(path: str | Path) -> JointTrajectory:
    """Read a trajectory from a file, as `read_trajectory_file` does.

    Raises:
        TrajectoryError: As `read_trajectory_file`.
    """
    return read_trajectory_file(path).trajectory


def read_trajectory_file(path: str | Path) -> TrajectoryFile:
    """Read a trajectory file: `.json` (ours), `.csv`, or `.yaml` / `.yml` (ROS).

    CSV has a header: `time` and, for every joint, `JOINT.position` and, if at hand for all of them,
    `JOINT.velocity` and `JOINT.acceleration`; further columns are ignored. ROS is a
    trajectory_msgs/JointTrajectory, or a goal that has one as `trajectory`.

    Raises:
        TrajectoryError: It cannot be read, is no trajectory file, or contradicts itself.
    """
    path = Path(path)
    readers = {".json": _read_json, ".csv": _read_csv, ".yaml": _read_ros, ".yml": _read_ros}
    read = readers.get(path.suffix.lower(), _read_json)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise TrajectoryError(f"trajectory file {path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError:
        raise TrajectoryError(f"trajectory file {path} is no text") from None
    try:
        return read(text)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error


def _read_json(text: str) -> TrajectoryFile:
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise TrajectoryError(
            f"is no JSON ({error}); .csv and .yaml are read as CSV and ROS"
        ) from error
    if not isinstance(fields, dict) or fields.get("format") != TRAJECTORY_FORMAT:
        raise TrajectoryError(f"is no trajectory file: format must be {TRAJECTORY_FORMAT}")
    version = fields.get("version")
    if version != TRAJECTORY_VERSION or isinstance(version, bool):
        raise TrajectoryError(f"version is {version!r}; {TRAJECTORY_VERSION} can be read")
    trajectory = JointTrajectory(
        _names(fields), _numbers(fields, "breakpoints"), _numbers(fields, "coefficients")
    )
    if "duration" in fields:
        _require_duration(_numbers(fields, "duration"), trajectory.duration)
    hashes = (fields.get(key) for key in ("problem_hash", "robot_hash"))
    problem_hash, robot_hash = (str(value) if value is not None else None for value in hashes)
    return TrajectoryFile(trajectory, None, problem_hash, robot_hash)


def _require_duration(given: FloatArray, duration: float) -> None:
    if given.size != 1:
        raise TrajectoryError("duration must be one number")
    if not abs(given.item() - duration) <= _DURATION_TOLERANCE:
        raise TrajectoryError(
            f"duration {given.item()} s contradicts the last breakpoint, {duration} s"
        )


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


def _read_csv(text: str) -> TrajectoryFile:
    rows = [row for row in csv.reader(text.splitlines()) if row]
    header = [name.strip() for name in rows[0]] if rows else []
    joints = [name.removesuffix(".position") for name in header if name.endswith(".position")]
    if "time" not in header or not joints:
        raise TrajectoryError(
            f"needs the columns time and JOINT.position; its columns are "
            f"{', '.join(header)[:200] or 'none'}"
        )
    for name in header:
        if header.count(name) > 1:
            raise TrajectoryError(f"the column '{name}' is there {header.count(name)} times")
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise TrajectoryError(f"row {number} has {len(row)} values for {len(header)} columns")

    def column(name: str) -> list[float]:
        index = header.index(name)
        return [_number(row[index], f"row {i}, {name}") for i, row in enumerate(rows[1:], start=2)]

    tables: dict[str, FloatArray] = {}
    for quantity in _QUANTITIES:
        missing = [joint for joint in joints if f"{joint}.{quantity}" not in header]
        if len(missing) == len(joints):
            break
        if missing:
            raise TrajectoryError(
                f"{quantity} is missing for {', '.join(missing)}; give it for all joints or none"
            )
        tables[quantity] = np.array([column(f"{joint}.{quantity}") for joint in joints]).T
    return _from_samples(joints, np.array(column("time")), tables)


def _number(value: Any, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{where} is {value!r:.40}, no number") from None
    if not np.isfinite(number):
        raise TrajectoryError(f"{where} is {number}; it must be finite")
    return number


def _read_ros(text: str) -> TrajectoryFile:
    import yaml  # takes longer to import than all else that a check by JSON needs

    try:
        # `ros2 topic echo` ends every message with a document marker.
        message = next(iter(yaml.load_all(text, Loader=yaml.CSafeLoader)), None)
    except yaml.YAMLError as error:
        raise TrajectoryError(f"is no YAML ({' '.join(str(error).split())[:200]})") from error
    if isinstance(message, dict) and isinstance(message.get("trajectory"), dict):
        message = message["trajectory"]
    message = message if isinstance(message, dict) else {}
    points = message.get("points")
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise TrajectoryError("is no trajectory_msgs/JointTrajectory: it needs a list of points")
    names = _names(message)
    tables: dict[str, FloatArray] = {}
    for quantity, field in _ROS_FIELDS.items():
        given = [bool(point.get(field)) for point in points]
        if not any(given):
            break
        if not all(given):
            raise TrajectoryError(
                f"point {given.index(False)} has no {field}; give them in all points or none"
            )
        tables[quantity] = np.array([_ros_row(names, i, p, field) for i, p in enumerate(points)])
    time = np.array([_ros_time(i, point) for i, point in enumerate(points)])
    return _from_samples(names, time, tables)


def _ros_row(names: list[str], index: int, point: dict[str, Any], field: str) -> list[float]:
    values = point[field]
    if not isinstance(values, list) or len(values) != len(names):
        raise TrajectoryError(
            f"point {index}: {field} {values!r:.60} must be {len(names)} numbers, one per joint"
        )
    return [_number(value, f"point {index}: {field}") for value in values]


def _ros_time(index: int, point: dict[str, Any]) -> float:
    stamp = point.get("time_from_start")
    for seconds, nanoseconds in _SECONDS:
        if isinstance(stamp, dict) and seconds in stamp:
            where = f"point {index}: time_from_start"
            rest = _number(stamp.get(nanoseconds, 0), where)
            return _number(stamp[seconds], where) + 1e-9 * rest
    raise TrajectoryError(f"point {index}: time_from_start is {stamp!r:.60}; sec and nanosec")


def _from_samples(
    joints: list[str], time: FloatArray, tables: dict[str, FloatArray]
) -> TrajectoryFile:
    """Return samples joined by polynomials of the degree that their columns determine."""
    if len(time) < 2 or "position" not in tables:
        raise TrajectoryError("at least two samples with positions are needed")
    time = time - time[0]
    for i in np.flatnonzero(np.diff(time) <= 0):
        raise TrajectoryError(
            f"time must increase: sample {i + 1} comes {time[i] - time[i + 1]:.6g} s before the "
            "sample in front of it"
        )
    _require_same_units(time, tables)
    if "velocity" not in tables:
        curve = CubicSpline(time, tables["position"], bc_type="clamped")
        how = "a cubic spline through the positions, at rest at both ends"
    else:
        degree = "quintics" if "acceleration" in tables else "cubics"
        how = f"{degree} that meet every sample's {', '.join(tables)}"
        return TrajectoryFile(joined_samples(joints, time, tuple(tables.values())), how)
    return TrajectoryFile(JointTrajectory(joints, curve.x, curve.c), how)


def joined_samples(
    joint_names: Sequence[str], time: FloatArray, known: Sequence[FloatArray]
) -> JointTrajectory:
    """Return the polynomials, one between every two samples, that meet all that is known of them.

    Args:
        joint_names: The n joints.
        time: Shape (N,), increasing from 0 [s].
        known: Positions and their derivatives at the samples, each (N, n).
    """
    curve = PPoly.from_bernstein_basis(BPoly.from_derivatives(time, np.stack(known, axis=1)))
    return JointTrajectory(joint_names, curve.x, curve.c)


def _require_same_units(time: FloatArray, tables: dict[str, FloatArray]) -> None:
    """Compare velocities with the slopes of the positions: detects degrees and milliseconds."""
    for quantity, derivative in (("position", "velocity"), ("velocity", "acceleration")):
        if derivative not in tables or len(time) < 3:
            continue
        slope = np.gradient(tables[quantity], time, axis=0)
        given, expected = (float(np.linalg.norm(x)) for x in (tables[derivative], slope))
        if expected == 0 or given == 0:
            continue
        ratio = given / expected
        if not 1 / _MAX_UNIT_RATIO < ratio < _MAX_UNIT_RATIO:
            raise TrajectoryError(
                f"the {derivative} is {ratio:.4g} times the slope of the {quantity} over time; are "
                "all in radians (a factor of 57.3 tells degrees) and seconds (1000: milliseconds)?"
            )
