"""Problems with narrow tubes: the bundled ones narrowed, and paths that a Z1 draws on a table.

As data of a problem file, so that any checkout can read them. `marks` are durations [s] that were
once reached at this radius, by a prototype of the same method.
"""

import math
from dataclasses import dataclass, field
from typing import Any

# A tool of 15 cm that a Z1 holds down, above a table.
Z1: dict[str, Any] = {
    "robot": {
        "urdf": "example:z1",
        "tool_frame": "gripperStator",
        "tool_offset": {"position": [0.15, 0, 0]},
    },
    "start": {"seed": [0, 1.5, -1, -0.54, 0, 0]},
    "obstacles": [{"name": "table", "box": [0.6, 0.6, 0.02], "position": [0.4, 0, 0]}],
}
_HEIGHT = 0.10
_BEAD = (
    *((0.30, -0.10), (0.36, -0.12), (0.42, -0.10), (0.45, -0.05), (0.45, 0.0), (0.45, 0.05)),
    *((0.42, 0.10), (0.36, 0.12), (0.30, 0.10), (0.27, 0.05), (0.27, -0.05), (0.30, -0.10)),
)
BUNDLED = {
    "ur5/over_the_wall": {0.5: 0.648, 1: 0.640, 2: 0.633, 5: 0.607},
    "panda/between_shelves": {0.5: 0.792, 1: 0.786, 2: 0.777, 5: 0.758},
    "ur10/onto_a_conveyor": {0.5: 1.049, 1: 1.037, 2: 1.018, 5: 0.989},
    "xarm7/from_crate_to_crate": {0.5: 0.660, 1: 0.644, 2: 0.626, 5: None},
}
WIDE = (*BUNDLED, "ur5/level_tray", "two_link/around_a_post")
PAPER = tuple(f"two_link/paper_{i}_{radius}mm" for i in range(1, 6) for radius in (10, 30, 50))


@dataclass(frozen=True)
class Case:
    """One problem.

    Attributes:
        name: What the table calls it.
        bundled: The bundled problem that it is, or None.
        radius: Its tube's radius instead of its own [m], or None.
        data: What its problem file holds, if it is no bundled one.
        mark: A duration that was reached [s], or None.
    """

    name: str
    bundled: str | None = None
    radius: float | None = None
    data: dict[str, Any] = field(default_factory=dict)
    mark: float | None = None

    @property
    def is_narrow(self) -> bool:
        """Whether its tube is one of millimetres."""
        return self.radius is not None or bool(self.data)


def cases() -> list[Case]:
    """Return all problems, the narrow ones first."""
    narrowed = [
        Case(f"{name} {radius:g} mm", name, radius / 1000, mark=mark)
        for name, marks in BUNDLED.items()
        for radius, mark in marks.items()
    ]
    wide = [Case(name, name) for name in (*WIDE, *PAPER)]
    return [*narrowed, *drawn(), *wide]


def drawn() -> list[Case]:
    """Return what the Z1 draws."""
    return [
        _drawn("bead 2 mm", _BEAD, 0.002, 0.426),
        _drawn("circle of 48 chords 1.5 mm", _circle(48, 0.08), 0.0015, 0.348),
        _drawn("circle of 60 chords 1 mm", _circle(60, 0.08), 0.001, 0.356),
        _drawn("lawn 1 mm", _lawn(6, 0.01), 0.001),
        _drawn("lawn 2 mm", _lawn(6, 0.005), 0.002),
        _drawn("hairpin 1 mm", [(0.36, -0.08), (0.44, 0.0), (0.36, -0.06)], 0.001),
        _drawn("spiral 1 mm", _spiral(40), 0.001),
        _drawn("star 1 mm", _star(5), 0.001),
    ]


def _drawn(name: str, path: Any, radius: float, mark: float | None = None) -> Case:
    points = [[round(x, 6), round(y, 6), _HEIGHT] for x, y in path]
    return Case(name, data={**Z1, "tube": {"points": points, "radius": radius}}, mark=mark)


def _circle(chords: int, radius: float) -> list[tuple[float, float]]:
    angles = [math.pi - 2 * math.pi * i / chords for i in range(chords + 1)]
    return [(0.36 + radius * math.cos(a), radius * math.sin(a)) for a in angles]


def _lawn(lines: int, apart: float) -> list[tuple[float, float]]:
    path = []
    for i in range(lines):
        ends = [(0.32 + apart * i, -0.06), (0.32 + apart * i, 0.06)]
        path += ends if i % 2 == 0 else ends[::-1]
    return path


def _spiral(chords: int) -> list[tuple[float, float]]:
    turns = [i / chords for i in range(chords + 1)]
    return [
        (
            0.36 + (0.02 + 0.06 * t) * math.cos(6 * math.pi * t),
            (0.02 + 0.06 * t) * math.sin(6 * math.pi * t),
        )
        for t in turns
    ]


def _star(corners: int) -> list[tuple[float, float]]:
    angles = [math.pi * i / corners for i in range(2 * corners + 1)]
    radii = [0.08 if i % 2 == 0 else 0.035 for i in range(2 * corners + 1)]
    return [(0.36 + r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
