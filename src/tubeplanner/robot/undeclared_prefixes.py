"""Prefixes that a URDF uses and does not declare, as `drake:`: declared before anything parses it.

Parsers without namespaces, as those of ROS and Drake, read such files; by XML they are malformed.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

_NAMESPACES = {
    "drake": "http://drake.mit.edu",
    "xacro": "http://www.ros.org/wiki/xacro",
}
_KNOWN = ("xml", "xmlns")  # declared by XML itself


@dataclass(frozen=True)
class DeclaredXml:
    """An XML text whose prefixes are all declared.

    Attributes:
        xml: The text; the given one if nothing was missing.
        undeclared: The names under each prefix that was not declared, in the order of the text.
    """

    xml: bytes
    undeclared: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def declare_prefixes(xml: bytes) -> DeclaredXml:
    """Return an XML text with declarations added to its root for the prefixes that lack one.

    Args:
        xml: Any text; what is malformed in another way, or is in an encoding that ASCII is no part
            of, is returned as it is.
    """
    seen = _Prefixes()
    parser = expat.ParserCreate()
    roots: list[tuple[int, bytes]] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        if not roots:
            roots.append((parser.CurrentByteIndex, f"<{name}".encode()))
        seen.enter(name, attributes)

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: seen.leave()
    try:
        parser.Parse(xml, True)
    except (expat.ExpatError, LookupError, ValueError):
        return DeclaredXml(xml)
    begin, tag = roots[0]
    if not seen.undeclared or not xml.startswith(tag, begin):
        return DeclaredXml(xml)
    end = begin + len(tag)
    found = {prefix: tuple(names) for prefix, names in seen.undeclared.items()}
    return DeclaredXml(xml[:end] + "".join(map(_declaration, found)).encode() + xml[end:], found)


def _declaration(prefix: str) -> str:
    return f' xmlns:{prefix}="{_NAMESPACES.get(prefix, "undeclared:" + prefix)}"'


class _Prefixes:
    """Collects names under prefixes that no element around them declares."""

    def __init__(self) -> None:
        self.undeclared: dict[str, dict[str, None]] = {}
        self._declared: list[frozenset[str]] = [frozenset(_KNOWN)]

    def enter(self, name: str, attributes: Mapping[str, str]) -> None:
        """Enter an element."""
        own = {key.removeprefix("xmlns:") for key in attributes if key.startswith("xmlns:")}
        self._declared.append(self._declared[-1] | own if own else self._declared[-1])
        for prefix, local in _prefixed((name, *attributes)):
            if prefix not in self._declared[-1]:
                self.undeclared.setdefault(prefix, {})[local] = None

    def leave(self) -> None:
        """Leave the element entered last."""
        self._declared.pop()


def _prefixed(names: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Yield prefix and local name of those that have both."""
    for name in names:
        prefix, _, local = name.partition(":")
        if prefix and local:
            yield prefix, local
