"""SRDF files: which pairs of links may touch."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from tubeplanner.documents import DocumentError, read_bytes
from tubeplanner.errors import RobotError
from tubeplanner.robot.urdf_values import read_name

_MAX_BYTES = 50_000_000


def read_allowed_pairs(path: Path) -> list[tuple[str, str]]:
    """Return the pairs of links whose collisions an SRDF disables.

    Args:
        path: The file.

    Raises:
        RobotError: The file cannot be read, is no SRDF, or an entry names no link.
    """
    try:
        root = ElementTree.fromstring(read_bytes(path, _MAX_BYTES))
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} cannot be read as SRDF: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: the root element is <{root.tag}>, not <robot>")
    return [
        (read_name(str(path), entry, "link1"), read_name(str(path), entry, "link2"))
        for entry in root.findall("disable_collisions")
    ]
