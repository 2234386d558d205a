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


def required_of_pairs(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> FloatArray:
    """Return the distances that the judge requires of the pairs of `problem.collision`, (K, P) [m].

    Pairs that may be in contact at a time have -inf then.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in their order.
        time: Of K samples, increasing, shape (K,) [s]; after the end, the values at the end hold.
    """
    problem = problem.joined
    ends = trajectory.position(np.array([0.0, trajectory.duration]))
    required = RequiredDistances(problem, ends[0], ends[1])
    if required.is_constant:
        return np.tile(required.by_segment, (len(time), 1))
    segment = judged_segments(problem, trajectory, time)
    tool = problem.robot.tool_position(trajectory.position(np.minimum(time, trajectory.duration)))
    distance = required.at(segment, tool)
    for near in required.near_ends:
        distance[np.ix_(near.holds(segment, tool), near.pair)] = -np.inf
    return distance


# ---- The closest pair of solids along a trajectory, beyond the required distances.
#
# Pairs are measured in the order of quick bounds, all times at once, until no other pair may be
# closer. Measured distances of shapes that overlap by many centimetres are too low by up to as
# much.

# The certificate's names for these kinds.
OBSTACLES = "obstacles"
SELF_COLLISION = "self_collision"


@dataclass(frozen=True, eq=False)
class ClosestPairs:
    """The pair of solids with the least margin, at each of K times.

    Where every pair may be in contact, distance and margin are inf.

    Attributes:
        kind: "obstacles" or "self_collision".
        time: Shape (K,) [s].
        distance: Of the pair, shape (K,) [m]; negative where the solids overlap.
        margin: Distance beyond the required one, shape (K,) [m].
        names: A link, and the obstacle or the other link.
        points: The closest points on both surfaces, in the base frame, shape (K, 2, 3) [m].
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

    A kind without checked pairs has no entry. Pairs that may be in contact at a time are left out
    then.

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
    radii = np.array([shape.shape.radius for shape in checker.shapes])
    count, result = len(checker.obstacle_pairs), []
    for kind, columns in ((OBSTACLES, slice(count)), (SELF_COLLISION, slice(count, None))):
        pairs = checker.pairs[columns]
        if len(pairs) == 0:
            continue
        column = _closest_columns(checker, poses, pairs, required[:, columns])
        pair, least = pairs[column], required[:, columns][np.arange(len(time)), column]
        closest = checker.closest_points(*poses, pair)
        # The points are those of cores: surfaces are as far beyond them as the shapes are rounded.
        first = closest.first + radii[pair[:, :1]] * closest.direction
        second = closest.second - radii[pair[:, 1:]] * closest.direction
        names = [(checker.shapes[i].owner, checker.shapes[j].owner) for i, j in pair.tolist()]
        distance = np.where(least == -np.inf, np.inf, closest.distance)
        points = np.stack([first, second], axis=1)
        margin = closest.distance - least
        result.append(ClosestPairs(kind, time, distance, margin, tuple(names), points))
    return result


def _closest_columns(
    checker: CollisionChecker,
    poses: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    required: FloatArray,
) -> IntArray:
    """Return the column of the pair with the least margin in each of K configurations: (K,)."""
    every = np.arange(len(required))
    rotation, position = poses

    def margins(row: IntArray, column: IntArray) -> FloatArray:
        closest = checker.closest_points(rotation[row], position[row], pairs[column])
        return closest.distance - required[row, column]

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


# ---- Binding limits by time: why a trajectory is not faster there, or takes no other way.

TOOL, LINKS = "tool", "links"
NONE = -1
# From this fraction on a limit binds; a joint's range does nearer to its end: two turns are long.
_BINDS = 0.98
_BINDS_IN_RANGE = 0.998
# Solids this much farther apart than required use nothing of that limit [m], so that they are in
# each other's way where a millimetre is left.
_FAR = 0.05
_OF_THE_SHAPE = (POSITION, TUBE, ROTATION)


@dataclass(frozen=True)
class Span:
    """An interval of time in which one limit binds.

    Attributes:
        kind: Of the limit.
        begin: [s].
        end: [s].
    """

    kind: str
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class BindingRow:
    """The binding limits of a joint, of the tool or of the links, at N samples.

    Attributes:
        name: Of the joint, "tool" or "links".
        time: Shape (N,) [s].
        kinds: The kinds of its limits.
        which: Index of the kind that binds, of several the most used; -1: none, shape (N,).
    """

    name: str
    time: FloatArray
    kinds: tuple[str, ...]
    which: IntArray

    @property
    def spans(self) -> list[Span]:
        """The intervals in which a limit binds; each ends half way to the next sample."""
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
    """Return the binding limits: a row per joint, a row of the tool, and a row of the links.

    Points of links whose speed is limited count as links. A row without limits is left out.

    Args:
        joint_names: The joints, in their order.
        uses: The use of each limit along a trajectory, at N samples.
        closest: Its closest pairs at the times of these samples.
    """
    rows: dict[str, list[LimitUse]] = {name: [] for name in (*joint_names, TOOL, LINKS)}
    for use in (*uses.uses, *map(clearance_use, closest)):
        is_tool = use.name == TOOL
        owner = TOOL if is_tool else LINKS if use.joint is None else joint_names[use.joint]
        rows[owner].append(use)
    result = []
    for name, own in rows.items():
        if not own:
            continue
        binding = np.array([_excess(use) >= 0 for use in own])
        which = np.where(binding, np.array([use.fraction for use in own]), -np.inf).argmax(axis=0)
        which = np.where(binding.any(axis=0), which, NONE)
        result.append(BindingRow(name, uses.samples.time, tuple(use.kind for use in own), which))
    return result


def clearance_use(closest: ClosestPairs) -> LimitUse:
    """Return the use of a required distance: 1 where it is just kept, 0 from 5 cm on."""
    fraction = np.maximum(1 - closest.margin / _FAR, 0.0)
    return LimitUse(closest.kind, LINKS, fraction)


def bound_fraction(uses: LimitUses, of: Iterable[LimitUse] | None = None) -> float:
    """Return the fraction of the time in which some limit binds, from 0 to 1.

    Args:
        uses: The use of each limit along a trajectory.
        of: The limits that count; None: all on the speed, without those of position, tube and
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
    """Return the use of a limit beyond the fraction from which on it binds, shape (N,)."""
    return use.fraction - (_BINDS_IN_RANGE if use.kind == POSITION else _BINDS)
