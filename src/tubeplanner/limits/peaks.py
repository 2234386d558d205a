"""Measures of a motion: peaks between samples, and the costs of its motors."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.holding import GRAVITY
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import STILL_FRACTION, monotone_intervals
from tubeplanner.trajectory.polynomials import peak_magnitudes

# ---- The highest peak of a function, refined between its samples.

_MAX_PEAKS = 24
_POINTS = 9  # per peak and zoom; every zoom narrows in by a factor of 4
_ZOOMS = 6  # by 4096 in all: the error of a smooth peak falls with the square of that


def refined_maximum(
    function: Callable[[FloatArray], FloatArray],
    time: FloatArray,
    value: FloatArray,
    *,
    band: float,
) -> tuple[float, float]:
    """Return the largest value of a function and its time [s].

    Args:
        function: From times (N,) to values (N,).
        time: Increasing sample times, shape (N,) [s]; two may be equal where a derivative jumps.
        value: The function at these samples, shape (N,).
        band: Peaks of the samples this far below the highest are refined as well, as long as they
            may become the highest.

    Returns:
        At least the largest sample.
    """
    best, when = float(value.max()), float(time[value.argmax()])
    padded = np.concatenate([[-np.inf], value, [-np.inf]])
    is_peak = (value >= padded[:-2]) & (value >= padded[2:]) & (value >= best - band)
    peaks = np.flatnonzero(is_peak)
    peaks = peaks[np.argsort(-value[peaks], kind="stable")][:_MAX_PEAKS]  # highest first
    # The nearest other times, not the nearest samples: at a breakpoint two samples share a time.
    low = time[np.maximum(np.searchsorted(time, time[peaks], "left") - 1, 0)]
    high = time[np.minimum(np.searchsorted(time, time[peaks], "right"), len(time) - 1)]
    return _zoomed(lambda _, grid: function(grid), low, high, (best, when))


def refined_maximum_of_pieces(
    function: Callable[[IntArray, FloatArray], FloatArray], value: FloatArray, *, band: float
) -> float:
    """Return the largest value of a function that is smooth in pieces and may jump between them.

    Args:
        function: From pieces (N,) and fractions of them, from 0 to 1, (N,), to values (N,).
        value: The function at three or more equidistant fractions of each piece, both ends
            included: shape (pieces, fractions).
        band: As for `refined_maximum`; all such peaks are refined.

    Returns:
        At least the largest sample.
    """
    best, last = float(value.max()), value.shape[1] - 1
    if not np.isfinite(best):
        return best
    padded = np.pad(value, ((0, 0), (1, 1)), constant_values=-np.inf)
    is_peak = (value >= padded[:, :-2]) & (value >= padded[:, 2:]) & (value >= best - band)
    piece, sample = np.nonzero(is_peak)
    low, high = np.maximum(sample - 1, 0) / last, np.minimum(sample + 1, last) / last

    def of_peaks(peak: IntArray, fraction: FloatArray) -> FloatArray:
        return function(piece[peak], fraction)

    return _zoomed(of_peaks, low, high, (best, np.nan), ends_are_smooth=True)[0]


def _zoomed(
    function: Callable[[IntArray, FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    start: tuple[float, float],
    *,
    ends_are_smooth: bool = False,
) -> tuple[float, float]:
    """Return the largest value of a function around K peaks, and its argument.

    Args:
        function: From indices of peaks (N,) and arguments (N,) to values (N,).
        low: Begin of the interval of each peak, shape (K,).
        high: End of the interval of each peak, shape (K,).
        start: The largest value so far, and its argument.
        ends_are_smooth: Whether a peak at an end of an interval rises no more than a concave
            function does, from its neighbours.
    """
    (best, when), peak = start, np.arange(len(low))
    for _ in range(_ZOOMS):
        grid = low[:, None] + np.linspace(0, 1, _POINTS) * (high - low)[:, None]
        values = function(np.repeat(peak, _POINTS), grid.ravel()).reshape(grid.shape)
        rows, top = np.arange(len(grid)), values.argmax(axis=1)
        before, after = np.maximum(top - 1, 0), np.minimum(top + 1, _POINTS - 1)
        value = values[rows, top]
        highest = int(value.argmax())
        if value[highest] > best:
            best, when = float(value[highest]), float(grid[highest, top[highest]])
        # A concave peak rises above its sample by no more than it falls to the lower neighbour.
        rise = value - np.minimum(values[rows, before], values[rows, after])
        at_end = (before == top) | (after == top)  # one neighbour is missing
        if ends_are_smooth:  # from an end to the next sample: below the line through the next two
            ends = values[at_end]
            falling = np.where((ends[:, 0] >= ends[:, -1])[:, None], ends, ends[:, ::-1])
            rise[at_end] = np.maximum(2 * falling[:, 1] - falling[:, 2] - falling[:, 0], 0.0)
        else:
            rise[at_end] = np.inf
        rows = rows[value + rise >= best]
        if len(rows) == 0:
            break
        low, high = grid[rows, before[rows]], grid[rows, after[rows]]
        peak = peak[rows]
    return best, when


# ---- The largest accelerations and tool speed of a trajectory.

_SAMPLES, _MIN_PER_PIECE = 1000, 12  # before the highest are refined
_BAND = 0.02  # of the highest: peaks of samples this far below it are refined as well
_WHOLE = 100.0  # numbers from here on are shown without decimals


@dataclass(frozen=True)
class Peak:
    """The largest magnitude of a quantity over a trajectory.

    Attributes:
        value: In `unit`.
        unit: Of the value.
        time: Of the peak [s].
        joint: Its joint; None: the tool centre point's.
    """

    value: float
    unit: str
    time: float
    joint: str | None = None

    def __str__(self) -> str:
        """Return value, unit, joint and time; of the tool's acceleration also gravities."""
        of_tool = f"{self.value / GRAVITY:.2g} g" if self.unit == "m/s^2" else None
        beside = of_tool if self.joint is None else self.joint
        figure = f"{self.value:.3g}" if self.value < _WHOLE else f"{self.value:,.0f}"
        owner = "" if beside is None else f"{beside}, "
        return f"{figure} {self.unit} ({owner}t = {self.time:.4f} s)"


@dataclass(frozen=True)
class TrajectoryPeaks:
    """The largest values over a trajectory.

    Attributes:
        peak_acceleration: The largest acceleration of any joint.
        tool_speed: Of the tool centre point.
        tool_acceleration: Likewise.
    """

    peak_acceleration: Peak
    tool_speed: Peak
    tool_acceleration: Peak

    def __str__(self) -> str:
        return (
            f"joint acceleration {self.peak_acceleration}, tool speed {self.tool_speed}, "
            f"tool acceleration {self.tool_acceleration}"
        )


def trajectory_peaks(robot: RobotModel, trajectory: JointTrajectory) -> TrajectoryPeaks:
    """Return the peaks of a trajectory.

    Joint acceleration is the polynomials' maximum, for all t; the tool's peaks are the highest of
    at least 1,000 samples, both sides of breakpoints, refined between them.

    Args:
        robot: The arm.
        trajectory: Of its joints, in any order.

    Raises:
        RobotError: The robot is none.
        TrajectoryError: The trajectory is none, or moves other joints.
    """
    RobotModel.require(robot)
    JointTrajectory.require(trajectory)
    trajectory = trajectory.reordered(robot.joint_names)
    count = max(_MIN_PER_PIECE, -(-_SAMPLES // len(trajectory.widths)))
    samples = trajectory.per_piece(count)
    rates = _tool_rates(robot, samples)

    def tool_peak(row: int, unit: str) -> Peak:
        value, when = refined_maximum(
            lambda time: _tool_rates(robot, trajectory.at(time))[row],
            samples.time,
            rates[row],
            band=_BAND * float(rates[row].max()),
        )
        return Peak(value, unit, when)

    peaks = peak_magnitudes(trajectory.derivative_coefficients(2), trajectory.widths)
    joint = int(peaks.value.argmax())
    time = float(trajectory.breakpoints[peaks.piece[joint]] + peaks.local_time[joint])
    unit = "rad/s^2" if robot.revolute[joint] else "m/s^2"
    acceleration = Peak(float(peaks.value[joint]), unit, time, robot.joint_names[joint])
    return TrajectoryPeaks(acceleration, tool_peak(0, "m/s"), tool_peak(1, "m/s^2"))


def _tool_rates(robot: RobotModel, samples: TrajectorySamples) -> FloatArray:
    """Return magnitudes of the tool's velocity and acceleration, shape (2, N)."""
    velocity, by_q, by_v = robot.tool_velocity(samples.position, samples.velocity)
    acceleration = np.einsum("nij,nj->ni", by_q, samples.velocity)
    acceleration += np.einsum("nij,nj->ni", by_v, samples.acceleration)
    return np.linalg.norm([velocity, acceleration], axis=2)


def peaks_as_dict(peaks: TrajectoryPeaks | None) -> dict[str, Any]:
    """Return the peaks as JSON values, null if there is no trajectory."""
    if peaks is None:
        return dict.fromkeys(field.name for field in fields(TrajectoryPeaks))
    return asdict(peaks)


# ---- Costs of motors: efforts, heat, work, effort variation.


def motor_effort(
    robot: RobotModel, trajectory: JointTrajectory, samples: TrajectorySamples
) -> FloatArray:
    """Return the efforts of the motors, friction included, shape (N, n) [N m or N].

    Args:
        robot: The arm.
        trajectory: Of its joints, in their order.
        samples: Of the trajectory.
    """
    smooth = robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    return smooth + coulomb_effort(robot, trajectory, samples)


def coulomb_effort(
    robot: RobotModel, trajectory: JointTrajectory, samples: TrajectorySamples
) -> FloatArray:
    """Return the efforts of the motors against Coulomb friction, shape (N, n) [N m or N].

    Arguments as of `motor_effort`. Where a joint reverses, friction is of the direction that it
    takes; at the goal, of its approach.
    """
    velocity = samples.velocity
    if not robot.motors.has_coulomb_friction:
        return np.zeros_like(velocity)
    starts, widths = trajectory.breakpoints, trajectory.widths
    piece = np.searchsorted(starts[1:-1], samples.time, side="right")
    fraction = (samples.time - starts[piece]) / widths[piece]
    beside = monotone_intervals(trajectory).at(piece, fraction)
    moves = abs(velocity) > STILL_FRACTION * abs(velocity).max()
    return robot.motors.coulomb_effort(np.where(moves, velocity, beside))


_SAMPLES_PER_PIECE = 41


class EffortCosts:
    """Heat and mechanical work of one motion in any duration, from 41 samples per piece."""

    def __init__(self, robot: RobotModel, trajectory: JointTrajectory) -> None:
        """Take the motion of an arm's joints, in their order."""
        self._robot, self._trajectory = robot, trajectory
        self._samples = trajectory.per_piece(_SAMPLES_PER_PIECE)

    def energy(self, weights: FloatArray, duration: float | None = None) -> float:
        """Return the integral of the weighted squared efforts, summed over the joints.

        Args:
            weights: Of the squared efforts, shape (n,).
            duration: Of the motion [s]; None: its own.

        Returns:
            In the weights' unit, times (N m)^2 s or N^2 s.
        """
        slower = self._slower(duration)
        return self._integral(self._effort(slower) ** 2 @ weights) * slower

    def work(self, duration: float | None = None) -> float:
        """Return the integral of the joints' positive power, summed over the joints [J].

        Braking recovers no energy.

        Args:
            duration: Of the motion [s]; None: its own.
        """
        power = self._effort(self._slower(duration)) * self._samples.velocity
        return self._integral(np.maximum(power, 0.0).sum(axis=1))

    def _slower(self, duration: float | None) -> float:
        return 1.0 if duration is None else duration / self._trajectory.duration

    def _effort(self, slower: float) -> FloatArray:
        static, viscous, inertial = self._efforts
        return static + viscous / slower + inertial / slower**2

    @cached_property
    def _efforts(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Efforts against gravity and Coulomb friction, viscous friction, and all inertia."""
        at, robot = self._samples, self._robot
        gravity = robot.gravity_effort(at.position)
        viscous = robot.motors.viscous_friction * at.velocity
        smooth = robot.inverse_dynamics(at.position, at.velocity, at.acceleration)
        static = gravity + coulomb_effort(robot, self._trajectory, at)
        return static, viscous, smooth - viscous - gravity

    def _integral(self, values: FloatArray) -> float:
        return float(np.trapezoid(values, self._samples.time))


_VARIATION_SAMPLES = 20


def effort_variation(
    robot: RobotModel, trajectory: JointTrajectory, beside: JointTrajectory | None = None
) -> FloatArray:
    """Return the total variation of each joint's effort, the sum of its ups and downs, shape (n,).

    From 20 samples per polynomial piece. Coulomb friction is left out: no motion spares the joints
    its jumps where they reverse. The efforts of start and end count, but not the hold before and
    after.

    Args:
        robot: The arm.
        trajectory: Of its joints, in their order.
        beside: The motion that it is compared with; None: itself.

    Returns:
        In effort limits; of joints without an effort limit, in their largest efforts of the motion
        compared with.
    """
    effort = _efforts(robot, trajectory)
    most = abs(effort if beside is None else _efforts(robot, beside)).max(axis=0)
    limit = robot.limits.effort
    nominal = np.where(np.isfinite(limit), limit, np.maximum(most, np.finfo(float).tiny))
    variation: FloatArray = abs(np.diff(effort, axis=0)).sum(axis=0) / nominal
    return variation


def _efforts(robot: RobotModel, trajectory: JointTrajectory) -> FloatArray:
    samples = trajectory.per_piece(_VARIATION_SAMPLES)
    return robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
