"""Trajectory files: our JSON, and CSV and ROS messages of any origin.

Our JSON holds the polynomials themselves. The others hold samples, which are joined by polynomials;
`TrajectoryFile.interpolation` states how.
"""

import csv
import io
from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.documents import DocumentError, parse_json, parse_yaml, read_text
from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.text import require_name
from tubeplanner.trajectory.joint_trajectory import MIN_DURATION, JointTrajectory
from tubeplanner.trajectory.parts import Mark, marks_of
from tubeplanner.trajectory.polynomials import hermite_pieces

QUANTITIES = ("position", "velocity", "acceleration")
TRAJECTORY_FORMAT = "tubeplanner/trajectory"
TRAJECTORY_VERSION = 1
_DURATION_TOLERANCE = 1e-9  # [s]
_MAX_BYTES = 200_000_000
_MAX_POSITION = 1e4  # [rad or m]
_MAX_SAMPLES = 100_000
_MAX_NUMBER = 1e18  # larger numbers are no reading of a joint or clock, and overflow when joined
_ROS_FIELDS = dict(zip(QUANTITIES, ("positions", "velocities", "accelerations"), strict=True))
_SECONDS = (("sec", "nanosec"), ("secs", "nsecs"))
# Velocities that differ from the slope of the positions by more than this factor have another unit.
_MAX_UNIT_RATIO = 10.0


@dataclass(frozen=True)
class GivenSamples:
    """Content of the samples of a file, before they are joined.

    Attributes:
        first_time: Of the first sample [s]; trajectories begin at zero all the same.
        quantities: The quantities of the file: position, velocity, acceleration.
        has_effort: True if a ROS message has efforts, which are not read.
    """

    first_time: float
    quantities: tuple[str, ...]
    has_effort: bool = False


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    """A trajectory with its origin.

    Attributes:
        trajectory: The trajectory.
        interpolation: Polynomials between the samples; None if the file holds polynomials.
        problem_hash: Of the problem of the trajectory; None if the file has none.
        robot_hash: Of the robot of the trajectory; None if the file has none.
        samples: Content of the samples; None if the file holds polynomials.
        ignored: Columns of a CSV file that are not read.
        part_hashes: Of the parts of the problem; empty if the file has none.
        marks: Events, in the order of time; empty but for the motion of a cycle.
    """

    trajectory: JointTrajectory
    interpolation: str | None = None
    problem_hash: str | None = None
    robot_hash: str | None = None
    samples: GivenSamples | None = None
    ignored: tuple[str, ...] = ()
    part_hashes: Mapping[str, str] = field(default_factory=dict)
    marks: tuple[Mark, ...] = ()


def read_trajectory(path: str | Path) -> JointTrajectory:
    """Read a trajectory from a file, as `read_trajectory_file` does.

    Raises:
        TrajectoryError: As `read_trajectory_file`.
    """
    return read_trajectory_file(path).trajectory


def read_trajectory_file(path: str | Path, joint_names: Collection[str] = ()) -> TrajectoryFile:
    """Read a trajectory file: `.json` (ours), `.csv`, or `.yaml` / `.yml` (ROS).

    CSV has a header: `time` and, for every joint, `JOINT.position` and optionally `JOINT.velocity`
    and `JOINT.acceleration`, each for all joints or none; further columns are ignored. ROS is a
    trajectory_msgs/JointTrajectory, or a goal with such a message as `trajectory`.

    Args:
        path: The file.
        joint_names: Joints whose CSV columns may have other names too: see `joint_columns`.

    Raises:
        TrajectoryError: The file cannot be read, is no trajectory file, or contradicts itself.
    """
    path = Path(path)
    readers: dict[str, Callable[[str], TrajectoryFile]] = {
        ".json": _read_json,
        ".csv": partial(_read_csv, joint_names=joint_names),
        ".yaml": _read_ros,
        ".yml": _read_ros,
    }
    read = readers.get(path.suffix.lower(), _read_json)
    try:
        text = read_text(path, _MAX_BYTES)
    except DocumentError as error:
        raise TrajectoryError(f"trajectory file {path} cannot be read: {error}") from error
    try:
        file = read(text)
        _require_positions_of_arms(file.trajectory)
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    return file


def _require_positions_of_arms(trajectory: JointTrajectory) -> None:
    """Raise if a joint may travel so far that the certificate would take minutes."""
    reach = trajectory.reach()
    if (reach <= _MAX_POSITION).all():
        return
    piece, joint = np.unravel_index(int(reach.argmax()), reach.shape)
    raise TrajectoryError(
        f"the position of '{trajectory.joint_names[joint]}' may reach {reach[piece, joint]:.3g} "
        f"rad or m in piece {piece}; files are read up to {_MAX_POSITION:g}"
    )


def _read_json(text: str) -> TrajectoryFile:
    try:
        fields = parse_json(text)
    except DocumentError as error:
        raise TrajectoryError(
            f"is no JSON ({error}); .csv and .yaml are read as CSV and ROS"
        ) from error
    if not isinstance(fields, dict) or fields.get("format") != TRAJECTORY_FORMAT:
        raise TrajectoryError(f"is no trajectory file: format must be {TRAJECTORY_FORMAT}")
    version = fields.get("version")
    if version != TRAJECTORY_VERSION or isinstance(version, bool):
        raise TrajectoryError(f"version is {shown(version)}; {TRAJECTORY_VERSION} can be read")
    breakpoints = _numbers(fields, "breakpoints")
    trajectory = JointTrajectory(
        _joint_names(fields), breakpoints, _numbers(fields, "coefficients")
    )
    if "duration" in fields:
        duration = _numbers(fields, "duration")
        if duration.size != 1:
            raise TrajectoryError("duration must be one number")
        if not abs(duration.item() - trajectory.duration) <= _DURATION_TOLERANCE:
            raise TrajectoryError(
                f"duration {duration.item()} s contradicts the last breakpoint, "
                f"{trajectory.duration} s"
            )
    marks = marks_of(fields.get("marks", []))
    if marks and marks[-1].time > trajectory.duration + _DURATION_TOLERANCE:
        raise TrajectoryError(
            f"marks[{len(marks) - 1}].time is {marks[-1].time:g} s, after the end at "
            f"{trajectory.duration:g} s"
        )
    hashes = (fields.get(key) for key in ("problem_hash", "robot_hash"))
    problem_hash, robot_hash = (str(value) if value is not None else None for value in hashes)
    part_hashes = fields.get("part_hashes")
    pairs = part_hashes.items() if isinstance(part_hashes, dict) else ()
    return TrajectoryFile(
        trajectory,
        problem_hash=problem_hash,
        robot_hash=robot_hash,
        part_hashes={str(name): str(value) for name, value in pairs},
        marks=marks,
    )


def _joint_names(fields: dict[str, Any]) -> list[str]:
    names = fields.get("joint_names")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TrajectoryError(f"joint_names is {shown(names)}; it must be a list of names")
    return names


def _numbers(fields: dict[str, Any], key: str) -> FloatArray:
    """Return a field as an array of numbers; text, truth values and None are no numbers."""
    try:
        array = np.array(fields.get(key))
    except ValueError:
        raise TrajectoryError(f"{key} has rows of different lengths") from None
    if array.dtype.kind not in "iuf" or array.size == 0:
        raise TrajectoryError(f"{key} is {shown(fields.get(key))}; it must be numbers")
    return array.astype(np.float64)


def _read_csv(text: str, joint_names: Collection[str]) -> TrajectoryFile:
    # Row by row, and columns as plain numbers: text takes ten times as much memory.
    rows = (row for row in csv.reader(io.StringIO(text, newline="")) if row)
    try:
        header = [name.strip() for name in next(rows, [])]
        columns = joint_columns(header, joint_names)
        names = [columns.time, *(name for table in columns.tables.values() for name in table)]
        time, *values = _csv_columns(rows, header, names)
    except csv.Error as error:
        raise TrajectoryError(f"is no CSV ({error})") from None
    n = len(columns.joints)
    tables = {
        quantity: np.array(values[n * k : n * k + n]).T for k, quantity in enumerate(columns.tables)
    }
    file = _from_samples(columns.joints, time, tables)
    samples = GivenSamples(float(time[0]), tuple(tables))
    return replace(file, samples=samples, ignored=columns.ignored)


def _csv_columns(
    rows: Iterator[list[str]], header: list[str], names: list[str]
) -> list[FloatArray]:
    """Return the columns of given names, each (N,)."""
    index_of = {name: index for index, name in enumerate(header)}
    columns = [(index_of[name], name, array("d")) for name in names]
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            raise TrajectoryError(f"row {number} has {len(row)} values for {len(header)} columns")
        if number - 1 > _MAX_SAMPLES:
            raise _too_many_samples()
        for index, name, column in columns:
            column.append(_number(row[index], "row {}, {}", number, name))
    return [np.frombuffer(column, dtype=np.float64) for *_, column in columns]


def _too_many_samples() -> TrajectoryError:
    return TrajectoryError(
        f"has more than {_MAX_SAMPLES} samples; write fewer per second, or cut it into parts"
    )


def _number(value: Any, where: str, *places: object) -> float:
    """Return a finite number; `where`, its braces filled with `places`, names the number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{where.format(*places)} is {shown(value)}, no number") from None
    except OverflowError:  # a whole number too large for a float
        number = np.inf
    if not abs(number) <= _MAX_NUMBER:
        raise TrajectoryError(
            f"{where.format(*places)} is {number:g}; it must be finite, at most {_MAX_NUMBER:g}"
        )
    return number


def _read_ros(text: str) -> TrajectoryFile:
    try:
        # `ros2 topic echo` ends every message with a document marker.
        message = parse_yaml(text, first_of_many=True)
    except DocumentError as error:
        raise TrajectoryError(f"is no YAML ({error})") from error
    if isinstance(message, dict) and isinstance(message.get("trajectory"), dict):
        message = message["trajectory"]
    message = message if isinstance(message, dict) else {}
    points = message.get("points")
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise TrajectoryError("is no trajectory_msgs/JointTrajectory: it needs a list of points")
    if len(points) > _MAX_SAMPLES:
        raise _too_many_samples()
    names = _joint_names(message)
    tables: dict[str, FloatArray] = {}
    for quantity, key in _ROS_FIELDS.items():
        has_key = [bool(point.get(key)) for point in points]
        if not any(has_key):
            break
        if not all(has_key):
            raise TrajectoryError(
                f"point {has_key.index(False)} has no {key}; give them in all points or none"
            )
        tables[quantity] = np.array([_ros_row(names, i, p, key) for i, p in enumerate(points)])
    time = np.array([_ros_time(i, point) for i, point in enumerate(points)])
    file = _from_samples(names, time, tables)
    has_effort = any(bool(point.get("effort")) for point in points)
    return replace(file, samples=GivenSamples(float(time[0]), tuple(tables), has_effort))


def _ros_row(names: list[str], index: int, point: dict[str, Any], field: str) -> list[float]:
    values = point[field]
    if not isinstance(values, list) or len(values) != len(names):
        raise TrajectoryError(
            f"point {index}: {field} {shown(values)} must be {len(names)} numbers, one per joint"
        )
    return [_number(value, "point {}: {}", index, field) for value in values]


def _ros_time(index: int, point: dict[str, Any]) -> float:
    stamp = point.get("time_from_start")
    for seconds, nanoseconds in _SECONDS:
        if isinstance(stamp, dict) and seconds in stamp:
            where = "point {}: time_from_start"
            remainder = _number(stamp.get(nanoseconds, 0), where, index)
            return _number(stamp[seconds], where, index) + 1e-9 * remainder
    raise TrajectoryError(f"point {index}: time_from_start is {shown(stamp)}; sec and nanosec")


def _from_samples(
    joints: list[str], time: FloatArray, tables: dict[str, FloatArray]
) -> TrajectoryFile:
    """Return samples joined by polynomials of a degree that depends on the quantities."""
    if len(time) < 2 or "position" not in tables:
        raise TrajectoryError("at least two samples with positions are needed")
    time = time - time[0]
    for i in np.flatnonzero(~(np.diff(time) >= MIN_DURATION)):
        raise TrajectoryError(
            f"time must increase: sample {i + 1} comes {time[i] - time[i + 1]:.6g} s before the "
            f"sample in front of it; it must come {MIN_DURATION:g} s after it or later"
        )
    _require_same_units(time, tables)
    if "velocity" in tables:
        degree = "quintics" if "acceleration" in tables else "cubics"
        interpolation = f"{degree} that meet every sample's {', '.join(tables)}"
        trajectory = joined_samples(joints, time, tuple(tables.values()))
        return TrajectoryFile(trajectory, interpolation)
    from scipy.interpolate import CubicSpline

    curve = CubicSpline(time, tables["position"], bc_type="clamped")
    interpolation = "a cubic spline through the positions, at rest at both ends"
    return TrajectoryFile(JointTrajectory(joints, curve.x, curve.c), interpolation)


def joined_samples(
    joint_names: Sequence[str], time: FloatArray, known: Sequence[FloatArray]
) -> JointTrajectory:
    """Return the trajectory with a polynomial between every two samples, as `hermite_pieces`.

    Args:
        joint_names: Names of the n joints.
        time: Shape (N,), increasing from 0 [s].
        known: Positions and their derivatives at the samples, each (N, n).
    """
    return JointTrajectory(joint_names, time, hermite_pieces(time, known))


def _require_same_units(time: FloatArray, tables: dict[str, FloatArray]) -> None:
    """Raise if a derivative has another unit than the slopes: degrees, milliseconds."""
    for quantity, derivative in (("position", "velocity"), ("velocity", "acceleration")):
        if derivative not in tables or len(time) < 3:
            continue
        slope = np.gradient(tables[quantity], time, axis=0)
        size, expected = (float(np.linalg.norm(x)) for x in (tables[derivative], slope))
        if expected == 0 or size == 0:
            continue
        ratio = size / expected
        if not 1 / _MAX_UNIT_RATIO < ratio < _MAX_UNIT_RATIO:
            raise TrajectoryError(
                f"the {derivative} is {ratio:.4g} times the slope of the {quantity} over time; are "
                "all in radians (a factor of 57.3 tells degrees) and seconds (1000: milliseconds)?"
            )


# ---- Columns of a CSV file: times, positions, velocities and accelerations of joints.
#
# Our own files have `time` and `JOINT.position`. Recorders write other names; `joint_columns` knows
# the names of PlotJuggler and of rosbag exports for the joints of a robot.

_TIME = "time"
_TIMES = ("time", "t", "timestamp")
_TIME_MARKS = "#_ "  # before a time's name: "#time", PlotJuggler's "__time"
_MAX_COLUMNS_SHOWN = 20


@dataclass(frozen=True)
class JointColumns:
    """Columns of a file that are read.

    Attributes:
        time: The column of times.
        joints: Names of the n joints.
        tables: Per quantity, the columns of all joints, in their order.
        ignored: Columns that are not read, without the efforts of these joints.
    """

    time: str
    joints: list[str]
    tables: dict[str, list[str]]
    ignored: tuple[str, ...]


def joint_columns(header: Sequence[str], joint_names: Collection[str] = ()) -> JointColumns:
    """Return the columns of a file that are read.

    Args:
        header: The names of all columns.
        joint_names: Joints whose columns may have other names than JOINT.position: the joint's name
            (a position), or JOINT/position, JOINT_position, position_JOINT or position/JOINT, after
            any path such as /joint_states/. Others are found by a column `JOINT.position`.

    Raises:
        TrajectoryError: There is no time, there are no positions, two columns are the same
            quantity, or a quantity is missing for some joints.
    """
    for name, count in Counter(header).items():
        if count > 1:
            raise TrajectoryError(f"the column {shown(name)} is there {count} times")
    own = [name.removesuffix(".position") for name in header if name.endswith(".position")]
    columns = _columns_by_quantity(header, dict.fromkeys([*own, *joint_names]))
    joints = [joint for joint, quantity in columns if quantity == QUANTITIES[0]]
    time = _time_column(header, {*columns.values()})
    if time is None or not joints:
        plain = (
            f" (or columns named as the joints: {', '.join(joint_names)})" if joint_names else ""
        )
        raise TrajectoryError(
            f"needs the columns time and JOINT.position{plain}; its columns are "
            f"{', '.join(map(shown, header[:_MAX_COLUMNS_SHOWN])) or 'none'}"
        )
    for joint in joints:
        require_name("the joint of a column", joint, TrajectoryError)
    tables = {
        quantity: [columns[joint, quantity] for joint in joints]
        for quantity in _complete_quantities(joints, columns)
    }
    used = {time, *(name for names in tables.values() for name in names)}
    used |= {name for joint in joints for name in _names(joint, "effort")}
    return JointColumns(time, joints, tables, tuple(name for name in header if name not in used))


def _columns_by_quantity(
    header: Sequence[str], joints: Iterable[str]
) -> dict[tuple[str, str], str]:
    """Return columns by joint and quantity, in the order of the header."""
    meanings = {
        name: (joint, quantity)
        for joint in joints
        for quantity in QUANTITIES
        for name in _names(joint, quantity)
    }
    columns: dict[tuple[str, str], str] = {}
    for column in header:
        key = _meaning(column, meanings)
        if key is None:
            continue
        if key in columns:
            joint, quantity = key
            raise TrajectoryError(
                f"the columns {shown(columns[key])} and {shown(column)} are both the {quantity} of "
                f"'{joint}'; leave out one of them"
            )
        columns[key] = column
    return columns


def _meaning(column: str, meanings: dict[str, tuple[str, str]]) -> tuple[str, str] | None:
    """Return joint and quantity of a column, after any path; None: the column has none."""
    if column in meanings:
        return meanings[column]
    parts = column.split("/")
    for k in range(1, len(parts)):
        meaning = meanings.get(tail := "/".join(parts[k:]))
        # A joint's bare name is a position only without a path.
        if meaning is not None and tail != meaning[0]:
            return meaning
    return None


def _names(joint: str, quantity: str) -> list[str]:
    """Return the possible names of the column for a quantity of a joint."""
    bare = [joint] if quantity == QUANTITIES[0] else []
    both = [f"{joint}{mark}{quantity}" for mark in "./_"]
    return [*bare, *both, f"{quantity}_{joint}", f"{quantity}/{joint}"]


def _time_column(header: Sequence[str], others: Collection[str]) -> str | None:
    """Return the column of times; None: there is none."""
    times = [
        name for name in header if name not in others and name.lstrip(_TIME_MARKS).lower() in _TIMES
    ]
    if _TIME in times:
        return _TIME
    if len(times) < 2:
        return times[0] if times else None
    raise TrajectoryError(
        f"the columns {' and '.join(map(shown, times))} may all be times; leave out all but one, "
        f"or call it {_TIME}"
    )


def _complete_quantities(joints: Sequence[str], keys: Collection[tuple[str, str]]) -> list[str]:
    """Return the quantities that all joints have; raise if only some joints have a quantity."""
    quantities = []
    for quantity in QUANTITIES:
        missing = [joint for joint in joints if (joint, quantity) not in keys]
        if len(missing) == len(joints):
            break
        if missing:
            raise TrajectoryError(
                f"{quantity} is missing for {', '.join(missing)}; give it for all joints or none"
            )
        quantities.append(quantity)
    return quantities
