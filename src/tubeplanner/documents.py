"""JSON and YAML within bounds of size, nesting and aliases.

A file of some bytes can ask for any time and memory: by nesting, by aliases of aliases, or by being
a pipe that never ends. YAML is read by libyaml's events, which take a tenth of the time and memory
of a tree of nodes; scalars mean what YAML 1.2's core schema says, numbers may have `_` in between.
"""

import json
import re
import stat
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

from tubeplanner.errors import shown

MAX_NESTING = 100
_TOO_DEEP = f"lists and maps are nested more than {MAX_NESTING} deep"
_HOLDERS = (dict, list, tuple)
MAX_ALIASED = 100_000  # values that all aliases and merges may stand for together

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
    """A file cannot be read, or is malformed; the caller adds the name of the file."""


def read_bytes(path: Path, most: int) -> bytes:
    """Return the contents of a regular file of at most `most` bytes.

    Raises:
        DocumentError: The file cannot be read, is no regular file, or is larger.
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
    """Return the value of a JSON text.

    Raises:
        DocumentError: The text is malformed, nested deeper than `MAX_NESTING`, or has a key twice.
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

    Deeper values cannot be copied, compared or shown.
    """
    level: list[Any] = [value] if isinstance(value, _HOLDERS) else []
    for _ in range(MAX_NESTING):
        inner = (
            x
            for holder in level
            for x in (holder.values() if isinstance(holder, dict) else holder)
            if isinstance(x, _HOLDERS)
        )
        level = list({id(x): x for x in inner}.values())
    if level:
        raise DocumentError(_TOO_DEEP)


def parse_yaml(text: str, *, first_of_many: bool = False) -> object:
    """Return the value of a YAML text: dictionaries, lists, text, numbers, truth values, None.

    An alias gives the same object again. `<<` merges maps; written keys hold before merged ones.
    Documents after the first are an error, or `first_of_many` ignored.

    Raises:
        DocumentError: The text is malformed, nested deeper than `MAX_NESTING`, or its aliases stand
            for more than `MAX_ALIASED` values. The message names line and column.
    """
    import yaml  # slower to import than everything else that a check by JSON needs

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
    """Builder of values from a parser's events, in their order."""

    def __init__(self, parser: Any) -> None:
        self._next: Callable[[], _Event] = parser.get_event
        self._count = 0  # of values, with the values of aliases
        self._aliased = 0
        # By anchor: the value, and the count of values in it; None while it is being built.
        self._anchors: dict[str, tuple[object, int] | None] = {}
        self._keys: dict[str, str] = {}  # one object for the same key of many maps

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
        """Return the value that begins with an event, inside `depth - 1` lists and maps."""
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
        elif kind == "SequenceStart":
            values: list[object] = []
            while _kind(event := self._next()) != "SequenceEnd":
                values.append(self._value(event, depth + 1))
            value = values
        else:
            value = self._map(depth)
        if anchor is not None:
            self._anchors[anchor] = (value, self._count - before)
        return value

    def _alias(self, event: _Event) -> object:
        anchored = self._anchors.get(event.anchor)
        if anchored is None:
            reason = "holds itself" if event.anchor in self._anchors else "is not known"
            raise _fault(event, f"the alias {shown(event.anchor)} {reason}")
        value, count = anchored
        self._count += count
        self._aliased += count
        if self._aliased > MAX_ALIASED:
            reason = f"aliases and merges stand for more than {MAX_ALIASED} values; write them out"
            raise _fault(event, reason)
        return value

    def _map(self, depth: int) -> dict[object, object]:
        own: dict[object, object] = {}
        merged: dict[object, object] = {}
        while _kind(event := self._next()) != "MappingEnd":
            if _kind(event) == "Scalar" and event.value == "<<" and event.implicit[0]:
                event = self._next()
                value = self._value(event, depth + 1)
                for each in value if isinstance(value, list) else [value]:
                    if not isinstance(each, dict):
                        raise _fault(event, "<< takes a map or a list of maps")
                    for key, member in each.items():
                        merged.setdefault(key, member)  # the first map that has a key holds
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
    return DocumentError(_location(event.start_mark) + reason)


def _location(mark: Any) -> str:
    return f"line {mark.line + 1}, column {mark.column + 1}: "


def _malformed(error: Any, text: str) -> str:
    """Return libyaml's message with its location: for an end too early, the last line."""
    reason, mark, lines = str(error.problem or error.context), error.problem_mark, text.splitlines()
    if mark is None:
        return reason
    if "maximum nesting" in reason:  # libyaml's own bound, 1,000 since 6.0.4 of PyYAML
        return _location(mark) + _TOO_DEEP
    if mark.line >= len(lines):
        return f"line {max(len(lines), 1)}, at its end: {reason}"
    is_tab = lines[mark.line][mark.column : mark.column + 1] == "\t"
    return _location(mark) + reason + (" (a tab); use spaces" if is_tab else "")


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    result = dict(pairs)
    if len(result) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        raise DocumentError(f"the key {shown(counts.most_common(1)[0][0])} is given twice")
    return result
