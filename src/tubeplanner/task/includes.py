"""Included files: a problem as layers, merged fields, relative paths."""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from tubeplanner.documents import DocumentError, require_shallow
from tubeplanner.errors import ProblemError, faults_of, shown
from tubeplanner.fields import FORMAT_VERSION, known_version
from tubeplanner.resources import PRESET_ENDINGS, find_problem, rebased
from tubeplanner.task.problem_format import PROBLEM_FORMAT, read_document

# ---- Merging of documents.


def merged_fields(below: Any, above: Any) -> Any:
    """Return the merged content of two documents; neither is changed.

    Maps are merged key by key; lists whose items all have a name, item by item of the same name,
    items of `below` first, then new items. Every other value is that of `above`.
    """
    if isinstance(below, dict) and isinstance(above, dict):
        shared = {k: merged_fields(below[k], above[k]) for k in above if k in below}
        return {**below, **above, **shared}
    if is_named(below) and is_named(above):
        # Repeated names, an error later, stay unmerged.
        first: dict[str, Any] = {}
        new = []
        names = set(map(name_of, below))
        for item in above:
            if name_of(item) in names and name_of(item) not in first:
                first[name_of(item)] = item
            else:
                new.append(item)
        merged = [merged_fields(item, first.pop(name_of(item), {})) for item in below]
        return [*merged, *new]
    return above


def is_named(items: Any) -> bool:
    """Return True if a value is a list whose items all have a name; an empty list is."""
    return isinstance(items, list) and all(isinstance(name_of(item), str) for item in items)


def name_of(item: Any) -> Any:
    """Return the name of an item of a list, for a planning scene its file; None without."""
    return item.get("name", item.get("moveit_scene")) if isinstance(item, dict) else None


# ---- Fields that are paths, relative to the file that holds them.


def move_paths(fields: Any, before: Path, after: Path) -> None:
    """Change the relative paths of a problem, in place, from one folder to another.

    Names of bundled robots, presets and problems, `package://` names and absolute paths stay
    unchanged, as do values that are no path: the schema's check reports them.
    """
    # Read before the first change: an alias may be at two places.
    locations = [(holder, key, holder[key]) for holder, key, _ in paths_in(fields)]
    for holder, key, path in locations:
        if isinstance(path, str):
            holder[key] = rebased(path, before, after)


def paths_in(fields: Any) -> Iterator[tuple[Any, Any, str]]:
    """Yield holder, key and field of every path in a problem or a cycle.

    Of presets only files: the others are bundled names.
    """
    fields = _map(fields)
    yield from _paths_in(fields, "include")
    robot = _map(fields.get("robot"))
    for key in ("urdf", "srdf", "limits_file", "package_dirs"):
        yield from _paths_in(robot, key)
    for section in (robot, _map(fields.get("robustness"))):
        for holder, key, field in _paths_in(section, "preset"):
            name = holder[key]
            if isinstance(name, str) and Path(name).suffix in PRESET_ENDINGS:
                yield holder, key, field
    yield from _paths_in_move(fields)
    for move in _list(fields.get("moves")):
        yield from _paths_in_move(_map(move))
        yield from _paths_in_solid(_map(move).get("shape"))
    for solids in (fields.get("obstacles"), robot.get("attached")):
        for solid in _list(solids):
            yield from _paths_in_solid(solid)


def _paths_in_solid(fields: Any) -> Iterator[tuple[Any, Any, str]]:
    """Yield the paths of a solid, or of a planning scene in its place."""
    for key in ("mesh", "points", "moveit_scene"):
        if isinstance(_map(fields).get(key), str):  # a mesh may be in the file itself
            yield fields, key, key


def _paths_in_move(fields: Any) -> Iterator[tuple[Any, Any, str]]:
    """Yield the paths of a tube, a start and a goal."""
    tube = _map(fields.get("tube"))
    if isinstance(tube.get("points"), str):
        yield tube, "points", "points"
    for end in ("start", "goal"):
        yield from _paths_in(_map(fields.get(end)), "trajectory")


def _paths_in(holder: Any, field: str) -> Iterator[tuple[Any, Any, str]]:
    """Yield holder and key of the path, or of each of the list or map of paths, in a field."""
    value = holder.get(field)
    if isinstance(value, list | dict):
        keys = value if isinstance(value, dict) else range(len(value))
        yield from ((value, key, field) for key in keys)
    elif value is not None:
        yield holder, field, field


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _map(value: Any) -> Any:
    return value if isinstance(value, dict) else {}


# ---- A problem file and its included files, each a layer above the earlier ones.

INCLUDE = "include"
# A file counts each time that it is included: levels of two includes each double the count.
_MAX_FILES = 100
_ABSENT = object()


@dataclass(frozen=True)
class ProblemLayers:
    """Documents of a problem file and its included files, the file itself last."""

    sources: tuple[str, ...]  # names of the files in messages
    # contents without `include`, with paths relative to the folder of the last file
    documents: tuple[Any, ...]

    @classmethod
    def read(cls, path: Path) -> "ProblemLayers":
        """Read a problem file, YAML 1.2 or JSON, and its included files."""
        return cls.of(read_document(path), path.parent, str(path), path)

    @classmethod
    def of(cls, data: Any, folder: Path, source: str, path: Path | None = None) -> "ProblemLayers":
        """Return the layers of a document with relative paths from a folder, from a file if any."""
        with faults_of(source, DocumentError):
            require_shallow(data)
        layers: list[tuple[str, Any]] = []
        chain = () if path is None else (path.resolve(),)
        for name, document, before in _layers(data, folder, source, chain):
            if len(layers) == _MAX_FILES:
                raise ProblemError(
                    f"{source}: {INCLUDE}: more than {_MAX_FILES} files are included; merge some"
                )
            if isinstance(document, dict):
                document = {key: value for key, value in document.items() if key != INCLUDE}
                if before != folder:
                    document = deepcopy(document)
                    move_paths(document, before, folder)
            layers.append((name, document))
        return cls(*map(tuple, zip(*layers, strict=True)))

    @property
    def merged(self) -> Any:
        """Merged content of all documents, later documents above."""
        return reduce(merged_fields, self.documents)

    @property
    def files(self) -> list[Path]:
        """Paths of the files, for layers that were read from a file."""
        return [Path(source) for source in self.sources]

    @property
    def below(self) -> Any:
        """Merged content of the included files."""
        return reduce(merged_fields, self.documents[:-1], {})

    def source_of(self, merged: Any, steps: Sequence[int | str]) -> str:
        """Return the source of a value of the merged content: the last layer that has it."""
        target = _value_at(merged, merged, steps)
        for source, document in zip(self.sources[::-1], self.documents[::-1], strict=True):
            value = _value_at(document, merged, steps)
            if value is not _ABSENT and (isinstance(value, dict) or _is_same(value, target)):
                return source
        return self.sources[-1]


def _layers(
    data: Any, folder: Path, source: str, chain: tuple[Path, ...]
) -> Iterator[tuple[str, Any, Path]]:
    """Yield source, document and folder of the included files, then of the document itself."""
    value = data.get(INCLUDE) if isinstance(data, dict) else None
    files = [] if value is None else value if isinstance(value, list) else [value]
    for name in files:
        if not isinstance(name, str) or not name:
            raise ProblemError(
                f"{source}: {INCLUDE} is {shown(value)}; it must be a file or a list of files"
            )
    for name in files:
        with faults_of(f"{source}: {INCLUDE}", ProblemError):
            path = find_problem(name, folder)
        resolved = path.resolve()
        if resolved in chain:
            circle = [*chain[chain.index(resolved) :], resolved]
            names = " includes ".join(file.name for file in circle)
            raise ProblemError(f"{source}: {INCLUDE}: {names}, a circle; take one of them out")
        document = read_document(path, "included file")
        if not isinstance(document, dict):
            raise ProblemError(f"{path}: an included file is a map, as a problem file is")
        kind = document.get("format", PROBLEM_FORMAT)
        if kind != PROBLEM_FORMAT:
            raise ProblemError(
                f"{path}: format is {shown(kind)}; an included file is a problem file or a part of "
                "one"
            )
        with faults_of(f"{path}: version", ValueError):
            known_version(document.get("version", FORMAT_VERSION))
        yield from _layers(document, path.parent, str(path), (*chain, resolved))
    yield source, data, folder


def _is_same(first: Any, second: Any) -> bool:
    try:
        return bool(first == second)
    except ValueError:  # of arrays, which a caller's document may have, but no file
        return first is second


def _value_at(document: Any, merged: Any, steps: Sequence[int | str]) -> Any:
    """Return the value of a document at keys and indices of the merged content, or `_ABSENT`."""
    for step in steps:
        try:
            merged = merged[step]
            if isinstance(step, int) and isinstance(merged, dict) and is_named(document):
                document = next(each for each in document if name_of(each) == name_of(merged))
            else:
                document = document[step]
        except (KeyError, IndexError, TypeError, StopIteration):
            return _ABSENT
    return document
