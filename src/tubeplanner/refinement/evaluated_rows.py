"""What every constraint at samples of a spline tells the optimiser, but for regions."""

from typing import Protocol

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.linear_rows import Rows, StepSize


class EvaluatedRows(Protocol):
    """A constraint at samples of a spline: rows, and their slack at another spline.

    Attributes:
        is_elastic: Whether it may be violated on the way, at a penalty.
    """

    @property
    def is_elastic(self) -> bool:
        """Whether it may be violated on the way, at a penalty."""
        ...

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        ...

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return the rows of the spline run in T seconds.

        Args:
            duration: T [s].
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        ...

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of all rows that `rows` numbers, here, for rows made elsewhere.

        Args:
            duration: The duration that those were made for [s].
            squared_duration: The new squared duration, as a multiple of the old one.
        """
        ...
