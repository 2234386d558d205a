"""SRDF files: which pairs of links may touch, and named configurations."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

from tubeplanner.documents import DocumentError, read_bytes
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.robot.urdf_values import read_name

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
        for entry in _root(path).findall("disable_collisions")
    ]


def read_group_state(path: Path, name: str, joint_names: Sequence[str]) -> list[float]:
    """Return the configuration (n,) that an SRDF has under a name [rad or m].

    Other joints of the state do not count. Of groups that share the name, the first one counts that
    has all the joints.

    Args:
        path: The file.
        name: The attribute `name` of a `<group_state>`.
        joint_names: The n joints.

    Raises:
        RobotError: As `read_allowed_pairs`; or there is no such state, it lacks a joint, or a value
            is no number.
    """
    states = _root(path).findall("group_state")
    named = [state for state in states if state.get("name") == name]
    if not named:
        known = sorted({state.get("name", "") for state in states})
        raise RobotError(f"{path}: {unknown_name('group_state', name, known)}")
    values = [_texts(path, state) for state in named]
    missing = [[joint for joint in joint_names if joint not in texts] for texts in values]
    best = min(range(len(named)), key=lambda k: len(missing[k]))
    if missing[best]:
        group = named[best].get("group", "")
        raise RobotError(
            f"{path}: group_state '{name}' of group '{group}' has no value for joint "
            f"{', '.join(missing[best])}; its joints are {', '.join(values[best]) or 'none'}"
        )
    return [_number(path, name, joint, values[best][joint]) for joint in joint_names]


def read_group_states(path: Path) -> dict[str, dict[str, float]]:
    """Return the positions of joints in every <group_state>, by its name; the last of equal names.

    Joints of several values are left out.

    Args:
        path: The file.

    Raises:
        RobotError: As `read_allowed_pairs`, or a value is no number.
    """
    return {
        name: {
            joint: _number(path, name, joint, text)
            for joint, text in _texts(path, state).items()
            if len(text.split()) == 1
        }
        for state in _root(path).findall("group_state")
        for name in [read_name(str(path), state, "name")]
    }


def _root(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(read_bytes(path, _MAX_BYTES))
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} cannot be read as SRDF: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: the root element is <{root.tag}>, not <robot>")
    return root


def _texts(path: Path, state: ElementTree.Element) -> dict[str, str]:
    """Return the values of a state by joint, as they are written."""
    return {
        read_name(str(path), joint, "name"): joint.get("value", "")
        for joint in state.findall("joint")
    }


def _number(path: Path, state: str, joint: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RobotError(
            f"{path}: group_state '{state}' has {shown(text)} for joint '{joint}'; it must be a "
            "number"
        ) from None
