"""Linear constraints on a step of the optimiser, each divided by its own limit.

What may change are the control points C of a spline, its inner switching times s, and its squared
duration y = T^2, by the relative step eta = dy / y. A row says: control . dC + switching . ds +
duration eta <= slack.
"""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray

# Rows with less slack than this are kept, however short the step.
_CLOSE = 0.3
NO_LIMIT = -1
# Steps aim this far inside tube and clearances, as a share of a radius; the merit function ignores
# most of it, which absorbs violations between samples and rounding.
INNER_MARGIN = 0.005
MERIT_TOLERANCE = 0.8 * INNER_MARGIN


@dataclass(frozen=True)
class StepSize:
    """The largest step.

    Attributes:
        control: Of control points [rad or m].
        switching: Of the inner switching times, shape (m-1,).
    """

    control: float
    switching: FloatArray


@dataclass(frozen=True, eq=False)
class Rows:
    """R linear constraints.

    Attributes:
        first: The first of the four control points that count, shape (R,).
        control: Shape (R, 4, n).
        switching: Shape (R, m-1).
        duration: Shape (R,).
        slack: Shape (R,).
        limit: Number of the limit that the row stands for; -1 for none, shape (R,).
        index: Number of the row among all that its constraints have, shape (R,).
    """

    first: IntArray
    control: FloatArray
    switching: FloatArray
    duration: FloatArray
    slack: FloatArray
    limit: IntArray
    index: IntArray

    def __len__(self) -> int:
        return len(self.slack)

    def where(self, keep: BoolArray | IntArray) -> "Rows":
        """Return some of the rows."""
        return Rows(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def numbered_from(self, first: int) -> "Rows":
        """Return the rows with other numbers, the first of which is given."""
        return replace(self, index=first + self.index)

    def reach(self, size: StepSize) -> FloatArray:
        """Return how far a step can move each row, shape (R,)."""
        return _reach(self.control, self.switching, size)


def stacked(parts: list[Rows]) -> Rows:
    """Return several sets of rows as one."""
    names = Rows.__dataclass_fields__
    return Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def sided_rows(
    first: IntArray,
    change: tuple[FloatArray, FloatArray],
    used: FloatArray,
    duration: tuple[FloatArray, float],
    limit: IntArray,
    signs: tuple[float, ...],
    size: StepSize | None,
) -> Rows:
    """Return the rows of I quantities at N samples: sign * quantity <= 1 for all signs.

    They are numbered by side, sample and quantity.

    Args:
        first: The first control point that counts at each sample, shape (N,).
        change: The quantities' derivatives by control points, (N, I, 4, n), and switching times,
            (N, I, m-1).
        used: The quantities, shape (N, I).
        duration: What eta adds: as much with the sign of the side, (N, I), and less on every side.
        limit: Number of each quantity's limit, shape (N, I).
        signs: Of the sides.
        size: Rows that no step of this size can break are left out; None: none.
    """
    control, switching = change
    with_side, on_every = duration
    reach = np.full(used.shape, np.inf)
    if size is not None:
        reach = np.maximum(_CLOSE, _reach(control, switching, size))
    parts = []
    for side, sign in enumerate(signs):
        slack = 1 - sign * used
        sample, quantity = np.nonzero(slack < reach)
        at = (sample, quantity)
        parts.append(
            Rows(
                first[sample],
                sign * control[at],
                sign * switching[at],
                sign * with_side[at] - on_every,
                slack[at],
                limit[at],
                side * used.size + sample * used.shape[1] + quantity,
            )
        )
    return stacked(parts)


def plane_rows(
    first: IntArray,
    change: tuple[FloatArray, FloatArray],
    slack: FloatArray,
    limit: IntArray,
    size: StepSize | None,
) -> Rows:
    """Return the rows of P planes at N samples, numbered by sample and plane.

    Args:
        first: The first control point that counts at each sample, shape (N,).
        change: What the planes' use changes by, with control points, (N, P, 4, n), and switching
            times.
        slack: How far inside the planes each sample is, shape (N, P); inf where there is none.
        limit: Number of each sample's limit, shape (N,).
        size: Rows that no step of this size can break are left out; None: none.
    """
    control, switching = change
    reach = np.inf if size is None else _reach(control, switching, size)
    sample, plane = np.nonzero(np.isfinite(slack) & (slack < reach))
    return Rows(
        first[sample],
        control[sample, plane],
        switching[sample, plane],
        np.zeros(len(sample)),
        slack[sample, plane],
        limit[sample],
        sample * slack.shape[1] + plane,
    )


def _reach(control: FloatArray, switching: FloatArray, size: StepSize) -> FloatArray:
    reach: FloatArray = size.control * abs(control).sum(axis=(-2, -1))
    return reach + abs(switching) @ size.switching
