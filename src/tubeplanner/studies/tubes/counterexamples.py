"""Random and downhill search for collisions; largest box free of counterexamples."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.studies.tubes.clearance_bounds import PairClearance
from tubeplanner.studies.tubes.configuration_sets import ConfigurationSet

# ---- The search for collisions in a set of configurations: random ones, and downhill from those.

# Descents begin at samples with less clearance than this [m].
_NEAR = 0.03
_STARTS_PER_PAIR = 4
_DESCENT_STEPS = 12
_MAX_STEP, _MIN_STEP = 0.15, 1e-3  # [rad or m] of all joints together
_FLAT = 1e-6  # [m/rad or 1]: a clearance that changes less does not change
_AIM = 2e-3  # [m]: overlap that a step of the descent aims at
_MIN_SAMPLES, _MAX_SAMPLES = 1024, 4096  # samples at once
_LOOKED_BESIDE, _NEIGHBOURS = 8, 24  # collisions, and configurations tested beside each
_ENOUGH = 48  # collisions that end a search


@dataclass(frozen=True, eq=False)
class CounterexampleSearch:
    """The result of a counterexample search in a set.

    Attributes:
        q: Configurations in which links are too close, shape (C, n); empty if there was none.
        pair: The pair of shapes that is too close in each, shape (C,).
        least_clearance: The least clearance of all samples [m]; infinite if no pair came near.
        samples: Number of configurations tested.
        tried: Number of configurations drawn; some do not reach their tool pose.
    """

    q: FloatArray
    pair: IntArray
    least_clearance: float
    samples: int
    tried: int

    @property
    def failed(self) -> bool:
        """True if no collision was found."""
        return len(self.q) == 0

    def then(self, later: "CounterexampleSearch") -> "CounterexampleSearch":
        """Return the joint result of this search and a later search in the same set."""
        return CounterexampleSearch(
            np.concatenate([self.q, later.q]),
            np.concatenate([self.pair, later.pair]),
            min(self.least_clearance, later.least_clearance),
            self.samples + later.samples,
            self.tried + later.tried,
        )


def search_counterexamples(
    allowed: ConfigurationSet, clearance: PairClearance, samples: int, rng: np.random.Generator
) -> CounterexampleSearch:
    """Search a set for configurations in which links are too close.

    Draws more samples at a time until there are enough collisions or the budget is spent.

    Args:
        allowed: The set.
        clearance: Of the pairs of links.
        samples: Number of configurations to draw.
        rng: Random numbers.
    """
    hits: list[tuple[FloatArray, IntArray]] = []
    least, tested, drawn, count = np.inf, 0, 0, _MIN_SAMPLES
    while drawn < samples and sum(len(q) for q, _ in hits) < _ENOUGH:
        count = min(count, samples - drawn)
        drawn += count
        q = allowed.sample(count, rng)
        nearest = clearance.least(q, _NEAR)
        tested += len(q)
        hits.append((q[nearest.clearance < 0], nearest.pair[nearest.clearance < 0]))
        least = min(least, nearest.clearance.min(initial=np.inf))
        if least >= 0:
            # Per pair, from the samples of least clearance.
            order = np.argsort(nearest.clearance)
            apart = nearest.clearance[order]
            order = order[(apart >= 0) & np.isfinite(apart)]
            pairs = nearest.pair[order]
            of_pairs = [order[pairs == k][:_STARTS_PER_PAIR] for k in np.unique(pairs)]
            starts = np.concatenate([np.zeros(0, dtype=np.int64), *of_pairs])
            q, pair, lowest = _descended(allowed, clearance, q[starts], nearest.pair[starts])
            hits.append((q[lowest < 0], pair[lowest < 0]))
            least = min(least, lowest.min(initial=np.inf))
        count = min(2 * count, _MAX_SAMPLES)
    # Chance alone finds the rest of a colliding region only in many more searches.
    beside = np.concatenate([q for q, _ in hits])[:_LOOKED_BESIDE]
    beside = np.repeat(beside, _NEIGHBOURS, axis=0)
    away = rng.uniform(0.0, _MAX_STEP, (len(beside), 1)) * rng.normal(size=beside.shape)
    beside = allowed.back_inside(beside + away)
    beside = beside[allowed.contains(beside)]
    nearest = clearance.least(beside, 0.0)
    hits.append((beside[nearest.clearance < 0], nearest.pair[nearest.clearance < 0]))
    q_hit, pair_hit = (np.concatenate(parts) for parts in zip(*hits, strict=True))
    return CounterexampleSearch(q_hit, pair_hit, float(least), tested, drawn)


def _descended(
    allowed: ConfigurationSet, clearance: PairClearance, q: FloatArray, pair: IntArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return configurations of least clearance near (N, n), the pairs (N,), the clearances [m]."""
    best, lowest = q.copy(), np.full(len(q), np.inf)
    slope, reach = np.zeros_like(q), np.full(len(q), _MAX_STEP)
    live = np.arange(len(q))
    for _ in range(_DESCENT_STEPS):
        value, gradient = clearance.of_pairs(q, pair[live])
        better = allowed.contains(q) & (value < lowest[live])
        down = live[better]
        best[down], lowest[down], slope[down] = q[better], value[better], gradient[better]
        reach[live[~better]] /= 2
        live = live[(lowest[live] >= 0) & (reach[live] >= _MIN_STEP)]
        if len(live) == 0:
            break
        size = np.maximum(np.linalg.norm(slope[live], axis=1), _FLAT)
        length = np.minimum((lowest[live] + _AIM) / size, reach[live])
        q = allowed.back_inside(best[live] - (length / size)[:, None] * slope[live])
    return best, pair, lowest


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
    """The extents of a box in c directions, and the points that end it.

    Attributes:
        extent: Shape (c,).
        blocker: Index of the point that ends the box in each direction, -1 for none, shape (c,).
    """

    extent: FloatArray
    blocker: IntArray

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
        """Set the goals in each of c directions.

        Args:
            margin: Distance of a box from the point that ends it, as far as there is space, shape
                (c,); it grows from search to search.
            worth: Weight of the logarithm of each size.
            enough: Extents beyond which more counts nothing.
            already: Sizes at extent zero; positive.
            rng: Random numbers, for the speeds at which boxes grow in each direction.
        """
        self._margin, self._rng = margin, rng
        self._worth, self._enough, self._already = worth, enough, already
        self._speed = enough
        self._draws, self._spread = _FIRST_DRAWS, _FIRST_SPREAD

    def best(self, beyond: FloatArray, within: Box) -> Box:
        """Return the best box found that leaves out points.

        Args:
            beyond: Distances of points beyond the core in each direction, shape (B, c); at least
                one entry of each row is positive.
            within: A box that holds the result; where extents are equal, so are blockers.
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
