"""Trajectory files: our JSON, and CSV and ROS messages of any origin.

Our JSON holds the polynomials themselves. The others hold samples, which are joined by polynomials;
`TrajectoryFile.interpolation` states how.
"""

import csv
import io
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.documents import DocumentError, parse_json, parse_yaml, read_text
from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.text import require_name
from tubeplanner.trajectory.joint_trajectory import MIN_DURATION, JointTrajectory, concatenate
from tubeplanner.trajectory.parts import Mark, marks_of
from tubeplanner.trajectory.polynomials import hermite_pieces

QUANTITIES = ("position", "velocity", "acceleration")
TRAJECTORY_FORMAT = "tubeplanner/trajectory"
TRAJECTORY_VERSION = 1
MARK_COLUMN = "mark"  # of CSV: texts of marks on the way, which are not read
_DURATION_TOLERANCE = 1e-9  # [s]
_MAX_BYTES = 200_000_000
_MAX_POSITION = 1e4  # [rad or m]
_MAX_SAMPLES = 100_000
_MAX_NUMBER = 1e18  # larger numbers are no reading of a joint or clock, and overflow when joined
_ROS_FIELDS = dict(zip(QUANTITIES, ("positions", "velocities", "accelerations"), strict=True))
_SECONDS = (("sec", "nanosec"), ("secs", "nsecs"))
# Fields that lead to the message: of action goals, of MoveIt's plans and displayed trajectories.
_WRAPPERS = ("goal", "trajectory", "planned_trajectory", "joint_trajectory")
_MULTI_DOF = "multi_dof_joint_trajectory"
_NEXT_MESSAGE = re.compile(r"^---[ \t]*$", re.M)
_CONTENT = re.compile(r"^[^#\s]", re.M)
_STANDSTILL = 1e-4  # [rad or m]: a joint that moves less stands still, as for judging such files
# Velocities that differ from the slope of the positions by more than this factor have another unit.
_MAX_UNIT_RATIO = 10.0


@dataclass(frozen=True)
class GivenSamples:
    """Content of the samples of a file, before they are joined."""

    first_time: float  # of the first sample [s]; trajectories begin at zero all the same
    quantities: tuple[str, ...]  # the quantities of the file: position, velocity, acceleration
    has_effort: bool = False  # True if a ROS message has efforts, which are not read


@dataclass(frozen=True, eq=False)
class TrajectoryFile:
    """A trajectory with its origin."""

    trajectory: JointTrajectory
    # polynomials between the samples; None if the file holds polynomials
    interpolation: str | None = None
    problem_hash: str | None = None  # of the problem of the trajectory; None if the file has none
    robot_hash: str | None = None  # of the robot of the trajectory; None if the file has none
    # content of the samples; None if the file holds polynomials
    samples: GivenSamples | None = None
    ignored: tuple[str, ...] = ()  # columns of a CSV file that are not read
    # positions of further joints that stand still, by name [rad or m]
    still: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()  # sentences on how the file was read
    # of the parts of the problem; empty if the file has none
    part_hashes: Mapping[str, str] = field(default_factory=dict)
    # events, in the order of time; of CSV and ROS files, whose marks are for readers, none
    marks: tuple[Mark, ...] = ()


def read_trajectory(path: str | Path) -> JointTrajectory:
    """Read a trajectory from a file, as `read_trajectory_file` does.

    Raises:
        TrajectoryError: As `read_trajectory_file`.
    """
    return read_trajectory_file(path).trajectory


def read_trajectory_file(path: str | Path, joint_names: Sequence[str] = ()) -> TrajectoryFile:
    """Read a trajectory file: `.json` (ours), `.csv` (`.tsv`, `.txt`), or `.yaml` / `.yml` (ROS).

    CSV has a header: `time` and, for every joint, `JOINT.position` and optionally `JOINT.velocity`
    and `JOINT.acceleration`, each for all joints or none; further columns are ignored. Columns are
    separated by commas, semicolons, tabs or blanks; the decimal mark is a point or a comma. ROS is
    a trajectory_msgs/JointTrajectory, a goal with such a message as `trajectory`, or MoveIt's
    RobotTrajectory or DisplayTrajectory, whose trajectories follow one another.

    Args:
        path: The file.
        joint_names: The joints of a robot, if known. Their CSV columns may have other names too:
            see `joint_columns`. Of samples of more joints, those that stand still are left out.

    Raises:
        TrajectoryError: The file cannot be read, is no trajectory file, or contradicts itself.
    """
    path = Path(path)
    table = partial(_read_csv, joint_names=joint_names)
    readers: dict[str, Callable[[str], TrajectoryFile]] = {
        ".json": _read_json,
        ".csv": table,
        ".tsv": table,
        ".txt": table,
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
        motion = file.trajectory
        reach = motion.reach()
        if not (reach <= _MAX_POSITION).all():  # the certificate would take minutes
            piece, joint = np.unravel_index(int(reach.argmax()), reach.shape)
            raise TrajectoryError(
                f"the position of '{motion.joint_names[joint]}' may reach "
                f"{reach[piece, joint]:.3g} rad or m in piece {piece}; files are read up to "
                f"{_MAX_POSITION:g}"
            )
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error
    # Further joints that stand still are left out, if the file has all named joints.
    others = [name for name in motion.joint_names if name not in joint_names]
    has_names = bool(joint_names) and set(joint_names) <= set(motion.joint_names)
    if file.samples is None or not others or not has_names:
        return file
    columns = [motion.joint_names.index(name) for name in others]
    position = motion.position(motion.breakpoints)[:, columns]
    rests = np.ptp(position, axis=0) <= _STANDSTILL
    still = {name: float(position[0, k]) for k, name in enumerate(others) if rests[k]}
    names = [name for name in motion.joint_names if name not in still]
    rows = [motion.joint_names.index(name) for name in names]
    motion = JointTrajectory(names, motion.breakpoints, motion.coefficients[:, :, rows])
    return replace(file, trajectory=motion, still=still)


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
        remedy = f"{TRAJECTORY_VERSION} can be read; a newer tubeplanner may read it"
        raise TrajectoryError(f"version is {shown(version)}; {remedy}")
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


def _read_csv(text: str, joint_names: Sequence[str]) -> TrajectoryFile:
    # Row by row, and columns as plain numbers: text takes ten times as much memory.
    try:
        number, separator, header = _csv_header(text)
        columns = joint_columns(header, joint_names)
        names = [columns.time, *(name for table in columns.tables.values() for name in table)]
        rows = enumerate(islice(_csv_rows(text, separator), number, None), number + 1)
        time, *values = _csv_columns(rows, separator, header, names)
    except csv.Error as error:
        raise TrajectoryError(f"is no CSV ({error})") from None
    n = len(columns.joints)
    tables = {
        quantity: np.array(values[n * k : n * k + n]).T for k, quantity in enumerate(columns.tables)
    }
    file = _from_samples(columns.joints, time, tables)
    samples = GivenSamples(float(time[0]), tuple(tables))
    return replace(file, samples=samples, ignored=columns.ignored, remarks=columns.remarks)


# ---- Rows of a CSV file. Spreadsheets separate by semicolons where the comma is the decimal mark.

_SEPARATORS = (",", ";", "\t", " ")
_THOUSANDS = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}")
_COMMENTS = ("#", "%", "sep=")  # before the header; "sep=;" is for spreadsheets


def _csv_rows(text: str, separator: str) -> Iterator[list[str]]:
    """Yield the cells of each row that is not empty."""
    lines = io.StringIO(text, newline="")
    if separator == " ":
        rows: Iterable[list[str]] = (line.split() for line in lines)
    else:
        rows = csv.reader(lines, delimiter=separator)
    return (row for row in rows if any(row))


def _csv_header(text: str) -> tuple[int, str, list[str]]:
    """Return the number of the header's row, the separator, and the names of the columns.

    The separator is the first one that makes a column of times. Without such a column it makes the
    most columns, blanks last.
    """
    options: list[tuple[int, str, list[str]]] = []
    for separator in _SEPARATORS:
        for number, row in enumerate(_csv_rows(text, separator), 1):
            names = [name.strip() for name in row]
            if separator == " " and names[0] in ("#", "%"):
                del names[0]
            if len(names) > 1 and any(map(_is_time, names)):
                return number, separator, names
            if not row[0].startswith(_COMMENTS):
                options.append((number, separator, names))
                break
    if not options:
        return 0, ",", []
    return max(
        options, key=lambda option: (option[1] != " " and len(option[2]) > 1, len(option[2]))
    )


def _csv_columns(
    rows: Iterable[tuple[int, list[str]]], separator: str, header: list[str], names: list[str]
) -> list[FloatArray]:
    """Return the columns of given names, each (N,), from numbered rows."""
    index_of = {name: index for index, name in enumerate(header)}
    columns = [(index_of[name], name, array("d")) for name in names]
    marks: dict[str, str] = {}  # per decimal mark, its first place
    is_clear = False  # True as soon as a comma cannot stand between thousands
    for count, (number, row) in enumerate(rows):
        if len(row) != len(header):
            has_more = separator == "," and len(row) > len(header)
            raise TrajectoryError(
                f"row {number} has {len(row)} values for {len(header)} columns"
                + "; are there decimal commas? Write points, or separate by semicolons" * has_more
            )
        if count >= _MAX_SAMPLES:
            raise _too_many_samples()
        for index, name, column in columns:
            text = row[index]
            mark = "," if "," in text else "."
            if mark not in marks and mark in text:
                marks[mark] = f"row {number}, {name}: {shown(text)}"
            if mark == "," and text.count(",") == 1 and "." not in text:
                is_clear = is_clear or _THOUSANDS.fullmatch(text.strip()) is None
                text = text.replace(",", ".")
            column.append(_number(text, "row {}, {}", number, name))
    if len(marks) > 1:
        raise TrajectoryError(
            f"has decimal points ({marks['.']}) and commas ({marks[',']}); write one decimal mark, "
            "and no marks between thousands"
        )
    if "," in marks and not is_clear:
        raise TrajectoryError(
            f"has commas ({marks[',']}) that may be decimal marks or stand between thousands; "
            "write decimal points, and no marks between thousands"
        )
    return [np.frombuffer(column, dtype=np.float64) for *_, column in columns]


def _too_many_samples() -> TrajectoryError:
    return TrajectoryError(
        f"has more than {_MAX_SAMPLES} samples; write fewer per second, or cut it into parts"
    )


def _number(value: Any, where: str, *locations: object) -> float:
    """Return a finite number; `where`, its braces filled with `locations`, names the number."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TrajectoryError(f"{where.format(*locations)} is {shown(value)}, no number") from None
    except OverflowError:  # a whole number too large for a float
        number = np.inf
    if not abs(number) <= _MAX_NUMBER:
        raise TrajectoryError(
            f"{where.format(*locations)} is {number:g}; it must be finite, at most {_MAX_NUMBER:g}"
        )
    return number


def _read_ros(text: str) -> TrajectoryFile:
    try:
        # `ros2 topic echo` ends every message with a document marker.
        message = parse_yaml(text, first_of_many=True)
    except DocumentError as error:
        raise TrajectoryError(f"is no YAML ({error})") from error
    messages = _messages(message)
    # Plans may hold trajectories without points, where a part of the robot has nothing to do.
    moving = [each for each in messages if each.get("points") != []]
    files = [_read_message(each) for each in moving or messages]
    if not files:
        raise TrajectoryError(_NO_MESSAGE)
    remarks = []
    if len(files) > 1:
        remarks.append(f"its {len(files)} trajectories are joined, one after the other")
    count = sum(_CONTENT.search(part) is not None for part in _NEXT_MESSAGE.split(text))
    if count > 1:
        remarks.append(f"of its {count} messages the first alone is read")
    first, names = files[0], files[0].trajectory.joint_names
    for k, file in enumerate(files):
        if sorted(file.trajectory.joint_names) != sorted(names):
            raise TrajectoryError(
                f"trajectory {k} moves {', '.join(file.trajectory.joint_names)}, trajectory 0 "
                f"{', '.join(names)}; trajectories of the same joints alone can be joined"
            )
        if file.interpolation != first.interpolation:
            raise TrajectoryError(
                f"samples of trajectory {k} are joined by {file.interpolation}, of trajectory 0 by "
                f"{first.interpolation}; give the same quantities in all"
            )
    motion = first.trajectory
    if len(files) > 1:
        motion = concatenate([file.trajectory.reordered(names) for file in files])
    return replace(first, trajectory=motion, remarks=tuple(remarks))


_NO_MESSAGE = (
    "is no trajectory_msgs/JointTrajectory, moveit_msgs/RobotTrajectory or DisplayTrajectory: it "
    "needs a list of points"
)


def _messages(value: object) -> list[dict[str, Any]]:
    """Return the messages in a value; MoveIt's DisplayTrajectory has a list of trajectories."""
    if isinstance(value, list):
        return [message for each in value for message in _messages(each)]
    if not isinstance(value, dict):
        return []
    other = value.get(_MULTI_DOF)
    if isinstance(other, dict) and other.get("points"):
        raise TrajectoryError(
            f"{_MULTI_DOF} moves {shown(other.get('joint_names'))}, which is not read; take a "
            "group without these joints"
        )
    for key in _WRAPPERS:
        if isinstance(value.get(key), dict | list):
            return _messages(value[key])
    return [value]


def _read_message(message: dict[str, Any]) -> TrajectoryFile:
    points = message.get("points")
    if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
        raise TrajectoryError(_NO_MESSAGE)
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
        rows = []
        for i, point in enumerate(points):
            values = point[key]
            if not isinstance(values, list) or len(values) != len(names):
                raise TrajectoryError(
                    f"point {i}: {key} {shown(values)} must be {len(names)} numbers, one per joint"
                )
            rows.append([_number(value, "point {}: {}", i, key) for value in values])
        tables[quantity] = np.array(rows)
    time = np.array([_ros_time(i, point) for i, point in enumerate(points)])
    file = _from_samples(names, time, tables)
    has_effort = any(bool(point.get("effort")) for point in points)
    return replace(file, samples=GivenSamples(float(time[0]), tuple(tables), has_effort))


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
    # A derivative with another unit than the slopes: degrees, milliseconds.
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
    joint_names: Sequence[str], time: FloatArray, values: Sequence[FloatArray]
) -> JointTrajectory:
    """Return samples at times (N,) [s], joined by `hermite_pieces`; values are (N, n) each."""
    return JointTrajectory(joint_names, time, hermite_pieces(time, values))


# ---- Columns of a CSV file: times, positions, velocities and accelerations of joints.
#
# Our own files have `time` and `JOINT.position`. Recorders write other names; `joint_columns` knows
# those of PlotJuggler, of rosbag exports and of Universal Robots' RTDE for the joints of a robot.

_TIME = "time"
_TIMES = ("time", "t", "timestamp")
_TIME_MARKS = "#%_ "  # before a time's name: "#time", PlotJuggler's "__time"
_MAX_COLUMNS_SHOWN = 20
_BY_NUMBER = (  # RTDE: names by quantity, the joints numbered from 0 in chain order
    {"position": "actual_q_{}", "velocity": "actual_qd_{}"},
    {"position": "target_q_{}", "velocity": "target_qd_{}", "acceleration": "target_qdd_{}"},
)


@dataclass(frozen=True)
class JointColumns:
    """Columns of a file that are read."""

    time: str  # the column of times
    joints: list[str]  # names of the n joints
    tables: dict[str, list[str]]  # per quantity, the columns of all joints, in their order
    ignored: tuple[str, ...]  # columns that are not read, without the efforts of these joints
    remarks: tuple[str, ...] = ()  # sentences on the meaning of columns


def joint_columns(header: Sequence[str], joint_names: Sequence[str] = ()) -> JointColumns:
    """Return the columns of a file that are read.

    Columns of `joint_names` may have other names than JOINT.position: the joint's name (a
    position), or JOINT/position, JOINT_position, position_JOINT or position/JOINT, after any path
    such as /joint_states/; or actual_q_0, actual_q_1, ..., one for each joint in this order. Others
    are found by a column `JOINT.position`.

    Raises:
        TrajectoryError: There is no time, there are no positions, two columns are the same
            quantity, or a quantity is missing for some joints.
    """
    for name, count in Counter(header).items():
        if count > 1:
            raise TrajectoryError(f"the column {shown(name)} is there {count} times")
    own = [name.removesuffix(".position") for name in header if name.endswith(".position")]
    columns = _columns_by_quantity(header, dict.fromkeys([*own, *joint_names]))
    remarks: tuple[str, ...] = ()
    if not any(quantity == QUANTITIES[0] for _, quantity in columns):
        columns = _columns_by_number(header, joint_names) or columns
        pairs = [f"{name} as {key[0]}" for key, name in columns.items() if key[1] == "position"]
        remarks = (f"columns are read by number: {', '.join(pairs)}",) if pairs else ()
    joints = [joint for joint, quantity in columns if quantity == QUANTITIES[0]]
    named = {*columns.values()}
    times = [name for name in header if name not in named and _is_time(name)]
    if len(times) > 1 and _TIME not in times:
        raise TrajectoryError(
            f"the columns {' and '.join(map(shown, times))} may all be times; leave out all but "
            f"one, or call it {_TIME}"
        )
    if not times or not joints:
        plain = (
            f" (or columns named as the joints: {', '.join(joint_names)})" if joint_names else ""
        )
        raise TrajectoryError(
            f"needs the columns time and JOINT.position{plain}; its columns are "
            f"{', '.join(map(shown, header[:_MAX_COLUMNS_SHOWN])) or 'none'}"
        )
    for joint in joints:
        require_name("the joint of a column", joint, TrajectoryError)
    tables: dict[str, list[str]] = {}
    for quantity in QUANTITIES:
        missing = [joint for joint in joints if (joint, quantity) not in columns]
        if len(missing) == len(joints):
            break
        if missing:
            raise TrajectoryError(
                f"{quantity} is missing for {', '.join(missing)}; give it for all joints or none"
            )
        tables[quantity] = [columns[joint, quantity] for joint in joints]
    time = _TIME if _TIME in times else times[0]
    used = {time, *(name for names in tables.values() for name in names)}
    used.add(MARK_COLUMN)
    used |= {name for joint in joints for name in _names(joint, "effort")}
    ignored = tuple(name for name in header if name not in used)
    return JointColumns(time, joints, tables, ignored, remarks)


def _columns_by_number(
    header: Sequence[str], joint_names: Sequence[str]
) -> dict[tuple[str, str], str]:
    """Return columns by joint and quantity; empty unless every joint has its number."""
    n = len(joint_names)
    for forms in _BY_NUMBER:
        columns = {
            (joint, quantity): form.format(k)
            for quantity, form in forms.items()
            for k, joint in enumerate(joint_names)
            if form.format(k) in header
        }
        last = forms["position"].format(n)
        if last not in header and all((joint, "position") in columns for joint in joint_names):
            return columns
    return {}


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
        key, tail = meanings.get(column), column
        while key is None and "/" in tail:  # after any path
            tail = tail.partition("/")[2]
            # A joint's bare name is a position only without a path.
            if (meaning := meanings.get(tail)) is not None and tail != meaning[0]:
                key = meaning
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


def _names(joint: str, quantity: str) -> list[str]:
    """Return the possible names of the column for a quantity of a joint."""
    bare = [joint] if quantity == QUANTITIES[0] else []
    both = [f"{joint}{mark}{quantity}" for mark in "./_"]
    return [*bare, *both, f"{quantity}_{joint}", f"{quantity}/{joint}"]


def _is_time(name: str) -> bool:
    return name.lstrip(_TIME_MARKS).lower() in _TIMES
