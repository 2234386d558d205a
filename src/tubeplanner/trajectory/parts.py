"""Parts of a trajectory, cut and joined; marks of events; intervals without reversal of a joint."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import comb
from typing import Any, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.checks import is_number
from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import bernstein_coefficients

# ---- What happens during a trajectory, and when.

MOVE, EVENT, ATTACH, DETACH = KINDS = ("move", "event", "attach", "detach")


@dataclass(frozen=True)
class Mark:
    """Something that happens at an instant.

    Attributes:
        time: When [s].
        kind: "move": a move begins; "event"; "attach" or "detach" of something.
        name: Of the move, the event or what is taken or let go.
        setting: What an event sets, as a file has it; None for nothing.
    """

    time: float
    kind: str
    name: str
    setting: Any = None

    def as_dict(self) -> dict[str, Any]:
        """Return the mark as a trajectory file has it."""
        setting = {} if self.setting is None else {"set": self.setting}
        return {"time": self.time, self.kind: self.name, **setting}

    def __str__(self) -> str:
        setting = "" if self.setting is None else f" {self.setting}"
        return f"{self.time:.4f} s: {self.kind} {self.name}{setting}"


def marks_of(fields: Any) -> tuple[Mark, ...]:
    """Return the marks that a trajectory file has.

    Args:
        fields: What it has under `marks`.

    Raises:
        TrajectoryError: They are no list of maps with a time and one of move, event, attach,
            detach, in the order of time.
    """
    if not isinstance(fields, list):
        raise TrajectoryError(f"marks is {shown(fields)}; it must be a list")
    marks = tuple(_mark(k, each) for k, each in enumerate(fields))
    for k, (mark, after) in enumerate(pairwise(marks), start=1):
        if after.time < mark.time:
            raise TrajectoryError(f"marks[{k}].time is {after.time:g} s, before the one before")
    return marks


def _mark(k: int, fields: Any) -> Mark:
    given = [kind for kind in KINDS if kind in fields] if isinstance(fields, dict) else []
    if len(given) != 1 or not isinstance(fields[given[0]], str):
        raise TrajectoryError(
            f"marks[{k}] is {shown(fields)}; it must be a map with a time and one name of "
            f"{', '.join(KINDS)}"
        )
    time = fields.get("time")
    if not is_number(time) or not time >= 0:
        raise TrajectoryError(f"marks[{k}].time is {shown(time)}; it must be a time [s]")
    return Mark(float(time), given[0], fields[given[0]], fields.get("set"))


# ---- Trajectories cut into parts, and joined of parts.


def part_of(trajectory: JointTrajectory, begin: float, end: float) -> JointTrajectory:
    """Return what a trajectory does between two times [s], as a trajectory that begins at zero.

    Raises:
        TrajectoryError: They are not in order, or lie outside of it.
    """
    if not 0 <= begin < end <= trajectory.duration:
        raise TrajectoryError(
            f"from {begin:g} to {end:g} s is no part of a trajectory of {trajectory.duration:g} s"
        )
    times, coefficients = trajectory.breakpoints, trajectory.coefficients
    first = max(int(np.searchsorted(times, begin, side="right")) - 1, 0)
    stop = max(int(np.searchsorted(times, end, side="left")), first + 1)
    pieces = coefficients[:, first:stop].copy()
    pieces[:, 0] = _from_later(pieces[:, 0], begin - times[first])
    inner = times[first + 1 : stop]
    return JointTrajectory(
        trajectory.joint_names, np.concatenate([[0.0], inner - begin, [end - begin]]), pieces
    )


def joined(joint_names: Sequence[str], parts: Sequence[JointTrajectory]) -> JointTrajectory:
    """Return trajectories one after the other as one, each of the same joints in their order.

    Each begins exactly where the one before ends in time; nothing makes positions meet.
    """
    degree = max(len(part.coefficients) for part in parts)
    pieces, times = [], [np.zeros(1)]
    for part in parts:
        padded = np.zeros((degree, *part.coefficients.shape[1:]))
        padded[degree - len(part.coefficients) :] = part.coefficients
        pieces.append(padded)
        times.append(times[-1][-1] + part.breakpoints[1:])
    return JointTrajectory(joint_names, np.concatenate(times), np.concatenate(pieces, axis=1))


def resting(joint_names: Sequence[str], q: FloatArray, duration: float) -> JointTrajectory:
    """Return the trajectory that stays in a configuration (n,) for a duration [s]."""
    return JointTrajectory(joint_names, [0.0, duration], q[None, None])


def _from_later(polynomial: FloatArray, by: float) -> FloatArray:
    """Return a polynomial (degree+1, n), highest power first, of a time that begins later [s]."""
    if by == 0:
        return polynomial
    degree = len(polynomial) - 1
    shifted = np.zeros_like(polynomial)
    for power in range(degree + 1):
        for lower in range(power + 1):
            term = comb(power, lower) * by ** (power - lower) * polynomial[degree - power]
            shifted[degree - lower] += term
    return shifted


# ---- Where piecewise polynomials change their sign.

# Nearer to an end of a piece, as a share of it, a change of sign is at that end: the next piece has
# its own.
_END = 1e-12


class SignChanges(NamedTuple):
    """Instants at which polynomials may change their sign, K of them, in no order.

    Attributes:
        column: Which polynomial does, shape (K,).
        piece: In which piece, shape (K,).
        share: How far inside it, between 0 and 1, shape (K,).
    """

    column: IntArray
    piece: IntArray
    share: FloatArray


def sign_changes(coefficients: FloatArray, widths: FloatArray) -> SignChanges:
    """Return all of n piecewise polynomials inside their pieces, none for sure where they touch 0.

    Args:
        coefficients: Shape (degree+1, pieces, n), highest power first.
        widths: Widths of the pieces [s], shape (pieces,).
    """
    hull = bernstein_coefficients(coefficients, np.zeros(len(widths)), widths)
    both = (hull.min(axis=0) < 0) & (hull.max(axis=0) > 0)
    powers = np.arange(len(coefficients) - 1, -1, -1)
    found = [
        (column, piece, root)
        for piece, column in np.argwhere(both).tolist()
        for root in _roots_inside(coefficients[:, piece, column] * widths[piece] ** powers)
    ]
    columns, pieces, roots = zip(*found, strict=True) if found else ((), (), ())
    return SignChanges(
        np.array(columns, dtype=np.int64), np.array(pieces, dtype=np.int64), np.array(roots)
    )


def _roots_inside(coefficients: FloatArray) -> list[float]:
    """Return where a polynomial, highest power first, may change its sign between 0 and 1."""
    roots = np.roots(coefficients)
    real = roots.real[roots.imag == 0]
    return real[(real > _END) & (real < 1 - _END)].tolist()


# ---- Stretches of a trajectory in which a joint moves one way: what Coulomb friction depends on.

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
