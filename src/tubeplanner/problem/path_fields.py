"""The fields of a problem file that are paths, relative to the file that holds them."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tubeplanner.resources import EXAMPLE_PREFIX, PRESET_ENDINGS

_PACKAGE_PREFIX, _FILE_PREFIX = "package://", "file://"


def move_paths(fields: Any, before: Path, after: Path) -> None:
    """Make the relative paths of a problem, valid in one folder, valid in another.

    Names of bundled robots, presets and problems, `package://` names and absolute paths stay as
    they are, and so does what is no path where one should be: the check of the schema names it.

    Args:
        fields: What a problem file holds, or a part of it; it is changed.
        before: The folder where its paths start.
        after: The folder where they are to start.
    """
    # Read before the first one is changed: an alias may be at two places.
    places = [(holder, key, holder[key]) for holder, key, _ in path_places(fields)]
    for holder, key, path in places:
        if isinstance(path, str):
            holder[key] = _moved(path, before, after)


def path_places(fields: Any) -> Iterator[tuple[Any, Any, str]]:
    """Yield holder and key of every path in a problem or a cycle, and the field that it is of.

    Of presets only those that are files: the others are bundled names.

    Args:
        fields: What its file holds, or a part of it.
    """
    fields = _map(fields)
    yield from _of(fields, "include")
    robot = _map(fields.get("robot"))
    for key in ("urdf", "srdf", "limits_file", "package_dirs"):
        yield from _of(robot, key)
    for holder, key, field in _of(robot, "preset"):
        if _is_preset_file(holder[key]):
            yield holder, key, field
    yield from _of_move(fields)
    for move in _list(fields.get("moves")):
        yield from _of_move(_map(move))
        yield from _of(_map(_map(move).get("shape")), "mesh")
    for solids in (fields.get("obstacles"), robot.get("attached")):
        for solid in _list(solids):
            yield from _of(_map(solid), "mesh")


def _of_move(fields: Any) -> Iterator[tuple[Any, Any, str]]:
    """Yield the paths of a tube, a start and a goal."""
    tube = _map(fields.get("tube"))
    if isinstance(tube.get("points"), str):
        yield tube, "points", "points"
    for end in ("start", "goal"):
        yield from _of(_map(fields.get(end)), "trajectory")


def _of(holder: Any, field: str) -> Iterator[tuple[Any, Any, str]]:
    """Yield where the one path or the list of paths of a field is."""
    value = holder.get(field)
    if isinstance(value, list):
        yield from ((value, k, field) for k in range(len(value)))
    elif value is not None:
        yield holder, field, field


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _map(value: Any) -> Any:
    return value if isinstance(value, dict) else {}


def _is_preset_file(name: Any) -> bool:
    """Return whether a preset is a file, rather than a bundled name."""
    return isinstance(name, str) and Path(name).suffix in PRESET_ENDINGS


def _moved(path: str, before: Path, after: Path) -> str:
    if path.startswith((EXAMPLE_PREFIX, _PACKAGE_PREFIX)):
        return path
    prefix = _FILE_PREFIX if path.startswith(_FILE_PREFIX) else ""
    plain = path.removeprefix(prefix)
    if Path(plain).is_absolute():
        return path
    return prefix + os.path.relpath((before / plain).resolve(), after.resolve())
