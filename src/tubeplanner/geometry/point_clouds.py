"""Point clouds as boxes: files of points (PLY, PCD, XYZ), cells of a grid, merged boxes."""

import hashlib
import io
import warnings
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import in_figures
from tubeplanner.documents import DocumentError, read_bytes
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.geometry.convex_shapes import ConvexShape, box

_MAX_BYTES = 200_000_000
_MAX_LENGTH = 1e4  # [m]: no arm and no cell is larger
_MAX_REASON = 200  # [characters]
# Every box is a pair with every shape of every moving link: with a Panda these are 20,000 pairs,
# whose distances take 20 to 50 ms, and `route` takes seconds instead of one.
MAX_BOXES = 2_000


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of a file."""

    path: Path
    points: FloatArray  # shape (N, 3) [m], all finite
    file_hash: str  # of its bytes

    def boxes(self, size: float) -> list[ConvexShape]:
        """Return the boxes of a grid of cells [m] that hold points.

        The grid's planes are at multiples of the size. Cells beside each other are one box where
        together they are one: the union is that of the cells.

        Raises:
            ProblemError: There are more than `MAX_BOXES` boxes.
        """
        bounds = _merged_cells(self.points, size)
        if len(bounds) > MAX_BOXES:
            larger, count = size, len(bounds)
            while count > MAX_BOXES:
                larger *= 2
                count = len(_merged_cells(self.points, larger))
            raise ProblemError(
                f"points: {self.path} fills {len(bounds)} boxes at size {in_figures(size)} m, at "
                f"most {MAX_BOXES} are accepted; a size of {in_figures(larger)} m makes {count}, "
                "or cut away what the arm cannot reach"
            )
        low, high = size * bounds[:, :3], size * bounds[:, 3:]
        placements = np.tile(np.eye(4), (len(bounds), 1, 1))
        placements[:, :3, 3] = (low + high) / 2
        return [
            box(side).transformed(placement)
            for side, placement in zip(high - low, placements, strict=True)
        ]


def read_point_cloud(path: Path) -> PointCloud:
    """Read the points of a file: PLY (text, binary), PCD (text, binary), XYZ (text) [m].

    Points that are not finite, which PCD has where a scanner saw nothing, count for nothing. So do
    colours, normals, triangles and the viewpoint.

    Raises:
        ProblemError: The file cannot be read, is malformed, or has no finite points.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        fault = unknown_name("ending", path.suffix.lower(), _READERS)
        raise ProblemError(f"points: {path}: {fault}")
    try:
        content = read_bytes(path, _MAX_BYTES)
    except DocumentError as error:
        raise ProblemError(f"points: {path} cannot be read: {error}") from None
    try:
        points = np.asarray(reader(content), dtype=np.float64).reshape(-1, 3)
    except Exception as error:  # trimesh's reader raises whatever it raises
        kind = path.suffix[1:].upper()
        reason = shown(" ".join(str(error).split()), _MAX_REASON)
        raise ProblemError(f"points: {path} is no readable {kind} file ({reason})") from error
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise ProblemError(f"points: {path} has no finite points; leave it out, or scan again")
    if (largest := abs(points).max()) > _MAX_LENGTH:
        raise ProblemError(
            f"points: {path} reaches {largest:.3g} m from its origin, where at most "
            f"{_MAX_LENGTH:g} m make sense: points are in [m], from the frame of the obstacle"
        )
    return PointCloud(path, read_only(points), hashlib.sha256(content).hexdigest())


def _merged_cells(points: FloatArray, size: float) -> IntArray:
    """Return the bounds (N, 6) of the cells of points, merged; in multiples of a size [m]."""
    cells = np.unique(np.floor(points / size).astype(np.int64), axis=0)
    rows = np.hstack([cells, cells + 1])
    results = []
    for axes in permutations(range(3)):
        merged = rows
        for axis in axes:
            merged = _merged_along(merged, axis)
        results.append(merged)
    return min(results, key=len)


def _merged_along(rows: IntArray, axis: int) -> IntArray:
    """Return bounds (N, 6), neighbours along an axis as one where their other bounds agree."""
    others = [k for k in range(6) if k % 3 != axis]
    rows = rows[np.lexsort((rows[:, axis], *rows[:, others].T))]
    goes_on = (rows[1:, others] == rows[:-1, others]).all(axis=1)
    goes_on &= rows[1:, axis] == rows[:-1, axis + 3]
    first = np.flatnonzero(np.concatenate([[True], ~goes_on]))
    last = np.append(first[1:], len(rows)) - 1
    merged = rows[first]
    merged[:, axis + 3] = rows[last, axis + 3]
    return merged


# ---- Readers of formats: points (N, 3) from the bytes of a file.


def _ply(content: bytes) -> FloatArray:
    import trimesh  # on first use, as for meshes

    loaded = trimesh.load(io.BytesIO(content), file_type="ply", process=False)
    return np.asarray(getattr(loaded, "vertices", np.zeros((0, 3))))


def _xyz(content: bytes) -> FloatArray:
    """Return the first three columns, apart by blanks, commas or semicolons; # is a comment."""
    text = content.decode("utf-8-sig").replace(",", " ").replace(";", " ")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of an empty file, which is refused later
        return np.loadtxt(io.StringIO(text), comments=("#", "//"), usecols=(0, 1, 2), ndmin=2)


_PCD_TYPES = {"F": "f", "I": "i", "U": "u"}
_HEADER_BYTES = 10_000


def _pcd(content: bytes) -> FloatArray:
    """Return the fields x, y, z of the format of the Point Cloud Library."""
    header: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in header:
        end = content.find(b"\n", at, _HEADER_BYTES)
        if end < 0:
            raise ValueError("its header has no line DATA")
        words = content[at:end].decode("ascii").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
    for key in ("FIELDS", "SIZE", "TYPE", "DATA"):
        if not header.get(key):
            raise ValueError(f"its header has no {key}")
    names = header["FIELDS"]
    missing = [name for name in "xyz" if name not in names]
    if missing:
        raise ValueError(f"its header names no field {missing[0]}")
    counts = [int(each) for each in header.get("COUNT", ["1"] * len(names))]
    # Names may come twice, as `_` does between fields: columns are called by their numbers.
    columns = [
        (f"{k}", f"<{_PCD_TYPES[kind]}{size}", (count,))
        for k, (kind, size, count) in enumerate(
            zip(header["TYPE"], header["SIZE"], counts, strict=True)
        )
    ]
    number = int(header["POINTS"][0]) if header.get("POINTS") else None
    form = header["DATA"][0].lower()
    if form == "ascii":
        first = np.cumsum([0, *counts])
        usecols = [int(first[names.index(name)]) for name in "xyz"]
        text = io.StringIO(content[at:].decode("ascii"))
        points: FloatArray = np.loadtxt(text, usecols=usecols, ndmin=2)
    elif form == "binary":
        rows = np.frombuffer(content[at:], np.dtype(columns), -1 if number is None else number)
        columns_of = [rows[f"{names.index(name)}"][:, 0] for name in "xyz"]
        points = np.stack(columns_of, axis=1).astype(np.float64)
    else:
        raise ValueError(f"its data are {form}; save it as ascii or binary")
    if number is not None and len(points) != number:
        raise ValueError(f"it has {len(points)} points where its header says {number}")
    return points


_READERS = {".ply": _ply, ".pcd": _pcd, ".xyz": _xyz}
