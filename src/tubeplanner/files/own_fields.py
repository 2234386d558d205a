"""What a problem file must hold itself, so that with its included files it says something else."""

from copy import deepcopy
from typing import Any

from tubeplanner.problem.merged_fields import is_named


def change_own(own: Any, merged: Any, wanted: Any) -> None:
    """Change a file's own fields so that with what it includes they give what is wanted.

    Comments stay; what need not be changed is left where it is.

    Args:
        own: The file's fields; they are changed.
        merged: What they give with the included ones.
        wanted: What they are to give: the same with other values, no key left out.
    """
    for key, value in wanted.items():
        old = merged.get(key)
        if value == old:
            continue
        if isinstance(value, dict) and isinstance(old, dict):
            change_own(_own_part(own, key, {}), old, value)
        elif old and value and is_named(old) and is_named(value) and len(old) == len(value):
            _change_items(_own_part(own, key, []), old, value)
        else:
            own[key] = value


def _change_items(own: Any, merged: Any, wanted: Any) -> None:
    """Change a list of named items likewise."""
    places = {item["name"]: k for k, item in enumerate(own)}
    for old, value in zip(merged, wanted, strict=True):
        if value == old:
            continue
        name = old["name"]
        if name not in places:
            places[name] = len(own)
            own.append({"name": name})
        change_own(_own_part(own, places[name], {}), old, value)


def _own_part(own: Any, key: Any, empty: Any) -> Any:
    """Return what a map or list holds, where a map may have nothing yet."""
    held = own.get(key) if isinstance(own, dict) else own[key]
    # A copy: an alias elsewhere in the file keeps what it stands for.
    own[key] = empty if held is None else deepcopy(held)
    return own[key]
