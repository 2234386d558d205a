"""Parts of a trajectory; marks of events; intervals without reversal of a joint."""

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

# ---- Marks of events.

MOVE, EVENT, ATTACH, DETACH = _OF_STEPS = ("move", "event", "attach", "detach")
PROCESS_ON, PROCESS_OFF = _OF_PROCESS = ("process_on", "process_off")
_STRETCH = "stretch"


@dataclass(frozen=True)
class Mark:
    """Mark of an event during a trajectory.

    Attributes:
        time: Since the start of the trajectory [s].
        kind: "move": a move begins; "event"; "attach" or "detach" of an object; "process_on" or
            "process_off": a stretch of constant speed begins or ends.
        name: Name of the move, the event, the object or the stretch.
        setting: Value that an event sets, as in a file; None for nothing.
        segment: Number of the segment, of a mark while the tool moves; None for others.
        distance: Along the reference path from the begin of that segment [m]; None for others.
    """

    time: float
    kind: str
    name: str
    setting: Any = None
    segment: int | None = None
    distance: float | None = None

    @property
    def is_of_step(self) -> bool:
        """True for the begin of a step of a cycle, False for a mark while the tool moves."""
        return self.segment is None

    def as_dict(self) -> dict[str, Any]:
        """Return the mark as a map of a trajectory file."""
        setting = {} if self.setting is None else {"set": self.setting}
        place = {"segment": self.segment, "distance": self.distance}
        place = {} if self.is_of_step else place
        own = {self.kind: self.name}
        if self.kind in _OF_PROCESS:  # an event, of a stretch
            own = {EVENT: self.kind, _STRETCH: self.name}
        return {"time": self.time, **own, **setting, **place}

    def __str__(self) -> str:
        setting = "" if self.setting is None else f" {self.setting}"
        return f"{self.time:.4f} s: {self.kind} {self.name}{setting}"


def marks_of(fields: Any) -> tuple[Mark, ...]:
    """Return the marks of a trajectory file from the value of its field `marks`.

    Raises:
        TrajectoryError: The value is no list of maps with a time and one of move, event, attach and
            detach, in the order of time.
    """
    if not isinstance(fields, list):
        raise TrajectoryError(f"marks is {shown(fields)}; it must be a list")
    marks: list[Mark] = []
    for k, each in enumerate(fields):
        kinds = [kind for kind in _OF_STEPS if kind in each] if isinstance(each, dict) else []
        if len(kinds) != 1 or not isinstance(each[kinds[0]], str):
            raise TrajectoryError(
                f"marks[{k}] is {shown(each)}; it must be a map with a time and one name of "
                f"{', '.join(_OF_STEPS)}"
            )
        time = each.get("time")
        if not is_number(time) or not time >= 0:
            raise TrajectoryError(f"marks[{k}].time is {shown(time)}; it must be a time [s]")
        place = each.get("segment"), each.get("distance")
        is_placed = all(is_number(value) for value in place)
        kind, name = kinds[0], each[kinds[0]]
        stretch = each.get(_STRETCH)
        if isinstance(stretch, str) and name in _OF_PROCESS:
            kind, name = name, stretch
        if not is_placed and (kind in _OF_PROCESS or place != (None, None)):
            raise TrajectoryError(
                f"marks[{k}] is {shown(each)}; a mark while the tool moves has a segment and a "
                "distance"
            )
        marks.append(Mark(float(time), kind, name, each.get("set"), *place))
    for k, (mark, after) in enumerate(pairwise(marks), start=1):
        if after.time < mark.time:
            raise TrajectoryError(f"marks[{k}].time is {after.time:g} s, before the one before")
    return tuple(marks)


# ---- Parts of trajectories, moving and at rest.


def part_of(trajectory: JointTrajectory, begin: float, end: float) -> JointTrajectory:
    """Return the part of a trajectory between two times [s], with a time that begins at zero.

    Raises:
        TrajectoryError: The times are not in order, or outside of the trajectory.
    """
    if not 0 <= begin < end <= trajectory.duration:
        raise TrajectoryError(
            f"from {begin:g} to {end:g} s is no part of a trajectory of {trajectory.duration:g} s"
        )
    times, coefficients = trajectory.breakpoints, trajectory.coefficients
    first = max(int(np.searchsorted(times, begin, side="right")) - 1, 0)
    stop = max(int(np.searchsorted(times, end, side="left")), first + 1)
    pieces = coefficients[:, first:stop].copy()
    if (delay := begin - times[first]) > 0:
        # The first polynomial, of a time that begins later; the highest power is first.
        polynomial, degree = coefficients[:, first], len(coefficients) - 1
        pieces[:, 0] = 0.0
        for power in range(degree + 1):
            for lower in range(power + 1):
                term = comb(power, lower) * delay ** (power - lower) * polynomial[degree - power]
                pieces[degree - lower, 0] += term
    inner = times[first + 1 : stop]
    return JointTrajectory(
        trajectory.joint_names, np.concatenate([[0.0], inner - begin, [end - begin]]), pieces
    )


def resting(joint_names: Sequence[str], q: FloatArray, duration: float) -> JointTrajectory:
    """Return the trajectory that rests in a configuration (n,) for a duration [s]."""
    return JointTrajectory(joint_names, [0.0, duration], q[None, None])


# ---- Sign changes of piecewise polynomials.

# A change of sign within this fraction of a piece from its end is at the end: intervals end there
# in any case.
_END = 1e-12


class SignChanges(NamedTuple):
    """Instants of K possible changes of sign, in no order."""

    column: IntArray  # index of the polynomial, shape (K,)
    piece: IntArray  # index of the piece, shape (K,)
    fraction: FloatArray  # fraction of the piece before the instant, between 0 and 1, shape (K,)


def sign_changes(coefficients: FloatArray, widths: FloatArray) -> SignChanges:
    """Return the sign changes of n piecewise polynomials inside pieces of widths (pieces,) [s].

    Coefficients are (degree+1, pieces, n), highest power first. A polynomial that only touches 0
    may be missing.
    """
    hull = bernstein_coefficients(coefficients, np.zeros(len(widths)), widths)
    both = (hull.min(axis=0) < 0) & (hull.max(axis=0) > 0)
    powers = np.arange(len(coefficients) - 1, -1, -1)
    columns, pieces, fractions = [], [], []
    for piece, column in np.argwhere(both).tolist():
        roots = np.roots(coefficients[:, piece, column] * widths[piece] ** powers)
        real = roots.real[roots.imag == 0]
        inside = real[(real > _END) & (real < 1 - _END)].tolist()
        columns += [column] * len(inside)
        pieces += [piece] * len(inside)
        fractions += inside
    return SignChanges(
        np.array(columns, dtype=np.int64), np.array(pieces, dtype=np.int64), np.array(fractions)
    )


# ---- Intervals without reversal: Coulomb friction has one direction in each.

# A joint whose velocity stays below this fraction of the largest velocity of any joint, rad/s and
# m/s compared as numbers, is at rest: friction has no direction there. Rounding of a velocity of
# zero is below it too.
STILL_FRACTION = 1e-6
_SAMPLES = np.array([0.25, 0.5, 0.75])  # of an interval, as fractions
_JUST_BELOW_ONE = 1 - 1e-12


@dataclass(frozen=True, eq=False)
class MonotoneIntervals:
    """S intervals in which a joint does not reverse, sorted by joint and then in time."""

    joint: IntArray  # index of the joint, shape (S,)
    piece: IntArray  # index of the polynomial piece that holds the interval, shape (S,)
    start: FloatArray  # start as a fraction of the piece, from 0 to 1, shape (S,)
    end: FloatArray  # end as a fraction of the piece, shape (S,)
    direction: FloatArray  # 1 forwards, -1 backwards, 0 where the joint is at rest, shape (S,)

    def at(self, piece: IntArray, fraction: FloatArray) -> FloatArray:
        """Return the directions of all joints in pieces (N,) at fractions (N,): (N, n).

        Inside a piece, an interval's end has the direction of the next interval; the end of the
        piece has that of the piece's last interval.
        """
        position = piece + np.clip(fraction, 0.0, _JUST_BELOW_ONE)
        directions = [
            direction[np.searchsorted(start, position, side="right") - 1]
            for start, direction in self._by_joint
        ]
        return np.stack(directions, axis=1)

    @cached_property
    def _by_joint(self) -> list[tuple[FloatArray, FloatArray]]:
        """Starts, counted in pieces, and directions of the intervals of every joint."""
        start, ends = self.piece + self.start, np.flatnonzero(np.diff(self.joint)) + 1
        parts = (np.split(start, ends), np.split(self.direction, ends))
        return list(zip(*parts, strict=True))


@dataclass(frozen=True, eq=False)
class CommonIntervals:
    """S intervals of a trajectory in which no joint reverses, in time."""

    piece: IntArray  # index of the polynomial piece that holds the interval, shape (S,)
    start: FloatArray  # start as a fraction of the piece, from 0 to 1, shape (S,)
    end: FloatArray  # end as a fraction of the piece, shape (S,)
    direction: FloatArray  # of every joint, shape (S, n)


def common_intervals(trajectory: JointTrajectory) -> CommonIntervals:
    """Return the intervals between ends of pieces and reversals of any joint."""
    intervals = monotone_intervals(trajectory)
    begin = np.unique(np.stack([intervals.piece, intervals.start], axis=1), axis=0)
    piece, start = begin[:, 0].astype(np.int64), begin[:, 1]
    is_last = np.append(np.diff(piece) != 0, True)
    end = np.where(is_last, 1.0, np.roll(start, -1))
    return CommonIntervals(piece, start, end, intervals.at(piece, (start + end) / 2))


def monotone_intervals(trajectory: JointTrajectory) -> MonotoneIntervals:
    """Return the intervals of every joint between ends of pieces and changes of velocity's sign."""
    velocity = trajectory.derivative_coefficients(1)
    pieces, n = velocity.shape[1:]
    hull = bernstein_coefficients(velocity, np.zeros(pieces), trajectory.widths)
    still = STILL_FRACTION * float(abs(hull).max())
    reversals = sign_changes(velocity, trajectory.widths)
    joint = np.append(np.repeat(np.arange(n), pieces), reversals.column)
    piece = np.append(np.tile(np.arange(pieces), n), reversals.piece)
    start = np.append(np.zeros(n * pieces), reversals.fraction)
    order = np.lexsort((start, piece, joint))
    joint, piece, start = joint[order], piece[order], start[order]
    is_last = np.append((np.diff(piece) != 0) | (np.diff(joint) != 0), True)
    end = np.where(is_last, 1.0, np.roll(start, -1))
    times = start[:, None] + (end - start)[:, None] * _SAMPLES
    times *= trajectory.widths[piece][:, None]
    value = np.zeros_like(times)
    for row in velocity[:, piece, joint]:
        value = value * times + row[:, None]
    # More than one sample: the joint may stop at an instant and go on.
    fastest = value[np.arange(len(value)), abs(value).argmax(axis=1)]
    direction = np.where(abs(fastest) > still, np.sign(fastest), 0.0)
    return MonotoneIntervals(joint, piece, start, end, direction)
