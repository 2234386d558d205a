"""How near solids come along a trajectory, by coal on the true shapes, and which must stay apart.

Meshes are their triangles, not hulls. Distances are measured where they can matter: from one
sample to another a distance changes by no more than the solids move, seen from each other, and no
sample is nearer than the bounding spheres. What these bounds leave out cannot be the least.
"""

import heapq
import math
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import coal
import numpy as np

from outside.arm import Arm, Solid
from outside.problem import Problem

NEAR = 1e-3  # [m]: steps beside a smaller margin are looked at again, divided
DEEP = -1e-3  # [m]: who penetrates by more need not be measured any closer
MAX_NEAR = 100  # samples whose neighbourhood is looked at again, the nearest ones
MAX_CONTACTS = 200  # pairs of triangles that are asked how deep they are in each other
Pair = tuple[Solid, Solid]
Placed = tuple[Solid, np.ndarray, np.ndarray]  # solid, rotation (3, 3), position (3,) [m]
TOUCH_SAMPLES = 400  # random configurations; who touches in all of them is taken to touch always
TOUCH_SEED = 1
# Rays from a point, in most of which it must be inside a mesh that is not closed.
RAYS = np.random.default_rng(TOUCH_SEED).normal(size=(49, 3))


@dataclass(frozen=True)
class Nearest:
    """The least margin of some pairs; infinite if there is none.

    Attributes:
        margin: Distance less what is asked [m].
        row: In which configuration.
        owners: Of which solids.
    """

    margin: float = math.inf
    row: int = 0
    owners: tuple[str, str] = ("", "")


@dataclass
class Poses:
    """Where N configurations put what the joints carry, and what was computed from that.

    Attributes:
        rotation: Shape (N, joints, 3, 3).
        position: Shape (N, joints, 3) [m].
    """

    rotation: np.ndarray
    position: np.ndarray
    _relative: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    def relative(self, first: int, second: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the pose of one joint's frame in another's: (N, 3, 3) and (N, 3) [m]."""
        if (first, second) not in self._relative:
            back = self.rotation[:, first].transpose(0, 2, 1)
            offset = self.position[:, second] - self.position[:, first]
            turned = np.einsum("nij,nj->ni", back, offset)
            self._relative[first, second] = back @ self.rotation[:, second], turned
        return self._relative[first, second]


def least_margin(
    pairs: list[Pair], poses: Poses, asked: np.ndarray | float
) -> tuple[Nearest, np.ndarray]:
    """Return the least margin over N configurations in the order of a trajectory.

    Args:
        pairs: P pairs.
        poses: Of N configurations.
        asked: How far apart they must be, shape (N, P), or one distance for all [m].

    Returns:
        It, and the configurations in which a margin below `NEAR` was met, the nearest first.
    """
    asked = np.broadcast_to(asked, (len(poses.position), len(pairs)))
    best: Nearest = Nearest()
    met: dict[int, float] = {}
    margins = [
        _sphere_distance(pair, poses) - row for pair, row in zip(pairs, asked.T, strict=True)
    ]
    for bound, k in sorted((float(margin.min()), k) for k, margin in enumerate(margins)):
        if bound >= best.margin or best.margin < DEEP:
            break
        best = _least_of(pairs[k], poses, asked[:, k], best, met)
    near = sorted((margin, row) for row, margin in met.items() if margin < NEAR)
    return best, np.array([row for _, row in near[:MAX_NEAR]], dtype=int)


def near_distances(pair: Pair, poses: Poses, below: np.ndarray) -> np.ndarray:
    """Return signed distances where they may be below some (N,), else infinite, shape (N,) [m].

    Stretches of configurations that are surely farther apart are left out.
    """
    spheres, displacement = _sphere_distance(pair, poses), _displacement(pair, poses)
    found = np.full(len(below), math.inf)
    intervals = [(0, len(below) - 1)]
    while intervals:
        low, high = intervals.pop()
        inside = slice(low, high + 1)
        if (spheres[inside] >= below[inside]).all():
            continue
        for row in {low, high}:
            if found[row] == math.inf:
                found[row] = signed_distance(pair, poses, row)
        moved = displacement[high] - displacement[low]
        if high - low > 1 and (found[low] + found[high] - moved) / 2 < below[inside].max():
            middle = (low + high) // 2
            intervals += [(low, middle), (middle, high)]
    return found


def owners_of(pair: Pair) -> frozenset[str]:
    """Return the names of a pair."""
    return frozenset((pair[0].owner, pair[1].owner))


def signed_distance(pair: Pair, poses: Poses, row: int) -> float:
    """Return the signed distance of a pair in a configuration [m].

    How deep triangles are in each other is that of the deepest two: no more than it is.
    """
    first, second = pair
    places = [coal.Transform3s(*place(solid, poses, row)) for solid in (first, second)]
    where = first.geometry, places[0], second.geometry, places[1]
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    distance = float(coal.distance(*where, request, coal.DistanceResult()))
    if distance > 0 or not any(is_mesh(solid.geometry) for solid in (first, second)):
        return distance
    found = coal.CollisionResult()
    coal.collide(*where, coal.CollisionRequest(coal.CONTACT, MAX_CONTACTS), found)
    depths = (found.getContact(k).penetration_depth for k in range(found.numContacts()))
    return min(depths, default=0.0)


def place(solid: Solid, poses: Poses, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a solid's rotation (3, 3) and position (3,) [m] in a configuration."""
    rotation = poses.rotation[row, solid.joint]
    offset = rotation @ solid.placement.translation
    return rotation @ solid.placement.rotation, poses.position[row, solid.joint] + offset


def is_inside(first: Placed, second: Placed) -> bool:
    """Return whether a point of either solid is inside the other one's triangles.

    Closed ones, wound alike, have an inside. Of others nobody knows it, and who begins there is not
    to be passed over: a point is inside if most rays from it leave through them.
    """
    return any(
        is_mesh(outer[0].geometry) and _surrounds(outer, _point(inner))
        for inner, outer in ((first, second), (second, first))
        if np.linalg.norm(_point(inner) - _middle(outer)) < outer[0].radius
    )


def is_mesh(geometry: Any) -> bool:
    """Return whether a geometry is triangles rather than a solid."""
    return isinstance(geometry, coal.BVHModelBase)


class Clearance:
    """Which solids must stay apart, and which may touch.

    Attributes:
        obstacle_pairs: A link or an attached solid against an obstacle.
        link_pairs: Links and attached solids against each other.
        always_touching: Names of the link pairs that are left out because they always touch.
    """

    def __init__(self, problem: Problem, arm: Arm, obstacles: list[Solid]) -> None:
        self._arm = arm
        ignored = {frozenset(pair) for pair in (*problem.ignored, *arm.allowed)}
        for solid in problem.robot.get("attached") or []:
            ignored |= {frozenset((solid["name"], link)) for link in solid.get("touch_links") or []}
        kept = [solid for solid in arm.solids if arm.moved_by[solid.joint].any()]
        self.obstacle_pairs: list[Pair] = [
            (solid, obstacle)
            for solid in kept
            for obstacle in obstacles
            if frozenset((solid.owner, obstacle.owner)) not in ignored
        ]
        pairs = combinations(arm.solids, 2) if problem.checks_links else ()
        candidates = [
            (first, second)
            for first, second in pairs
            if self._must_stay_apart(first, second)
            and frozenset((first.owner, second.owner)) not in ignored
        ]
        self.always_touching = self._always_touching(candidates)
        self.link_pairs: list[Pair] = [
            pair for pair in candidates if owners_of(pair) not in self.always_touching
        ]

    def inside(self, poses: Poses, row: int) -> Nearest:
        """Return who is wholly inside an obstacle's triangles, or an obstacle inside a link's.

        Triangles have no inside for coal, and a trajectory that begins inside need not cross them.
        """
        for first, second in self.obstacle_pairs:
            places = [place(solid, poses, row) for solid in (first, second)]
            if is_inside((first, *places[0]), (second, *places[1])):
                return Nearest(-min(first.radius, second.radius), row, (first.owner, second.owner))
        return Nearest()

    def _must_stay_apart(self, first: Solid, second: Solid) -> bool:
        """Return whether joints move two solids against each other, as neighbours or not.

        Links on either side of one joint meet there; what is attached has no right to.
        """
        moved = self._arm.moved_by
        between = int((moved[first.joint] != moved[second.joint]).sum())
        return between > (0 if "attached" in (first.kind, second.kind) else 1)

    def _always_touching(self, pairs: list[Pair]) -> set[frozenset[str]]:
        q = self._arm.random(np.random.default_rng(TOUCH_SEED), TOUCH_SAMPLES)
        poses = Poses(*self._arm.poses(q))
        touching = {owners_of(pair) for pair in pairs if pair[1].kind == pair[0].kind == "link"}
        for row in range(TOUCH_SAMPLES):
            hit: set[frozenset[str]] = set()
            for pair in pairs:
                if owners_of(pair) in touching - hit and self._collide(pair, poses, row):
                    hit.add(owners_of(pair))
            touching = hit
            if not touching:
                break
        return touching

    def _collide(self, pair: Pair, poses: Poses, row: int) -> bool:
        first, second = pair
        places = [coal.Transform3s(*place(solid, poses, row)) for solid in (first, second)]
        result = coal.CollisionResult()
        request = coal.CollisionRequest()
        coal.collide(first.geometry, places[0], second.geometry, places[1], request, result)
        return bool(result.isCollision())


def _least_of(
    pair: Pair, poses: Poses, asked: np.ndarray, best: Nearest, met: dict[int, float]
) -> Nearest:
    """Return the least margin of a pair, of which (N,) is asked, if it is less than the best's.

    Stretches of samples are halved, the one with the lowest bound first.
    """
    spheres, displacement = _sphere_distance(pair, poses) - asked, _displacement(pair, poses)
    distance: dict[int, float] = {}

    def measured(row: int) -> Nearest:
        distance[row] = signed_distance(pair, poses, row)
        margin = distance[row] - float(asked[row])
        met[row] = min(margin, met.get(row, math.inf))
        return Nearest(margin, row, (pair[0].owner, pair[1].owner))

    def bound(low: int, high: int) -> float:
        inside = slice(low, high + 1)
        moved = displacement[high] - displacement[low]
        by_ends = (distance[low] + distance[high] - moved) / 2 - asked[inside].max()
        return float(max(by_ends, spheres[inside].min()))

    last = len(displacement) - 1
    best = min(best, measured(0), measured(last), key=_margin)
    heap = [(bound(0, last), 0, last)]
    while heap and best.margin >= DEEP:
        lowest, low, high = heapq.heappop(heap)
        if lowest >= best.margin:
            break
        if high - low < 2:
            continue
        middle = (low + high) // 2
        best = min(best, measured(middle), key=_margin)
        for part in ((low, middle), (middle, high)):
            if bound(*part) < best.margin:
                heapq.heappush(heap, (bound(*part), *part))
    return best


def _margin(nearest: Nearest) -> float:
    return nearest.margin


def _sphere_distance(pair: Pair, poses: Poses) -> np.ndarray:
    """Return lower bounds on a pair's distances, from bounding spheres, shape (N,) [m]."""
    first, second = pair
    gap = np.linalg.norm(_centre(pair, poses) - first.centre, axis=1)
    distance: np.ndarray = gap - first.radius - second.radius
    return distance


def _centre(pair: Pair, poses: Poses) -> np.ndarray:
    """Return the second's bounding sphere's centre, seen from the first's joint, shape (N, 3)."""
    rotation, position = poses.relative(pair[0].joint, pair[1].joint)
    return rotation @ pair[1].centre + position


def _displacement(pair: Pair, poses: Poses) -> np.ndarray:
    """Return how far any point of a solid has come, seen from the other, shape (N,) [m].

    From one sample to the next that is at most what its bounding sphere's centre moves, and its
    radius times the greatest singular value of the change of rotation, 2 sin(angle / 2).
    """
    rotation, _ = poses.relative(pair[0].joint, pair[1].joint)
    moved = np.linalg.norm(np.diff(_centre(pair, poses), axis=0), axis=1)
    turned = np.linalg.norm(np.diff(rotation, axis=0), axis=(1, 2)) / math.sqrt(2)
    return np.concatenate([[0.0], np.cumsum(moved + pair[1].radius * turned)])


def _middle(placed: Placed) -> np.ndarray:
    solid, rotation, position = placed
    return position + rotation @ np.array(solid.geometry.aabb_center)


def _point(placed: Placed) -> np.ndarray:
    """Return a point of a solid: its centre, or a corner of its triangles."""
    solid, rotation, position = placed
    if is_mesh(solid.geometry):
        return position + rotation @ np.array(solid.geometry.vertex(0))
    return position


def _surrounds(placed: Placed, point: np.ndarray) -> bool:
    solid, rotation, position = placed
    vertices = np.array(solid.geometry.vertices()) + 0.0
    vertices, same = np.unique(vertices, axis=0, return_inverse=True)
    rows = [solid.geometry.tri_indices(k) for k in range(solid.geometry.num_tris)]
    faces = same.reshape(-1)[np.array([[row[k] for k in range(3)] for row in rows])]
    local = rotation.T @ (point - position)
    once = np.unique(np.sort(faces, axis=1), axis=0)
    if _is_closed(faces) and len(once) == len(faces):
        return _winding(vertices[faces] - local) > 0.5
    return _leaving_rays(vertices[once] - local) > len(RAYS) / 2


def _is_closed(faces: np.ndarray) -> bool:
    """Return whether each edge of triangles (F, 3) has one on either side, wound alike."""
    sides = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    sides = sides[sides[:, 0] != sides[:, 1]]
    there, back = (np.unique(each, axis=0, return_counts=True) for each in (sides, sides[:, ::-1]))
    return all(np.array_equal(one, other) for one, other in zip(there, back, strict=True))


def _leaving_rays(corners: np.ndarray) -> int:
    """Return how many rays from the origin go through an odd number of triangles (F, 3, 3).

    Moeller and Trumbore, "Fast, minimum storage ray-triangle intersection", 1997.
    """
    a, first, second = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    odd, across = 0, np.cross(-a, first)
    for ray in RAYS:
        normal = np.cross(ray, second)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / np.einsum("ni,ni->n", first, normal)
            u, v = -np.einsum("ni,ni->n", a, normal) * scale, across @ ray * scale
            along = np.einsum("ni,ni->n", second, across) * scale
        odd += int(((u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0)).sum()) % 2
    return odd


def _winding(corners: np.ndarray) -> float:
    """Return how often closed triangles (F, 3, 3) wind round the origin: 1 inside, 0 outside.

    Van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
    """
    a, b, c = corners.transpose(1, 0, 2)
    lengths = [np.linalg.norm(side, axis=1) for side in (a, b, c)]
    above = np.einsum("ni,ni->n", a, np.cross(b, c))
    below = np.prod(lengths, axis=0) + sum(
        np.einsum("ni,ni->n", x, y) * z
        for x, y, z in ((a, b, lengths[2]), (b, c, lengths[0]), (c, a, lengths[1]))
    )
    return abs(float(np.arctan2(above, below).sum() / (2 * np.pi)))
