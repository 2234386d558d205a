"""Stretches of a trajectory in which a joint moves one way: what Coulomb friction depends on."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.trajectory.bernstein import bernstein_coefficients
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.sign_changes import sign_changes

# A joint that stays below this share of the largest velocity of any joint, in rad/s and m/s alike,
# stands still: friction has no direction there. So is what rounding makes of a velocity of zero.
STILL_SHARE = 1e-6
_LOOKS = np.array([0.25, 0.5, 0.75])
_JUST_BELOW_ONE = 1 - 1e-12


@dataclass(frozen=True, eq=False)
class DirectedStretches:
    """Stretches of the joints' motions, S of them, by joint and then in time.

    Attributes:
        joint: Whose it is, shape (S,).
        piece: The polynomial piece that it is in, shape (S,).
        start: Where it starts in that piece, from 0 to 1, shape (S,).
        end: Where it ends, likewise.
        direction: 1 forwards, -1 backwards, 0 where the joint stands still, shape (S,).
    """

    joint: IntArray
    piece: IntArray
    start: FloatArray
    end: FloatArray
    direction: FloatArray

    def at(self, piece: IntArray, share: FloatArray) -> FloatArray:
        """Return the directions of all joints in pieces (N,) at shares of them (N,): (N, n).

        At the end of a stretch inside a piece, that of the next one; at a piece's end, its own.
        """
        place = piece + np.clip(share, 0.0, _JUST_BELOW_ONE)
        found = [
            direction[np.searchsorted(start, place, side="right") - 1]
            for start, direction in self._by_joint
        ]
        return np.stack(found, axis=1)

    @cached_property
    def _by_joint(self) -> list[tuple[FloatArray, FloatArray]]:
        """Starts, counted in pieces, and directions, of every joint."""
        start, ends = self.piece + self.start, np.flatnonzero(np.diff(self.joint)) + 1
        parts = (np.split(start, ends), np.split(self.direction, ends))
        return list(zip(*parts, strict=True))


@dataclass(frozen=True, eq=False)
class CommonStretches:
    """Stretches of a trajectory in which no joint reverses, S of them, in time.

    Attributes:
        piece: The polynomial piece that it is in, shape (S,).
        start: Where it starts in that piece, from 0 to 1, shape (S,).
        end: Where it ends, likewise.
        direction: Of every joint, shape (S, n).
    """

    piece: IntArray
    start: FloatArray
    end: FloatArray
    direction: FloatArray


def common_stretches(trajectory: JointTrajectory) -> CommonStretches:
    """Return the stretches of a trajectory that end where pieces do and where a joint reverses."""
    stretches = directed_stretches(trajectory)
    begin = np.unique(np.stack([stretches.piece, stretches.start], axis=1), axis=0)
    piece, start = begin[:, 0].astype(np.int64), begin[:, 1]
    is_last = np.append(np.diff(piece) != 0, True)
    end = np.where(is_last, 1.0, np.roll(start, -1))
    return CommonStretches(piece, start, end, stretches.at(piece, (start + end) / 2))


def directed_stretches(trajectory: JointTrajectory) -> DirectedStretches:
    """Return the stretches into which every joint's motion falls, each within one piece.

    They end where pieces do and where the joint's velocity changes its sign.
    """
    velocity = trajectory.derivative_coefficients(1)
    pieces, n = velocity.shape[1:]
    hull = bernstein_coefficients(velocity, np.zeros(pieces), trajectory.widths)
    still = STILL_SHARE * float(abs(hull).max())
    turned = sign_changes(velocity, trajectory.widths)
    joint = np.append(np.repeat(np.arange(n), pieces), turned.column)
    piece = np.append(np.tile(np.arange(pieces), n), turned.piece)
    start = np.append(np.zeros(n * pieces), turned.share)
    order = np.lexsort((start, piece, joint))
    joint, piece, start = joint[order], piece[order], start[order]
    is_last = np.append((np.diff(piece) != 0) | (np.diff(joint) != 0), True)
    end = np.where(is_last, 1.0, np.roll(start, -1))
    looks = start[:, None] + (end - start)[:, None] * _LOOKS
    looks *= trajectory.widths[piece][:, None]
    value = np.zeros_like(looks)
    for row in velocity[:, piece, joint]:
        value = value * looks + row[:, None]
    # One look may be at an instant at which the joint stops and goes on.
    fastest = value[np.arange(len(value)), abs(value).argmax(axis=1)]
    direction = np.where(abs(fastest) > still, np.sign(fastest), 0.0)
    return DirectedStretches(joint, piece, start, end, direction)
