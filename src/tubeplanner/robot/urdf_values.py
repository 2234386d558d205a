"""Values out of URDF elements, each fault named with its element and its text."""

from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.names import require_name

MAX_LENGTH = 1e4  # [m]: no arm is larger, and far beyond it distances are only rounding


def read_number(where: str, element: Element | None, key: str) -> float | None:
    """Return an attribute as a number; None without the element or the attribute.

    Raises:
        RobotError: The text is no number, or not a number (nan).
    """
    text = None if element is None else element.get(key)
    if text is None:
        return None
    value = _number(text)
    if value is None:
        raise RobotError(f"{where}: {written(key, text)} is not a number")
    return value


def read_numbers(where: str, element: Element, key: str, count: int) -> FloatArray:
    """Return an attribute as a vector of finite numbers, shape (count,).

    Raises:
        RobotError: It is missing, has another count, or a word is no finite number.
    """
    text = element.get(key)
    what = f"{where}: <{element.tag}> {written(key, text or '')}"
    numbers = [_number(word) for word in (text or "").split()]
    values = [value for value in numbers if value is not None and np.isfinite(value)]
    if len(numbers) != count or len(values) != count:
        wanted = "one finite number" if count == 1 else f"{count} finite numbers"
        raise RobotError(f"{what} must be {wanted}")
    return np.array(values)


def require_origin(where: str, element: Element) -> None:
    """Raise unless an element's <origin>, if any, has three sensible numbers in xyz and in rpy."""
    origin = element.find("origin")
    for key, unit in (("xyz", "m"), ("rpy", "rad")):
        if origin is None or origin.get(key) is None:
            continue
        largest = abs(read_numbers(where, origin, key, 3)).max()
        if largest > MAX_LENGTH:
            raise RobotError(
                f"{where}: <origin> {key} has {largest:g} {unit}; at most {MAX_LENGTH:g} {unit} "
                "are accepted (metres and radians are meant)"
            )


def written(key: str, text: str) -> str:
    """Return an attribute as a file has it, cut where it is long."""
    inner = shown(text).strip("'")
    return f'{key}="{inner}"'


def read_name(where: str, element: Element, key: str) -> str:
    """Return an attribute that names something.

    Raises:
        RobotError: It is missing, empty, too long, or cannot be shown.
    """
    value = read_attribute(where, element, key)
    return require_name(f"{where}: <{element.tag}> {key}", value, RobotError)


def read_attribute(where: str, element: Element, key: str) -> str:
    """Return an attribute.

    Raises:
        RobotError: It is missing or empty.
    """
    value = element.get(key)
    if not value:
        raise RobotError(f"{where}: a <{element.tag}> element has no attribute '{key}'")
    return value


def read_child(where: str, element: Element, tag: str) -> Element:
    """Return the only child with a tag.

    Raises:
        RobotError: There is none, or more than one.
    """
    children = element.findall(tag)
    if len(children) != 1:
        count = "no" if not children else str(len(children))
        raise RobotError(f"{where} has {count} <{tag}>; one is needed")
    return children[0]


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return None if np.isnan(value) else value
