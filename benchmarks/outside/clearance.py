"""Which solids of a problem must stay apart."""

from itertools import combinations

import coal
import numpy as np

from outside.arm import Arm, Solid
from outside.inside import is_inside
from outside.nearest import Nearest, Pair, Poses, owners_of, place
from outside.problem import Problem

TOUCH_SAMPLES = 400  # random configurations; who touches in all of them is taken to touch always
TOUCH_SEED = 1


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
