"""Largest set of one segment without a counterexample; reuse between splits.

The set is the product of a capsule around the segment and a range for every joint; it holds the
branch along the centre line. Counterexample searches find collisions, and the set is the largest
box that excludes them all; searches continue until they find nothing. (Shrinking by counterexamples
is the idea of IRIS-NP: Petersen & Tedrake, "Growing convex collision-free regions in configuration
space using nonlinear programming", ICRA 2023.)
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.studies.tubes.clearance_bounds import (
    CounterexampleSearch,
    PairClearance,
    search_counterexamples,
)
from tubeplanner.studies.tubes.configuration_sets import ConfigurationSet
from tubeplanner.task.problem import PlanningProblem

# ---- The largest box around a core that leaves out all of some points.
#
# A box reaches from its core by one extent per direction; a point is left out if it lies beyond the
# extent in at least one direction.

# Spread of the logarithms of random speeds, and its factor from one search to the next.
_FIRST_SPREAD, _CALMING, _MIN_SPREAD = 0.8, 0.95, 0.3
# Margins grow from search to search: the box shrinks until searches find no point.
_MARGIN_GROWTH = 1.05
_NO_SPEED = 1e-12
_FIRST_DRAWS, _LATER_DRAWS = 200, 60


@dataclass(frozen=True, eq=False)
class Box:
    """The extents of a box in c directions, and the points that end it."""

    extent: FloatArray  # shape (c,)
    blocker: IntArray  # index of the point that ends each direction, -1 for none, shape (c,)

    @property
    def has_choice(self) -> bool:
        """True if the box might reach farther in a direction at the cost of another."""
        return bool((self.blocker >= 0).any() and (self.extent > 0).sum() > 1)


class BoxSearch:
    """The search for the best of many boxes; points may be added between searches."""

    def __init__(
        self,
        margin: FloatArray,
        worth: FloatArray,
        enough: FloatArray,
        already: FloatArray,
        rng: np.random.Generator,
    ) -> None:
        """Set the goals in each of c directions, all of shape (c,).

        Args:
            margin: Distance of a box from the point that ends it, as far as there is space; it
                grows from search to search.
            worth: Weight of the logarithm of each size.
            enough: Extents beyond which more counts nothing.
            already: Sizes at extent zero; positive.
            rng: For the speeds at which boxes grow in each direction.
        """
        self._margin, self._rng = margin, rng
        self._worth, self._enough, self._already = worth, enough, already
        self._speed = enough
        self._draws, self._spread = _FIRST_DRAWS, _FIRST_SPREAD

    def best(self, beyond: FloatArray, within: Box) -> Box:
        """Return the best box found within another that leaves out points.

        Of distances (B, c) of points beyond the core in each direction, at least one of each row is
        positive.
        """
        inside = np.flatnonzero((beyond <= within.extent).all(axis=1))
        best = self._grown(beyond, inside, within, self._speed)
        for _ in range(self._draws):
            speed = self._speed * np.exp(self._spread * self._rng.normal(size=len(self._speed)))
            box = self._grown(beyond, inside, within, speed)
            if self._value(box) > self._value(best):
                best, self._speed = box, speed
        self._margin = _MARGIN_GROWTH * self._margin
        self._draws, self._spread = _LATER_DRAWS, max(self._spread * _CALMING, _MIN_SPREAD)
        return best

    def _value(self, box: Box) -> float:
        sizes = self._already + np.minimum(box.extent, self._enough)
        return float(self._worth @ np.log(sizes))

    def _grown(self, beyond: FloatArray, rows: IntArray, within: Box, speed: FloatArray) -> Box:
        """Return the box that grows at a speed (c,) in each direction until points stop growth.

        Of the points (B, c), those in `rows` are inside `within`.
        """
        extent, blocker = within.extent.copy(), within.blocker.copy()
        # When the box reaches points in each direction; a point is inside from the last one on.
        time = np.maximum(beyond[rows], 0.0) / np.maximum(speed, _NO_SPEED)
        while len(rows):
            row = int(time.max(axis=1).argmin())
            direction = int(time[row].argmax())
            ends = beyond[rows[row], direction]
            extent[direction] = max(ends - self._margin[direction], ends / 2)
            blocker[direction] = rows[row]
            inside = beyond[rows, direction] <= extent[direction]
            rows, time = rows[inside], time[inside]
        return Box(extent, blocker)


# ---- The largest set of one segment.

# The set reaches this far beyond what the branch itself needs [m], [rad or m]; where it is free,
# its ranges reach the farther one.
_MIN_RADIUS, _MIN_RANGE = 1e-3, 1e-3
WANTED_RANGE = 0.05
_MAX_RANGE = 0.8  # [rad or m]: how far ranges may reach beyond the branch
# More counts nothing: of a range whose need is unknown [rad or m]; else beyond the need, of a
# radius [m] and of a range [rad or m].
_ENOUGH_RANGE, _EXTRA_RADIUS, _EXTRA_RANGE = 0.3, 5e-3, 0.05
# How far the set ends before a collision [m], [rad or m]: so that searches come to an end.
_MARGIN_RADIUS, _MARGIN_RANGE = 1e-3, 1e-2
_FIRST_SAMPLES = 2000
_FIRST_FRACTION = 8  # samples of the last search over those of the first
# After this many counterexample searches, or one without a collision, the set only shrinks: most
# collisions are known where it was.
_FREE_ROUNDS = 25
_MAX_ROUNDS = 200
# Collisions per search that are moved to the edge of the colliding region, and bisections for it.
_MAX_MOVED, _BISECTIONS = 48, 8
_DECIMALS = 4  # of the numbers written to files

# Lower and upper joint bounds, shape (n,) each [rad or m].
JointBounds: TypeAlias = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class SetPreferences:
    """The trade between radius and joint ranges of a set."""

    # extents beyond the branch that a fast trajectory needs, shape (1 + 2n,), of which a little
    # more is enough; None: not known, and no radius is enough
    needed: FloatArray | None = None
    # weight of the logarithm of the radius; that of every side of a range is 1
    radius_worth: float = 4.0


@dataclass(frozen=True, eq=False)
class SegmentSearch:
    """The largest set found for a segment."""

    allowed: ConfigurationSet  # the set
    box: Box  # its extents beyond the branch, and the collisions that end it there
    preferences: SetPreferences  # the preferences it was searched with
    q: FloatArray  # collisions found during the search, shape (B, n); the blockers of the box
    pair: IntArray  # the pair of shapes that is too close in each, shape (B,)
    last: CounterexampleSearch  # the counterexample search that found nothing
    samples: int  # number of configurations tested by the counterexample searches of this search


class CollisionBoxes:
    """Boxes around a branch that leave out the collisions known so far.

    Directions are the radius, the lower sides of the n joints, and their upper sides.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        segment: int,
        branch: FloatArray,
        core: JointBounds,
        outer: JointBounds,
        clearance: PairClearance,
    ) -> None:
        """Begin with no collision known, around a branch (P, n) of a segment.

        Sets must hold the core's joint bounds, stay in the outer ones, and have at most the radius
        of the problem.
        """
        self._problem, self._segment, self._branch = problem, segment, branch
        self._pair_clearance = clearance
        lower, upper = self._outer_lower, self._outer_upper = outer
        self._lower, self._upper = core
        radius = float(problem.tube.effective_radius[segment])
        tool = ConfigurationSet(problem, segment, lower, upper, radius).tool_distance(branch)
        self._radius = min(radius, float(_up(tool.max() + _MIN_RADIUS)))
        below, above = self._lower - lower, upper - self._upper
        ranges = np.minimum(np.concatenate([below, above]), _MAX_RANGE)
        self._widest = np.append(radius - self._radius, ranges)
        # Known collisions, the pairs that collide, their distances beyond the core.
        self._q = np.zeros((0, branch.shape[1]))
        self._pair = np.zeros(0, dtype=np.int64)
        self._beyond = np.zeros((0, len(self._widest)))
        # Sets in which a search found nothing, and that search.
        self._cleared: list[tuple[ConfigurationSet, CounterexampleSearch]] = []

    def needed(self, q: FloatArray) -> FloatArray:
        """Return the extents beyond the core that hold configurations (N, n), shape (1 + 2n,)."""
        return np.asarray(np.maximum(self._beyond_core(q).max(axis=0, initial=0.0), 0.0))

    def moved_to(
        self, problem: PlanningProblem, segment: int, search: "SegmentSearch", branch: FloatArray
    ) -> "tuple[CollisionBoxes, SegmentSearch] | None":
        """Return the same boxes and set for the same segment of another problem.

        None if they do not hold another branch (P, n).
        """
        old = search.allowed
        allowed = ConfigurationSet(problem, segment, old.lower, old.upper, old.radius)
        if self._in_core().any() or not allowed.contains(branch).all():
            return None
        boxes = copy(self)
        boxes._problem, boxes._segment = problem, segment
        return boxes, replace(search, allowed=allowed)

    def require_free_core(
        self, clearance: PairClearance, samples: int, rng: np.random.Generator
    ) -> None:
        """Raise Infeasible if a quick search finds a collision in the core; as `search`."""
        core, budget = self._allowed(np.zeros_like(self._widest)), samples // _FIRST_FRACTION + 1
        result = search_counterexamples(core, clearance, budget, rng)
        if not result.failed:
            raise self._blocked(result.q, result.pair, clearance)

    def search(
        self,
        clearance: PairClearance,
        samples: int,
        rng: np.random.Generator,
        preferences: SetPreferences,
        within: Box | None = None,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> SegmentSearch:
        """Return the largest set found around the branch.

        A set counts when a counterexample search with `samples` draws finds nothing. Searches find
        pairs by a clearance; the boxes' own tells where known collisions begin. A checkpoint,
        called before every search, may raise to end the work.

        Raises:
            Infeasible: Status tube_blocked: a collision leaves no set, or searches do not end.
        """
        sides = np.ones(len(self._widest) - 1)
        enough = np.concatenate([self._widest[:1], _ENOUGH_RANGE * sides])
        if preferences.needed is not None:
            enough = preferences.needed + np.concatenate([[_EXTRA_RADIUS], _EXTRA_RANGE * sides])
        search = BoxSearch(
            margin=np.concatenate([[_MARGIN_RADIUS], _MARGIN_RANGE * sides]),
            worth=np.concatenate([[preferences.radius_worth], sides]),
            enough=np.minimum(self._widest, enough),
            already=np.concatenate([[self._radius], WANTED_RANGE * sides]),
            rng=rng,
        )
        budget = samples // _FIRST_FRACTION + 1
        if len(self._q) == 0:
            self.require_free_core(clearance, samples, rng)
            q = self._allowed(self._widest).sample(_FIRST_SAMPLES, rng)
            least = clearance.least(q, 0.0)
            self._learn(q[least.clearance < 0], least.pair[least.clearance < 0])
        total, within = 0, within or Box(self._widest, np.full(len(self._widest), -1))
        for number in range(_MAX_ROUNDS):
            in_core = self._in_core()
            if in_core.any():
                raise self._blocked(self._q[in_core], self._pair[in_core], self._pair_clearance)
            checkpoint()
            box = search.best(self._beyond, within)
            allowed = self._allowed(box.extent)
            known = (
                old
                for cleared, old in self._cleared
                if old.tried >= samples and cleared.is_as(allowed)
            )
            last = next(known, None)
            if last is None:
                result = search_counterexamples(allowed, clearance, budget, rng)
                while result.failed and result.tried < samples:
                    more = min(result.tried, samples - result.tried)
                    result = result.then(search_counterexamples(allowed, clearance, more, rng))
                    within = box
                total += result.samples
                if result.failed:
                    last = result
                    self._cleared.append((allowed, last))
            if last is not None:
                return SegmentSearch(allowed, box, preferences, self._q, self._pair, last, total)
            self._learn(result.q, result.pair)
            if number >= _FREE_ROUNDS:
                within = box
        raise self._blocked(result.q, result.pair, clearance)

    def _in_core(self) -> BoolArray:
        """Return True for the collisions inside the core, which no box leaves out."""
        return np.asarray((self._beyond <= 0).all(axis=1))

    def _blocked(self, q: FloatArray, pair: IntArray, clearance: PairClearance) -> Infeasible:
        """Return the reason for no set: the deepest of some collisions."""
        slack, _ = clearance.of_pairs(q, pair)
        worst = int(slack.argmin())
        shapes = clearance.pairs[pair[worst]]
        location = pair_location(self._problem, self._segment, q[worst], shapes)
        return Infeasible(
            PlanStatus.TUBE_BLOCKED,
            f"there is no free space around the branch in segment {location.segment}: within its "
            f"own joint ranges {location}, {-1000 * slack[worst]:.1f} mm too close; split the "
            "segment by another reference point, or move it",
            location,
        )

    def _allowed(self, extent: FloatArray) -> ConfigurationSet:
        """Return the set that reaches by extents (1 + 2n,) beyond the branch, in round numbers."""
        below, above = extent[1:].reshape(2, -1)
        lower = np.minimum(_up(self._lower - below), self._lower)
        upper = np.maximum(_down(self._upper + above), self._upper)
        # A bound that the problem has anyway stays as it is.
        lower = np.where(below >= self._lower - self._outer_lower, self._outer_lower, lower)
        upper = np.where(above >= self._outer_upper - self._upper, self._outer_upper, upper)
        radius = max(float(_down(self._radius + extent[0])), self._radius)
        return ConfigurationSet(self._problem, self._segment, lower, upper, radius)

    def _learn(self, q: FloatArray, pair: IntArray) -> None:
        """Add collisions: configurations (C, n) and their pairs (C,)."""
        fraction = self._beyond_core(q) / np.maximum(self._widest, _MIN_RANGE)
        nearest = np.argsort(fraction.max(axis=1))[:_MAX_MOVED]
        # The first collisions on joint lines from the branch to these.
        apart = np.linalg.norm(q[nearest, None] - self._branch, axis=2)
        begin = self._branch[apart.argmin(axis=1)]
        away = q[nearest] - begin
        free, hit = np.zeros((len(nearest), 1)), np.ones((len(nearest), 1))
        for _ in range(_BISECTIONS):
            middle = (free + hit) / 2
            clearance, _ = self._pair_clearance.of_pairs(begin + middle * away, pair[nearest])
            collides = (clearance < 0)[:, None]
            free, hit = np.where(collides, free, middle), np.where(collides, middle, hit)
        q = q.copy()
        q[nearest] = begin + hit * away
        self._q, self._pair = np.concatenate([self._q, q]), np.concatenate([self._pair, pair])
        self._beyond = np.concatenate([self._beyond, self._beyond_core(q)])

    def _beyond_core(self, q: FloatArray) -> FloatArray:
        core = ConfigurationSet(self._problem, self._segment, self._lower, self._upper, 0.0)
        tool = core.tool_distance(q)[:, None]
        return np.hstack([tool - self._radius, self._lower - q, q - self._upper])


def pair_location(
    problem: PlanningProblem, k: int, q: FloatArray, pair: IntArray, joint: str | None = None
) -> Location:
    """Return links, obstacle and tool position of a pair of shapes in a configuration (n,)."""
    links, obstacle = problem.collision.owners(pair)
    number = problem.tube.segment_number(k)
    location = Location(joint=joint, segment=number, links=links, obstacle=obstacle)
    return location.at(problem.robot.tool_position(q[None])[0])


def range_core(
    problem: PlanningProblem, segment: int, branch: FloatArray, beyond: float = _MIN_RANGE
) -> JointBounds:
    """Return joint bounds that hold a branch (P, n) and a little more."""
    lower = np.maximum(_down(branch.min(axis=0) - beyond), problem.joint_lower[segment])
    upper = np.minimum(_up(branch.max(axis=0) + beyond), problem.joint_upper[segment])
    return lower, upper


def _down(values: FloatArray) -> FloatArray:
    """Return the next round numbers below values."""
    return np.asarray(np.round(np.floor(values * 10.0**_DECIMALS) / 10.0**_DECIMALS, _DECIMALS))


def _up(values: FloatArray) -> FloatArray:
    """Return the next round numbers above values."""
    return -_down(-values)
