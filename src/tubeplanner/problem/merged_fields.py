"""One problem's fields from those of two files."""

from typing import Any


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
