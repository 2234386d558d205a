"""How far apart pairs of solids must be, in each segment and wherever the tool is."""

from dataclasses import dataclass

import numpy as np

from outside.arm import Arm
from outside.distances import Distances
from outside.files import BadInput
from outside.nearest import NEAR, Pair, Poses, near_distances, owners_of, signed_distance
from outside.problem import Problem
from outside.trajectory import Samples, Trajectory


@dataclass(frozen=True, eq=False)
class NearEnd:
    """What is asked of a pair in contact while the tool is near an end.

    Attributes:
        owners: The pair.
        segment: The first or the last.
        tool: Where the tool is at that end, shape (3,) [m].
        within: How far from there it may be [m].
        distance: How far apart the two are at that end [m].
    """

    owners: frozenset[str]
    segment: int
    tool: np.ndarray
    within: float
    distance: float


class Required:
    """What a problem asks of the distances of pairs along a trajectory.

    Attributes:
        pairs: Obstacle pairs and link pairs, P in all.
        changes: Whether that is not the same all along.
    """

    def __init__(
        self,
        problem: Problem,
        arm: Arm,
        obstacle_pairs: list[Pair],
        link_pairs: list[Pair],
        trajectory: Trajectory,
    ) -> None:
        """Take what is asked.

        Raises:
            BadInput: A pair with a clearance of its own, or in contact, is not held apart at all.
        """
        self.pairs = [*obstacle_pairs, *link_pairs]
        _require_checked(problem.distances, {owners_of(pair) for pair in self.pairs})
        self._arm, self._trajectory = arm, trajectory
        tube, asked = problem.tube, problem.distances
        own = [tube.clearance] * len(obstacle_pairs) + [0 * tube.clearance] * len(link_pairs)
        self._own = [
            np.full_like(each, asked.pairs.get(owners_of(pair), each))
            for pair, each in zip(self.pairs, own, strict=True)
        ]
        is_given = bool({"joints", "seed", "pose"} & set(problem.goal))
        self._ends = _near_ends(asked, arm, self.pairs, trajectory, is_given, len(tube.radius))
        self.changes = bool(asked.contacts) or bool(np.ptp(tube.clearance) > 0)

    def margin(self, samples: Samples) -> np.ndarray:
        """Return what the worst pair has left in all segments, (N, m) [m]; infinite if plenty."""
        q = self._trajectory.at(samples)
        poses, tool = Poses(*self._arm.poses(q)), self._arm.tool(q)[1]
        margin = np.full((len(q), len(self._own[0]) if self._own else 1), np.inf)
        for k, pair in enumerate(self.pairs):
            asked = self._of_pair(k, tool)
            distance = near_distances(pair, poses, asked.max(axis=1) + NEAR)
            margin = np.minimum(margin, distance[:, None] - asked)
        return margin

    def at(self, samples: Samples, current: np.ndarray) -> np.ndarray:
        """Return the most that current segments (N, m) ask of all pairs, shape (N, P) [m]."""
        tool = self._arm.tool(self._trajectory.at(samples))[1]
        columns = [
            np.where(current, self._of_pair(k, tool), -np.inf).max(axis=1)
            for k in range(len(self.pairs))
        ]
        return np.reshape(columns, (len(self.pairs), len(samples))).T

    def _of_pair(self, k: int, tool: np.ndarray) -> np.ndarray:
        """Return what all segments ask of a pair while the tool is at places (N, 3), (N, m)."""
        asked = np.tile(self._own[k], (len(tool), 1))
        for end in self._ends:
            if end.owners == owners_of(self.pairs[k]):
                here = np.linalg.norm(tool - end.tool, axis=1) <= end.within
                less = np.minimum(asked[here, end.segment], end.distance)
                asked[here, end.segment] = less
        return asked


def _require_checked(asked: Distances, checked: set[frozenset[str]]) -> None:
    for names in [*asked.pairs, *(contact.links for contact in asked.contacts)]:
        if names not in checked:
            raise BadInput(f"{' and '.join(sorted(names))} are not held against each other")


def _near_ends(
    asked: Distances,
    arm: Arm,
    pairs: list[Pair],
    trajectory: Trajectory,
    is_given: bool,
    count: int,
) -> list[NearEnd]:
    """Return what contacts ask; of a goal whose configuration is open, that none overlap."""
    q = trajectory.at(trajectory.samples(2))[[0, -1]]
    poses, tool = Poses(*arm.poses(q)), arm.tool(q)[1]
    found = []
    for contact in asked.contacts:
        own = [pair for pair in pairs if owners_of(pair) == contact.links]
        for row, has_end in enumerate((contact.at_start, contact.at_goal)):
            if not has_end:
                continue
            distance = 0.0
            if row == 0 or is_given:
                distance = min(signed_distance(pair, poses, row) for pair in own)
            segment = row * (count - 1)
            found.append(NearEnd(contact.links, segment, tool[row], contact.within, distance))
    return found
