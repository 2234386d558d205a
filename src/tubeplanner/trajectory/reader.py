"""Trajectory files: our JSON, foreign CSV and ROS messages.

Our own files have `time` and `JOINT.position`. Recorders write other names; `joint_columns` knows
those of PlotJuggler and of rosbag exports for the joints of a robot.
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

# ---- Which columns of a CSV file are times, positions, velocities and accelerations of joints.

QUANTITIES = ("position", "velocity", "acceleration")
_TIME = "time"
_TIMES = ("time", "t", "timestamp")
_TIME_MARKS = "#_ "  # before a time's name: "#time", PlotJuggler's "__time"
_COLUMNS_SHOWN = 20


@dataclass(frozen=True)
class JointColumns:
    """The columns of a file that are read.

    Attributes:
        time: The column of times.
        joints: The n joints.
        tables: By quantity, the columns of all joints, in their order.
        ignored: Columns that are not read, efforts of these joints left out.
    """

    time: str
    joints: list[str]
    tables: dict[str, list[str]]
    ignored: tuple[str, ...]


def joint_columns(header: Sequence[str], joint_names: Collection[str] = ()) -> JointColumns:
    """Return which columns of a file are read.

    Args:
        header: The names of all columns.
        joint_names: Joints that may have columns of other names than JOINT.position: their own name
            (a position), and JOINT/position, JOINT_position, position_JOINT and the like behind any
            path such as /joint_states/; without them `JOINT.position` alone is known.

    Raises:
        TrajectoryError: There is no time, there are no positions, two columns are the same
            quantity, or some joints lack what others have.
    """
    for name, count in Counter(header).items():
        if count > 1:
            raise TrajectoryError(f"the column {shown(name)} is there {count} times")
    own = [name.removesuffix(".position") for name in header if name.endswith(".position")]
    found = _found(header, dict.fromkeys([*own, *joint_names]))
    joints = [joint for joint, quantity in found if quantity == QUANTITIES[0]]
    time = _time(header, {*found.values()})
    if time is None or not joints:
        raise TrajectoryError(_missing(header, joint_names))
    for joint in joints:
        require_name("the joint of a column", joint, TrajectoryError)
    tables = {
        quantity: [found[joint, quantity] for joint in joints]
        for quantity in _quantities(joints, found)
    }
    read = {time, *(name for names in tables.values() for name in names)}
    read |= {name for joint in joints for name in _names(joint, "effort")}
    return JointColumns(time, joints, tables, tuple(name for name in header if name not in read))


def _found(header: Sequence[str], joints: Iterable[str]) -> dict[tuple[str, str], str]:
    """Return the column of each joint's quantities, in the order of the header."""
    meant = {
        name: (joint, quantity)
        for joint in joints
        for quantity in QUANTITIES
        for name in _names(joint, quantity)
    }
    found: dict[tuple[str, str], str] = {}
    for column in header:
        key = _meaning(column, meant)
        if key is None:
            continue
        if key in found:
            joint, quantity = key
            raise TrajectoryError(
                f"the columns {shown(found[key])} and {shown(column)} are both the {quantity} of "
                f"'{joint}'; leave out one of them"
            )
        found[key] = column
    return found


def _meaning(column: str, meant: dict[str, tuple[str, str]]) -> tuple[str, str] | None:
    """Return what a column is, whatever path stands before its name."""
    if column in meant:
        return meant[column]
    parts = column.split("/")
    tails = ("/".join(parts[k:]) for k in range(1, len(parts)))
    # A joint's bare name is taken for its position only where nothing stands before it.
    return next((meant[tail] for tail in tails if tail in meant and tail != meant[tail][0]), None)


def _names(joint: str, quantity: str) -> list[str]:
    """Return the names of columns that are one quantity of a joint."""
    bare = [joint] if quantity == QUANTITIES[0] else []
    both = [f"{joint}{mark}{quantity}" for mark in "./_"]
    return [*bare, *both, f"{quantity}_{joint}", f"{quantity}/{joint}"]


def _time(header: Sequence[str], taken: Collection[str]) -> str | None:
    """Return the column of times, if there is one."""
    times = [
        name for name in header if name not in taken and name.lstrip(_TIME_MARKS).lower() in _TIMES
    ]
    if _TIME in times or len(times) < 2:
        return _TIME if _TIME in times else next(iter(times), None)
    raise TrajectoryError(
        f"the columns {' and '.join(map(shown, times))} may all be times; leave out all but one, "
        f"or call it {_TIME}"
    )


def _quantities(joints: Sequence[str], found: Collection[tuple[str, str]]) -> list[str]:
    """Return the quantities that all joints have, those that some have being an error."""
    quantities = []
    for quantity in QUANTITIES:
        missing = [joint for joint in joints if (joint, quantity) not in found]
        if len(missing) == len(joints):
            break
        if missing:
            raise TrajectoryError(
                f"{quantity} is missing for {', '.join(missing)}; give it for all joints or none"
            )
        quantities.append(quantity)
    return quantities


def _missing(header: Sequence[str], joint_names: Collection[str]) -> str:
    plain = f" (or columns named as the joints: {', '.join(joint_names)})" if joint_names else ""
    return (
        f"needs the columns time and JOINT.position{plain}; its columns are "
        f"{', '.join(map(shown, header[:_COLUMNS_SHOWN])) or 'none'}"
    )


# ---- Trajectory files read back: our JSON, and CSV and ROS messages made anywhere.
#
# Our JSON holds the polynomials themselves. The others hold samples, which are joined by
# polynomials; `interpolation` states how.

TRAJECTORY_FORMAT = "tubeplanner/trajectory"
TRAJECTORY_VERSION = 1
_DURATION_TOLERANCE = 1e-9  # [s]
_MAX_BYTES = 200_000_000
_MAX_POSITION = 1e4  # [rad or m]
_MAX_SAMPLES = 100_000
_MAX_NUMBER = 1e18  # what is larger is no reading of any joint or clock, and overflows when joined
_ROS_FIELDS = dict(zip(QUANTITIES, ("positions", "velocities", "accelerations"), strict=True))
_SECONDS = (("sec", "nanosec"), ("secs", "nsecs"))
# Velocities that differ from the slope of the positions by more than this factor have another unit.
_MAX_UNIT_RATIO = 10.0


@dataclass(frozen=True)
class GivenSamples:
    """What the samples of a file say, before they are joined.

    Attributes:
        first_time: Of the first one [s]; trajectories begin at zero all the same.
        quantities: Which of position, velocity and acceleration there are.
        has_effort: Whether a ROS message has efforts, which are not read.
    """

    first_time: float
    quantities: tuple[str, ...]
    has_effort: bool = False


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    """A trajectory and where it comes from.

    Attributes:
        trajectory: The trajectory.
        interpolation: How samples were joined; None if the file holds polynomials.
        problem_hash: Of the problem it was made for; None if the file does not say.
        robot_hash: Of the robot it was made for; likewise.
        samples: What its samples say; None if the file holds polynomials.
        ignored: Columns of a CSV file that are not read.
        part_hashes: Of the parts of the problem it was made for; empty if the file does not say.
        marks: What happens during it, in the order of time; empty but for the motion of a cycle.
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

    CSV has a header: `time` and, for every joint, `JOINT.position` and, if at hand for all of them,
    `JOINT.velocity` and `JOINT.acceleration`; further columns are ignored. ROS is a
    trajectory_msgs/JointTrajectory, or a goal that has one as `trajectory`.

    Args:
        path: The file.
        joint_names: Joints whose columns in CSV may have other names too, as `joint_columns` says.

    Raises:
        TrajectoryError: It cannot be read, is no trajectory file, or contradicts itself.
    """
    path = Path(path)
    readers: dict[str, Callable[[str], TrajectoryFile]]
    readers = {
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
    """Raise if a joint may travel so far that judging it would take minutes."""
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
        _require_duration(_numbers(fields, "duration"), trajectory.duration)
    hashes = (fields.get(key) for key in ("problem_hash", "robot_hash"))
    problem_hash, robot_hash = (str(value) if value is not None else None for value in hashes)
    file = TrajectoryFile(trajectory, None, problem_hash, robot_hash)
    marks = _marks(fields.get("marks", []), trajectory.duration)
    return replace(file, part_hashes=_texts(fields.get("part_hashes")), marks=marks)


def _marks(given: object, duration: float) -> tuple[Mark, ...]:
    marks = marks_of(given)
    if marks and marks[-1].time > duration + _DURATION_TOLERANCE:
        raise TrajectoryError(
            f"marks[{len(marks) - 1}].time is {marks[-1].time:g} s, after the end at {duration:g} s"
        )
    return marks


def _texts(given: object) -> dict[str, str]:
    pairs = given.items() if isinstance(given, dict) else ()
    return {str(name): str(value) for name, value in pairs}


def _require_duration(given: FloatArray, duration: float) -> None:
    if given.size != 1:
        raise TrajectoryError("duration must be one number")
    if not abs(given.item() - duration) <= _DURATION_TOLERANCE:
        raise TrajectoryError(
            f"duration {given.item()} s contradicts the last breakpoint, {duration} s"
        )


def _joint_names(fields: dict[str, Any]) -> list[str]:
    names = fields.get("joint_names")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise TrajectoryError(f"joint_names is {shown(names)}; it must be a list of names")
    return names


def _numbers(fields: dict[str, Any], key: str) -> FloatArray:
    """Return a field as an array of numbers; texts, truth values and gaps are no numbers."""
    try:
        array = np.array(fields.get(key))
    except ValueError:
        raise TrajectoryError(f"{key} has rows of different lengths") from None
    if array.dtype.kind not in "iuf" or array.size == 0:
        raise TrajectoryError(f"{key} is {shown(fields.get(key))}; it must be numbers")
    return array.astype(np.float64)


def _read_csv(text: str, joint_names: Collection[str]) -> TrajectoryFile:
    # Rows are taken one by one, and their columns as plain numbers: text takes ten times as much.
    rows = (row for row in csv.reader(io.StringIO(text, newline="")) if row)
    try:
        header = [name.strip() for name in next(rows, [])]
        named = joint_columns(header, joint_names)
        wanted = [named.time, *(name for names in named.tables.values() for name in names)]
        columns = _csv_columns(rows, header, wanted)
    except csv.Error as error:
        raise TrajectoryError(f"is no CSV ({error})") from None
    time, *values = columns
    n = len(named.joints)
    known = {what: np.array(values[n * k : n * k + n]).T for k, what in enumerate(named.tables)}
    file = _from_samples(named.joints, time, known)
    samples = GivenSamples(float(time[0]), tuple(known))
    return replace(file, samples=samples, ignored=named.ignored)


def _csv_columns(
    rows: Iterator[list[str]], header: list[str], wanted: list[str]
) -> list[FloatArray]:
    """Return columns by their names, each (N,)."""
    places = {name: index for index, name in enumerate(header)}
    columns = [(places[name], name, array("d")) for name in wanted]
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
    """Return a finite number; `where` says which one, its braces filled with the places."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{where.format(*places)} is {shown(value)}, no number") from None
    except OverflowError:  # a whole number
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
        given = [bool(point.get(key)) for point in points]
        if not any(given):
            break
        if not all(given):
            raise TrajectoryError(
                f"point {given.index(False)} has no {key}; give them in all points or none"
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
            rest = _number(stamp.get(nanoseconds, 0), where, index)
            return _number(stamp[seconds], where, index) + 1e-9 * rest
    raise TrajectoryError(f"point {index}: time_from_start is {shown(stamp)}; sec and nanosec")


def _from_samples(
    joints: list[str], time: FloatArray, tables: dict[str, FloatArray]
) -> TrajectoryFile:
    """Return samples joined by polynomials of the degree that their columns determine."""
    if len(time) < 2 or "position" not in tables:
        raise TrajectoryError("at least two samples with positions are needed")
    time = time - time[0]
    for i in np.flatnonzero(~(np.diff(time) >= MIN_DURATION)):
        raise TrajectoryError(
            f"time must increase: sample {i + 1} comes {time[i] - time[i + 1]:.6g} s before the "
            f"sample in front of it; it must come {MIN_DURATION:g} s after it or later"
        )
    _require_same_units(time, tables)
    if "velocity" not in tables:
        from scipy.interpolate import CubicSpline

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
    return JointTrajectory(joint_names, time, hermite_pieces(time, known))


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
