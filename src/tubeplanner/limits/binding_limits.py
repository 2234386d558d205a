"""The binding limit at each time; the closest pair of solids."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.limits.speed_limits import POSITION, ROTATION, TUBE, LimitUse, LimitUses
from tubeplanner.limits.tube_membership import judged_segments
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- How far apart pairs of solids must be along a trajectory, as the judge asks it.


def required_of_pairs(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> FloatArray:
    """Return the distances that the pairs of `problem.collision` must keep, shape (K, P) [m].

    Of pairs that may be in contact then, -inf: they are allowed to touch.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in their order.
        time: Of K samples, increasing, shape (K,) [s]; after the end what holds there.
    """
    problem = problem.joined
    ends = trajectory.position(np.array([0.0, trajectory.duration]))
    required = RequiredDistances(problem, ends[0], ends[1])
    if required.is_constant:
        return np.tile(required.by_segment, (len(time), 1))
    segment = judged_segments(problem, trajectory, time)
    tool = problem.robot.tool_position(trajectory.position(np.minimum(time, trajectory.duration)))
    asked = required.at(segment, tool)
    for near in required.near_ends:
        asked[np.ix_(near.holds(segment, tool), near.pair)] = -np.inf
    return asked


# ---- Which two solids are closest along a trajectory, beyond what they must be apart.
#
# Pairs are measured in the order of quick bounds, all times at once, until no other pair may be
# closer. Of shapes that overlap by many centimetres, measured distances are too low by up to as
# much.

# As the certificate calls them.
OBSTACLES = "obstacles"
SELF_COLLISION = "self_collision"


@dataclass(frozen=True, eq=False)
class ClosestPairs:
    """The pair of solids with the least margin, at each of K times.

    Where every pair may be in contact, distance and margin are inf.

    Attributes:
        kind: "obstacles" or "self_collision".
        time: Shape (K,) [s].
        distance: Between the two, shape (K,) [m]; negative where they overlap.
        margin: How much more than required that is, shape (K,) [m].
        names: A link, and the obstacle or the other link.
        points: Where the two are closest, on their surfaces and in the base frame, shape (K, 2, 3)
            [m].
    """

    kind: str
    time: FloatArray
    distance: FloatArray
    margin: FloatArray
    names: tuple[tuple[str, str], ...]
    points: FloatArray


def closest_pairs(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> list[ClosestPairs]:
    """Return the pairs with the least margins: of links and obstacles, and of links alone.

    Of what is not checked, nothing. Pairs that may be in contact at a time are left out then.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        time: Of K samples, not decreasing, shape (K,) [s].
    """
    checker = problem.collision
    if len(checker.pairs) == 0:
        return []
    trajectory = trajectory.reordered(problem.robot.joint_names)
    poses = problem.robot.body_poses(trajectory.position(time))
    required = required_of_pairs(problem, trajectory, time)
    count = len(checker.obstacle_pairs)
    kinds = {OBSTACLES: slice(count), SELF_COLLISION: slice(count, None)}
    return [
        _closest(checker, time, poses, (kind, checker.pairs[own], required[:, own]))
        for kind, own in kinds.items()
        if len(checker.pairs[own])
    ]


def _closest(
    checker: CollisionChecker,
    time: FloatArray,
    poses: tuple[FloatArray, FloatArray],
    asked: tuple[str, IntArray, FloatArray],
) -> ClosestPairs:
    """Return the closest of pairs of a kind (P, 2), of which so much is required, (K, P) [m]."""
    kind, pairs, required = asked
    column = _closest_columns(checker, poses, pairs, required)
    pair, least = pairs[column], required[np.arange(len(time)), column]
    found = checker.closest_points(*poses, pair)
    # The points are those of cores: surfaces are as far beyond them as the shapes are rounded.
    radii = np.array([shape.shape.radius for shape in checker.shapes])[pair, None]
    first = found.first + radii[:, 0] * found.direction
    second = found.second - radii[:, 1] * found.direction
    owners = [(checker.shapes[i].owner, checker.shapes[j].owner) for i, j in pair.tolist()]
    return ClosestPairs(
        kind,
        time,
        np.where(least == -np.inf, np.inf, found.distance),
        found.distance - least,
        tuple(owners),
        np.stack([first, second], axis=1),
    )


def _closest_columns(
    checker: CollisionChecker,
    poses: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    required: FloatArray,
) -> IntArray:
    """Return which of some pairs has the least margin in each of K configurations, shape (K,)."""
    every = np.arange(len(required))
    rotation, position = poses

    def margins(row: IntArray, column: IntArray) -> FloatArray:
        found = checker.closest_points(rotation[row], position[row], pairs[column])
        return found.distance - required[row, column]

    bound = checker.sphere_distances(*poses, pairs) - required
    best = bound.argmin(axis=1)
    least = margins(every, best)
    bound[every, best] = np.inf
    row, column = np.nonzero(bound < least[:, None])
    closer = checker.box_distances(*poses, row, pairs[column]) - required[row, column]
    while len(row):
        open_ = closer < least[row]
        row, column, closer = row[open_], column[open_], closer[open_]
        order = np.lexsort([closer, row])
        first = order[np.flatnonzero(np.diff(row[order], prepend=-1))]
        margin = margins(row[first], column[first])
        nearer = margin < least[row[first]]
        least[row[first[nearer]]] = margin[nearer]
        best[row[first[nearer]]] = column[first[nearer]]
        closer[first] = np.inf
    return best


# ---- Which limit binds when: why a trajectory is not faster there, or takes no other way.

TOOL, LINKS = "tool", "links"
NONE = -1
# From this share on a limit binds; of a joint's range nearer to its end: two turns are long.
_BINDS = 0.98
_BINDS_IN_RANGE = 0.998
# Solids this much farther apart than they must be use nothing of that limit [m], so that they are
# in each other's way where a millimetre is left.
_FAR = 0.05
_OF_THE_SHAPE = (POSITION, TUBE, ROTATION)


@dataclass(frozen=True)
class Span:
    """A stretch of time in which one limit binds.

    Attributes:
        kind: Of the limit.
        begin: When it begins to [s].
        end: When it ends [s].
    """

    kind: str
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class BindingRow:
    """Which limit of a joint, of the tool or of the links binds, at N samples.

    Attributes:
        name: Of the joint, "tool" or "links".
        time: Shape (N,) [s].
        kinds: The kinds of limits that it has.
        which: Index of the kind that binds, of several that of which most is used; -1: none,
            shape (N,).
    """

    name: str
    time: FloatArray
    kinds: tuple[str, ...]
    which: IntArray

    @property
    def spans(self) -> list[Span]:
        """The stretches in which a limit binds, each half way to the samples beside it."""
        changes = np.flatnonzero(np.diff(self.which)) + 1
        middles = (self.time[changes - 1] + self.time[changes]) / 2
        ends = [float(self.time[0]), *middles.tolist(), float(self.time[-1])]
        which = self.which[[0, *changes.tolist()]].tolist()
        return [
            Span(self.kinds[k], begin, end)
            for k, (begin, end) in zip(which, pairwise(ends), strict=True)
            if k != NONE and end > begin
        ]


def binding_rows(
    joint_names: Sequence[str], uses: LimitUses, closest: Sequence[ClosestPairs]
) -> list[BindingRow]:
    """Return which limits bind: a row per joint, one of the tool, and one of the links.

    Points of links whose speed is limited count as links. No row of what has no limit.

    Args:
        joint_names: The joints, in their order.
        uses: How much of its limits a trajectory uses, at N samples.
        closest: Its closest pairs at the times of these samples.
    """
    rows: dict[str, list[LimitUse]] = {name: [] for name in (*joint_names, TOOL, LINKS)}
    for use in (*uses.uses, *map(clearance_use, closest)):
        is_tool = use.name == TOOL
        owner = TOOL if is_tool else LINKS if use.joint is None else joint_names[use.joint]
        rows[owner].append(use)
    time = uses.samples.time
    return [_row(name, time, own) for name, own in rows.items() if own]


def clearance_use(closest: ClosestPairs) -> LimitUse:
    """Return how much of a required distance is used: 1 where it is just kept, 0 from 5 cm on."""
    share = np.maximum(1 - closest.margin / _FAR, 0.0)
    return LimitUse(closest.kind, LINKS, share)


def bound_share(uses: LimitUses, of: Iterable[LimitUse] | None = None) -> float:
    """Return in which share of the time some limit binds, from 0 to 1.

    Args:
        uses: How much of its limits a trajectory uses.
        of: Which of them count; None: all on the speed, without those of position, tube and
            rotation, which shape the way.
    """
    if of is None:
        of = [use for use in uses.uses if use.kind not in _OF_THE_SHAPE]
    binds = np.zeros(len(uses.samples.time), dtype=bool)
    for use in of:
        binds |= _excess(use) >= 0
    halves = np.diff(uses.samples.time) / 2
    duration: FloatArray = np.append(halves, 0.0) + np.append(0.0, halves)
    return float(duration[binds].sum() / duration.sum())


def _excess(use: LimitUse) -> FloatArray:
    """Return how far beyond the share from which on it binds a limit is used, shape (N,)."""
    return use.share - (_BINDS_IN_RANGE if use.kind == POSITION else _BINDS)


def _row(name: str, time: FloatArray, uses: Sequence[LimitUse]) -> BindingRow:
    share = np.array([use.share for use in uses])
    binding = np.array([_excess(use) >= 0 for use in uses])
    which = np.where(binding, share, -np.inf).argmax(axis=0)
    which = np.where(binding.any(axis=0), which, NONE)
    return BindingRow(name, time, tuple(use.kind for use in uses), which)
