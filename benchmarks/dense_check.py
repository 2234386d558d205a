"""A trajectory judged at many samples by Pinocchio and coal, without the certificate's code."""

import coal
import numpy as np
import pinocchio as pin

from tubeplanner import JointTrajectory, PlanningProblem
from tubeplanner.collision.convex_shape import ConvexShape

SAMPLES, POSES = 4000, 300
ALLOWED = {"position": 1e-6, "velocity": 1e-6, "effort": 1e-6, "tube": 1e-6, "distance": 1e-5}


def broken(problem: PlanningProblem, trajectory: JointTrajectory) -> dict[str, float]:
    """Return by how much conditions are broken, by name; those that hold are left out.

    Positions [rad or m], velocities and efforts relative to their limits, the tool's place beyond
    all capsules [m], and what is missing of the clearance to obstacles and between links [m].
    """
    times = np.linspace(0, trajectory.duration, SAMPLES)
    q, v, a = (
        getattr(trajectory, name)(times) for name in ("position", "velocity", "acceleration")
    )
    limits, tube = problem.robot.limits, problem.tube
    effort, tool = _effort_and_tool(problem, q, v, a)
    with np.errstate(divide="ignore"):
        excess = {
            "position": max((limits.lower_position - q).max(), (q - limits.upper_position).max()),
            "velocity": (abs(v) / limits.velocity).max() - 1,
            "effort": (abs(effort) / limits.effort).max() - 1,
            "tube": _beyond(tool, tube.points, tube.radius - tube.tool_radius),
            "distance": _missing_distance(problem, q[:: SAMPLES // POSES]),
        }
    return {name: float(value) for name, value in excess.items() if value > ALLOWED[name]}


def _effort_and_tool(
    problem: PlanningProblem, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    robot, model = problem.robot, problem.robot._model
    data, order = model.createData(), robot._joints.planned
    effort, tool = np.empty_like(q), np.empty((len(q), 3))
    for sample, state in enumerate(zip(q, v, a, strict=True)):
        in_model_order = (values[order] for values in state)
        effort[sample, order] = pin.rnea(model, data, *in_model_order)
        pin.framesForwardKinematics(model, data, state[0][order])
        tool[sample] = data.oMf[robot._tool_id].translation
    return effort, tool


def _beyond(tool: np.ndarray, points: np.ndarray, radius: np.ndarray) -> float:
    """Return how far the worst point is outside all capsules [m]."""
    margins = []
    for begin, end, size in zip(points[:-1], points[1:], radius, strict=True):
        along = end - begin
        share = np.clip((tool - begin) @ along / (along @ along), 0, 1)
        margins.append(size - np.linalg.norm(tool - begin - np.outer(share, along), axis=1))
    return float(-np.max(margins, axis=0).min())


def _missing_distance(problem: PlanningProblem, q: np.ndarray) -> float:
    checker, robot = problem.collision, problem.robot
    solids = [_hull(shape.shape) for shape in checker.shapes]
    model = robot._model
    data, request = model.createData(), coal.DistanceRequest()
    pairs = [(*pair, problem.clearance) for pair in checker.obstacle_pairs.tolist()]
    pairs += [(*pair, 0.0) for pair in checker.link_pairs.tolist()]
    missing = -np.inf
    for configuration in q:
        pin.forwardKinematics(model, data, configuration[robot._joints.planned])
        places = [
            coal.Transform3s(data.oMi[s.body].rotation, data.oMi[s.body].translation)
            for s in checker.shapes
        ]
        for i, j, wanted in pairs:
            found = coal.distance(
                solids[i], places[i], solids[j], places[j], request, coal.DistanceResult()
            )
            missing = max(missing, wanted - found)
    return missing


def _hull(shape: ConvexShape) -> coal.ConvexBase:
    assert shape.radius == 0, "rounded shapes are not carried over"
    points = coal.StdVec_Vec3s()
    points.extend(list(shape.vertices))
    return coal.Convex.convexHull(points, False, "")
