"""The largest box around a core that leaves out all of some points.

A box reaches from its core by one extent per direction; a point is left out if it lies beyond the
extent in at least one direction.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray

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
