"""Mesh files: size bounds, units, first covers, solids; the cache of covers in the user's folder.

Readers of meshes open whatever a mesh names, materials and textures, also what never ends.
"""

import hashlib
import io
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner import __version__
from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.documents import DocumentError, read_bytes, require_regular
from tubeplanner.errors import RobotError, not_installed, shown
from tubeplanner.geometry.convex_shapes import ConvexShape, Thinning, convex_hull, hull
from tubeplanner.geometry.fine_covers import OUTER_ERROR, Cover, cover_error, fine_cover
from tubeplanner.geometry.mesh_solids import MeshSolid
from tubeplanner.resources import cache_folder
from tubeplanner.writing import StagedFile, signals_held

if TYPE_CHECKING:
    import trimesh
    from trimesh.resolvers import FilePathResolver

# ---- Bounds for mesh files, and for the files that they name: regular files of limited size.

_MAX_BYTES = 200_000_000  # four million triangles


def files_beside(path: Path) -> "FilePathResolver":
    """Return the resolver that opens the files that a mesh file names, within bounds.

    Raises:
        DocumentError: The mesh file itself is not within bounds.
    """
    from trimesh.resolvers import FilePathResolver

    class Bounded(FilePathResolver):
        def absolute(self, name: str) -> Path:
            file: Path = super().absolute(name)
            if file.exists():
                require_regular(file, _MAX_BYTES)
            return file

    require_regular(path, _MAX_BYTES)
    return Bounded(str(path))


# ---- Meshes covered by convex shapes. trimesh reads the meshes; it is imported on first use.

# A mesh is cut into twice as many slabs as long as that shrinks the cover to this fraction.
_WORTHWHILE_VOLUME_RATIO = 0.95
_MAX_SLABS = 8
_MAX_REASON = 200  # [characters]
_MAX_LENGTH = 1e4  # [m]: no arm and no cell is larger


def load_mesh(
    owner: str, path: Path, scale: float | Sequence[float] | None = None
) -> "trimesh.Trimesh":
    """Return the triangles of a mesh file of any format that trimesh reads, scaled along all axes.

    Raises:
        RobotError: The file is no readable mesh; the message begins with the owner.
    """
    import trimesh

    try:
        # Unprocessed: processing drops what is not finite, and the solid has a hole.
        with np.errstate(invalid="ignore", over="ignore"):  # such numbers are refused below
            files = files_beside(path)
            loaded = trimesh.load(str(path), force="mesh", process=False, resolver=files)
        unit = length_unit(path)
    except DocumentError as error:
        raise RobotError(f"{owner}: mesh {path} cannot be read: {error}") from None
    except ModuleNotFoundError as error:
        missing = not_installed("meshes", f"reading {path.suffix[1:].upper()}", "trimesh[easy]")
        raise RobotError(f"{owner}: mesh {path}: {missing}, or export the mesh as STL") from error
    except Exception as error:  # trimesh's readers raise whatever their formats' libraries raise
        raise RobotError(
            f"{owner}: mesh {path} is no readable {path.suffix[1:].upper()} file; export it "
            f"again ({shown(str(error), _MAX_REASON)})"
        ) from error
    return _sound_mesh(f"{owner}: mesh {path}", loaded, unit, scale)


def _sound_mesh(
    label: str, loaded: Any, unit: float, scale: float | Sequence[float] | None
) -> "trimesh.Trimesh":
    """Return loaded triangles with each once, in a unit [m], scaled along all axes."""
    fault = _fault(loaded, unit * np.asarray(1.0 if scale is None else scale, dtype=float))
    if fault is not None:
        raise RobotError(f"{label} {fault}; export it again")
    loaded.process()
    # Equal triangles, whose corners go round in the same order, obstruct searches for the nearest,
    # and count twice in winding numbers: the first of them stays.
    faces = np.asarray(loaded.faces)
    rows = np.arange(len(faces))[:, None]
    rolled = faces[rows, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3]
    first = np.zeros(len(faces), dtype=bool)
    first[np.unique(rolled, axis=0, return_index=True)[1]] = True
    loaded.update_faces(first)
    loaded.apply_scale(unit)
    if scale is not None:
        loaded.apply_scale(scale)
    return loaded


def _fault(mesh: "trimesh.Trimesh", scale: np.ndarray) -> str | None:
    """Return the reason why a scaled mesh is no solid [m], or None for a solid."""
    vertices = np.asarray(getattr(mesh, "vertices", ()), dtype=float)
    faces = np.asarray(getattr(mesh, "faces", ()))
    if len(faces) == 0:
        return "has no triangles; points alone, as of a scan, are no solid"
    if len(vertices) == 0 or not np.isfinite(vertices).all():
        return "has no vertices, or some that are not finite"
    if vertices.shape[1] != 3:
        return f"has points of {vertices.shape[1]} coordinates; a solid has 3"
    if faces.min() < 0 or faces.max() >= len(vertices):
        return f"has a triangle of vertex {faces.max()}; it has {len(vertices)} vertices"
    with np.errstate(over="ignore"):
        largest = float(abs(vertices * scale).max())
    if not largest <= _MAX_LENGTH:
        return (
            f"reaches {largest:.3g} m from its origin, where at most {_MAX_LENGTH:g} m make sense"
        )
    return None


def length_unit(path: Path) -> float:
    """Return the length unit of a mesh file [m]; trimesh ignores the unit in COLLADA files.

    Raises:
        ValueError: The unit is no number.
        ElementTree.ParseError: The file is not well-formed.
    """
    if path.suffix.lower() != ".dae":
        return 1.0
    for element in ElementTree.parse(path).iter():
        if element.tag.endswith("}unit") or element.tag == "unit":
            return float(element.get("meter", "1"))
    return 1.0


def cover_mesh(mesh: "trimesh.Trimesh") -> list[ConvexShape]:
    """Return as few slab hulls as cover a mesh closely.

    The solid inside a slab lies in the hull of the surface inside that slab, because every
    cross-section is bounded by surface.
    """
    return _cover_and_cuts(mesh)[0]


def _cover_and_cuts(mesh: "trimesh.Trimesh") -> tuple[list[ConvexShape], list[tuple[int, float]]]:
    """Return the cover by slabs, and the cuts between them: axis and coordinate [m]."""
    cover, cuts, slabs = [convex_hull(mesh.vertices)], list[tuple[int, float]](), 2
    axis = int(np.argmax(mesh.extents))
    while slabs <= _MAX_SLABS:
        bounds = np.linspace(mesh.bounds[0, axis], mesh.bounds[1, axis], slabs + 1)
        parts = (_slab_points(mesh, axis, low, high) for low, high in pairwise(bounds))
        finer = [convex_hull(points) for points in parts if len(points)]
        if _volume(finer) > _WORTHWHILE_VOLUME_RATIO * _volume(cover):
            break
        cover, cuts = finer, [(axis, float(height)) for height in bounds[1:-1]]
        slabs *= 2
    return cover, cuts


def _slab_points(mesh: "trimesh.Trimesh", axis: int, low: float, high: float) -> np.ndarray:
    """Return a mesh's vertices in a slab and the points where edges enter and leave the slab."""
    heights = mesh.vertices[:, axis]
    points = [mesh.vertices[(low <= heights) & (heights <= high)]]
    start, end = mesh.vertices[mesh.edges_unique].transpose(1, 0, 2)
    for height in (low, high):
        crossing = (start[:, axis] - height) * (end[:, axis] - height) < 0
        a, b = start[crossing], end[crossing]
        fraction = (height - a[:, axis]) / (b[:, axis] - a[:, axis])
        points.append(a + fraction[:, None] * (b - a))
    return np.vstack(points)


def _volume(shapes: list[ConvexShape]) -> float:
    return sum(float(hull(shape.vertices).volume) for shape in shapes)


# ---- Covers and hulls of earlier runs, in the user's cache folder.
#
# The name of an entry has a hash of all that it was computed from, so that no entry is ever stale;
# an entry begins with a hash of its name and content, so that a damaged entry is never used. An
# entry that cannot be read or written is computed again: the cache changes times, never answers.

# Part of every name: with another number, entries made by other code are not found any more.
_FORMAT = f"{__version__}-5"
_DIGEST_SIZE = hashlib.sha256().digest_size

Arrays = dict[str, np.ndarray]


def content_hash(parts: Iterable[bytes | str | np.ndarray]) -> str:
    """Return a hash of some contents, arrays by their shape and bits."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            content = f"{part.dtype}{part.shape}".encode() + np.ascontiguousarray(part).tobytes()
        else:
            content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()


def packed(shapes: Sequence[ConvexShape]) -> Arrays:
    """Return shapes as arrays, with faces and thinnings, so that no hull is computed again."""
    no_faces = np.zeros((0, 3), dtype=np.int64)
    return {
        "vertices": np.concatenate([np.zeros((0, 3)), *(shape.vertices for shape in shapes)]),
        "counts": np.array([len(shape.vertices) for shape in shapes], dtype=np.int64),
        "faces": np.concatenate([no_faces, *(shape.faces for shape in shapes)]),
        "face_counts": np.array([len(shape.faces) for shape in shapes], dtype=np.int64),
        "radius": np.array([shape.radius for shape in shapes], dtype=np.float64),
        "thinned": np.concatenate([no_faces[:, 0], *(shape.thinning.corners for shape in shapes)]),
        "thinned_counts": np.array([len(s.thinning.corners) for s in shapes], dtype=np.int64),
        "growth": np.array([shape.thinning.growth for shape in shapes], dtype=np.float64),
    }


def unpacked(arrays: Mapping[str, np.ndarray]) -> list[ConvexShape]:
    """Return the shapes of arrays made by `packed`."""
    parts = (
        _parts(arrays["vertices"], arrays["counts"]),
        _parts(arrays["faces"], arrays["face_counts"]),
        arrays["radius"],
        _parts(arrays["thinned"], arrays["thinned_counts"]),
        arrays["growth"],
    )
    return [
        ConvexShape(read_only(vertices), float(radius), faces, Thinning(corners, float(growth)))
        for vertices, faces, radius, corners, growth in zip(*parts, strict=True)
    ]


def cached(kind: str, key: str | None, compute: Callable[[], Mapping[str, np.ndarray]]) -> Arrays:
    """Return arrays from the cache, or compute and store the arrays.

    The entry's name has the kind and the key: from `content_hash`, of all that the arrays depend
    on. Without a key nothing is stored.
    """
    folder = cache_folder()
    if folder is None or key is None:
        return dict(compute())
    path = folder / f"{kind}-{_FORMAT}-{key[:40]}"
    arrays = _read(path)
    if arrays is None:
        arrays = dict(compute())
        _write(path, arrays)
    return arrays


def _parts(rows: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    return np.split(rows, np.cumsum(counts)[:-1]) if len(counts) else []


def _digest(path: Path, content: bytes) -> bytes:
    return hashlib.sha256(path.name.encode() + content).digest()


def _read(path: Path) -> Arrays | None:
    try:
        entry = path.read_bytes()
    except OSError:
        return None
    digest, content = entry[:_DIGEST_SIZE], entry[_DIGEST_SIZE:]
    if digest != _digest(path, content):
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _write(path: Path, arrays: Arrays) -> None:
    """Write an entry whole or not at all."""
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with signals_held(), StagedFile(path) as file:
            file.write(_digest(path, content.getvalue()) + content.getvalue())
            file.put()
    except OSError:
        return


# ---- Mesh files as solids and as covers.

# Each shape of one link is checked against each of another: fewer than for obstacles. Both links of
# a pair have a cover: each has half of the accepted error [m].
_LINK_PIECES = 32
_LINK_ERROR = OUTER_ERROR / 2
# Formats whose files hold all of the mesh: only these are cached.
_SELF_CONTAINED = {".stl", ".obj", ".dae", ".ply", ".off", ".glb", ".3mf"}


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh file that belongs to a link or an obstacle.

    Every member raises RobotError if the file is no readable mesh.
    """

    owner: str  # link or obstacle, in messages
    path: Path  # STL, OBJ, DAE or another format that trimesh reads
    scale: float | Sequence[float] | None = None  # a factor, or a factor per axis; None: 1
    # vertices (V, 3) [m] and vertex indices (F, 3), in place of the contents of a file
    triangles: tuple[FloatArray, IntArray] | None = None

    @cached_property
    def key(self) -> str | None:
        """A hash of the file's content and the scale; None if the mesh may lie in other files too.

        None also of an unreadable file.
        """
        scale = np.array([1.0 if self.scale is None else self.scale], dtype=np.float64)
        if self.triangles is not None:
            return content_hash([*self.triangles, scale])
        if self.path.suffix.lower() not in _SELF_CONTAINED:
            return None
        try:
            content = read_bytes(self.path, _MAX_BYTES)
        except DocumentError:
            return None  # reading the mesh says what is wrong
        return content_hash([content, self.path.suffix.lower(), scale])

    @property
    def bytes_hash(self) -> str:
        """A hash of the file's bytes, or of the triangles."""
        if self.triangles is not None:
            return content_hash(self.triangles)
        return hashlib.sha256(self.path.read_bytes()).hexdigest()

    @cached_property
    def solid(self) -> MeshSolid:
        """The triangles, scaled."""
        faces = np.asarray(self._mesh.faces, dtype=np.int64)
        return MeshSolid(np.asarray(self._mesh.vertices), faces)

    def open_edges(self) -> int:
        """Return the number of edges at which the mesh is open or wound both ways."""
        arrays = cached("open", self.key, lambda: {"edges": np.array(self.solid.open_edges)})
        return int(arrays["edges"])

    def extent(self) -> FloatArray:
        """Return the least and the largest coordinates, shape (2, 3) [m]."""
        return cached("extent", self.key, lambda: {"box": np.array(self._mesh.bounds)})["box"]

    def cover(self) -> list[ConvexShape]:
        """Return few shapes that cover the mesh, where other solids do not come near."""
        return unpacked(
            cached("cover", self.key, lambda: packed(cover_mesh(self._filled(self.solid.filled))))
        )

    def outer_error(self) -> float:
        """Return the largest distance found from the surface of `cover` to the mesh [m].

        Of an open mesh to its triangles: openings that `cover` closes count.
        """
        arrays = cached(
            "error", self.key, lambda: {"error": np.array(cover_error(self.solid, self.cover()))}
        )
        return float(arrays["error"])

    def close_cover(self) -> list[ConvexShape]:
        """Return shapes with a cover error of at most 2 mm, or as little as 64 shapes allow."""

        def computed() -> dict[str, np.ndarray]:
            solid = self.solid.plugged
            cover: Sequence[ConvexShape] = cover_mesh(self._filled(solid))
            error = cover_error(solid, cover)
            if error > OUTER_ERROR:
                finer = fine_cover(solid)
                cover = finer.shapes if finer.outer_error < error else cover
            return packed(cover)

        return unpacked(cached("close", self.key, computed))

    def fine_cover(self, probes: FloatArray) -> Cover:
        """Return shapes that cover the mesh closely near probes, shape (N, 3) [m]."""
        return fine_cover(
            self.solid.filled,
            probes,
            cuts=_cover_and_cuts(self._filled(self.solid.filled))[1],
            outer_error=_LINK_ERROR,
            max_pieces=_LINK_PIECES,
        )

    @cached_property
    def _mesh(self) -> Any:
        if self.triangles is None:
            return load_mesh(self.owner, self.path, self.scale)
        import trimesh

        mesh = trimesh.Trimesh(*self.triangles, process=False)
        return _sound_mesh(f"{self.owner}: mesh", mesh, 1.0, self.scale)

    def _filled(self, solid: MeshSolid) -> Any:
        """Return the mesh with its openings closed as in a solid."""
        import trimesh

        return (
            trimesh.Trimesh(solid.vertices, solid.faces, process=False)
            if solid.shells
            else self._mesh
        )
