"""Excursions of executed motions from the tube; executed clearances."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.tube_visits import ordered_switching_samples
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.tube.points import passing_radius
from tubeplanner.limits.binding_limits import required_of_pairs
from tubeplanner.outcome import Place
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- How far executed motions leave the tube: sampled, hand-overs chosen as the certificate does.

_FREE = 1e3  # [rad or m]: the margin where nothing is asked


@dataclass(frozen=True)
class Extreme:
    """The largest of a quantity.

    Attributes:
        value: In m, rad or as the quantity has it.
        place: When and where.
    """

    value: float
    place: Place


@dataclass(frozen=True)
class TubeExcursions:
    """How far beyond what a tube asks a motion goes, below zero where it stays inside.

    Attributes:
        tube: Of the tool beyond the regions about the segments [m].
        rotation: Of its turning beyond the tolerance [rad]; None where the tube leaves it free.
        points: Beyond the ball about the compulsory point that is passed the farthest [m]; None
            where there is none.
        tube_by_segment: As `tube`, while each of the joined segments is current, shape (m,) [m].
        rotation_by_segment: As `rotation`, likewise [rad]; -1e3 where it is free.
    """

    tube: Extreme
    rotation: Extreme | None
    points: Extreme | None
    tube_by_segment: FloatArray
    rotation_by_segment: FloatArray


@dataclass(frozen=True, eq=False)
class TubeMargins:
    """How far inside what a tube asks a motion is at K samples, and on its way from the one before.

    Attributes:
        tube: Of the tool, in the regions about the segments that are current, shape (K,) [m].
        rotation: Of its turning, likewise [rad], inf where it is free; None where it always is.
    """

    tube: FloatArray
    rotation: FloatArray | None


@dataclass(frozen=True, eq=False)
class _Asked:
    """What a tube asks of a motion, while it does: at samples and where two segments fit equally.

    Attributes:
        problem: With joined segments, m of them.
        time: Of T instants, shape (T,) [s].
        tube: Margins of the tool, shape (T, m) [m]; `_FREE` where a segment is not current.
        rotation: Likewise of its turning [rad]; None where the tube leaves it free.
        passing: How far inside the balls about compulsory points it is, (T,) [m], by index.
        first: The first segment that is current, shape (T,).
        last: The last one.
    """

    problem: PlanningProblem
    time: FloatArray
    tube: FloatArray
    rotation: FloatArray | None
    passing: dict[int, FloatArray]
    first: IntArray
    last: IntArray


def tube_excursions(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    tool: FloatArray,
) -> TubeExcursions:
    """Return how far a motion leaves the tube.

    Between samples margins are taken as linear, and a hand-over where two segments fit equally.

    Args:
        problem: The planning problem.
        time: Of K samples, shape (K,) [s].
        q: Positions of the joints, shape (K, n): segments may ask their signs.
        rotation: Of the tool, shape (K, 3, 3).
        tool: Of the tool centre point, shape (K, 3) [m].
    """
    asked = _asked(problem, time, q, rotation, tool)
    turned = asked.rotation
    return TubeExcursions(
        _worst(asked, asked.tube),
        None if turned is None else _worst(asked, turned),
        _worst_passage(asked),
        -asked.tube.min(axis=0),
        np.full(asked.tube.shape[1], -_FREE) if turned is None else -turned.min(axis=0),
    )


def tube_margins(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    tool: FloatArray,
) -> TubeMargins:
    """Return how far inside the tube a motion is over time; arguments as of `tube_excursions`.

    The least of them is what `tube_excursions` finds.
    """
    asked = _asked(problem, time, q, rotation, tool)
    sample = np.searchsorted(time, asked.time)

    def least(margin: FloatArray) -> FloatArray:
        found = np.full(len(time), _FREE)
        np.minimum.at(found, sample, margin.min(axis=1))
        return np.where(found < _FREE, found, np.inf)

    return TubeMargins(least(asked.tube), None if asked.rotation is None else least(asked.rotation))


def _asked(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    tool: FloatArray,
) -> _Asked:
    joined = problem.joined
    tube = joined.tube
    margins = [tube.margin(tool), _range_margin(joined, q)]
    if tube.rotation is not None:
        margins.append(np.minimum(tube.rotation_margin(rotation, tool), _FREE))
    passing = _passing(joined, tool)
    all_rows = np.hstack([time[:, None], *margins, *(row[:, None] for row in passing.values())])
    rows = _with_crossings(all_rows, np.minimum.reduce(margins))
    columns = np.arange(1, rows.shape[1] - len(passing)).reshape(-1, tube.segment_count)
    own = [rows[:, column] for column in columns]
    passing = {k: rows[:, i - len(passing)] for i, k in enumerate(passing)}
    first, last = _segments(joined, np.minimum.reduce(own), passing)
    current = [_while_current(margin, first, last) for margin in own]
    turned = current[2] if tube.rotation is not None and tube.rotation.is_bounded else None
    return _Asked(joined, rows[:, 0], current[0], turned, passing, first, last)


def _range_margin(problem: PlanningProblem, q: FloatArray) -> FloatArray:
    """Return how far inside the ranges that segments ask joints are, (K, m); finite."""
    lower, upper = problem.tube.ranges_of(problem.robot.joint_names)
    inside = np.minimum(q[:, None] - lower, upper - q[:, None])
    return np.minimum(inside.min(axis=2), _FREE)


def _passing(problem: PlanningProblem, tool: FloatArray) -> dict[int, FloatArray]:
    """Return how far inside the balls about compulsory points tools are, (K,), by index."""
    tube = problem.tube
    radius = passing_radius(tube.effective_radius)
    return {
        k: radius[k - 1] - np.linalg.norm(tool - tube.points[k], axis=1)
        for k in tube.compulsory_points.tolist()
    }


def _with_crossings(rows: FloatArray, margin: FloatArray) -> FloatArray:
    """Return rows (K, c), with those inserted where neighbouring segments fit equally well."""
    nearer = np.diff(margin, axis=1)
    before, column = np.nonzero(nearer[:-1] * nearer[1:] < 0)
    begin, end = nearer[before, column], nearer[before + 1, column]
    share = (begin / (begin - end))[:, None]
    between = rows[before] + share * (rows[before + 1] - rows[before])
    merged = np.concatenate([rows, between])
    return merged[np.argsort(merged[:, 0], kind="stable")]


def _segments(
    problem: PlanningProblem, margin: FloatArray, passing: dict[int, FloatArray]
) -> tuple[IntArray, IntArray]:
    """Return the first and the last segment in which each sample counts, (K,) each.

    At a hand-over these are two, and both must hold.
    """
    if problem.tube.visit != "ordered":
        best = margin.argmax(axis=1)
        return best, best
    switches, samples = ordered_switching_samples(margin, passing), np.arange(len(margin))
    return (
        np.searchsorted(switches, samples, side="left"),
        np.searchsorted(switches, samples, side="right"),
    )


def _while_current(margin: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """Return margins (K, m) where a segment counts, `_FREE` elsewhere."""
    segment = np.arange(margin.shape[1])
    counts = (segment >= first[:, None]) & (segment <= last[:, None])
    return np.where(counts, margin, _FREE)


def _worst(asked: _Asked, margin: FloatArray) -> Extreme:
    sample, column = np.unravel_index(int(margin.argmin()), margin.shape)
    number = asked.problem.tube.segment_number(int(column))
    where = Place(time=float(asked.time[sample]), segment=number)
    return Extreme(-float(margin[sample, column]), where)


def _worst_passage(asked: _Asked) -> Extreme | None:
    tube, found = asked.problem.tube, []
    for k, margin in asked.passing.items():
        counts = (asked.last >= k - 1) & (asked.first <= k)
        if tube.visit != "ordered":
            counts = np.ones_like(counts)
        best = int(np.where(counts, margin, -np.inf).argmax())
        where = Place(time=float(asked.time[best]), point=int(tube.numbers[k]))
        found.append(Extreme(-float(margin[best]), where))
    return max(found, key=lambda extreme: extreme.value, default=None)


# ---- How near executed motions come to obstacles and to themselves, at samples.
#
# Pairs are measured where quick bounds are lowest. The direction that separates a pair there bounds
# its distance at all other samples, nearly everywhere beyond the least that has been measured. Of
# shapes that overlap by many centimetres, measured distances are too low by up to as much.

_ROUNDING = 1e-12  # [m], of bounds: what is nearer by less is not looked for


def least_clearances(
    problem: PlanningProblem,
    time: FloatArray,
    q: FloatArray,
    base: FloatArray,
    more: FloatArray | None = None,
) -> tuple[Extreme | None, Extreme | None]:
    """Return the least distances of links from obstacles and from each other [m].

    Args:
        problem: The planning problem.
        time: Of K samples, shape (K,) [s].
        q: Positions of the joints, shape (K, n).
        base: By how much the robot is shifted among the obstacles, shape (3,) [m].
        more: What is taken off the pairs' distances, as `additional_distances` has it, shape
            (K, P) [m]; None: nothing.

    Returns:
        Each None where no such pair is judged; negative where solids overlap.
    """
    rotation, position = problem.robot.body_poses(q)
    checker = problem.collision
    count = len(checker.obstacle_pairs)
    asked = np.zeros((len(q), len(checker.pairs))) if more is None else more
    shifted = _shifted(position, base)
    return (
        _least(problem, time, (rotation, shifted), checker.obstacle_pairs, asked[:, :count]),
        _least(problem, time, (rotation, position), checker.link_pairs, asked[:, count:]),
    )


def additional_distances(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> FloatArray | None:
    """Return how much more than the clearance from obstacles pairs must keep, shape (K, P) [m].

    While a trajectory is executed, as the plan is asked it at the same time. Of links from each
    other, how much they must keep at all; of pairs that may be in contact then -inf: how solids
    touch is not simulated.

    Args:
        problem: The planning problem.
        trajectory: What is executed.
        time: Of K samples, shape (K,) [s].

    Returns:
        None where all pairs have the problem's clearance.
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

    Args:
        problem: With a pair of link and obstacle that is judged, at least.
        q: Positions of the joints, shape (K, n).
        base: As for `least_clearances`.
        more: Likewise; where it takes all pairs away the distance is inf.
    """
    rotation, position = problem.robot.body_poses(q)
    position, checker = _shifted(position, base), problem.collision
    pairs = checker.obstacle_pairs
    asked = np.zeros((len(q), len(pairs))) if more is None else more[:, : len(pairs)]
    bound = checker.sphere_distances(rotation, position, pairs) - asked
    first = bound.argmin(axis=1)
    found = checker.closest_points(rotation, position, pairs[first])
    least: FloatArray = found.distance - asked[np.arange(len(q)), first]
    row, column = np.nonzero(bound < least[:, None])
    boxes = checker.box_distances(rotation, position, row, pairs[column])
    nearer = boxes - asked[row, column] < least[row]
    row, column = row[nearer], column[nearer]
    others = checker.closest_points(rotation[row], position[row], pairs[column])
    np.minimum.at(least, row, others.distance - asked[row, column])
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
    asked: FloatArray,
) -> Extreme | None:
    """Return the least distance of pairs (P, 2), less what is asked in addition, (K, P)."""
    if len(pairs) == 0:
        return None
    checker, (rotation, position) = problem.collision, poses
    bound = checker.sphere_distances(rotation, position, pairs) - asked
    nearest = _Nearest(checker, rotation, position, pairs, asked)
    nearest.measure(*np.unravel_index([bound.argmin()], bound.shape))
    rows, columns = np.nonzero(bound < nearest.distance)
    closer = checker.box_distances(rotation, position, rows, pairs[columns]) - asked[rows, columns]
    rows, columns, closer = nearest.undecided(rows, columns, closer)
    while len(rows):
        lowest = _lowest(columns, closer)
        directions = nearest.measure(rows[lowest], columns[lowest])
        closer[lowest] = np.inf
        rows, columns, closer = nearest.undecided(rows, columns, closer)
        along = checker.separations_along(
            rotation[rows], position[rows], pairs[columns], directions[columns]
        )
        closer = np.maximum(closer, along - asked[rows, columns])
        rows, columns, closer = nearest.undecided(rows, columns, closer)
    if nearest.distance == np.inf:  # whatever may be in contact is so all along
        return None
    links, obstacle = checker.owners(pairs[nearest.column])
    where = Place(time=float(time[nearest.row]), links=links, obstacle=obstacle)
    return Extreme(nearest.distance, where)


class _Nearest:
    """The least distance that has been measured, less what is asked in addition, of pairs (P, 2).

    Attributes:
        distance: How much it is [m].
        row: In which configuration.
        column: Of which pair.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        asked: FloatArray,
    ) -> None:
        self._checker, self._rotation, self._position = checker, rotation, position
        self._pairs, self._asked = pairs, asked
        self._second = np.array([checker.shapes[index].body for index in pairs[:, 1]])
        self.distance, self.row, self.column = np.inf, 0, 0

    def measure(self, row: IntArray, column: IntArray) -> FloatArray:
        """Measure some pairs, and return directions for `separations_along` by pair, (P, 3)."""
        rotation, position = self._rotation[row], self._position[row]
        found = self._checker.closest_points(rotation, position, self._pairs[column])
        margin = found.distance - self._asked[row, column]
        best = int(margin.argmin())
        if margin[best] < self.distance:
            self.distance = float(margin[best])
            self.row, self.column = int(row[best]), int(column[best])
        frames = self._rotation[row, self._second[column]]
        directions = np.zeros((len(self._pairs), 3))
        directions[column] = np.einsum("pij,pi->pj", frames, found.direction)
        return directions

    def undecided(
        self, row: IntArray, column: IntArray, bound: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """Return those of some pairs, and their bounds, that may be nearer."""
        may_be = bound < self.distance - _ROUNDING
        return row[may_be], column[may_be], bound[may_be]


def _lowest(columns: IntArray, bound: FloatArray) -> IntArray:
    """Return where the bound is lowest of each column that there is."""
    order = np.lexsort([bound, columns])
    return order[np.flatnonzero(np.diff(columns[order], prepend=-1))]
