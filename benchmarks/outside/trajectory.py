"""A trajectory file, its samples, and the part of it between two instants."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from outside.files import BadInput

ORDERS = 4  # position, velocity, acceleration, jerk
MIN_STEP = 1e-12  # of the duration: finer samples are rounding
AT_BREAKPOINT = 1e-9  # [s]: who is that near to a breakpoint is there


@dataclass(frozen=True, eq=False)
class Samples:
    """Instants of a trajectory, in order of time. At a breakpoint there is one on either side.

    Attributes:
        piece: Which polynomial holds there: int, shape (N,).
        local: Time since that piece began, shape (N,) [s].
        time: Shape (N,) [s].
    """

    piece: np.ndarray
    local: np.ndarray
    time: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    def between(self, after: np.ndarray, parts: int) -> "Samples":
        """Return the inner points of `parts` equal parts of the steps that follow samples.

        Args:
            after: Indices of samples; a step ends at the next sample. Steps from one side of a
                breakpoint to the other have no inside and are left out.
            parts: Into how many parts.
        """
        after = np.unique(after[(after >= 0) & (after < len(self) - 1)])
        after = after[self.piece[after] == self.piece[after + 1]]
        after = after[self.local[after + 1] - self.local[after] > MIN_STEP * self.time[-1]]
        fraction = np.arange(1, parts) / parts
        step = (self.local[after + 1] - self.local[after])[:, None] * fraction
        return Samples(
            np.repeat(self.piece[after], parts - 1),
            (self.local[after][:, None] + step).ravel(),
            (self.time[after][:, None] + step).ravel(),
        )

    def joined(self, other: "Samples") -> "Samples":
        """Return both, in order of time."""
        piece = np.concatenate([self.piece, other.piece])
        local = np.concatenate([self.local, other.local])
        order = np.lexsort((local, piece))
        time = np.concatenate([self.time, other.time])
        return Samples(piece[order], local[order], time[order])


class Trajectory:
    """A piecewise polynomial trajectory of n joints.

    Attributes:
        joint_names: The n joints.
        breakpoints: Shape (P+1,) [s].
        coefficients: Highest power first, shape (degree+1, P, n).
    """

    def __init__(
        self, joint_names: list[str], breakpoints: np.ndarray, coefficients: np.ndarray
    ) -> None:
        self.joint_names = joint_names
        self.breakpoints, self.coefficients = breakpoints, coefficients
        self.duration = float(breakpoints[-1])
        self._derivatives = [coefficients]
        for _ in range(ORDERS - 1):
            last = self._derivatives[-1]
            powers = np.arange(len(last) - 1, 0, -1)[:, None, None]
            lower = last[:-1] * powers if len(last) > 1 else np.zeros_like(last)
            self._derivatives.append(lower)

    def ordered(self, joint_names: list[str]) -> "Trajectory":
        """Return the trajectory with its joints in another order.

        Raises:
            BadInput: It moves other joints.
        """
        if sorted(joint_names) != sorted(self.joint_names):
            raise BadInput(
                f"the trajectory is of {', '.join(self.joint_names)}; the problem's joints are "
                f"{', '.join(joint_names)}"
            )
        columns = [self.joint_names.index(name) for name in joint_names]
        return Trajectory(joint_names, self.breakpoints, self.coefficients[:, :, columns])

    def samples(self, count: int) -> Samples:
        """Return uniform samples, and both sides of every breakpoint."""
        time = np.linspace(0.0, self.duration, count)
        piece = np.searchsorted(self.breakpoints, time, side="right") - 1
        piece = np.clip(piece, 0, len(self.breakpoints) - 2)
        begin, end = self.breakpoints[:-1], self.breakpoints[1:]
        every = np.arange(len(begin))
        uniform = Samples(piece, time - begin[piece], time)
        sides = Samples(
            np.repeat(every, 2),
            np.column_stack([np.zeros_like(begin), end - begin]).ravel(),
            np.column_stack([begin, end]).ravel(),
        )
        return uniform.joined(sides)

    def at(self, samples: Samples, order: int = 0) -> np.ndarray:
        """Return positions (order 0) or a derivative at samples, shape (N, n)."""
        coefficients = self._derivatives[order]
        value = np.zeros((len(samples), coefficients.shape[2]))
        for row in coefficients:
            value = value * samples.local[:, None] + row[samples.piece]
        return value


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory file.

    Raises:
        BadInput: It is no trajectory file, or contradicts itself.
    """
    try:
        fields = json.loads(path.read_text("utf-8-sig"))
        if (fields["format"], fields["version"]) != ("tubeplanner/trajectory", 1):
            raise BadInput(f"{path} is no trajectory file of version 1")
        breakpoints = np.array(fields["breakpoints"], dtype=float)
        coefficients = np.array(fields["coefficients"], dtype=float)
        names, duration = [str(name) for name in fields["joint_names"]], float(fields["duration"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path} is no trajectory file: {error!r}") from error
    if coefficients.ndim != 3 or coefficients.shape[1:] != (len(breakpoints) - 1, len(names)):
        raise BadInput(f"{path}: coefficients are not (degree+1, pieces, joints)")
    if not (np.isfinite(coefficients).all() and np.isfinite(breakpoints).all()):
        raise BadInput(f"{path}: numbers are not finite")
    if breakpoints[0] != 0 or (np.diff(breakpoints) <= 0).any():
        raise BadInput(f"{path}: breakpoints must start at 0 and rise")
    if abs(breakpoints[-1] - duration) > 1e-9:
        raise BadInput(f"{path}: duration contradicts the last breakpoint")
    return Trajectory(names, breakpoints, coefficients)


def part_of(trajectory: Trajectory, begin: float, end: float) -> Trajectory:
    """Return what a trajectory does between two times [s], as one that begins at zero.

    Raises:
        BadInput: They are not in order, or outside of it.
    """
    begin, end = (_at_breakpoint(trajectory.breakpoints, time) for time in (begin, end))
    if not 0 <= begin < end <= trajectory.duration:
        raise BadInput(f"from {begin:g} to {end:g} s is no part of {trajectory.duration:g} s")
    inner = trajectory.breakpoints[
        (trajectory.breakpoints > begin) & (trajectory.breakpoints < end)
    ]
    times = np.array([begin, *inner, end])
    piece = np.searchsorted(trajectory.breakpoints, times[:-1], side="right") - 1
    coefficients = trajectory.coefficients[:, piece]
    later = begin - trajectory.breakpoints[piece[0]]
    coefficients[:, 0] = _shifted(coefficients[:, 0], later)
    return Trajectory(trajectory.joint_names, times - begin, coefficients)


def _at_breakpoint(breakpoints: np.ndarray, time: float) -> float:
    nearest = float(breakpoints[abs(breakpoints - time).argmin()])
    return nearest if abs(nearest - time) <= AT_BREAKPOINT else time


def _shifted(polynomial: np.ndarray, by: float) -> np.ndarray:
    """Return a polynomial (degree+1, n), highest power first, of a time that begins later.

    Taylor: the coefficient of a power is that derivative there, divided by the factorial.
    """
    rows, derivative = [], polynomial
    for power in range(len(polynomial)):
        value = np.zeros(polynomial.shape[1])
        for row in derivative:
            value = value * by + row
        rows.append(value / math.factorial(power))
        derivative = derivative[:-1] * np.arange(len(derivative) - 1, 0, -1)[:, None]
    return np.array(rows[::-1])
