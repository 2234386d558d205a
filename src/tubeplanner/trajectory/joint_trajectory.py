"""JointTrajectory: evaluation, sampling, concatenation, saving; moving averages."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import factorial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import is_number
from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.text import require_name
from tubeplanner.trajectory.polynomials import BSpline, PiecewisePolynomial

if TYPE_CHECKING:
    from tubeplanner.task.problem import PlanningProblem

# Bounds that every arm respects, far below those of rounding and of computing time.
MAX_DEGREE, MAX_PIECES, MAX_JOINTS = 20, 100_000, 1000
MIN_DURATION, MAX_DURATION = 1e-9, 1e6  # [s]
# Candidates of a search may swing far before they are rejected.
_MAX_POSITION = 1e6  # [rad or m]
_MAX_RATE = 1e6  # [1/s]; the bound of the derivative of order k is `_MAX_POSITION * _MAX_RATE**k`
_UNITS = ("rad or m", "rad/s or m/s", "rad/s^2 or m/s^2", "rad/s^3 or m/s^3")
_DERIVATIVES = ("position", "velocity", "acceleration", "jerk")
_MAX_SAMPLES = 1_000_000


@dataclass(frozen=True, eq=False)
class TrajectorySamples:
    """A trajectory at N times."""

    time: FloatArray  # shape (N,) [s]
    position: FloatArray  # shape (N, n) [rad or m]
    velocity: FloatArray  # shape (N, n) [rad/s or m/s]
    acceleration: FloatArray  # shape (N, n) [rad/s^2 or m/s^2]


class JointTrajectory:
    """Positions of n joints over time, as polynomials between breakpoints; immutable.

    Attributes:
        joint_names: Names of the n joints.
        breakpoints: Shape (pieces+1,) [s], from 0 to the duration, increasing.
        coefficients: Shape (degree+1, pieces, n), as `scipy.interpolate.PPoly`: highest power
            first, local time `t - breakpoints[i]`.
    """

    joint_names: tuple[str, ...]
    breakpoints: FloatArray
    coefficients: FloatArray
    _derivatives: tuple[PiecewisePolynomial, ...]

    def __init__(
        self, joint_names: Sequence[str], breakpoints: object, coefficients: object
    ) -> None:
        """Check and copy the polynomials, read-only.

        Raises:
            TrajectoryError: Shapes do not fit, a name is given twice or cannot be shown, a number
                is not finite, time does not increase from zero, or there are more joints, pieces,
                degrees, seconds or radians than an arm could use.
        """
        try:
            names = () if isinstance(joint_names, str | bytes) else tuple(joint_names)
        except TypeError:
            names = ()
        if not names:
            raise TrajectoryError(f"joint_names is {shown(joint_names)}; give a list of names")
        self._keep("joint_names", names)
        for k, name in enumerate(names):
            require_name(f"joint_names[{k}]", name, TrajectoryError)
            if name in names[:k]:
                raise TrajectoryError(f"joint_names has '{name}' twice; each joint moves once")
        for field, values in (("breakpoints", breakpoints), ("coefficients", coefficients)):
            try:
                self._keep(field, read_only(values))
            except (TypeError, ValueError) as error:
                raise TrajectoryError(
                    f"breakpoints and coefficients must be arrays of numbers ({field}: {error})"
                ) from None
        self._require_consistent()
        position = PiecewisePolynomial(self.coefficients, self.breakpoints)
        self._keep("_derivatives", tuple(position.derivative(order) for order in range(4)))
        for order, quantity in enumerate(_DERIVATIVES):
            most = _MAX_POSITION * _MAX_RATE**order
            reach = self.reach(order)
            if (reach <= most).all():
                continue
            piece, joint = np.unravel_index(int(reach.argmax()), reach.shape)
            raise TrajectoryError(
                f"the {quantity} of '{names[joint]}' may reach {reach[piece, joint]:.3g} "
                f"{_UNITS[order]} in piece {piece}; beyond {most:g} nothing can be computed"
            )

    @staticmethod
    def require(trajectory: object) -> None:
        """Raise TrajectoryError unless a value is a JointTrajectory."""
        if not isinstance(trajectory, JointTrajectory):
            raise TrajectoryError(
                f"the trajectory is {shown(trajectory)}; give a JointTrajectory, as plan returns"
            )

    def __repr__(self) -> str:
        names, (rows, pieces, _) = ", ".join(self.joint_names), self.coefficients.shape
        structure = f"{pieces} pieces of degree {rows - 1}"
        return f"<JointTrajectory of {self.duration:.4f} s: {structure}, joints {names}>"

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(
            f"{name} of a trajectory cannot be changed; make another JointTrajectory"
        )

    def _keep(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.breakpoints[-1])

    @property
    def widths(self) -> FloatArray:
        """Durations of the pieces, shape (pieces,) [s]."""
        return np.diff(self.breakpoints)

    def position(self, t: object) -> FloatArray:
        """Return joint positions at times [s] of shape (...,): shape (..., n) [rad or m].

        Times before the start or after the end give the first or last configuration.
        """
        return self._derivatives[0](self._clip(t))

    def velocity(self, t: object) -> FloatArray:
        """Return joint velocities at times (...,): shape (..., n) [rad/s or m/s]."""
        return self._derivatives[1](self._clip(t))

    def acceleration(self, t: object) -> FloatArray:
        """Return joint accelerations at times (...,): shape (..., n) [rad/s^2 or m/s^2]."""
        return self._derivatives[2](self._clip(t))

    def jerk(self, t: object) -> FloatArray:
        """Return joint jerks at times (...,): shape (..., n) [rad/s^3 or m/s^3].

        At a breakpoint, the jerk of the piece after it.
        """
        return self._derivatives[3](self._clip(t))

    def derivative_coefficients(self, order: int) -> FloatArray:
        """Return the coefficients of a derivative of order 0 to 3 (jerk), highest power first.

        Shape (degree+1-order, pieces, n), at least one row.
        """
        return self._derivatives[order].coefficients

    def reach(self, order: int = 0) -> FloatArray:
        """Return an upper bound on a derivative's magnitude, order 0 to 3, shape (pieces, n).

        From the magnitudes of the coefficients; for all times of a piece.
        """
        rows, width = self.derivative_coefficients(order), self.widths[:, None]
        bound = np.zeros(rows.shape[1:])
        with np.errstate(over="ignore"):
            for row in rows:  # Horner's scheme: powers of small widths would vanish
                bound *= width
                bound += abs(row)
        return bound

    def sample(self, rate: float = 500.0) -> TrajectorySamples:
        """Return samples at a rate [Hz], the last sample at the duration.

        A regular sample closer than half a period to the end is left out.

        Raises:
            TrajectoryError: The rate is no positive finite number, or makes more than 1e6 samples.
        """
        if not is_number(rate):
            raise TrajectoryError(f"rate is {shown(rate)}; it must be a number > 0 [Hz]")
        if not 0 < rate < np.inf:
            raise TrajectoryError(f"rate {rate:g} Hz must be > 0 and finite")
        if self.duration * rate > _MAX_SAMPLES:
            raise TrajectoryError(
                f"rate {rate:g} Hz makes {self.duration * rate:.3g} samples of {self.duration:.3g} "
                f"s; at most {_MAX_SAMPLES} are made"
            )
        regular = np.arange(int(np.ceil(self.duration * rate))) / rate
        regular = regular[regular <= self.duration - 0.5 / rate]
        if len(regular) == 0:
            regular = np.zeros(1)
        return self.at(np.append(regular, self.duration))

    def at(self, time: FloatArray) -> TrajectorySamples:
        """Return samples at times of shape (N,) [s]."""
        return TrajectorySamples(
            time, self.position(time), self.velocity(time), self.acceleration(time)
        )

    def per_piece(self, count: int) -> TrajectorySamples:
        """Return `count` samples of every piece, with both its ends.

        At a breakpoint each of the two pieces has a sample of its own; the two differ where a
        derivative jumps.
        """
        local, values = self._per_piece(count, range(3))
        return TrajectorySamples((self.breakpoints[:-1, None] + local).ravel(), *values)

    def jerk_per_piece(self, count: int) -> FloatArray:
        """Return the jerk at the samples of `per_piece`, shape (N, n) [rad/s^3 or m/s^3]."""
        return self._per_piece(count, [3])[1][0]

    def _per_piece(self, count: int, orders: Iterable[int]) -> tuple[FloatArray, list[FloatArray]]:
        """Return times of samples since the starts of their pieces, and derivatives (N, n)."""
        local, values = np.linspace(0.0, 1.0, count) * self.widths[:, None], []
        for order in orders:
            value = np.zeros((*local.shape, len(self.joint_names)))
            for row in self.derivative_coefficients(order):
                value = value * local[:, :, None] + row[:, None]
            values.append(value.reshape(-1, len(self.joint_names)))
        return local, values

    def within(self, piece: IntArray, local: FloatArray, order: int) -> FloatArray:
        """Return a derivative of an order from 0 to 3 on given pieces, shape (N, n).

        The piece decides between the two values at a breakpoint where the derivative jumps.

        Args:
            piece: Indices of pieces, shape (N,).
            local: Times since the start of the piece, shape (N,) [s].
            order: 0: position; 1: velocity; 2: acceleration; 3: jerk.
        """
        value = np.zeros((len(piece), len(self.joint_names)))
        for row in self.derivative_coefficients(order):
            value = value * local[:, None] + row[piece]
        return value

    def scaled(self, factor: float) -> "JointTrajectory":
        """Return the same path with all times multiplied by a factor > 0."""
        degree = len(self.coefficients) - 1
        powers = np.arange(degree, -1, -1)
        coefficients = self.coefficients / (factor**powers)[:, None, None]
        return JointTrajectory(self.joint_names, self.breakpoints * factor, coefficients)

    def between(self, begin: float, end: float) -> "JointTrajectory":
        """Return the part between two times [s], with a time that starts at zero.

        A part shorter than a nanosecond is widened to a nanosecond.
        """
        width = max(end - begin, 1e-9)
        begin = min(begin, self.duration - width)
        # Compared after the subtraction: rounding must not make a breakpoint meet the end.
        local = self.breakpoints - begin
        inner = (local > 0) & (local < width)
        starts = np.concatenate([[begin], self.breakpoints[inner]])
        position = self._derivatives[0]
        powers = range(len(self.coefficients) - 1, -1, -1)
        rows = [position.derivative(power)(starts) / factorial(power) for power in powers]
        breakpoints = np.concatenate([[0.0], local[inner], [width]])
        return JointTrajectory(self.joint_names, breakpoints, rows)

    def reordered(self, joint_names: Sequence[str]) -> "JointTrajectory":
        """Return the trajectory with its joints in another order.

        Raises:
            TrajectoryError: The names are not those of the trajectory.
        """
        if sorted(joint_names) != sorted(self.joint_names):
            extra = [name for name in self.joint_names if name not in joint_names]
            moves = f"; leave out {', '.join(extra)}, or plan these joints too"
            raise TrajectoryError(
                f"the trajectory moves the joints {', '.join(self.joint_names)}; the problem's "
                f"are {', '.join(joint_names)}{moves * (set(joint_names) < set(self.joint_names))}"
            )
        columns = [self.joint_names.index(name) for name in joint_names]
        return JointTrajectory(joint_names, self.breakpoints, self.coefficients[:, :, columns])

    def save(
        self, path: str | Path, problem: "PlanningProblem | None" = None, rate: float | None = None
    ) -> tuple[str, ...]:
        """Write the trajectory to a file, replaced whole or not at all.

        Args:
            path: The suffix decides the format. `.json`: the trajectory itself. `.csv`: samples.
                `.yaml` or `.yml`: samples as trajectory_msgs/JointTrajectory (ROS).
                `read_trajectory` reads all of them.
            problem: The planning problem of the trajectory. The JSON then has hashes of problem and
                robot, the CSV has efforts, and samples are such that the limits hold when they
                are joined, where the rate allows it; joints are in the problem's order. None:
                none of these, and samples are the trajectory's own.
            rate: Of the samples [Hz]; None: one every period of the problem's controller, 500 Hz if
                it has none.

        Returns:
            Notes on differences between samples and trajectory, and on limits that the joined
            samples break; empty if there are none.

        Raises:
            OutputError: The suffix is another one, or the file could not be written.
            OptionError: The rate is not positive and finite.
            TrajectoryError: The problem has other joints, or the rate makes too many samples.
        """
        # The only import of a higher folder, so that a trajectory writes itself: `ignore_imports`.
        from tubeplanner.output.files.trajectory_writer import write_trajectory

        return write_trajectory(path, self, problem, rate)

    def _clip(self, t: object) -> FloatArray:
        return np.clip(np.asarray(t, dtype=np.float64), 0.0, self.duration)

    def _require_consistent(self) -> None:
        """Raise unless shapes fit, numbers are finite, and counts and duration within bounds."""
        b, c = self.breakpoints, self.coefficients
        if b.ndim != 1 or len(b) < 2 or b[0] != 0.0 or not (np.diff(b) > 0).all():
            raise TrajectoryError("breakpoints must be at least two times that increase from 0")
        expected = (max(len(c) if c.ndim else 0, 1), len(b) - 1, len(self.joint_names))
        if c.shape != expected:
            raise TrajectoryError(
                f"coefficients have shape {c.shape}; (degree+1, pieces, joints) = {expected} is "
                "needed for these breakpoints and joint_names"
            )
        if not np.isfinite(b).all() or not np.isfinite(c).all():
            raise TrajectoryError("breakpoints and coefficients must be finite numbers")
        rows, pieces, joints = c.shape
        for what, count, most, remedy in (
            ("degree", rows - 1, MAX_DEGREE, "divide the pieces"),
            ("number of pieces", pieces, MAX_PIECES, "join some, or cut the trajectory into parts"),
            ("number of joints", joints, MAX_JOINTS, "leave out those that are not planned"),
        ):
            if count > most:
                raise TrajectoryError(f"the {what} is {count}, at most {most}; {remedy}")
        if not MIN_DURATION <= self.duration <= MAX_DURATION:
            raise TrajectoryError(
                f"the duration is {self.duration:.3g} s; it must be from {MIN_DURATION:g} to "
                f"{MAX_DURATION:g} s (seconds are meant)"
            )


def concatenate(parts: Sequence[JointTrajectory]) -> JointTrajectory:
    """Return the trajectory of parts in their order, all of the same joints in the same order.

    Each part begins at the time at which its predecessor ends; positions need not meet.
    """
    rows = max(len(part.coefficients) for part in parts)
    pieces, times = [], [np.zeros(1)]
    for part in parts:
        padded = np.zeros((rows, *part.coefficients.shape[1:]))
        padded[rows - len(part.coefficients) :] = part.coefficients
        pieces.append(padded)
        times.append(times[-1][-1] + part.breakpoints[1:])
    names, coefficients = parts[0].joint_names, np.concatenate(pieces, axis=1)
    return JointTrajectory(names, np.concatenate(times), coefficients)


def from_spline(joint_names: Sequence[str], spline: BSpline) -> JointTrajectory:
    """Return the trajectory of a B-spline, clamped, from time 0, control points (K, n)."""
    return from_splines(
        joint_names, BSpline(spline.knots, spline.control_points[:, None], spline.degree)
    )[0]


def from_splines(joint_names: Sequence[str], splines: BSpline) -> list[JointTrajectory]:
    """Return the trajectories of S B-splines with control points (K, S, n), as `from_spline`."""
    breakpoints = np.unique(splines.knots)
    powers = range(splines.degree, -1, -1)
    coefficients = np.array(
        [splines(breakpoints[:-1], power) / factorial(power) for power in powers]
    )
    return [
        JointTrajectory(joint_names, breakpoints, coefficients[:, :, k])
        for k in range(coefficients.shape[2])
    ]


_DEGREE = 3  # of `averaged`


def averaged(trajectory: JointTrajectory, intervals: int, duration: float) -> JointTrajectory:
    """Return a C2 cubic spline of a duration [s] whose control points lie on a trajectory.

    On at least 3 equal intervals. Schoenberg's operator (de Boor, "A Practical Guide to Splines",
    chapter XI): the average of a monotone position is monotone. The first three control points are
    the start and the last three the goal, so that the spline begins and ends with no velocity and
    no acceleration.
    """
    knots = np.linspace(0.0, 1.0, intervals + 1)
    knots = np.concatenate([np.zeros(_DEGREE), knots, np.ones(_DEGREE)])
    means = (knots[1:-3] + knots[2:-2] + knots[3:-1]) / _DEGREE  # Greville abscissae
    first, last = means[2], means[-3]
    fraction = np.clip((means - first) / (last - first), 0.0, 1.0)
    control_points = trajectory.position(fraction * trajectory.duration)
    return from_spline(trajectory.joint_names, BSpline(knots * duration, control_points, _DEGREE))
