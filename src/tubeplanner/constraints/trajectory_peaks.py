"""What a machine feels first of a trajectory: its largest accelerations and its tool's speed."""

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.peaks import refined_maximum
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.bernstein import peak_magnitudes
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

_SAMPLES, _LEAST_PER_PIECE = 1000, 12  # before the highest are refined
_BAND = 0.02  # of the highest: samples that near to it are refined as well
_WHOLE = 100.0  # numbers from here on are shown without decimals


@dataclass(frozen=True)
class Peak:
    """The largest magnitude of a quantity over a trajectory.

    Attributes:
        value: In `unit`.
        unit: Of the value.
        time: When [s].
        joint: Whose it is; None: the tool centre point's.
    """

    value: float
    unit: str
    time: float
    joint: str | None = None

    def __str__(self) -> str:
        owner = "" if self.joint is None else f"{self.joint}, "
        shown = f"{self.value:.3g}" if self.value < _WHOLE else f"{self.value:,.0f}"
        return f"{shown} {self.unit} ({owner}t = {self.time:.4f} s)"


@dataclass(frozen=True)
class TrajectoryPeaks:
    """The largest values over a trajectory.

    Attributes:
        peak_acceleration: The largest of any joint.
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

    Joint acceleration is the polynomials' maximum; the tool's are the highest of at least 1,000
    samples, both sides of breakpoints, refined between them.

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
    count = max(_LEAST_PER_PIECE, -(-_SAMPLES // len(trajectory.widths)))
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

    return TrajectoryPeaks(
        _peak_acceleration(robot, trajectory), tool_peak(0, "m/s"), tool_peak(1, "m/s^2")
    )


def peaks_as_dict(peaks: TrajectoryPeaks | None) -> dict[str, Any]:
    """Return the fields as JSON values, null if there is no trajectory."""
    if peaks is None:
        return dict.fromkeys(field.name for field in fields(TrajectoryPeaks))
    return asdict(peaks)


def _peak_acceleration(robot: RobotModel, trajectory: JointTrajectory) -> Peak:
    """Return the largest acceleration of any joint, for all t."""
    found = peak_magnitudes(trajectory.derivative_coefficients(2), trajectory.widths)
    joint = int(found.value.argmax())
    time = float(trajectory.breakpoints[found.piece[joint]] + found.local_time[joint])
    unit = "rad/s^2" if robot.revolute[joint] else "m/s^2"
    return Peak(float(found.value[joint]), unit, time, robot.joint_names[joint])


def _tool_rates(robot: RobotModel, samples: TrajectorySamples) -> FloatArray:
    """Return magnitudes of the tool's velocity and acceleration, shape (2, N)."""
    velocity, by_q, by_v = robot.tool_velocity(samples.position, samples.velocity)
    acceleration = np.einsum("nij,nj->ni", by_q, samples.velocity)
    acceleration += np.einsum("nij,nj->ni", by_v, samples.acceleration)
    return np.linalg.norm([velocity, acceleration], axis=2)
