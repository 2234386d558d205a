"""How far covers stand off the solids that they cover."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.collision.hulls import hull
from tubeplanner.collision.mesh_solid import MeshSolid

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

_SAMPLES = 200  # points on each shape's surface
_SEED = 0
# Points this near another shape [m] are not on the surface of the cover, but where shapes meet.
_SAME_PLACE = 1e-6
_MIN_VERTICES = 4  # of a shape with a surface of its own; balls and capsules are as they are


def cover_error(solid: MeshSolid, shapes: Sequence[ConvexShape]) -> float:
    """Return the largest distance found from a cover's surface to a solid [m].

    Args:
        solid: With triangles.
        shapes: Its cover, in the same frame.
    """
    rng = np.random.default_rng(_SEED)
    hulls = [hull(s.vertices) if len(s.vertices) >= _MIN_VERTICES else None for s in shapes]
    worst = 0.0
    for k, shape in enumerate(shapes):
        if hulls[k] is None or len(solid.faces) == 0:
            continue
        points = surface_samples(shape.vertices[shape.faces], _SAMPLES, rng)
        for other in hulls[:k] + hulls[k + 1 :]:
            if other is not None:
                points = points[_outside(other, points) > _SAME_PLACE]
        worst = max(worst, _largest_gap(solid, points))
    return worst


def surface_samples(triangles: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    """Return random points on triangles (T, 3, 3), evenly by area, shape (count, 3) [m]."""
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(sides, axis=1)
    if len(area) == 0 or not area.sum() > 0:
        return triangles.reshape(-1, 3)[:count]
    chosen = rng.choice(len(area), count, p=area / area.sum())
    return np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), count), triangles[chosen])


def _outside(hull: "ConvexHull", points: FloatArray) -> FloatArray:
    """Return how far points (N, 3) are outside of a hull at least, shape (N,) [m]."""
    values = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    outside: FloatArray = values.max(axis=1)
    return outside


def _largest_gap(solid: MeshSolid, points: FloatArray) -> float:
    """Return the largest distance of points from the surface, those inside left out."""
    distance = solid.distance(points)
    for k in np.argsort(-distance):
        if not solid.contains(points[k : k + 1])[0]:
            return float(distance[k])
    return 0.0
