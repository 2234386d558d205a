"""Obstacle and AttachedSolid: placement, contents, hand-over between cell and tool."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import are_numbers, checked_path, in_figures, is_number
from tubeplanner.errors import ProblemError, shown
from tubeplanner.geometry.convex_shapes import ConvexShape, extent_of, simple_shape
from tubeplanner.geometry.meshes import MeshFile
from tubeplanner.geometry.point_clouds import read_point_cloud
from tubeplanner.orientation import matrix_of_quaternion, matrix_of_rpy
from tubeplanner.text import require_name

# ---- The source of a solid, the same for every cover by convex shapes.


@dataclass(frozen=True, eq=False)
class SolidContents:
    """The source of a solid. It pickles by content, without any file."""

    kind: str  # "box", "sphere", "cylinder", "capsule", "mesh" or "points"
    # side lengths, radius, or radius and length [m]; of a mesh its scale along each axis; of points
    # the side of their boxes [m]
    sizes: tuple[float, ...]
    placement: FloatArray  # pose in the user's frame, shape (4, 4)
    mesh_hash: str = ""  # of the bytes of its file of a mesh or points; empty for other kinds
    path: Path | None = None  # that file, which need not exist any more; None for other kinds
    open_edges: int = 0  # number of edges at which the mesh is open or wound both ways


def simple_contents(kind: str, sizes: Iterable[float], placement: FloatArray) -> SolidContents:
    """Return the contents of a solid of a simple kind, its sizes [m] in a placement (4, 4)."""
    return SolidContents(kind, tuple(float(size) for size in sizes), read_only(placement))


def mesh_contents(mesh: MeshFile, scale: Iterable[float], placement: FloatArray) -> SolidContents:
    """Return the contents of a mesh file, scaled along each axis, in a placement (4, 4).

    Raises:
        OSError: The file cannot be read.
        RobotError: It is no readable mesh.
    """
    open_edges = mesh.open_edges()  # first: it says what is wrong with a file
    factors, pose = tuple(float(factor) for factor in scale), read_only(placement)
    return SolidContents("mesh", factors, pose, mesh.bytes_hash, mesh.path, open_edges)


# ---- Named solids: obstacles at rest in the base frame, and solids that the tool carries.

# Lengths that make sense around an arm [m]; far outside them distances are only rounding.
MIN_SIZE, MAX_SIZE = 1e-6, 1e4


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A solid that the links must keep clear of.

    The constructors of each kind raise ProblemError for a size outside 1e-6 to 1e4 m, a placement
    that is no rotation and translation, and a name that is no text or cannot be shown.

    Attributes:
        name: Unique among the obstacles of a problem.
        shapes: Convex shapes in the base frame that together cover it.
        contents: Its source; None: the shapes themselves.
    """

    name: str
    shapes: tuple[ConvexShape, ...]
    contents: SolidContents | None = None

    def __post_init__(self) -> None:
        _require_solid(self.name, self.shapes)

    def __repr__(self) -> str:
        return f"<Obstacle {self.name}: {_extent(self.shapes)}>"

    @classmethod
    def _simple(
        cls, name: str, kind: str, sizes: Sequence[float], placement: FloatArray
    ) -> "Obstacle":
        _require_positive(name, kind, sizes)
        shape = _placed(name, simple_shape(kind, sizes), placement)
        return cls(name, (shape,), simple_contents(kind, sizes, placement))

    @classmethod
    def box(cls, name: str, size: Sequence[float], placement: FloatArray) -> "Obstacle":
        """Return a box of full side lengths [m], centred in a placement (4, 4)."""
        return cls._simple(name, "box", size, placement)

    @classmethod
    def sphere(cls, name: str, radius: float, placement: FloatArray) -> "Obstacle":
        """Return a sphere [m], centred in a placement (4, 4)."""
        return cls._simple(name, "sphere", [radius], placement)

    @classmethod
    def cylinder(cls, name: str, radius: float, length: float, placement: FloatArray) -> "Obstacle":
        """Return a cylinder [m] along z of a placement (4, 4), centred at its origin."""
        return cls._simple(name, "cylinder", [radius, length], placement)

    @classmethod
    def capsule(cls, name: str, radius: float, length: float, placement: FloatArray) -> "Obstacle":
        """Return a capsule [m] along z of a placement (4, 4); length between its caps' centres."""
        return cls._simple(name, "capsule", [radius, length], placement)

    @classmethod
    def mesh(
        cls,
        name: str,
        path: str | Path | tuple[FloatArray, IntArray],
        placement: FloatArray,
        scale: float = 1.0,
    ) -> "Obstacle":
        """Return a solid mesh in a placement (4, 4), from a file, or vertices [m] and triangles.

        At most 64 convex shapes cover it, with a cover error of 2 mm, or as little as 64 shapes
        allow; larger hollows are free. Openings of an open mesh count as closed.

        Raises:
            RobotError: The file is no readable mesh.
            ProblemError: The scale is not between 1e-6 and 1e4.
        """
        require_name("the name of an obstacle", name, ProblemError)
        if not isinstance(path, str | Path | tuple):
            raise ProblemError(f"obstacle '{name}': path is {shown(path)}; name a mesh file")
        if not is_number(scale) or not MIN_SIZE <= scale <= MAX_SIZE:
            raise ProblemError(
                f"obstacle '{name}': scale {in_figures(scale)}; {MIN_SIZE:g} to {MAX_SIZE:g} are "
                "accepted"
            )
        triangles = path if isinstance(path, tuple) else None
        file = Path("in the file") if isinstance(path, tuple) else Path(path)
        mesh = MeshFile(f"obstacle '{name}'", file, scale, triangles)
        shapes = tuple(_placed(name, shape, placement) for shape in mesh.close_cover())
        return cls(name, shapes, mesh_contents(mesh, [scale] * 3, placement))

    @classmethod
    def points(cls, name: str, path: str | Path, size: float, placement: FloatArray) -> "Obstacle":
        """Return the boxes of a grid of cells [m] with points of a file, in a placement (4, 4).

        Cells beside each other are one box where that is exact.

        Raises:
            ProblemError: The file has no readable points, or they fill too many boxes.
        """
        _require_positive(name, "points", [size])
        cloud = read_point_cloud(checked_path(f"obstacle '{name}': path", path))
        boxes = tuple(_placed(name, shape, placement) for shape in cloud.boxes(size))
        pose = read_only(placement)
        contents = SolidContents("points", (float(size),), pose, cloud.file_hash, cloud.path)
        return cls(name, boxes, contents)


@dataclass(frozen=True, eq=False)
class AttachedSolid:
    """A solid that the tool carries; it must keep clear like a link.

    Attributes:
        name: Unique among links, obstacles and attached solids.
        shapes: Convex shapes in the tool frame that together cover it.
        touch_links: Names of links that it may touch.
        contents: Its source, in the tool frame; None: the shapes themselves.
    """

    name: str
    shapes: tuple[ConvexShape, ...]
    touch_links: tuple[str, ...] = ()
    contents: SolidContents | None = None

    def __post_init__(self) -> None:
        _require_solid(self.name, self.shapes)

    def __repr__(self) -> str:
        return f"<AttachedSolid {self.name}: {_extent(self.shapes)}>"


def placement_of(
    position: Sequence[float] = (0.0, 0.0, 0.0),
    rpy: Sequence[float] | None = None,
    quaternion: Sequence[float] | None = None,
) -> FloatArray:
    """Return a homogeneous transform, shape (4, 4).

    Args:
        position: [m].
        rpy: Roll, pitch, yaw about fixed x, y, z [rad], as in URDF; default: no rotation.
        quaternion: x, y, z, w instead of `rpy`; it need not have unit length.

    Raises:
        ProblemError: Both rotations are given, or the quaternion is zero.
    """
    if rpy is not None and quaternion is not None:
        raise ProblemError("a placement takes rpy or quaternion, not both")
    if not are_numbers(position, 3) or not (abs(np.array(position)) <= MAX_SIZE).all():
        raise ProblemError(
            f"position {shown(_listed(position))} must be three finite numbers within "
            f"{MAX_SIZE:g} m"
        )
    placement = np.eye(4)
    placement[:3, 3] = position
    if quaternion is not None:
        is_row = are_numbers(quaternion, 4)
        if not is_row or not 1e-9 < math.hypot(*quaternion) < 1e9:
            raise ProblemError(f"quaternion {shown(_listed(quaternion))} has no direction")
        placement[:3, :3] = matrix_of_quaternion(np.array(quaternion, dtype=float))
    elif rpy is not None:
        if not are_numbers(rpy, 3):
            raise ProblemError(f"rpy {shown(_listed(rpy))} must be three finite angles")
        placement[:3, :3] = matrix_of_rpy(*rpy)
    return placement


_SIZE_COUNTS = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2, "points": 1}
_ORTHONORMAL = 1e-6  # accepted error of R R^T, by rounding


def _listed(row: object) -> object:
    """Return a row as files have it."""
    return list(row) if isinstance(row, tuple) else row


def _extent(shapes: Sequence[ConvexShape]) -> str:
    """Return a text: size along the axes, centre and number of shapes of a solid."""
    low, high = extent_of(shapes)
    size = " x ".join(f"{side:.3g}" for side in high - low)
    centre = ", ".join(f"{x:.3g}" for x in (low + high) / 2 + 0.0)
    return f"{size} m about [{centre}], {len(shapes)} convex shape{'s' * (len(shapes) > 1)}"


def _require_solid(name: object, shapes: object) -> None:
    require_name("the name of an obstacle", name, ProblemError)
    are_shapes = isinstance(shapes, tuple) and all(isinstance(s, ConvexShape) for s in shapes)
    if not are_shapes or not shapes:
        raise ProblemError(f"obstacle '{name}': shapes is {shown(shapes)}; use Obstacle.box, ...")


def _placed(name: str, shape: ConvexShape, placement: FloatArray) -> ConvexShape:
    """Return a shape in a placement (4, 4).

    Raises:
        ProblemError: The placement is no rotation and translation, or too far away.
    """
    try:
        pose = read_only(placement)
    except (TypeError, ValueError):
        pose = read_only(())
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ProblemError(
            f"obstacle '{name}': placement is {shown(placement)}; it must be finite numbers of "
            "shape (4, 4), as placement_of makes"
        )
    matrix = pose[:3, :3]
    error = float(abs(matrix @ matrix.T - np.eye(3)).max())
    is_rotation = error <= _ORTHONORMAL and np.linalg.det(matrix) > 0
    if not is_rotation or (pose[3] != (0, 0, 0, 1)).any():
        raise ProblemError(
            f"obstacle '{name}': placement {pose.tolist()} is no rotation and translation (a "
            "reflection, a scale, or zeros); make it with placement_of"
        )
    if abs(pose[:3, 3]).max() > MAX_SIZE:
        raise ProblemError(
            f"obstacle '{name}': position {pose[:3, 3].tolist()} must be within {MAX_SIZE:g} m"
        )
    return shape.transformed(pose)


def _require_positive(name: str, kind: str, values: Sequence[float]) -> None:
    require_name("the name of an obstacle", name, ProblemError)
    if not isinstance(values, Sequence | np.ndarray) or isinstance(values, str):
        raise ProblemError(f"obstacle '{name}': {kind} is {shown(values)}; it takes sizes [m]")
    if len(values) != _SIZE_COUNTS[kind]:
        raise ProblemError(
            f"obstacle '{name}': {kind} takes {_SIZE_COUNTS[kind]} sizes, not {len(values)}"
        )
    for value in values:
        if not is_number(value) or not MIN_SIZE <= value <= MAX_SIZE:
            raise ProblemError(
                f"obstacle '{name}': {kind} has size {in_figures(value)} m; {MIN_SIZE:g} to "
                f"{MAX_SIZE:g} m are accepted"
            )


# ---- Open meshes of links and solids.


def open_meshes(
    links: Mapping[str, Sequence[SolidContents]], solids: Iterable[Obstacle | AttachedSolid]
) -> dict[str, dict[str, int]]:
    """Return the number of open edges of each open mesh, by the names of its solid and its file."""
    others = {solid.name: (solid.contents,) for solid in solids if solid.contents is not None}
    is_open = {
        name: {part.path.name: part.open_edges for part in own if part.path and part.open_edges}
        for name, own in (*links.items(), *others.items())
    }
    return {name: files for name, files in is_open.items() if files}


def open_mesh_texts(meshes: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return a sentence for each of some `open_meshes`."""
    return [
        f"the mesh {file} of {name} is not closed ({count} edges are open or wound both ways), its "
        "openings count as solid: export it closed"
        for name, files in meshes.items()
        for file, count in files.items()
    ]


# ---- Solids that the tool picks up in the cell, or puts down there.


def taken(obstacle: Obstacle, tool_frame: FloatArray) -> AttachedSolid:
    """Return an obstacle as attached to a tool with a pose (4, 4) in the base frame."""
    shapes, contents = _moved(obstacle, np.array(np.linalg.inv(tool_frame), dtype=float))
    return AttachedSolid(obstacle.name, shapes, contents=contents)


def left(solid: AttachedSolid, tool_frame: FloatArray) -> Obstacle:
    """Return an attached solid as the obstacle that the tool puts down; the pose as of `taken`."""
    shapes, contents = _moved(solid, tool_frame)
    return Obstacle(solid.name, shapes, contents)


def _moved(
    solid: Obstacle | AttachedSolid, placement: FloatArray
) -> tuple[tuple[ConvexShape, ...], SolidContents | None]:
    shapes = tuple(shape.transformed(placement) for shape in solid.shapes)
    contents = solid.contents
    if contents is not None:
        contents = replace(contents, placement=read_only(placement @ contents.placement))
    return shapes, contents
