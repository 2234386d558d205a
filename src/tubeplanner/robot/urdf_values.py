"""Values out of URDF elements, each fault named with its element and its text."""

from xml.etree.ElementTree import Element

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError


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
        raise RobotError(f'{where}: {key}="{text}" is not a number')
    return value


def read_numbers(where: str, element: Element, key: str, count: int) -> FloatArray:
    """Return an attribute as a vector of finite numbers, shape (count,).

    Raises:
        RobotError: It is missing, has another count, or a word is no finite number.
    """
    text = element.get(key)
    what = f'{where}: <{element.tag}> {key}="{text or ""}"'
    numbers = [_number(word) for word in (text or "").split()]
    values = [value for value in numbers if value is not None and np.isfinite(value)]
    if len(numbers) != count or len(values) != count:
        wanted = "one finite number" if count == 1 else f"{count} finite numbers"
        raise RobotError(f"{what} must be {wanted}")
    return np.array(values)


def require_origin(where: str, element: Element) -> None:
    """Raise unless an element's <origin>, if any, has three finite numbers in xyz and in rpy."""
    origin = element.find("origin")
    for key in ("xyz", "rpy"):
        if origin is not None and origin.get(key) is not None:
            read_numbers(where, origin, key, 3)


def read_name(where: str, element: Element, key: str) -> str:
    """Return an attribute that names something.

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
