"""Excursions of executed motions from the tube, and their clearances, at samples."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.tube_visits import ordered_switching_samples
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.tube.points import passing_radius
from tubeplanner.limits.binding_limits import required_of_pairs
from tubeplanner.outcome import Location
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Excursions from the tube: sampled, with the certificate's choice of hand-overs.

_FREE = 1e3  # [rad or m]: the margin where nothing is required


@dataclass(frozen=True)
class Extreme:
    """The extreme value of a quantity."""

    value: float  # in the unit of the quantity
    location: Location  # with the time


@dataclass(frozen=True)
class TubeExcursions:
    """The largest excursions of a motion beyond the requirements of a tube; negative: inside."""

    tube: Extreme  # excursion of the tool beyond the regions about the segments [m]
    # rotation error beyond the tolerance [rad]; None where the tube leaves it free
    rotation: Extreme | None
    # excursion beyond the ball about the compulsory point that is missed most [m]; None: no point
    points: Extreme | None
    # as `tube`, while each of the joined segments is current, shape (m,) [m]
    tube_by_segment: FloatArray
    rotation_by_segment: FloatArray  # as `rotation`, shape (m,) [rad]; -1e3 where it is free


def tube_excursions(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    tool: FloatArray,
) -> TubeExcursions:
    """Return the largest excursions of a motion from the tube.

    Margins are linear between samples; segments hand over where two fit equally.

    Args:
        problem: The planning problem.
        time: Times of K samples, shape (K,) [s].
        q: Positions of the joints, shape (K, n): segments may require their signs.
        rotation: Orientations of the tool, shape (K, 3, 3).
        tool: Positions of the tool centre point, shape (K, 3) [m].
    """
    margins = _margins(problem, time, q, rotation, tool)
    by_rotation, tube, passages = margins.rotation, margins.problem.tube, []
    for k, margin in margins.passing.items():
        counts = (margins.last >= k - 1) & (margins.first <= k)
        if tube.visit != "ordered":
            counts = np.ones_like(counts)
        best = int(np.where(counts, margin, -np.inf).argmax())
        location = Location(time=float(margins.time[best]), point=int(tube.numbers[k]))
        passages.append(Extreme(-float(margin[best]), location))
    return TubeExcursions(
        _worst(margins, margins.tube),
        None if by_rotation is None else _worst(margins, by_rotation),
        max(passages, key=lambda extreme: extreme.value, default=None),
        -margins.tube.min(axis=0),
        np.full(margins.tube.shape[1], -_FREE) if by_rotation is None else -by_rotation.min(axis=0),
    )


def tube_margins(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    tool: FloatArray,
) -> tuple[FloatArray, FloatArray | None]:
    """Return the least margins of a motion in the tube at K samples, each with the time before it.

    Of the tool in the regions of the current segments, (K,) [m], and of its rotation, (K,) [rad],
    inf where free, None if always free. The arguments are those of `tube_excursions`, which returns
    the least of these margins, negated.
    """
    margins = _margins(problem, time, q, rotation, tool)
    sample = np.searchsorted(time, margins.time)

    def least(margin: FloatArray) -> FloatArray:
        result = np.full(len(time), _FREE)
        np.minimum.at(result, sample, margin.min(axis=1))
        return np.where(result < _FREE, result, np.inf)

    by_rotation = None if margins.rotation is None else least(margins.rotation)
    return least(margins.tube), by_rotation


@dataclass(frozen=True, eq=False)
class _Margins:
    """The margins of a motion in the current segments, at samples and at hand-overs."""

    problem: PlanningProblem  # the problem with joined segments, m of them
    time: FloatArray  # T instants, shape (T,) [s]
    # margins of the tool, shape (T, m) [m]; `_FREE` where a segment is not current
    tube: FloatArray
    # margins of the tool's rotation, shape (T, m) [rad]; None where the tube leaves it free
    rotation: FloatArray | None
    # margins in the balls about compulsory points, (T,) [m], by index
    passing: dict[int, FloatArray]
    first: IntArray  # the first current segment, shape (T,)
    last: IntArray  # the last current segment, shape (T,): both must hold at a hand-over


def _margins(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    tool: FloatArray,
) -> _Margins:
    joined = problem.joined
    tube = joined.tube
    lower, upper = tube.ranges_of(joined.robot.joint_names)
    in_ranges = np.minimum(q[:, None] - lower, upper - q[:, None]).min(axis=2)
    margins = [tube.margin(tool), np.minimum(in_ranges, _FREE)]
    if tube.rotation is not None:
        margins.append(np.minimum(tube.rotation_margin(rotation, tool), _FREE))
    radius, points = passing_radius(tube.effective_radius), tube.compulsory_points.tolist()
    in_balls = [radius[k - 1] - np.linalg.norm(tool - tube.points[k], axis=1) for k in points]
    samples = np.hstack([time[:, None], *margins, *(margin[:, None] for margin in in_balls)])
    # Interpolated rows where neighbouring segments fit equally well.
    nearer = np.diff(np.minimum.reduce(margins), axis=1)
    before, column = np.nonzero(nearer[:-1] * nearer[1:] < 0)
    begin, end = nearer[before, column], nearer[before + 1, column]
    fraction = (begin / (begin - end))[:, None]
    between = samples[before] + fraction * (samples[before + 1] - samples[before])
    rows = np.concatenate([samples, between])
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    columns = np.arange(1, rows.shape[1] - len(points)).reshape(-1, tube.segment_count)
    by_kind = [rows[:, column] for column in columns]
    passing = {k: rows[:, i - len(points)] for i, k in enumerate(points)}
    margin = np.minimum.reduce(by_kind)
    if tube.visit == "ordered":
        switches, indices = ordered_switching_samples(margin, passing), np.arange(len(margin))
        first = np.searchsorted(switches, indices, side="left")
        last = np.searchsorted(switches, indices, side="right")
    else:
        first = last = margin.argmax(axis=1)
    segment = np.arange(tube.segment_count)
    is_current = (segment >= first[:, None]) & (segment <= last[:, None])
    current = [np.where(is_current, each, _FREE) for each in by_kind]
    by_rotation = current[2] if tube.rotation is not None and tube.rotation.is_bounded else None
    return _Margins(joined, rows[:, 0], current[0], by_rotation, passing, first, last)


def _worst(margins: _Margins, margin: FloatArray) -> Extreme:
    sample, column = np.unravel_index(int(margin.argmin()), margin.shape)
    number = margins.problem.tube.segment_number(int(column))
    location = Location(time=float(margins.time[sample]), segment=number)
    return Extreme(-float(margin[sample, column]), location)


# ---- Clearances of executed motions from obstacles and between links, at samples.
#
# Pairs are measured where quick bounds are lowest. The direction that separates a pair there bounds
# its distance at all other samples, nearly everywhere above the least measured distance. Of shapes
# that overlap by many centimetres, measured distances are too low by up to as much.

_ROUNDING = 1e-12  # [m], of bounds: pairs nearer by less are not measured


def least_clearances(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    base: FloatArray,
    more: FloatArray | None = None,
) -> tuple[Extreme | None, Extreme | None]:
    """Return the least distances of links from obstacles and from each other [m].

    Each None where no pair of its kind is judged; negative where solids overlap. The robot is
    shifted among the obstacles by `base` (3,) [m]; `more` is that of `additional_distances`.
    """
    rotation, position = problem.robot.body_poses(q)
    checker = problem.collision
    count = len(checker.obstacle_pairs)
    extra = np.zeros((len(q), len(checker.pairs))) if more is None else more
    shifted = _shifted(position, base)
    return (
        _least(problem, time, (rotation, shifted), checker.obstacle_pairs, extra[:, :count]),
        _least(problem, time, (rotation, position), checker.link_pairs, extra[:, count:]),
    )


def additional_distances(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> FloatArray | None:
    """Return the required distances of pairs beyond the problem's clearance, shape (K, P) [m].

    They are those of the plan at the same time. Of pairs of links it is the whole required
    distance, of pairs that may be in contact -inf: contact is not simulated. None where all pairs
    have the problem's clearance.
    """
    if problem.has_one_clearance:
        return None
    more = required_of_pairs(problem, trajectory, time)
    more[:, : len(problem.collision.obstacle_pairs)] -= problem.clearance
    return more


def obstacle_distances(
    problem: PlanningProblem, q: FloatArray, base: FloatArray, more: FloatArray | None = None
) -> FloatArray:
    """Return the least distance of links from obstacles at each of K samples, shape (K,) [m].

    At least one pair is judged. Arguments are those of `least_clearances`; where all entries of
    `more` are -inf the distance is inf.
    """
    rotation, position = problem.robot.body_poses(q)
    position, checker = _shifted(position, base), problem.collision
    pairs = checker.obstacle_pairs
    extra = np.zeros((len(q), len(pairs))) if more is None else more[:, : len(pairs)]
    bound = checker.sphere_distances(rotation, position, pairs) - extra
    first = bound.argmin(axis=1)
    lowest = checker.closest_points(rotation, position, pairs[first])
    least: FloatArray = lowest.distance - extra[np.arange(len(q)), first]
    row, column = np.nonzero(bound < least[:, None])
    boxes = checker.box_distances(rotation, position, row, pairs[column])
    nearer = boxes - extra[row, column] < least[row]
    row, column = row[nearer], column[nearer]
    others = checker.closest_points(rotation[row], position[row], pairs[column])
    np.minimum.at(least, row, others.distance - extra[row, column])
    return least


def _shifted(position: FloatArray, base: FloatArray) -> FloatArray:
    """Return positions (K, bodies, 3) of a shifted robot; body 0 carries the obstacles."""
    shifted = position.copy()
    shifted[:, 1:] += base
    return shifted


def _least(
    problem: PlanningProblem,
    time: FloatArray,
    poses: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    extra: FloatArray,
) -> Extreme | None:
    """Return the least distance of pairs (P, 2), less the additional distances (K, P)."""
    if len(pairs) == 0:
        return None
    checker, (rotation, position) = problem.collision, poses
    bound = checker.sphere_distances(rotation, position, pairs) - extra
    nearest = _Nearest(checker, rotation, position, pairs, extra)
    nearest.measure(*np.unravel_index([bound.argmin()], bound.shape))
    rows, columns = np.nonzero(bound < nearest.distance)
    closer = checker.box_distances(rotation, position, rows, pairs[columns]) - extra[rows, columns]
    rows, columns, closer = nearest.undecided(rows, columns, closer)
    while len(rows):
        # Of each pair the sample with the lowest bound.
        order = np.lexsort([closer, columns])
        lowest = order[np.flatnonzero(np.diff(columns[order], prepend=-1))]
        directions = nearest.measure(rows[lowest], columns[lowest])
        closer[lowest] = np.inf
        rows, columns, closer = nearest.undecided(rows, columns, closer)
        along = checker.separations_along(
            rotation[rows], position[rows], pairs[columns], directions[columns]
        )
        closer = np.maximum(closer, along - extra[rows, columns])
        rows, columns, closer = nearest.undecided(rows, columns, closer)
    if nearest.distance == np.inf:  # all pairs may be in contact all along
        return None
    links, obstacle = checker.owners(pairs[nearest.column])
    location = Location(time=float(time[nearest.row]), links=links, obstacle=obstacle)
    return Extreme(nearest.distance, location)


class _Nearest:
    """The least measured distance of pairs (P, 2), less the additional distances.

    Attributes:
        distance: The distance [m].
        row: Index of its configuration.
        column: Index of its pair.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        extra: FloatArray,
    ) -> None:
        self._checker, self._rotation, self._position = checker, rotation, position
        self._pairs, self._extra = pairs, extra
        self._second = np.array([checker.shapes[index].body for index in pairs[:, 1]])
        self.distance, self.row, self.column = np.inf, 0, 0

    def measure(self, row: IntArray, column: IntArray) -> FloatArray:
        """Measure some pairs, and return directions for `separations_along` by pair, (P, 3)."""
        rotation, position = self._rotation[row], self._position[row]
        points = self._checker.closest_points(rotation, position, self._pairs[column])
        margin = points.distance - self._extra[row, column]
        best = int(margin.argmin())
        if margin[best] < self.distance:
            self.distance = float(margin[best])
            self.row, self.column = int(row[best]), int(column[best])
        frames = self._rotation[row, self._second[column]]
        directions = np.zeros((len(self._pairs), 3))
        directions[column] = np.einsum("pij,pi->pj", frames, points.direction)
        return directions

    def undecided(
        self, row: IntArray, column: IntArray, bound: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the samples, pairs and bounds that may be nearer than the least distance."""
        may_be = bound < self.distance - _ROUNDING
        return row[may_be], column[may_be], bound[may_be]
