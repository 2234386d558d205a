"""The speeds of points that move with the arm's links."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.outcome import Place
from tubeplanner.robot.point_speed import PointSpeed
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.verification.enclosure import Quantity, enclosed
from tubeplanner.verification.judged_condition import (
    RELATIVE,
    JudgedCondition,
    bracketed,
    not_required,
)
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.majorants import derivative, point_majorant
from tubeplanner.verification.tube_visits import Visit, least_concave_margin

# How closely velocities are enclosed, as a share of their limits: tighter than the certificate's
# tolerance, so that the planner may use most of it.
_ENCLOSURE = 1e-8


def judge_point_speed(motion: JudgedMotion) -> JudgedCondition:
    """Judge the speeds of points, by polynomials that enclose their velocities."""
    points = motion.robot.limits.point_speed
    if not points:
        return not_required(RELATIVE, "no point's speed is limited")
    judged = [_judged(motion, k, point) for k, point in enumerate(points)]
    return min(judged, key=lambda condition: condition.margin or 0.0)


def _judged(motion: JudgedMotion, k: int, point: PointSpeed) -> JudgedCondition:
    """Judge the speed of one point, from the begin to the end: no segment has a say in it."""
    limit, whole = point.speed, [Visit(0, 0.0, motion.trajectory.duration)]
    tolerance = np.full(3, _ENCLOSURE * limit)
    velocity = enclosed(motion.trajectory, _point_velocity(motion.robot, point), tolerance)

    def margin(vector: FloatArray, _: IntArray) -> FloatArray:
        return 1 - np.linalg.norm(vector, axis=2) / limit

    least = least_concave_margin(velocity, whole, margin, np.array([1 / limit]))
    place = Place(time=least.time, links=(point.link,), point_speed=k)
    return bracketed(least.lower_bound, least.attained, RELATIVE, place)


def _point_velocity(robot: RobotModel, point: PointSpeed) -> Quantity:
    """Return the velocity of a point that moves with a link, c = 3 [m/s]."""
    body = robot.link_body[point.link]
    in_body = robot.link_placement[point.link] @ np.append(point.position, 1.0)

    def values(q: FloatArray, v: FloatArray) -> FloatArray:
        rotation, position = robot.body_poses(q)
        place = rotation[:, body] @ in_body[:3] + position[:, body]
        carriers = np.full(len(q), body)
        moved = robot.point_jacobian(rotation, position, carriers, place)
        return np.einsum("nij,nj->ni", moved, v)

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        reach = float(np.linalg.norm(in_body[:3]))
        rate = derivative(point_majorant(robot, joints, body, reach)) / width
        return np.stack([rate] * 3, axis=2)

    return Quantity(1, values, majorant)
