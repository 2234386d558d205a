"""Which columns of a CSV file are times, positions, velocities and accelerations of joints.

Our own files have `time` and `JOINT.position`. Recorders write other names; `joint_columns` knows
those of PlotJuggler and of rosbag exports for the joints of a robot.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.names import require_name

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
