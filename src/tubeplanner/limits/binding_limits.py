"""Use of each limit along a trajectory; the limit that binds at each time; closest solids."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.limits.path_samples import LimitKey, PathSamples, SpeedLimit, directed_friction
from tubeplanner.limits.speed_limits import speed_limits
from tubeplanner.limits.speed_polynomial import SpeedPolynomial
from tubeplanner.limits.tube_membership import current_segments, judged_segments, tube_use
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import monotone_intervals

# ---- The use of each limit along a trajectory, at samples on both sides of its breakpoints.

POSITION, TUBE, ROTATION = "position", "tube", "rotation"
LEAST_SPEED = "least_tool_speed"
_SAMPLES, _MIN_PER_PIECE = 800, 4


@dataclass(frozen=True, eq=False)
class LimitUse:
    """The used fraction of one limit."""

    kind: str  # of the limit, as the certificate calls it: "effort", "tool_speed", "tube"
    name: str  # of the limited part: a joint, "tool", or a point by number and link
    fraction: FloatArray  # at N samples, shape (N,): 1 at the limit, 0 where nothing of it is used
    joint: int | None = None  # index of the joint; None: not a joint's limit
    # index among the points whose speed is limited; None: not a point's limit
    point: int | None = None


@dataclass(frozen=True, eq=False)
class LimitUses:
    """The used fractions of all limits along a trajectory."""

    # the N samples; at a breakpoint two, which differ where a quantity jumps
    samples: TrajectorySamples
    segment: IntArray  # the tube segment of each sample, shape (N,)
    # of each limit: of joints first, by joint, then of the tool, then of points
    uses: tuple[LimitUse, ...]

    def of(self, kind: str) -> list[LimitUse]:
        """Return the uses of one kind of limit."""
        return [use for use in self.uses if use.kind == kind]


def limit_uses(
    problem: PlanningProblem, trajectory: JointTrajectory, count: int | None = None
) -> LimitUses:
    """Return the used fractions of all limits along a trajectory.

    Of a position, the distance from the middle of the range that the segment allows; of the tube,
    `tube_use`; of the rotation tolerance, the largest of its bounds'; of the lower end of a band of
    tool speeds, how far down the band the speed is; of limits on the speed, as `speed_limits` has
    them: a new kind of limit needs no line here.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        count: Samples of each polynomial piece, both its ends included; None:
            `samples_per_piece`.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    count = count or samples_per_piece(trajectory)
    samples = trajectory.per_piece(count)
    segment = current_segments(problem, trajectory, samples)
    jerk, motors = trajectory.jerk_per_piece(count), problem.robot.motors
    state = np.stack([samples.position, samples.velocity, samples.acceleration, jerk])
    friction = None
    if motors.has_coulomb_friction:  # at a breakpoint, each sample has that of its piece
        piece, sample = np.divmod(np.arange(len(segment)), count)
        direction = monotone_intervals(trajectory).at(piece, sample / (count - 1))
        friction = partial(directed_friction, motors, direction)
    at = PathSamples(problem, state, lambda: segment, friction)
    uses = _position_uses(problem, samples.position, segment)
    rotation, tool = at.tool_pose
    uses.append(LimitUse(TUBE, "tool", tube_use(problem, tool, segment)))
    if problem.tube.rotation is not None:
        error = problem.tube.rotation.error(rotation, tool, segment)
        angle = np.linalg.norm(error, axis=1, keepdims=True)
        bounds = problem.tube.rotation.bounds[segment]
        fraction = (np.hstack([abs(error), angle]) / bounds).max(axis=1)
        uses.append(LimitUse(ROTATION, "tool", fraction))
    least, most = problem.tube.least_tool_speed, problem.tube.tool_speed
    if least is not None and most is not None:
        depth = np.zeros(len(segment))
        banded = np.flatnonzero(np.isfinite(least[segment]))
        low, high = least[segment[banded]], most[segment[banded]]
        speed = np.linalg.norm(at.tool_rate[0][banded], axis=1)
        depth[banded] = np.maximum((high - speed) / (high - low), 0.0)
        uses.append(LimitUse(LEAST_SPEED, "tool", depth))
    for limit in speed_limits(problem):
        uses += _uses_of(limit, at)
    uses.sort(key=lambda use: (use.joint is None, use.joint or 0, use.point is not None))
    return LimitUses(samples, segment, tuple(uses))


def samples_per_piece(trajectory: JointTrajectory) -> int:
    """Return the number of samples of each piece for a figure: 800 in all, at least 4 each."""
    return max(_MIN_PER_PIECE, _SAMPLES // len(trajectory.widths))


def _position_uses(problem: PlanningProblem, q: FloatArray, segment: IntArray) -> list[LimitUse]:
    """Return the joints' distances from the middle of their ranges; unbounded joints are left out.

    Of a range that is open on one side, the middle is where the motion is farthest from its end.
    """
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    bounded = np.flatnonzero((np.isfinite(lower) | np.isfinite(upper)).any(axis=0))
    low = np.where(np.isfinite(lower), lower, 2 * q.min(axis=0) - upper)
    high = np.where(np.isfinite(upper), upper, 2 * q.max(axis=0) - lower)
    fraction = np.where(high > low, 0.0, 1.0)  # in a range without width a joint is at its end
    wide = (high > low) & np.isfinite(low) & np.isfinite(high)
    fraction[wide] = abs(2 * q[wide] - low[wide] - high[wide]) / (high[wide] - low[wide])
    names = problem.robot.joint_names
    return [LimitUse(POSITION, names[j], fraction[:, j], j) for j in bounded.tolist()]


def _uses_of(limit: SpeedLimit, at: PathSamples) -> list[LimitUse]:
    """Return the used fractions of one kind of limit, by joint or point, both signs together."""
    fractions = _fractions(limit.used(at), limit.signs)
    first_keys: dict[tuple[int | None, int | None], LimitKey] = {}
    for key in limit.keys:
        first_keys.setdefault((key.joint, key.point), key)
    owners = list(first_keys)
    owner_of = np.array([owners.index((key.joint, key.point)) for key in limit.keys])
    owner = np.broadcast_to(owner_of[limit.key_of(at)], fractions.shape)
    uses = []
    for k, key in enumerate(first_keys.values()):
        if key.joint is not None:
            name = at.problem.robot.joint_names[key.joint]
        else:
            name = "tool" if key.link is None else f"point {key.point} on {key.link}"
        fraction = np.where(owner == k, fractions, 0.0).max(axis=1)
        uses.append(LimitUse(limit.kind, name, fraction, key.joint, key.point))
    return uses


def _fractions(used: SpeedPolynomial, signs: tuple[float, ...]) -> FloatArray:
    """Return the used fractions of the actual, not the nominal, limits, shape (N, I)."""
    value = used.at(1.0)
    most: FloatArray = np.max([sign * value for sign in signs], axis=0)
    if used.allowed is None:
        return np.maximum(most, 0.0)
    # The terms contain the shortfall of a limit, unless it has no bound in that direction.
    shortfall = np.where(used.terms[0] == 0, 0.0, 1 - used.allowed)
    quantity = np.maximum(most - shortfall, 0.0)
    fraction = np.where(quantity > 0, np.inf, 0.0)
    np.divide(quantity, used.allowed, out=fraction, where=used.allowed > 0)
    return fraction


# ---- Required distances, and the closest pair.


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
    """

    kind: str  # "obstacles" or "self_collision"
    time: FloatArray  # shape (K,) [s]
    distance: FloatArray  # of the pair, shape (K,) [m]; negative where the solids overlap
    margin: FloatArray  # distance beyond the required one, shape (K,) [m]
    names: tuple[tuple[str, str], ...]  # a link, and the obstacle or the other link
    # the closest points on both surfaces, in the base frame, shape (K, 2, 3) [m]
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
    """An interval of time in which one limit binds."""

    kind: str  # of the limit
    begin: float  # [s]
    end: float  # [s]


@dataclass(frozen=True, eq=False)
class BindingRow:
    """The binding limits of a joint, of the tool or of the links, at N samples."""

    name: str  # of the joint, "tool" or "links"
    time: FloatArray  # shape (N,) [s]
    kinds: tuple[str, ...]  # the kinds of its limits
    which: IntArray  # index of the kind that binds, of several the most used; -1: none, shape (N,)

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
