"""How convex covers lie about points and meshes."""

import numpy as np
from scipy.spatial import ConvexHull


def outside(shapes, points):
    """Return how far points (N, 3) are outside of all shapes; inside of one it is negative [m]."""
    found = []
    for shape in shapes:
        planes = ConvexHull(shape.vertices).equations
        found.append((points @ planes[:, :3].T + planes[:, 3]).max(axis=1) - shape.radius)
    return np.min(found, axis=0)
