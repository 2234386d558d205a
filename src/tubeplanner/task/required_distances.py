"""Required distances by pair and segment, reduced near contacts and hand-overs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.task.demands import GOAL, START, Contact
from tubeplanner.task.problem import PlanningProblem


@dataclass(frozen=True, eq=False)
class NearEnd:
    """Required distance of pairs in contact while the tool is near an end of the motion."""

    segment: int  # index of the tube's first or last segment
    tool: FloatArray  # position of the tool centre point at that end, shape (3,) [m]
    within: float  # largest distance from that position [m]
    pair: BoolArray  # True for the pairs in contact, shape (P,)
    distance: float  # required distance of these pairs [m]

    def holds(self, segment: IntArray, tool: FloatArray) -> BoolArray:
        """Return True for tool positions (N, 3) in segments (N,) near the end, shape (N,)."""
        distance = np.linalg.norm(tool - self.tool, axis=1)
        return (segment == self.segment) & (distance <= self.within)


class RequiredDistances:
    """Required distances of the P pairs of a problem's `collision`.

    The more specific clearance holds: of a pair before that of a segment before the problem's.
    Between links no distance is required, unless a pair has a clearance.

    Attributes:
        by_segment: Different rows of distances, shape (u, P) [m].
        row_of: Index of the row of each of m segments, shape (m,).
        near_ends: Required distances of pairs in contact, where they are less.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        start: FloatArray,
        goal: FloatArray | None,
        slack: float = 0.0,
    ) -> None:
        """Collect the required distances from a start to a goal, configurations (n,).

        Without a goal the tool ends at the tube's last point. The slack [m] adds to obstacles.
        """
        self.by_segment, self.row_of = _rows(problem, slack)
        last = problem.tube.segment_count - 1
        ends = {START: (0, start, True), GOAL: (last, goal, not problem.endpoints[1].is_open)}
        near_ends = []
        for contact in problem.contacts:
            pair = problem.collision.between(*contact.links)
            for end in contact.ends:
                segment, q, is_fixed = ends[end]
                tool = problem.tube.points[-1]
                if q is not None:
                    tool = problem.robot.tool_position(q[None])[0]
                distance = 0.0  # at an open goal: no overlap
                if is_fixed and q is not None:
                    rotation, position = problem.robot.body_poses(q[None])
                    pairs = problem.collision.pairs[pair]
                    near = problem.collision.distances(rotation[0], position[0], pairs)
                    distance = float(near.min())
                near_ends.append(NearEnd(segment, tool, contact.within, pair, distance))
        self.near_ends = tuple(near_ends)

    @property
    def is_constant(self) -> bool:
        """True if the distances are the same all along the tube."""
        return len(self.by_segment) == 1 and not self.near_ends

    def at(self, segment: IntArray, tool: FloatArray) -> FloatArray:
        """Return the required distances (N, P) [m] at tool positions (N, 3) in segments (N,)."""
        required = self.by_segment[self.row_of[segment]]
        for near in self.near_ends:
            rows = np.ix_(near.holds(segment, tool), near.pair)
            required[rows] = np.minimum(required[rows], near.distance)
        return required

    def anywhere(self, tool: FloatArray) -> FloatArray:
        """Return the least required distances of all segments at tools (N, 3), (N, P) [m]."""
        least = self.by_segment.min(axis=0)
        required = np.broadcast_to(least, (len(tool), len(least)))
        required = required.copy() if self.near_ends else required
        for near in self.near_ends:
            is_near = near.holds(np.full(len(tool), near.segment), tool)
            rows = np.ix_(is_near, near.pair)
            required[rows] = np.minimum(required[rows], near.distance)
        return required


def required_everywhere(problem: PlanningProblem) -> FloatArray:
    """Return the largest required distance of each pair, without contacts, shape (P,) [m]."""
    most: FloatArray = _rows(problem, 0.0)[0].max(axis=0)
    return most


def in_contact(problem: PlanningProblem) -> BoolArray:
    """Return True for pairs that may be nearer at start or goal, shape (P,)."""
    checker = problem.collision
    result = np.zeros(len(checker.pairs), dtype=bool)
    for contact in problem.contacts:
        result |= checker.between(*contact.links)
    return result


def _rows(problem: PlanningProblem, slack: float) -> tuple[FloatArray, IntArray]:
    """Return the different rows of distances (u, P) [m], and the index of each segment's, (m,)."""
    checker, own = problem.collision, problem.tube.clearance
    clearances = np.full(problem.tube.segment_count, float(problem.clearance))
    if own is not None:
        clearances = np.where(np.isfinite(own), own, clearances)
    different, row_of = np.unique(clearances, return_inverse=True)
    rows = np.zeros((len(different), len(checker.pairs)))
    is_obstacle = np.arange(len(checker.pairs)) < len(checker.obstacle_pairs)
    rows[:, is_obstacle] = different[:, None]
    for names, clearance in problem.pair_clearances.items():
        rows[:, checker.between(*names)] = clearance
    rows[:, is_obstacle] += slack
    return rows, row_of.ravel()


WITHIN = 0.03  # [m]
# Rough geometry overlaps less; solids that overlap more are not meant to touch.
_MAX_OVERLAP = 1e-3  # [m]


def usual_contacts(
    problem: PlanningProblem,
    begins_with: Sequence[str],
    ends_with: Sequence[str],
    end: FloatArray | None = None,
) -> tuple[Contact, ...]:
    """Return contacts of solids attached or detached at an end, for pairs without a contact.

    A carried solid may be as near to obstacles, and links to a standing solid, as they are at
    that end of the motion, if they overlap by less than 1 mm there. At an end of unknown
    configuration, solids that move with the tool may be near to any obstacle.

    Args:
        problem: The problem of a leg.
        begins_with: Names of the solids attached or detached before the motion.
        ends_with: Names of the solids attached or detached after the motion.
        end: Configuration at the end, shape (n,); None: the goal's, if it has one.
    """
    contacts = []
    start, goal = (endpoint.joints for endpoint in problem.endpoints)
    for side, names in ((START, begins_with), (GOAL, ends_with)):
        q = start if side == START else goal if end is None else end
        listed = {frozenset(each.links) for each in problem.contacts if side in each.ends}
        for name in names:
            pairs = _near_pairs(problem, name, q)
            new = [pair for pair in pairs if frozenset(pair) not in listed]
            contacts += [Contact(pair, WITHIN, (side,)) for pair in new]
    return tuple(contacts)


def _near_pairs(problem: PlanningProblem, name: str, q: FloatArray | None) -> list[tuple[str, str]]:
    """Return the pairs of a solid with obstacles nearer than required at q (n,)."""
    robot, checker = problem.robot, problem.collision
    count = len(checker.obstacle_pairs)
    owners = np.array([shape.owner for shape in checker.shapes])[checker.obstacle_pairs]
    owners = owners.reshape(-1, 2)
    own = (owners == name).any(axis=1)
    if q is None:
        body = np.array([shape.body for shape in checker.shapes])
        own &= body[checker.obstacle_pairs[:, 0]] == robot.link_body[robot.tool_frame]
    elif own.any():
        rotation, position = robot.body_poses(q[None])
        distances = checker.distances(rotation[0], position[0], checker.obstacle_pairs[own])
        required = required_everywhere(problem)[:count][own]
        own[own] = (distances < required) & (distances > -_MAX_OVERLAP)
    return [(str(first), str(second)) for first, second in dict.fromkeys(map(tuple, owners[own]))]
