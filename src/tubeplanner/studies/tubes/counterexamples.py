"""Random and downhill search for collisions; largest box free of counterexamples."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.studies.tubes.clearance_bounds import PairClearance
from tubeplanner.studies.tubes.configuration_sets import ConfigurationSet

# ---- The search for collisions in a set of configurations: random ones, and downhill from those.

# Samples with less clearance than this [m] are worth going downhill from.
_NEAR = 0.03
_STARTS_PER_PAIR = 4
_DESCENT_STEPS = 12
_MAX_STEP, _MIN_STEP = 0.15, 1e-3  # [rad or m] of all joints together
_FLAT = 1e-6  # [m/rad or 1]: a clearance that changes less does not change
_AIM = 2e-3  # [m] of overlap that a step of the descent aims at
_MIN_SAMPLES, _MAX_SAMPLES = 1024, 4096  # samples at once
_LOOKED_BESIDE, _NEIGHBOURS = 8, 24  # collisions, and configurations looked at beside each
_ENOUGH = 48  # collisions that end a search


@dataclass(frozen=True, eq=False)
class CounterexampleSearch:
    """What a counterexample search in a set found.

    Attributes:
        q: Configurations in which links are too close, shape (C, n); empty if the search found no
            counterexample.
        pair: The pair of shapes that is too close in each, shape (C,).
        least_clearance: The least clearance that was seen [m]; infinite if no pair came near.
        samples: How many configurations were tested.
        tried: How many were drawn; not all of them reach their tool pose.
    """

    q: FloatArray
    pair: IntArray
    least_clearance: float
    samples: int
    tried: int

    @property
    def failed(self) -> bool:
        """Whether no collision was found."""
        return len(self.q) == 0

    def then(self, later: "CounterexampleSearch") -> "CounterexampleSearch":
        """Return what this search and a later one in the same set found together."""
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
    """Look for configurations of a set in which links are too close.

    It continues, with more samples at a time, until it finds some or the budget is spent.

    Args:
        allowed: The set.
        clearance: Of the pairs of links.
        samples: How many configurations to draw.
        rng: Random numbers.
    """
    hits: list[tuple[FloatArray, IntArray]] = []
    least, drawn, tried, count = np.inf, 0, 0, _MIN_SAMPLES
    while tried < samples and sum(len(q) for q, _ in hits) < _ENOUGH:
        count = min(count, samples - tried)
        tried += count
        q = allowed.sample(count, rng)
        found = clearance.least(q, _NEAR)
        drawn += len(q)
        hits.append((q[found.clearance < 0], found.pair[found.clearance < 0]))
        least = min(least, found.clearance.min(initial=np.inf))
        if least >= 0:
            starts = _starts(found.clearance, found.pair)
            q, pair, lowest = _descended(allowed, clearance, q[starts], found.pair[starts])
            hits.append((q[lowest < 0], pair[lowest < 0]))
            least = min(least, lowest.min(initial=np.inf))
        count = min(2 * count, _MAX_SAMPLES)
    hits.append(_beside(allowed, clearance, np.concatenate([q for q, _ in hits]), rng))
    q_hit, pair_hit = (np.concatenate(parts) for parts in zip(*hits, strict=True))
    return CounterexampleSearch(q_hit, pair_hit, float(least), drawn, tried)


def _beside(
    allowed: ConfigurationSet, clearance: PairClearance, q: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, IntArray]:
    """Return collisions beside the first of some collisions (C, n), and their pairs.

    What is left of a colliding region is found by chance otherwise, in many more searches.
    """
    beside = np.repeat(q[:_LOOKED_BESIDE], _NEIGHBOURS, axis=0)
    away = rng.uniform(0.0, _MAX_STEP, (len(beside), 1)) * rng.normal(size=beside.shape)
    beside = allowed.back_inside(beside + away)
    beside = beside[allowed.contains(beside)]
    found = clearance.least(beside, 0.0)
    return beside[found.clearance < 0], found.pair[found.clearance < 0]


def _starts(clearance: FloatArray, pair: IntArray) -> IntArray:
    """Return the samples from which to descend: for every pair, those with the least clearance."""
    order = np.argsort(clearance)
    order = order[(clearance[order] >= 0) & np.isfinite(clearance[order])]
    chosen = [order[pair[order] == k][:_STARTS_PER_PAIR] for k in np.unique(pair[order])]
    return np.concatenate([np.zeros(0, dtype=np.int64), *chosen])


def _descended(
    allowed: ConfigurationSet, clearance: PairClearance, q: FloatArray, pair: IntArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Find where the clearance of pairs (N,) is least near configurations (N, n), and its value."""
    best, lowest = q.copy(), np.full(len(q), np.inf)
    slope, reach = np.zeros_like(q), np.full(len(q), _MAX_STEP)
    live = np.arange(len(q))
    for _ in range(_DESCENT_STEPS):
        found, found_slope = clearance.of_pairs(q, pair[live])
        better = allowed.contains(q) & (found < lowest[live])
        down = live[better]
        best[down], lowest[down], slope[down] = q[better], found[better], found_slope[better]
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

# Of the logarithms of random speeds, and by how much it shrinks from one search to the next.
_FIRST_SPREAD, _CALMING, _MIN_SPREAD = 0.8, 0.95, 0.3
# Margins grow from search to search: the box shrinks until no point is left to be found.
_MARGIN_GROWTH = 1.05
_NO_SPEED = 1e-12
_FIRST_DRAWS, _LATER_DRAWS = 200, 60


@dataclass(frozen=True, eq=False)
class Box:
    """How far a box reaches in each of c directions.

    Attributes:
        extent: Shape (c,).
        blocker: Which point ends it in each direction, -1 where none does, shape (c,).
    """

    extent: FloatArray
    blocker: IntArray

    @property
    def has_choice(self) -> bool:
        """Whether it might reach farther in one direction at the cost of another."""
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
            margin: How far a box stays away from the point that ends it, as far as there is space,
                shape (c,); it grows from search to search.
            worth: Weight of the logarithm of each size.
            enough: Extents beyond which more counts nothing.
            already: What an extent adds to, to make a size; positive.
            rng: Random numbers: boxes differ by how fast they grow in which direction.
        """
        self._margin, self._rng = margin, rng
        self._worth, self._enough, self._already = worth, enough, already
        self._speed = enough
        self._draws, self._spread = _FIRST_DRAWS, _FIRST_SPREAD

    def best(self, beyond: FloatArray, within: Box) -> Box:
        """Return the best box found that leaves out points.

        Args:
            beyond: How far points lie beyond the core in each direction, shape (B, c); at least
                one entry of each is positive.
            within: The box must lie in this one; where it reaches as far, what ends that one ends
                it.
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

    def _grown(self, beyond: FloatArray, left: IntArray, within: Box, speed: FloatArray) -> Box:
        """Return the box that grows at some speed (c,) in each direction until points stop it.

        Args:
            beyond: As for `best`.
            left: Which points count.
            within: As for `best`.
            speed: Shape (c,).
        """
        extent, blocker = within.extent.copy(), within.blocker.copy()
        # When a point is reached in each direction; it is inside once it is in all of them.
        time = np.maximum(beyond[left], 0.0) / np.maximum(speed, _NO_SPEED)
        while len(left):
            row = int(time.max(axis=1).argmin())
            direction = int(time[row].argmax())
            ends = beyond[left[row], direction]
            extent[direction] = max(ends - self._margin[direction], ends / 2)
            blocker[direction] = left[row]
            kept = beyond[left, direction] <= extent[direction]
            left, time = left[kept], time[kept]
        return Box(extent, blocker)
