"""An arm's path at samples, and what limits need to know of it, computed once."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.coulomb_friction import CoulombFriction, directed_friction
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.effort_rate import effort_rate, gravity_effort_rate
from tubeplanner.trajectory.directed_stretches import STILL_SHARE


@dataclass(frozen=True, eq=False)
class PathSamples:
    """A path q(x) at N samples.

    Run in x per second, its derivatives by x are velocity, acceleration and jerk.

    Attributes:
        problem: The planning problem, its segments joined.
        by_path: Positions and their derivatives by x, up to the second or third: (orders, N, n).
        segments: Returns the tube segment of each sample, shape (N,); None: they are not known.
        friction: Returns the Coulomb friction at the samples; None: by the signs of velocities.
    """

    problem: PlanningProblem
    by_path: FloatArray
    segments: Callable[[], IntArray] | None = None
    friction: Callable[[], CoulombFriction] | None = None
    _effort_derivatives: dict[float, tuple[FloatArray, FloatArray, FloatArray]] = field(
        default_factory=dict, repr=False
    )

    def __len__(self) -> int:
        return self.by_path.shape[1]

    @property
    def position(self) -> FloatArray:
        """Shape (N, n) [rad or m]."""
        return self.by_path[0]

    def rate(self, order: int, speed: float) -> FloatArray:
        """Return velocity (1), acceleration (2) or jerk (3) at a speed, shape (N, n)."""
        rate: FloatArray = self.by_path[order] * speed**order
        return rate

    @cached_property
    def segment(self) -> IntArray:
        """The tube segment of each sample, shape (N,)."""
        if self.segments is None:
            raise RuntimeError("samples without segments: what depends on these is to be left out")
        return self.segments()

    @cached_property
    def gravity(self) -> FloatArray:
        """Efforts that hold the arm still, shape (N, n) [N m or N]."""
        return self.problem.robot.gravity_effort(self.position)

    @cached_property
    def effort(self) -> FloatArray:
        """Efforts at a speed of 1, Coulomb friction left out, shape (N, n) [N m or N]."""
        return self.problem.robot.inverse_dynamics(*self.by_path[:3])

    @cached_property
    def viscous_effort(self) -> FloatArray:
        """What viscous friction takes of them, shape (N, n) [N m or N]."""
        return self.problem.robot.motors.viscous_friction * self.by_path[1]

    @cached_property
    def coulomb_friction(self) -> CoulombFriction:
        """Coulomb friction, at any speed."""
        if self.friction is not None:
            return self.friction()
        return directed_friction(self.problem.robot.motors, self.direction)

    @cached_property
    def direction(self) -> FloatArray:
        """By its sign the direction in which joints move, 0 where they stand still, shape (N, n).

        What rounding makes of a velocity of zero has none.
        """
        rate = self.by_path[1]
        moves = abs(rate) > STILL_SHARE * abs(rate).max(initial=0.0)
        return np.where(moves, rate, 0.0)

    @cached_property
    def effort_rate(self) -> FloatArray:
        """How fast the efforts change at a speed of 1, shape (N, n) [N m/s or N/s]."""
        return effort_rate(self.problem.robot, *self.by_path[:4])

    @cached_property
    def gravity_rate(self) -> FloatArray:
        """How fast efforts against gravity do, likewise."""
        return gravity_effort_rate(self.problem.robot, *self.by_path[:2])

    def effort_derivatives(self, speed: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the efforts' derivatives by position, velocity and acceleration at a speed.

        As `RobotModel.inverse_dynamics_derivatives`, (N, n, n) each; kept for one speed.
        """
        if speed not in self._effort_derivatives:
            state = (self.position, self.rate(1, speed), self.rate(2, speed))
            self._effort_derivatives.clear()
            self._effort_derivatives[speed] = self.problem.robot.inverse_dynamics_derivatives(
                *state
            )
        return self._effort_derivatives[speed]

    @cached_property
    def tool_pose(self) -> tuple[FloatArray, FloatArray]:
        """Rotation (N, 3, 3) and position (N, 3) [m] of the tool centre point."""
        return self.problem.robot.tool_pose(self.position)

    @cached_property
    def tool_rate(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Velocity of the tool (N, 3) at a speed of 1, and its derivatives by q and q', (N, 3, n).

        As `RobotModel.tool_velocity`.
        """
        return self.problem.robot.tool_velocity(*self.by_path[:2])

    @cached_property
    def point_rates(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The same of the P points whose speed is limited: (P, N, 3) and twice (P, N, 3, n)."""
        return self.problem.robot.point_velocities(*self.by_path[:2])

    @cached_property
    def tool_jacobian(self) -> FloatArray:
        """Jacobian of the tool centre point, as `RobotModel.tool_jacobian`, shape (N, 6, n)."""
        return self.problem.robot.tool_jacobian(self.position)[1]
