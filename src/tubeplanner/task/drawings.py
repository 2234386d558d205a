"""Drawings of beads: ways of the tool in a frame of their own, and their reader for DXF."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.documents import DocumentError, read_bytes
from tubeplanner.errors import ProblemError, not_installed, unknown_name

# ---- Ways of the tool.

# Kinds: the process is on; a speed is not to be exceeded; as fast as possible.
BEAD: Final = "bead"
LIMITED: Final = "limited"
FREE: Final = "free"


class Way(NamedTuple):
    """A way of the tool in straight lines."""

    points: FloatArray  # shape (k+1, 3), in the drawing's frame [m]
    kind: str  # BEAD, LIMITED or FREE
    speed: float | None = None  # [m/s]
    orientations: FloatArray | None = None  # of the tool at the points, shape (k+1, 3, 3)
    radius: FloatArray | None = None  # of the k segments [m]


@dataclass(frozen=True, eq=False)
class Drawing:
    """Ways in their order; between ways that do not meet the tool lifts off."""

    ways: tuple[Way, ...]
    notes: tuple[str, ...]  # what was not used


# ---- Lines and curves of a DXF drawing, joined end to end.

_MAX_BYTES = 100_000_000
_MM = 0.001
# Metres by the header's $INSUNITS.
_UNITS = {
    **{1: 0.0254, 2: 0.3048, 3: 1609.344, 4: _MM, 5: 0.01, 6: 1.0, 7: 1000.0, 8: 2.54e-8},
    **{9: 2.54e-5, 10: 0.9144, 11: 1e-10, 12: 1e-9, 13: 1e-6, 14: 0.1, 15: 10.0, 16: 100.0},
}
_CURVES = ("ARC", "CIRCLE", "ELLIPSE", "SPLINE")
_POLYLINES = ("LWPOLYLINE", "POLYLINE")
_KINDS = ("LINE", *_CURVES, *_POLYLINES)
_JOINED = 1e-5  # [m]: ends so near are one point


def read_dxf(
    path: Path, sagitta: float, speed: float | None = None, layers: Sequence[str] = ()
) -> Drawing:
    """Read the lines and curves of a DXF file's model space as beads [m].

    Entities whose ends meet become one bead, in the order and the direction of the first of them.

    Args:
        path: The file.
        sagitta: Largest distance of a curve from its chords [m].
        speed: Of all beads [m/s].
        layers: Names of those that are read; none: all that are not switched off.

    Raises:
        ProblemError: ezdxf is not installed, the file cannot be read, its unit or a layer is
            unknown, or nothing is drawn.
    """
    try:
        import ezdxf
    except ImportError:
        raise ProblemError(not_installed("dxf", str(path), "ezdxf")) from None
    try:
        read_bytes(path, _MAX_BYTES)
        document = ezdxf.readfile(path)
    except (DocumentError, OSError, ezdxf.DXFError, ValueError) as error:
        raise ProblemError(f"{path} cannot be read: {error}") from None
    notes = []
    unit = document.header.get("$INSUNITS", 0)
    if unit == 0:
        notes.append(f"{path} has no unit ($INSUNITS is 0); mm are taken")
    elif unit not in _UNITS:
        raise ProblemError(f"{path}: $INSUNITS is {unit}; a length of 1 (inch) to 16 is read")
    scale = _UNITS.get(unit, _MM)
    entities = list(document.modelspace())
    names = sorted({entity.dxf.layer for entity in entities})
    for layer in layers:
        if layer not in names:
            raise ProblemError(f"{path}: --layer: {unknown_name('layer', layer, names)}")
    off = {layer.dxf.name for layer in document.layers if layer.is_off() or layer.is_frozen()}
    kept = set(layers) or set(names) - off
    pieces, unused = list[FloatArray](), Counter[str]()
    for entity in entities:
        kind, layer = entity.dxftype(), entity.dxf.layer
        if layer not in kept:
            unused[f"on layer {layer}"] += 1
        elif kind in _KINDS and not _is_mesh(entity):
            pieces.append(scale * _chords(entity, sagitta / scale))
        else:
            unused[kind] += 1
    sheets = [each for layout in document.layouts if not layout.is_modelspace for each in layout]
    unused["on sheets (paper space)"] = sum(each.dxftype() != "VIEWPORT" for each in sheets)
    unused = +unused
    if unused:
        counted = ", ".join(f"{count} {what}" for what, count in unused.items())
        notes.append(f"{path}: entities that are not used: {counted}")
    if not pieces:
        raise ProblemError(
            f"{path} has no bead on layers {', '.join(sorted(kept)) or 'that are on'}: read are "
            f"{', '.join(_KINDS)}; its other entities: {', '.join(unused) or 'none'}"
        )
    ways = tuple(Way(points, BEAD, speed) for points in joined(pieces))
    return Drawing(ways, tuple(notes))


def _is_mesh(entity: Any) -> bool:
    """Return True for a POLYLINE that is a surface."""
    return entity.dxftype() == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline)


def _chords(entity: Any, sagitta: float) -> FloatArray:
    """Return the chords of an entity as corners (k+1, 3) in the drawing's unit."""
    kind = entity.dxftype()
    if kind == "LINE":
        return np.array([[*entity.dxf.start], [*entity.dxf.end]])
    if kind not in _POLYLINES:
        return np.array([[*point] for point in entity.flattening(sagitta)])
    is_flat = kind == "LWPOLYLINE"
    vertices = list(entity.vertices_in_wcs() if is_flat else entity.points_in_wcs())
    line = np.array([[*vertices[0]]])
    for part in entity.virtual_entities():  # arcs are anticlockwise, however they are passed
        piece = _chords(part, sagitta)
        from_begin, from_end = np.linalg.norm(piece[[0, -1]] - line[-1], axis=1)
        line = np.vstack([line, (piece if from_begin <= from_end else piece[::-1])[1:]])
    return line


def joined(pieces: Sequence[FloatArray]) -> list[FloatArray]:
    """Return pieces (k+1, 3) whose ends meet as polylines, from the first piece on its own way."""
    lines, rest = [], list(pieces)
    while rest:
        line = rest.pop(0)
        for is_at_begin in (False, True):
            line = line[::-1] if is_at_begin else line
            while (k := _next(line[-1], rest)) is not None:
                piece = rest.pop(k)
                is_reversed = np.linalg.norm(piece[0] - line[-1]) > _JOINED
                line = np.vstack([line, (piece[::-1] if is_reversed else piece)[1:]])
        lines.append(line[::-1])
    return lines


def _next(end: FloatArray, pieces: Sequence[FloatArray]) -> int | None:
    """Return the index of the first piece with an end at a point (3,)."""
    if not pieces:
        return None
    ends = np.array([[piece[0], piece[-1]] for piece in pieces])
    near = np.flatnonzero((np.linalg.norm(ends - end, axis=2) <= _JOINED).any(axis=1))
    return int(near[0]) if len(near) else None
