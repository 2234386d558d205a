"""JSON and YAML within bounds of size, nesting and aliases.

A file of some bytes can ask for any time and memory: by nesting, by aliases of aliases, or by being
a pipe that never ends. YAML is read by libyaml's events, which take a tenth of the time and memory
of a tree of nodes; scalars mean what YAML 1.2's core schema says, numbers may have `_` in between.
"""

import json
import re
import stat
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeAlias

from tubeplanner.errors import shown

MAX_NESTING = 100
_TOO_DEEP = f"lists and maps are nested more than {MAX_NESTING} deep"
_HOLDERS = (dict, list, tuple)
# How many values aliases and merges may stand for, all together.
MAX_ALIASED = 100_000

_TAG = "tag:yaml.org,2002:"
_TEXT_TAGS = ("!", _TAG + "str")
_SCALAR_TAGS = (None, *(_TAG + name for name in ("null", "bool", "int", "float")))
_WORDS: dict[str, object] = dict.fromkeys(("", "~", "null", "Null", "NULL"))
_WORDS |= dict.fromkeys(("true", "True", "TRUE"), True)
_WORDS |= dict.fromkeys(("false", "False", "FALSE"), False)
_WORDS |= {
    sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")
}
_WORDS |= dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan"))
_INTEGER = re.compile(r"[-+]?[0-9][0-9_]*")
_BASED = re.compile(r"0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9][0-9_]*|[0-9][0-9_]*(\.[0-9_]*)?)([eE][-+]?[0-9]+)?")
_MAX_DIGITS = 308  # of a whole number: longer ones are no floats, and slow to read

_Event: TypeAlias = Any


class DocumentError(ValueError):
    """A file cannot be read, or is malformed; whoever reads it says which file it is."""


def read_bytes(path: Path, most: int) -> bytes:
    """Return the contents of a regular file.

    Args:
        path: The file.
        most: How large it may be [bytes].

    Raises:
        DocumentError: It cannot be read, is no regular file, or is larger.
    """
    require_regular(path, most)
    try:
        return path.read_bytes()
    except OSError as error:
        raise DocumentError(str(error.strerror)) from error


def require_regular(path: Path, most: int) -> None:
    """Raise unless a path is a regular file within bounds; arguments and errors as `read_bytes`."""
    try:
        status = path.stat()
    except OSError as error:
        raise DocumentError(str(error.strerror)) from error
    except ValueError:
        raise DocumentError("its name has a character that no file's name can have") from None
    if not stat.S_ISREG(status.st_mode):
        raise DocumentError("it is no regular file; name one (a pipe might never end)")
    if status.st_size > most:
        raise DocumentError(f"it is larger than {most / 1e6:g} MB")


def read_text(path: Path, most: int) -> str:
    """Return the contents of a regular file in UTF-8; arguments and errors as `read_bytes`."""
    try:
        return read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DocumentError(f"it is no text: {error}") from None


def parse_json(text: str) -> object:
    """Return what a JSON text holds.

    Raises:
        DocumentError: It is malformed, nested deeper than `MAX_NESTING`, or gives a key twice.
    """
    try:
        value = json.loads(text, object_pairs_hook=_unique_keys)
    except RecursionError:
        raise DocumentError(_TOO_DEEP) from None
    except (json.JSONDecodeError, DocumentError) as error:
        raise DocumentError(str(error)) from None
    except ValueError:
        raise DocumentError("a whole number has more than 4300 digits; shorten it") from None
    require_shallow(value)
    return value


def require_shallow(value: object) -> None:
    """Raise DocumentError if lists and maps are nested deeper than `MAX_NESTING`, or in a circle.

    Deeper ones cannot be copied, compared or shown.
    """
    level = [value]
    for _ in range(MAX_NESTING):
        inner = (each for held in level for each in _parts(held))
        level = list({id(each): each for each in inner if isinstance(each, _HOLDERS)}.values())
    if level:
        raise DocumentError(_TOO_DEEP)


def _parts(value: Any) -> Iterable[object]:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, _HOLDERS) else ()


def parse_yaml(text: str, *, first_of_many: bool = False) -> object:
    """Return what a YAML text holds: dictionaries, lists, text, numbers, truth values, None.

    An alias gives the same object again. `<<` merges maps, what is written out holds before what is
    merged.

    Args:
        text: The YAML text.
        first_of_many: Whether documents may follow the first, which are left out.

    Raises:
        DocumentError: It is malformed, nested deeper than `MAX_NESTING`, or its aliases stand for
            more than `MAX_ALIASED` values. The message names line and column.
    """
    import yaml  # takes longer to import than all else that a check by JSON needs

    parser = yaml.CSafeLoader(text)
    try:
        return _Builder(parser).document(first_of_many)
    except yaml.MarkedYAMLError as error:
        raise DocumentError(_malformed(error, text)) from None
    except yaml.YAMLError as error:
        raise DocumentError(" ".join(str(error).split())[:200]) from None
    finally:
        parser.dispose()


class _Builder:
    """Makes values of a parser's events as they come."""

    def __init__(self, parser: Any) -> None:
        self._next: Callable[[], _Event] = parser.get_event
        self._count = 0  # of values, those behind aliases included
        self._aliased = 0
        # By anchor: its value, and how many values that are; None while it is being made.
        self._anchors: dict[str, tuple[object, int] | None] = {}
        self._keys: dict[str, str] = {}  # the same key of many maps is kept once

    def document(self, first_of_many: bool) -> object:
        """Return the value of the first document."""
        self._next()  # the stream begins
        if _kind(self._next()) == "StreamEnd":
            return None
        value = self._value(self._next(), 1)
        self._next()  # the document ends
        if not first_of_many and _kind(following := self._next()) != "StreamEnd":
            raise _fault(following, "a second document begins; there must be one alone")
        return value

    def _value(self, event: _Event, depth: int) -> object:
        """Return the value that an event begins, of which `depth - 1` others are around."""
        kind = _kind(event)
        if kind == "Alias":
            return self._alias(event)
        if depth > MAX_NESTING:
            raise _fault(event, _TOO_DEEP)
        anchor, before = event.anchor, self._count
        self._count += 1
        if anchor is not None:
            self._anchors[anchor] = None
        if kind == "Scalar":
            value = _scalar(event)
        elif event.tag not in (None, "!", _TAG + ("seq" if kind == "SequenceStart" else "map")):
            raise _unknown_tag(event)
        else:
            value = self._list(depth) if kind == "SequenceStart" else self._map(depth)
        if anchor is not None:
            self._anchors[anchor] = (value, self._count - before)
        return value

    def _alias(self, event: _Event) -> object:
        found = self._anchors.get(event.anchor)
        if found is None:
            known = event.anchor in self._anchors
            why = "holds itself" if known else "is not known"
            raise _fault(event, f"the alias {shown(event.anchor)} {why}")
        value, count = found
        self._count += count
        self._aliased += count
        if self._aliased > MAX_ALIASED:
            raise _fault(
                event,
                f"aliases and merges stand for more than {MAX_ALIASED} values; write them out",
            )
        return value

    def _list(self, depth: int) -> list[object]:
        values: list[object] = []
        while _kind(event := self._next()) != "SequenceEnd":
            values.append(self._value(event, depth + 1))
        return values

    def _map(self, depth: int) -> dict[object, object]:
        own: dict[object, object] = {}
        merged: dict[object, object] = {}
        while _kind(event := self._next()) != "MappingEnd":
            if _kind(event) == "Scalar" and event.value == "<<" and event.implicit[0]:
                self._merge(merged, depth)
                continue
            key = self._value(event, depth + 1)
            if isinstance(key, list | dict):
                raise _fault(event, "a list or map cannot be a key")
            if isinstance(key, str):
                key = self._keys.setdefault(key, key)
            if key in own:
                name = shown(str(key)).strip("'")
                raise _fault(event, f'found duplicate key "{name}"')
            own[key] = self._value(self._next(), depth + 1)
        return {**merged, **own} if merged else own

    def _merge(self, merged: dict[object, object], depth: int) -> None:
        """Add the maps that follow a `<<`; the first that has a key holds."""
        event = self._next()
        value = self._value(event, depth + 1)
        maps = value if isinstance(value, list) else [value]
        for each in maps:
            if not isinstance(each, dict):
                raise _fault(event, "<< takes a map or a list of maps")
            for key, held in each.items():
                merged.setdefault(key, held)


def _scalar(event: _Event) -> object:
    text, tag = event.value, event.tag
    if tag in _TEXT_TAGS or (tag is None and not event.implicit[0]):
        return text
    if tag not in _SCALAR_TAGS:
        raise _unknown_tag(event)
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return (int if len(text) <= _MAX_DIGITS else float)(text.replace("_", ""))
    if _FLOAT.fullmatch(text):
        return float(text.replace("_", ""))
    return int(text, 0) if _BASED.fullmatch(text) and len(text) <= _MAX_DIGITS else text


def _kind(event: _Event) -> str:
    return type(event).__name__.removesuffix("Event")


def _unknown_tag(event: _Event) -> DocumentError:
    return _fault(event, f"could not determine what the tag {shown(event.tag)} means")


def _fault(event: _Event, reason: str) -> DocumentError:
    return DocumentError(_place(event.start_mark) + reason)


def _place(mark: Any) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}: "


def _malformed(error: Any, text: str) -> str:
    """Return what libyaml says is wrong; what is missing at the end is missing in the last line."""
    reason, mark, lines = str(error.problem or error.context), error.problem_mark, text.splitlines()
    if mark is None:
        return reason
    if "maximum nesting" in reason:  # libyaml's own bound, 1,000 since 6.0.4 of PyYAML
        return _place(mark) + _TOO_DEEP
    if mark.line >= len(lines):
        return f"line {max(len(lines), 1)}, at its end: {reason}"
    is_tab = lines[mark.line][mark.column : mark.column + 1] == "\t"
    return _place(mark) + reason + (" (a tab); use spaces" if is_tab else "")


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        raise DocumentError(f"the key {shown(counts.most_common(1)[0][0])} is given twice")
    return result
