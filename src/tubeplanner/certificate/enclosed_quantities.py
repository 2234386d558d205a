"""Majorants and enclosures of tool pose and joint efforts, for all t.

A trajectory in joint space is polynomial, tool pose and efforts are not. Here, every vector of the
recursive Newton-Euler algorithm is replaced by a power series whose coefficients bound the norms of
the vector's own ("majorants" in the sense of Cauchy): sums and products of vectors become sums and
products of series, and a vector fixed in a turning body obeys x' = w x x. Whatever the directions,
no Taylor coefficient of the real quantity on the interval is larger.

Time runs from 0 to 1 over each of I intervals; a series is an array (order+1, I).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.enclosure import (
    Enclosure,
    Quantity,
    enclosed,
    enclosed_rate,
    joint_bounds,
    total,
)
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.robot.model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- Polynomials that enclose the position and the orientation of the tool, for all t.


@dataclass(frozen=True, eq=False)
class EnclosedPose:
    """Position and orientation of the tool, over the same I intervals."""

    tool: Enclosure  # position of the tool centre point, c = 3 [m]
    # rotation matrix, row by row, c = 9; no column is farther off than the error
    rotation: Enclosure
    speed: FloatArray  # bound on the speed, shape (I,) [m/s]
    acceleration: FloatArray  # bound on the norm of the acceleration, shape (I,) [m/s^2]
    spin: FloatArray  # bound on the angular velocity, shape (I,) [rad/s]
    spin_rate: FloatArray  # bound on the angular acceleration, shape (I,) [rad/s^2]


def enclosed_tool(
    robot: RobotModel, tube: Tube, trajectory: JointTrajectory, tolerance: float
) -> Enclosure:
    """Return the tool centre point's position, c = 3 [m].

    Args:
        robot: The arm.
        tube: The tube in whose frame the tool counts.
        trajectory: In the robot's joint order.
        tolerance: Largest norm of the error [m], the same for all components.
    """

    def position(q: FloatArray) -> FloatArray:
        return tube.tool_pose(robot, q)[1]

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        return np.stack([tool_majorant(robot, joints).position] * 3, axis=2)

    return enclosed(trajectory, Quantity(0, position, majorant), np.full(3, tolerance))


def enclosed_pose(
    robot: RobotModel,
    tube: Tube,
    trajectory: JointTrajectory,
    tolerance: float,
    rotation_tolerance: float,
) -> EnclosedPose:
    """Return position and orientation of the tool centre point.

    Args:
        robot: The arm.
        tube: The tube in whose frame the tool counts.
        trajectory: In the robot's joint order.
        tolerance: Largest error of the position [m].
        rotation_tolerance: Largest error of a column of the rotation matrix.
    """

    def values(q: FloatArray) -> FloatArray:
        rotation, position = tube.tool_pose(robot, q)
        return np.hstack([position, rotation.reshape(-1, 9)])

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        tool = tool_majorant(robot, joints)
        return np.stack([tool.position] * 3 + [tool.axis] * 9, axis=2)

    tolerances = np.repeat([tolerance, rotation_tolerance], [3, 9])
    pose = enclosed(trajectory, Quantity(0, values, majorant), tolerances)
    tool, rotation = (
        Enclosure(pose.start, pose.width, pose.coefficients[:, :, part], pose.error[:, part])
        for part in (slice(3), slice(3, 12))
    )
    piece = np.searchsorted(trajectory.breakpoints, pose.start, "right") - 1
    local = pose.start - trajectory.breakpoints[piece]
    rates = tool_majorant(robot, joint_bounds(trajectory, piece, local, pose.width, 3))
    return EnclosedPose(
        tool,
        rotation,
        speed=rates.position[1] / pose.width,
        acceleration=2 * rates.position[2] / pose.width**2,
        spin=rates.spin[0] / pose.width,
        spin_rate=rates.spin[1] / pose.width**2,
    )


# ---- Polynomials that enclose the joint efforts and their rates, for all t.
#
# The terms of the effort law are listed once. Values and bounds between values are sums over that
# list, so that no term can be in the values and not in the bounds.


def effort_terms(robot: RobotModel) -> Mapping[str, Quantity]:
    """Return the smooth terms of the effort law by name, c = n each [N m or N].

    Their values add up to `inverse_dynamics`: the motors' efforts without Coulomb friction.
    """

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        bodies = rigid_body_majorant(robot, joints, width)
        return bodies + motor_majorant(robot, joints, width)

    return {"rigid bodies and motors": Quantity(2, robot.inverse_dynamics, majorant)}


def enclosed_efforts(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: FloatArray
) -> Enclosure:
    """Return the joint efforts, c = n [N m or N].

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: Largest errors, shape (n,) [N m or N].
    """
    return enclosed(trajectory, total(effort_terms(robot).values()), tolerance)


def enclosed_effort_rates(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: FloatArray
) -> Enclosure:
    """Return the rates of the joint efforts inside the pieces, c = n [N m/s or N/s].

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: Largest errors, shape (n,) [N m/s or N/s].
    """
    return enclosed_rate(trajectory, total(effort_terms(robot).values()), tolerance)


# ---- Bounds on the Taylor coefficients of a trajectory's tool pose and joint efforts.


@dataclass(frozen=True, eq=False)
class _BodyMotion:
    """Majorants of a body."""

    spin: FloatArray  # angular velocity
    unit: FloatArray  # vector of length one that is fixed in the body
    link: FloatArray  # vector from the origin of the parent body to the body's own
    # origin of the body in the base frame; the value itself may be any constant off
    origin: FloatArray


@dataclass(frozen=True, eq=False)
class ToolMajorant:
    """Bounds on the Taylor coefficients of the tool's trajectory, each (orders, I)."""

    position: FloatArray  # of the tool centre point [m]; the first row has no meaning
    axis: FloatArray  # of a unit vector fixed in the tool, such as each of its axes
    spin: FloatArray  # of the angular velocity [rad per interval], one order shorter


def tool_majorant(robot: RobotModel, joints: FloatArray) -> ToolMajorant:
    """Return bounds on the Taylor coefficients of the tool centre point's trajectory.

    Args:
        robot: The arm.
        joints: Bounds on the Taylor coefficients of the joint positions, shape (order+1, I, n).
    """
    body = _motions(robot, joints)[robot.link_body[robot.tool_frame]]
    return ToolMajorant(body.origin + robot.tool_reach * body.unit, body.unit, body.spin)


def point_majorant(robot: RobotModel, joints: FloatArray, body: int, reach: float) -> FloatArray:
    """Return bounds on the Taylor coefficients of a point that moves with a body.

    Args:
        robot: The arm.
        joints: Bounds on the Taylor coefficients of the joint positions, shape (order+1, I, n).
        body: Index of the body.
        reach: Distance of the point from the body's origin [m].

    Returns:
        Shape (order+1, I) [m]; the first row has no meaning.
    """
    carrier = _motions(robot, joints)[body]
    return carrier.origin + reach * carrier.unit


def motor_majorant(robot: RobotModel, joints: FloatArray, width: FloatArray) -> FloatArray:
    """Return bounds on the Taylor coefficients of the efforts for rotors and viscous friction.

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
    """Return bounds on the efforts that move the rigid bodies, as `motor_majorant`."""
    bodies = _motions(robot, joints)
    gravity = float(np.linalg.norm(robot.gravity))
    forces: dict[int, FloatArray] = {}
    moments: dict[int, FloatArray] = {}
    for i in range(robot.body_count - 1, 0, -1):
        inertia, body = robot.inertias[i], bodies[i]
        arm = inertia.com_distance * body.unit
        force = inertia.mass * derivative(body.origin + arm, 2) / width**2
        force[0] += inertia.mass * gravity
        momentum = product(inertia.moment * _turning(2 * body.spin), body.spin)
        moment = derivative(momentum) / width**2 + product(arm, force)
        for child in np.flatnonzero(robot.body_parents == i).tolist():
            force = force + forces[child]
            moment = moment + moments[child] + product(bodies[child].link, forces[child])
        forces[i], moments[i] = force, moment
    efforts = np.zeros((len(joints) - 2, joints.shape[1], robot.joint_count))
    fraction = abs(robot.body_rules[0])  # of a body's effort that its joint takes
    for i in range(1, robot.body_count):
        joint, axis = robot.body_joints[i], bodies[robot.body_parents[i]].unit
        load = moments[i] if robot.body_is_revolute[i] else forces[i]
        efforts[:, :, joint] += fraction[i] * product(axis, load)
    return efforts


def derivative(a: FloatArray, times: int = 1) -> FloatArray:
    """Return the `times`-th derivative of series (orders, I, ...), shorter by as many coefficients.

    With respect to the intervals' own time: the real rate is this over the widths [s].
    """
    for _ in range(times):
        a = (np.arange(1, len(a)) * a[1:].T).T
    return a


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the product of two series, as far as both are known."""
    order = min(len(a), len(b))
    product = np.zeros((order, a.shape[1]))
    for k in range(order):
        product[k:] += a[k] * b[: order - k]
    return product


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
        if robot.body_is_revolute[i]:
            spin = spin + product(parent.unit, derivative(value))
        else:
            link = link + product(parent.unit, value)
        bodies.append(_BodyMotion(spin, _turning(spin), link, parent.origin + link))
    return bodies


def _turning(spin: FloatArray) -> FloatArray:
    """Return the series of a unit vector that obeys x' = spin x, longer by a coefficient."""
    unit = np.zeros((len(spin) + 1, spin.shape[1]))
    unit[0] = 1.0
    for k in range(len(spin)):
        unit[k + 1] = np.einsum("ki,ki->i", spin[: k + 1], unit[k::-1]) / (k + 1)
    return unit
