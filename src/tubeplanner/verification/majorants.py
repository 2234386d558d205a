"""Bounds on the Taylor coefficients of a trajectory's tool pose and joint efforts.

A trajectory in joint space is polynomial, what follows from it is not. Here, every vector of the
recursive Newton-Euler algorithm is replaced by a power series whose coefficients bound the norms of
its own ("majorants" in the sense of Cauchy): sums and products of vectors become sums and products
of series, and a vector fixed in a turning body obeys x' = w x x. Whatever the directions, no Taylor
coefficient of the real quantity on the interval is larger.

Time runs from 0 to 1 over each of I intervals; a series is an array (order+1, I).
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel


@dataclass(frozen=True, eq=False)
class _BodyMotion:
    """Majorants of one body.

    Attributes:
        spin: Angular velocity.
        unit: A vector of length one that is fixed in the body.
        link: From the origin of the body that carries it to its own.
        origin: Its origin in the base frame; the value itself may be any constant off.
    """

    spin: FloatArray
    unit: FloatArray
    link: FloatArray
    origin: FloatArray


@dataclass(frozen=True, eq=False)
class ToolMajorant:
    """Bounds on the Taylor coefficients of the tool's trajectory, each (orders, I).

    Attributes:
        position: Of the tool centre point [m]; the first row has no meaning.
        axis: Of a unit vector fixed in the tool, such as each of its axes.
        spin: Of its angular velocity [rad per interval], one order shorter.
    """

    position: FloatArray
    axis: FloatArray
    spin: FloatArray


def tool_majorant(robot: RobotModel, joints: FloatArray) -> ToolMajorant:
    """Return bounds on the Taylor coefficients of the tool centre point's trajectory.

    Args:
        robot: The arm.
        joints: Bounds on the Taylor coefficients of the joint positions, shape (order+1, I, n).
    """
    body = _motions(robot, joints)[robot.link_body[robot.tool_frame]]
    return ToolMajorant(body.origin + robot.tool_reach * body.unit, body.unit, body.spin)


def point_majorant(robot: RobotModel, joints: FloatArray, body: int, reach: float) -> FloatArray:
    """Return bounds on the Taylor coefficients of the course of a point that moves with a body.

    Args:
        robot: The arm.
        joints: Bounds on the Taylor coefficients of the joint positions, shape (order+1, I, n).
        body: Which one.
        reach: Distance of the point from the body's origin [m].

    Returns:
        Shape (order+1, I) [m]; the first row has no meaning.
    """
    carrier = _motions(robot, joints)[body]
    return carrier.origin + reach * carrier.unit


def motor_majorant(robot: RobotModel, joints: FloatArray, width: FloatArray) -> FloatArray:
    """Return bounds on the Taylor coefficients of what rotors and viscous friction take.

    Args:
        robot: The arm.
        joints: Bounds on the Taylor coefficients of the joint positions, shape (order+1, I, n).
        width: Real widths of the intervals, shape (I,) [s].

    Returns:
        Shape (order-1, I, n) [N m or N].
    """
    motors, width = robot.motors, width[:, None]
    rotors = motors.armature * derivative(joints, 2) / width**2
    return rotors + motors.viscous_friction * derivative(joints)[: len(rotors)] / width


def rigid_body_majorant(robot: RobotModel, joints: FloatArray, width: FloatArray) -> FloatArray:
    """Return bounds on the Taylor coefficients of the joint efforts that move the rigid bodies.

    Args:
        robot: The arm.
        joints: Bounds on the Taylor coefficients of the joint positions, shape (order+1, I, n).
        width: Real widths of the intervals, shape (I,) [s].

    Returns:
        Shape (order-1, I, n) [N m or N].
    """
    bodies = _motions(robot, joints)
    gravity = float(np.linalg.norm(robot.gravity))
    forces: dict[int, FloatArray] = {}
    moments: dict[int, FloatArray] = {}
    for i in range(robot.body_count - 1, 0, -1):
        inertia, body = robot.inertias[i], bodies[i]
        arm = inertia.com_distance * body.unit
        force = inertia.mass * derivative(body.origin + arm, 2) / width**2
        force[0] += inertia.mass * gravity
        momentum = _product(inertia.moment * _turning(2 * body.spin), body.spin)
        moment = derivative(momentum) / width**2 + _product(arm, force)
        for child in np.flatnonzero(robot.body_parents == i).tolist():
            force = force + forces[child]
            moment = moment + moments[child] + _product(bodies[child].link, forces[child])
        forces[i], moments[i] = force, moment
    efforts = np.zeros((len(joints) - 2, joints.shape[1], robot.joint_count))
    share = abs(robot.body_rules[0])  # of a body's effort that its joint feels
    for i in range(1, robot.body_count):
        joint, axis = robot.body_joints[i], bodies[robot.body_parents[i]].unit
        load = moments[i] if robot.body_turns[i] else forces[i]
        efforts[:, :, joint] += share[i] * _product(axis, load)
    return efforts


def derivative(a: FloatArray, times: int = 1) -> FloatArray:
    """Return the derivative of series (orders, I, ...), one coefficient shorter each time.

    With respect to the intervals' own time: real rates are this over the widths [s].
    """
    for _ in range(times):
        a = (np.arange(1, len(a)) * a[1:].T).T
    return a


def _motions(robot: RobotModel, joints: FloatArray) -> list[_BodyMotion]:
    """Return the majorants of all bodies, the base first."""
    still = np.zeros(joints.shape[:2])
    base = _BodyMotion(still[1:], _turning(still[1:]), still, still)
    bodies = [base]
    multiplier, offset = robot.body_rules
    for i in range(1, robot.body_count):
        parent, joint = bodies[robot.body_parents[i]], robot.body_joints[i]
        link, spin = robot.body_offsets[i] * parent.unit, parent.spin
        value = abs(multiplier[i]) * joints[:, :, joint]
        value[0] += abs(offset[i])
        if robot.body_turns[i]:
            spin = spin + _product(parent.unit, derivative(value))
        else:
            link = link + _product(parent.unit, value)
        bodies.append(_BodyMotion(spin, _turning(spin), link, parent.origin + link))
    return bodies


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the product of two series, as far as both are known."""
    order = min(len(a), len(b))
    product = np.zeros((order, a.shape[1]))
    for k in range(order):
        product[k:] += a[k] * b[: order - k]
    return product


def _turning(spin: FloatArray) -> FloatArray:
    """Return the series of a unit vector that obeys x' = spin x, one coefficient longer."""
    unit = np.zeros((len(spin) + 1, spin.shape[1]))
    unit[0] = 1.0
    for k in range(len(spin)):
        unit[k + 1] = np.einsum("ki,ki->i", spin[: k + 1], unit[k::-1]) / (k + 1)
    return unit
