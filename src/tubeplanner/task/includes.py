"""Included files: a problem as layers, merged fields, relative paths."""

import os
from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from tubeplanner.documents import DocumentError, require_shallow
from tubeplanner.errors import ProblemError, shown
from tubeplanner.resources import EXAMPLE_PREFIX, PRESET_ENDINGS, find_problem
from tubeplanner.task.problem_format import PROBLEM_FORMAT, read_document

# ---- One problem's fields from those of two files.


def merged_fields(below: Any, above: Any) -> Any:
    """Return what two documents give together; neither is changed.

    Maps are merged key by key, lists whose items all have a name, item by item of the same name:
    those of `below` first, then the new ones. Everything else is that of `above`.
    """
    if isinstance(below, dict) and isinstance(above, dict):
        shared = {k: merged_fields(below[k], above[k]) for k in above if k in below}
        return {**below, **above, **shared}
    if is_named(below) and is_named(above):
        return _merged_items(below, above)
    return above


def is_named(items: Any) -> bool:
    """Return whether something is a list whose items go by their names; an empty one does."""
    return isinstance(items, list) and all(
        isinstance(item, dict) and isinstance(item.get("name"), str) for item in items
    )


def _merged_items(below: list[Any], above: list[Any]) -> list[Any]:
    """Return items merged by name; of those with one name, which are a fault, only the first."""
    first: dict[str, Any] = {}
    new = []
    known = {item["name"] for item in below}
    for item in above:
        if item["name"] in known and item["name"] not in first:
            first[item["name"]] = item
        else:
            new.append(item)
    merged = [merged_fields(item, first.pop(item["name"], {})) for item in below]
    return [*merged, *new]


# ---- The fields of a problem file that are paths, relative to the file that holds them.

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


# ---- A problem file and the files that it includes, each a layer above those before it.

INCLUDE = "include"
_MAX_FILES = 100
_ABSENT = object()


@dataclass(frozen=True)
class ProblemLayers:
    """What a problem file and those that it includes hold, the lowest first, the file itself last.

    Attributes:
        sources: What messages call each.
        documents: What each holds without its `include`, paths relative to the folder of the last.
    """

    sources: tuple[str, ...]
    documents: tuple[Any, ...]

    @classmethod
    def read(cls, path: Path) -> "ProblemLayers":
        """Read a problem file, YAML 1.2 or JSON, and all that it includes.

        Raises:
            ProblemError: As `of`; or the file itself cannot be read.
        """
        return cls.of(read_document(path), path.parent, str(path), path)

    @classmethod
    def of(cls, data: Any, folder: Path, source: str, path: Path | None = None) -> "ProblemLayers":
        """Return the layers of what a problem file holds.

        Args:
            data: The document; it stays as it is.
            folder: Where its relative paths start.
            source: What messages call it.
            path: The file that holds it; None: it is in no file.

        Raises:
            ProblemError: An included file cannot be read or is none, files include each other in
                a circle, or the document is nested too deep.
        """
        try:
            require_shallow(data)
        except DocumentError as error:
            raise ProblemError(f"{source}: {error}") from None
        layers: list[tuple[str, Any]] = []
        chain = () if path is None else (path.resolve(),)
        for layer in _layers(data, folder, source, chain):
            if len(layers) == _MAX_FILES:
                raise ProblemError(
                    f"{source}: {INCLUDE}: more than {_MAX_FILES} files are included; merge some"
                )
            layers.append((layer[0], _with_moved_paths(layer[1], layer[2], folder)))
        return cls(*map(tuple, zip(*layers, strict=True)))

    @property
    def merged(self) -> Any:
        """What all of them give together, the later ones above."""
        return reduce(merged_fields, self.documents)

    @property
    def files(self) -> list[Path]:
        """The files that were read, for layers that all come from one."""
        return [Path(source) for source in self.sources]

    @property
    def below(self) -> Any:
        """What the included files give together."""
        return reduce(merged_fields, self.documents[:-1], {})

    def source_of(self, merged: Any, steps: Sequence[int | str]) -> str:
        """Return the source of a value: the last layer that has it.

        Args:
            merged: What all of them give together, perhaps changed since.
            steps: Keys and indices that lead to the value there.
        """
        wanted = _value_at(merged, merged, steps)
        for source, document in zip(self.sources[::-1], self.documents[::-1], strict=True):
            found = _value_at(document, merged, steps)
            if found is not _ABSENT and (isinstance(found, dict) or _is_same(found, wanted)):
                return source
        return self.sources[-1]


def _layers(
    data: Any, folder: Path, source: str, chain: tuple[Path, ...]
) -> Iterator[tuple[str, Any, Path]]:
    """Yield source, document and folder of what a document includes, then of itself.

    Args:
        data: The document.
        folder: Where its relative paths start.
        source: What messages call it.
        chain: The files that lead here, each including the next.
    """
    for name in _included(data, source):
        try:
            path = find_problem(name, folder)
        except ProblemError as error:
            raise ProblemError(f"{source}: {INCLUDE}: {error}") from None
        resolved = path.resolve()
        if resolved in chain:
            circle = [*chain[chain.index(resolved) :], resolved]
            names = " includes ".join(file.name for file in circle)
            raise ProblemError(f"{source}: {INCLUDE}: {names}, a circle; take one of them out")
        document = read_document(path, "included file")
        _require_part(document, path)
        yield from _layers(document, path.parent, str(path), (*chain, resolved))
    yield source, data, folder


def _included(data: Any, source: str) -> list[str]:
    """Return the names of the files that a document includes."""
    given = data.get(INCLUDE) if isinstance(data, dict) else None
    names = [] if given is None else given if isinstance(given, list) else [given]
    for name in names:
        if not isinstance(name, str) or not name:
            raise ProblemError(
                f"{source}: {INCLUDE} is {shown(given)}; it must be a file or a list of files"
            )
    return names


def _require_part(document: Any, path: Path) -> None:
    """Raise unless an included file may hold a part of a problem."""
    if not isinstance(document, dict):
        raise ProblemError(f"{path}: an included file is a map, as a problem file is")
    kind = document.get("format", PROBLEM_FORMAT)
    if kind != PROBLEM_FORMAT:
        raise ProblemError(
            f"{path}: format is {shown(kind)}; an included file is a problem file or a part of one"
        )


def _with_moved_paths(document: Any, before: Path, after: Path) -> Any:
    """Return a document without its includes, its paths valid in another folder."""
    if not isinstance(document, dict):
        return document
    own = {key: value for key, value in document.items() if key != INCLUDE}
    if before != after:
        own = deepcopy(own)
        move_paths(own, before, after)
    return own


def _is_same(first: Any, second: Any) -> bool:
    try:
        return bool(first == second)
    except ValueError:  # of arrays, which no file holds, but a caller's document may
        return first is second


def _value_at(document: Any, merged: Any, steps: Sequence[int | str]) -> Any:
    """Return what a document has where keys and indices lead to in the merged one."""
    for step in steps:
        try:
            merged = merged[step]
            if isinstance(step, int) and isinstance(merged, dict) and is_named(document):
                document = next(each for each in document if each["name"] == merged.get("name"))
            else:
                document = document[step]
        except (KeyError, IndexError, TypeError, StopIteration):
            return _ABSENT
    return document
