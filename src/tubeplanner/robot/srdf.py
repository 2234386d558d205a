"""SRDF files: which pairs of links may touch, and states that have a name."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from tubeplanner.documents import DocumentError, read_bytes
from tubeplanner.errors import RobotError
from tubeplanner.robot.urdf_values import read_name, read_number

_MAX_BYTES = 50_000_000


def read_allowed_pairs(path: Path) -> list[tuple[str, str]]:
    """Return the pairs of links whose collisions an SRDF disables.

    Args:
        path: The file.

    Raises:
        RobotError: The file cannot be read, is no SRDF, or an entry names no link.
    """
    return [
        (read_name(str(path), entry, "link1"), read_name(str(path), entry, "link2"))
        for entry in _read_root(path).findall("disable_collisions")
    ]


def read_group_states(path: Path) -> dict[str, dict[str, float]]:
    """Return the positions of joints in every <group_state>, by its name; the last of equal names.

    Joints of several values are left out.

    Args:
        path: The file.

    Raises:
        RobotError: As `read_allowed_pairs`, or a value is no number.
    """
    states: dict[str, dict[str, float]] = {}
    for entry in _read_root(path).findall("group_state"):
        where = f"{path}: <group_state> '{(name := read_name(str(path), entry, 'name'))}'"
        values = {
            read_name(where, joint, "name"): read_number(where, joint, "value")
            for joint in entry.findall("joint")
            if len(str(joint.get("value")).split()) == 1
        }
        states[name] = {joint: value for joint, value in values.items() if value is not None}
    return states


def _read_root(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(read_bytes(path, _MAX_BYTES))
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} cannot be read as SRDF: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: the root element is <{root.tag}>, not <robot>")
    return root
