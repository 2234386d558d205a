"""Sphinx extension: types in signatures by their public names and array aliases, as in the sources.

Autodoc would write the module that defines a public name, and the type behind an array alias.
"""

import re
from functools import cached_property
from typing import Any, get_type_hints

from docutils.nodes import Element

import tubeplanner
from tubeplanner.arrays import BoolArray, FloatArray, IntArray

_ALIASES = {"FloatArray": FloatArray, "IntArray": IntArray, "BoolArray": BoolArray}
# Types without a module of their own, written by their name alone.
_STAND_INS = {alias: type(alias, (), {"__module__": "builtins"}) for alias in _ALIASES}
_ARRAY = re.compile(r"~?(?:numpy\.)?ndarray\[.*?dtype\[~?(?:numpy\.)?(\w+?)(?:64|_)?\]\]")


def setup(app: Any) -> None:
    """Connect to Sphinx."""
    app.connect("missing-reference", _resolved_public_name)
    app.connect("autodoc-process-signature", _with_array_aliases)
    for kind in (getattr(tubeplanner, name) for name in tubeplanner.__all__ if name[0].isupper()):
        for member in vars(kind).values():
            _name_array_of(member)
        for annotated in (kind, kind.__init__) if isinstance(kind, type) else ():
            _drop_bounds_of_files(getattr(annotated, "__annotations__", {}))


def _resolved_public_name(app: Any, env: Any, node: Element, content: Element) -> Element | None:
    """Link a type to the name by which it is imported."""
    name = node.get("reftarget", "").rpartition(".")[2]
    if node.get("refdomain") != "py" or name not in tubeplanner.__all__:
        return None
    target, python = f"tubeplanner.{name}", env.domains["py"]
    found: Element | None = python.resolve_xref(
        env, node["refdoc"], app.builder, "obj", target, node, content
    )
    return found


def _with_array_aliases(
    app: object, what: str, name: str, item: object, options: object, *signature: str | None
) -> tuple[str | None, ...]:
    """Return arguments and result of a signature with short array types."""
    short = [text and _ARRAY.sub(_alias, text) for text in signature]
    return tuple(text and text.replace("<factory>", "...") for text in short)


def _alias(match: re.Match[str]) -> str:
    return f"{match.group(1).capitalize()}Array"


def _name_array_of(member: object) -> None:
    """Name the array that a property returns: its type never passes as a signature."""
    getter = {property: "fget", cached_property: "func"}.get(type(member))
    if getter is None:
        return
    annotations = getattr(member, getter).__annotations__
    for alias, array in _ALIASES.items():
        if annotations.get("return") == array:
            annotations["return"] = _STAND_INS[alias]


def _drop_bounds_of_files(annotations: dict[str, Any]) -> None:
    """Write types of fields without the metadata by which files are checked."""
    for name, of_field in annotations.items():
        if "Annotated[" in repr(of_field):
            holder = type("Holder", (), {"__annotations__": {name: of_field}})
            annotations[name] = get_type_hints(holder)[name]
