"""Required distances by pair and segment, reduced near contacts and hand-overs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.task.demands import GOAL, START, Contact
from tubeplanner.task.problem import PlanningProblem

# ---- How far apart solids must be: by pair, by segment, and less where they touch at start or
# goal.


@dataclass(frozen=True, eq=False)
class NearEnd:
    """What is required of pairs in contact while the tool is near an end of the motion.

    Attributes:
        segment: The tube's first or last one.
        tool: Where it is at that end, shape (3,) [m].
        within: How far from there the tool may be [m].
        pair: Which of the P pairs, shape (P,).
        distance: How far apart these must be at least [m].
    """

    segment: int
    tool: FloatArray
    within: float
    pair: BoolArray
    distance: float

    def holds(self, segment: IntArray, tool: FloatArray) -> BoolArray:
        """Return whether tools (N, 3) in segments (N,) are near enough, shape (N,)."""
        away = np.linalg.norm(tool - self.tool, axis=1)
        return (segment == self.segment) & (away <= self.within)


class RequiredDistances:
    """The distances that the pairs of a problem's `collision` must keep.

    The more specific holds: that of a pair before that of a segment before that of the problem.
    Links keep none from each other, unless a pair asks it.

    Attributes:
        by_segment: The different rows of distances, shape (u, P) [m].
        row_of: Which row each of m segments has, shape (m,).
        near_ends: What is required of pairs in contact instead, if it is less.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        start: FloatArray,
        goal: FloatArray | None,
        room: float = 0.0,
    ) -> None:
        """Take what a problem requires.

        Args:
            problem: The planning problem.
            start: Configuration in which the motion begins, shape (n,).
            goal: In which it ends; None: not known, the tool at the tube's last point.
            room: What is required of obstacles in addition [m].
        """
        self.by_segment, self.row_of = _rows(problem, room)
        self.near_ends = tuple(_near_ends(problem, start, goal))

    @property
    def is_constant(self) -> bool:
        """Whether the distances are the same all along the tube."""
        return len(self.by_segment) == 1 and not self.near_ends

    def at(self, segment: IntArray, tool: FloatArray) -> FloatArray:
        """Return what is required while the tool is at places in segments, shape (N, P) [m].

        Args:
            segment: Of the tube, shape (N,).
            tool: Where the tool is, shape (N, 3) [m].
        """
        required = self.by_segment[self.row_of[segment]]
        for near in self.near_ends:
            rows = np.ix_(near.holds(segment, tool), near.pair)
            required[rows] = np.minimum(required[rows], near.distance)
        return required

    def anywhere(self, tool: FloatArray) -> FloatArray:
        """Return the least that any segment requires of tools (N, 3), shape (N, P) [m]."""
        least = self.by_segment.min(axis=0)
        required = np.broadcast_to(least, (len(tool), len(least)))
        required = required.copy() if self.near_ends else required
        for near in self.near_ends:
            is_near = near.holds(np.full(len(tool), near.segment), tool)
            rows = np.ix_(is_near, near.pair)
            required[rows] = np.minimum(required[rows], near.distance)
        return required


def required_everywhere(problem: PlanningProblem) -> FloatArray:
    """Return the most that any segment requires of each pair, contacts apart, shape (P,) [m]."""
    most: FloatArray = _rows(problem, 0.0)[0].max(axis=0)
    return most


def in_contact(problem: PlanningProblem) -> BoolArray:
    """Return which pairs may be nearer at start or goal, shape (P,)."""
    checker = problem.collision
    found = np.zeros(len(checker.pairs), dtype=bool)
    for contact in problem.contacts:
        found |= checker.between(*contact.links)
    return found


def _rows(problem: PlanningProblem, room: float) -> tuple[FloatArray, IntArray]:
    """Return the different rows of distances (u, P) [m], and which each segment has, (m,)."""
    checker, own = problem.collision, problem.tube.clearance
    count = problem.tube.segment_count
    asked = np.full(count, float(problem.clearance))
    if own is not None:
        asked = np.where(np.isfinite(own), own, asked)
    different, row_of = np.unique(asked, return_inverse=True)
    rows = np.zeros((len(different), len(checker.pairs)))
    is_obstacle = np.arange(len(checker.pairs)) < len(checker.obstacle_pairs)
    rows[:, is_obstacle] = different[:, None]
    for names, clearance in problem.pair_clearances.items():
        rows[:, checker.between(*names)] = clearance
    rows[:, is_obstacle] += room
    return rows, row_of.ravel()


def _near_ends(
    problem: PlanningProblem, start: FloatArray, goal: FloatArray | None
) -> list[NearEnd]:
    """Return what contacts require; of a goal that is open, that its solids do not overlap."""
    last = problem.tube.segment_count - 1
    given = {START: (0, start, True), GOAL: (last, goal, not problem.endpoints[1].is_open)}
    found = []
    for contact in problem.contacts:
        pair = problem.collision.between(*contact.links)
        for end in contact.ends:
            segment, q, is_given = given[end]
            tool = problem.tube.points[-1]
            if q is not None:
                tool = problem.robot.tool_position(q[None])[0]
            distance = _distance(problem, pair, q) if is_given and q is not None else 0.0
            found.append(NearEnd(segment, tool, contact.within, pair, distance))
    return found


def _distance(problem: PlanningProblem, pair: BoolArray, q: FloatArray) -> float:
    """Return how far apart some of the pairs (P,) are at least in a configuration (n,) [m]."""
    rotation, position = problem.robot.body_poses(q[None])
    checker = problem.collision
    return float(checker.distances(rotation[0], position[0], checker.pairs[pair]).min())


# ---- What may be near to what where something is taken or let go, unless a cycle says otherwise.

WITHIN = 0.03  # [m]
# What overlaps deeper than rough geometry does was not meant to touch.
_DEEPEST = 1e-3  # [m]


def usual_contacts(
    problem: PlanningProblem,
    begins_with: Sequence[str],
    ends_with: Sequence[str],
    end: FloatArray | None = None,
) -> tuple[Contact, ...]:
    """Return contacts of what changes hands, for pairs that are given none at that end.

    Something carried may be as near to obstacles, and links to something that stands, as they are
    where the motion begins or ends, if they do not overlap there. Where it is not known in which
    configuration it ends, links that move with the tool may be, and any obstacle.

    Args:
        problem: A motion.
        begins_with: What was taken or let go before it.
        ends_with: What is taken or let go after it.
        end: In which configuration it ends, shape (n,); None: as its goal says, if that does.
    """
    found = []
    start, goal = (endpoint.joints for endpoint in problem.endpoints)
    for side, names in ((START, begins_with), (GOAL, ends_with)):
        q = start if side == START else goal if end is None else end
        known = {frozenset(each.links) for each in problem.contacts if side in each.ends}
        for name in names:
            pairs = _near(problem, name, q)
            fresh = [pair for pair in pairs if frozenset(pair) not in known]
            found += [Contact(pair, WITHIN, (side,)) for pair in fresh]
    return tuple(found)


def _near(problem: PlanningProblem, name: str, q: FloatArray | None) -> list[tuple[str, str]]:
    """Return the names of pairs with obstacles that something is in, and that may be near.

    Args:
        problem: The motion.
        name: The solid.
        q: The configuration there, shape (n,); None: it is open.
    """
    checker = problem.collision
    count = len(checker.obstacle_pairs)
    owners = np.array([shape.owner for shape in checker.shapes])[checker.obstacle_pairs]
    owners = owners.reshape(-1, 2)
    own = (owners == name).any(axis=1)
    if q is None:
        own &= _of_tool(problem)
    elif own.any():
        rotation, position = problem.robot.body_poses(q[None])
        distances = checker.distances(rotation[0], position[0], checker.obstacle_pairs[own])
        required = required_everywhere(problem)[:count][own]
        own[own] = (distances < required) & (distances > -_DEEPEST)
    return [(str(first), str(second)) for first, second in dict.fromkeys(map(tuple, owners[own]))]


def _of_tool(problem: PlanningProblem) -> BoolArray:
    """Return which pairs with obstacles are of what moves with the tool, shape (P,)."""
    robot, checker = problem.robot, problem.collision
    body = np.array([shape.body for shape in checker.shapes])
    is_tool: BoolArray = body[checker.obstacle_pairs[:, 0]] == robot.link_body[robot.tool_frame]
    return is_tool
