"""Limits on the speed of points that move with the arm's links."""

from collections.abc import Mapping, Sequence

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_of_points import speed_by_path
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.robot.point_speed import PointSpeed


class PointSpeedLimit:
    """A `SpeedLimit` on the speeds of P points, as shares of their limits.

    Attributes:
        limit: Of each point, shape (P,) [m/s].
    """

    kind = "point_speed"
    order = 1
    signs = (1.0,)

    def __init__(self, points: Sequence[PointSpeed]) -> None:
        """Take the points of a robot, in its order."""
        self.limit = np.array([point.speed for point in points])
        self.keys = tuple(
            LimitKey(self.kind, link=point.link, point=k) for k, point in enumerate(points)
        )

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the points' speeds as shares of their limits."""
        speed = np.linalg.norm(at.point_rates[0], axis=2)
        return SpeedPolynomial({1: speed.T / self.limit})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path; where a point rests, not at all."""
        scale = np.repeat(speed / self.limit[:, None], len(at), axis=1)
        rates = zip(*at.point_rates, strict=True)
        by_point = [speed_by_path(*each) for each in zip(rates, scale, strict=True)]
        return {order: np.stack(by, axis=1) for order, by in enumerate(zip(*by_point, strict=True))}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per point."""
        return np.arange(len(self.limit))[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return that there is none: a path can be run as slowly as one likes."""
        return Infeasible(PlanStatus.NO_TRAJECTORY, f"{self.kind} allows no motion", Place())
