"""Short steps along a trajectory, in none of which anything jumps."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.trajectory.directed_stretches import directed_stretches
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


@dataclass(frozen=True, eq=False)
class PathSteps:
    """S steps, one after the other; polynomial pieces end and joints turn round between them.

    Attributes:
        trajectory: Whose they are.
        piece: The piece that each is in, shape (S,).
        local: Where steps start and end, in that piece's own time, shape (2, S) [s].
        direction: Which way joints move: 1, -1 or 0, shape (S, n).
    """

    trajectory: JointTrajectory
    piece: IntArray
    local: FloatArray
    direction: FloatArray

    @property
    def width(self) -> FloatArray:
        """Durations, shape (S,) [s]."""
        width: FloatArray = self.local[1] - self.local[0]
        return width

    @property
    def start(self) -> FloatArray:
        """When they start, shape (S,) [s]."""
        start: FloatArray = self.trajectory.breakpoints[self.piece] + self.local[0]
        return start

    def at_ends(self, order: int) -> FloatArray:
        """Return a derivative of an order from 0 to 3 at starts, then at ends: (2 S, n).

        As it is inside the step, where it jumps at its end.
        """
        return self.trajectory.within(np.tile(self.piece, 2), self.local.ravel(), order)

    def part(self, begin: int, end: int) -> "PathSteps":
        """Return the steps from one to before another."""
        chosen = slice(begin, end)
        return PathSteps(
            self.trajectory, self.piece[chosen], self.local[:, chosen], self.direction[chosen]
        )


def path_steps(trajectory: JointTrajectory, count: int, per_piece: int) -> PathSteps:
    """Return steps of a trajectory.

    Args:
        trajectory: Any.
        count: How many there are at least.
        per_piece: How many every piece has at least.
    """
    pieces = len(trajectory.widths)
    each = max(per_piece, -(-count // pieces))
    stretches = directed_stretches(trajectory)
    # Counted in pieces.
    regular = np.arange(pieces * each) / each
    begin = np.unique(np.append(regular, stretches.piece + stretches.start))
    piece = begin.astype(np.int64)
    share = np.stack([begin, np.append(begin[1:], pieces)]) - piece
    direction = stretches.at(piece, share.mean(axis=0))
    return PathSteps(trajectory, piece, share * trajectory.widths[piece], direction)
