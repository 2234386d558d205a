"""What a motion takes from its motors: energy, and mechanical work."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.joint_effort import JointEffort
from tubeplanner.refinement.interval_motion import SIMPSON, IntervalMotion
from tubeplanner.refinement.measure import MeasureModel

# Beside the power of a motion that is spread evenly, this share is rounded off where power begins.
_ROUNDED = 0.5
_NOTHING = 1e-9


class Energy:
    """The integral of the weighted squared efforts: what currents heat."""

    def __init__(self, weights: FloatArray) -> None:
        """Take the weights of the squared efforts, (n,), >= 0."""
        with np.errstate(divide="ignore"):
            limit = 1 / np.sqrt(weights)
        self._effort = JointEffort(limit, with_coulomb_friction=True)

    def total(self, motion: IntervalMotion) -> float:
        """Return the integral, in one second."""
        return float((self._squared(motion) ** 2).sum())

    def model(self, motion: IntervalMotion, share: float) -> MeasureModel:
        """Return a share of it near a motion; residuals are what is squared."""
        residual, scale = self._squared(motion), _scale(motion)
        control, switching = motion.effort_derivatives(self._effort)
        wider = motion.width_by_switching / (2 * motion.width[:, None])
        return MeasureModel.of(
            np.full(residual.shape, 2 * share),
            2 * share * residual,
            control * scale[..., None, None],
            switching * scale[..., None] + residual[..., None] * wider[:, None, None],
        )

    def _squared(self, motion: IntervalMotion) -> FloatArray:
        squared: FloatArray = motion.effort(self._effort) * _scale(motion)
        return squared


class Work:
    """The integral of the power that motors put in; what braking gives back is lost."""

    def __init__(self, joints: int, nominal: float) -> None:
        """Take scales.

        Args:
            joints: How many there are.
            nominal: About the work of a motion [J].
        """
        self._effort = JointEffort(np.ones(joints), with_coulomb_friction=True)
        self._rounded = _ROUNDED * nominal / joints

    def total(self, motion: IntervalMotion) -> float:
        """Return the work [J], rounded upwards where power changes its sign."""
        added, rounded = self._added(motion)
        return float((added + np.hypot(added, rounded)).sum() / 2)

    def model(self, motion: IntervalMotion, share: float) -> MeasureModel:
        """Return a share of it near a motion; residuals are what samples add or give back.

        And the sums of efforts and velocities. Power is their product, a difference of two squares:
        that of the sum curves upwards. (The convex-concave procedure: Yuille & Rangarajan, 2003.)
        """
        added, rounded = self._added(motion)
        size = np.hypot(added, rounded)
        driving = share * (1 + added / size) / 2
        scale = _scale(motion)[..., None]
        control, switching = motion.chained(self._power_by_path(motion))
        wider = motion.width_by_switching / motion.width[:, None]
        power = MeasureModel.of(
            share * rounded**2 / (2 * size**3),
            driving,
            control * scale[..., None] ** 2,
            switching * scale**2 + added[..., None] * wider[:, None, None],
        )
        control, switching = motion.chained(self._sum_by_path(motion))
        both = MeasureModel.of(
            driving / 2, 0 * driving, control * scale[..., None], switching * scale
        )
        return MeasureModel.stacked([power, both])

    def _added(self, motion: IntervalMotion) -> tuple[FloatArray, FloatArray]:
        """Return the work that samples stand for, (M, 3, n), and how much of it is rounded off."""
        power = motion.effort(self._effort) * motion.at_samples(motion.path.by_path[1])
        rounded = self._rounded / len(power) * SIMPSON[:, None]
        return power * _scale(motion) ** 2, np.broadcast_to(rounded, power.shape)

    def _power_by_path(self, motion: IntervalMotion) -> dict[int, FloatArray]:
        """Return how power changes with the path, (N, n, n) each."""
        path, speed = motion.path, 1 / motion.run_in
        velocity = path.by_path[1]
        by_path = dict(self._effort.by_path(path, speed))
        by_path = {order: by * velocity[:, :, None] for order, by in by_path.items()}
        effort = self._effort.used(path).at(speed)
        by_path[1] = by_path[1] + effort[:, :, None] * np.eye(velocity.shape[1])
        return by_path

    def _sum_by_path(self, motion: IntervalMotion) -> dict[int, FloatArray]:
        """Return how sums of efforts and velocities, in units of equal size, do: likewise."""
        path, speed = motion.path, 1 / motion.run_in
        efforts, velocities = self._effort.used(path).at(speed), path.by_path[1]
        unit = np.sqrt(_size(efforts) / _size(velocities))[:, None]
        by_path = {order: by / unit for order, by in self._effort.by_path(path, speed).items()}
        by_path[1] = by_path[1] + unit * np.eye(len(unit))
        return by_path


def _scale(motion: IntervalMotion) -> FloatArray:
    """Return the square root of the time that samples stand for, (M, 3, 1)."""
    return np.sqrt(motion.width[:, None] * SIMPSON)[:, :, None]


def _size(values: FloatArray) -> FloatArray:
    """Return the root mean squares of columns, above zero."""
    return np.sqrt((values**2).mean(axis=0)) + _NOTHING
