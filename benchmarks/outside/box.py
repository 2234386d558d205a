"""Boxes about segments, as the outside judge has them: six half spaces each."""

from typing import Any

import numpy as np

from outside.files import BadInput

Section = tuple[float, ...]  # width, height [m], and the upward direction
PARALLEL = 1e-6  # sine of the least angle between a segment and what is upward there
NO_LENGTH = 1e-6  # [m]: a segment as short is left out


def read_sections(given: Any, count: int) -> list[Section | None]:
    """Return width and height [m] and the upward direction of each segment, None for a disc.

    Args:
        given: As the file has it: one map for all segments, or one or null for each.
        count: Of segments.
    """
    entries = given if isinstance(given, list) else [given] * count
    if len(entries) != count:
        raise BadInput(f"tube.cross_section has {len(entries)} entries for {count} segments")
    return [None if entry is None else _section(entry) for entry in entries]


def _section(entry: Any) -> Section:
    if not isinstance(entry, dict) or set(entry) != {"box", "up"}:
        raise BadInput("tube.cross_section: an entry has box and up, and no more")
    width, height = (float(side) for side in entry["box"])
    x, y, z = (float(value) for value in entry["up"])
    if not (width > 0 and height > 0):
        raise BadInput("tube.cross_section.box must be two lengths")
    return width, height, x, y, z


def radii(given: Any, sections: list[Section | None]) -> np.ndarray:
    """Return the radii (m,) [m]: half of the smaller side where there is a box."""
    entries = given if isinstance(given, list) else [given] * len(sections)
    if len(entries) != len(sections):
        raise BadInput(f"tube.radius has {len(entries)} values for {len(sections)} segments")
    found = []
    for k, (radius, section) in enumerate(zip(entries, sections, strict=True)):
        if section is not None:
            half = min(section[:2]) / 2
            if isinstance(given, list) and radius is not None and abs(radius - half) > 1e-12:
                raise BadInput(f"tube.radius: segment {k} has a box")
            found.append(half)
        elif radius is None:
            raise BadInput(f"tube.radius: segment {k} has neither a radius nor a box")
        else:
            found.append(float(radius))
    return np.array(found)


def box_margin(
    begin: np.ndarray, end: np.ndarray, section: Section, off: float, position: np.ndarray
) -> np.ndarray:
    """Return how far positions (N, 3) are behind the nearest of six faces, shape (N,) [m].

    Args:
        begin: Where the segment begins, shape (3,) [m].
        end: Where it ends.
        section: From `read_sections`.
        off: The tool's radius: all faces are moved inwards by it [m].
        position: Of the tool centre point.
    """
    width, height, *up = section
    beyond = min(width, height) / 2
    length = float(np.linalg.norm(end - begin))
    along = (end - begin) / length if length >= NO_LENGTH else np.zeros(3)
    upward = np.cross(np.cross(along, up), along) if length >= NO_LENGTH else np.array(up)
    if np.linalg.norm(upward) <= PARALLEL * np.linalg.norm(up):
        raise BadInput("tube.cross_section: up is parallel to its segment")
    upward = upward / np.linalg.norm(upward)
    across = np.cross(along, upward)
    walls = [(begin + side * width / 2 * across, side * across) for side in (-1, 1)]
    walls += [(begin + side * height / 2 * upward, side * upward) for side in (-1, 1)]
    walls += [(begin - beyond * along, -along), (end + beyond * along, along)]
    margins: np.ndarray = np.min([(on - position) @ normal for on, normal in walls], axis=0) - off
    return margins
