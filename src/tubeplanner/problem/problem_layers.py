"""A problem file and the files that it includes, each a layer above those before it."""

from collections.abc import Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from tubeplanner.documents import DocumentError, require_shallow
from tubeplanner.errors import ProblemError, shown
from tubeplanner.problem.merged_fields import is_named, merged_fields
from tubeplanner.problem.path_fields import move_paths
from tubeplanner.problem.problem_format import PROBLEM_FORMAT, read_document
from tubeplanner.resources import find_problem

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
            layers.append((layer[0], _moved(layer[1], layer[2], folder)))
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


def _moved(document: Any, before: Path, after: Path) -> Any:
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
