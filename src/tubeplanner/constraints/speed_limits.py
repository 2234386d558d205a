"""The limits on a trajectory's speed that a problem has: all that phases and studies know of."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.effort_limit import EffortLimit
from tubeplanner.constraints.effort_rate import EffortRate
from tubeplanner.constraints.joint_effort import JointEffort
from tubeplanner.constraints.joint_rate import RATES, JointRate
from tubeplanner.constraints.motor_curve import MotorCurve
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.point_speed import PointSpeedLimit
from tubeplanner.constraints.speed_limit import SpeedLimit
from tubeplanner.constraints.tool_speed import ToolSpeed
from tubeplanner.constraints.velocity_by_position import VelocityByPositionLimit
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel


def speed_limits(problem: PlanningProblem) -> tuple[SpeedLimit, ...]:
    """Return the limits of a problem that limit anything."""
    limits = problem.robot.limits
    rates = [JointRate(kind, getattr(limits, kind)) for kind in RATES]
    found: tuple[SpeedLimit, ...] = (
        _effort_limit(problem.robot),
        MotorCurve(problem.robot.motors),
        EffortRate(limits.effort_rate),
        *rates,
        VelocityByPositionLimit(limits),
        ToolSpeed(problem),
        PointSpeedLimit(limits.point_speed),
    )
    return tuple(limit for limit in found if limit.keys)


def _effort_limit(robot: RobotModel) -> SpeedLimit:
    """Return the simpler kind of effort limit where it serves."""
    limits, motors = robot.limits, robot.motors
    is_unsure = motors.has_friction and motors.friction_uncertainty > 0
    if motors.has_coulomb_friction or limits.effort_ranges or is_unsure:
        return EffortLimit(limits)
    return JointEffort(limits.effort)


def largest_use(at: PathSamples, limits: tuple[SpeedLimit, ...]) -> FloatArray:
    """Return the largest share of some limits that each sample uses at a speed of 1, shape (N,)."""
    used = np.zeros(len(at))
    for limit in limits:
        share = limit.used(at).at(1.0)
        used = np.maximum(used, np.max([sign * share for sign in limit.signs], axis=(0, 2)))
    return used


def rates_and_others(
    limits: tuple[SpeedLimit, ...],
) -> tuple[list[JointRate], tuple[SpeedLimit, ...]]:
    """Return limits of the joints' rates, polynomials over time, and all others."""
    rates = [limit for limit in limits if isinstance(limit, JointRate)]
    return rates, tuple(limit for limit in limits if not isinstance(limit, JointRate))


def largest_speeds(at: PathSamples, limits: tuple[SpeedLimit, ...]) -> FloatArray:
    """Return up to which speed each sample keeps some limits, shape (N,); inf where none limits.

    Limits that depend on a derivative that the samples do not know are left out.
    """
    found = np.full(len(at), np.inf)
    for limit in limits:
        if limit.order >= len(at.by_path):
            continue
        found = np.minimum(found, limit.used(at).largest_speed(limit.signs).min(axis=1))
    return found
