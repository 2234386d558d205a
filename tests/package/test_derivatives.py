"""Every analytic derivative of the package against central differences: one table."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cases import with_motors

import tubeplanner as t
from tubeplanner.optimizer.control_variables import ControlVariables
from tubeplanner.optimizer.link_constraints import DistancesAlong, LinkConstraints
from tubeplanner.optimizer.motion_measures import objective_measures
from tubeplanner.optimizer.phased_spline import PhasedSpline
from tubeplanner.optimizer.spline_constraints import SplineConstraints
from tubeplanner.optimizer.starts import knot_grid
from tubeplanner.optimizer.step_objective import _FIRST_WORTH, MeasuredObjective, StepCost
from tubeplanner.orientation import nearest_branch

STEP = 1e-6


@pytest.fixture(scope="module")
def on_a_slope():
    base = t.BasePose((0.3, -0.2, 1.1), (0.4, -1.2, 2.5))
    return t.load_robot("example:ur5", "tool0", base=base)


def finite_difference(function, x, step=STEP):
    """Return d function / d x by central differences: shape (N, ..., n) for x of shape (N, n)."""
    columns = []
    for j in range(x.shape[1]):
        shift = np.zeros_like(x)
        shift[:, j] = step
        columns.append((function(x + shift) - function(x - shift)) / (2 * step))
    return np.stack(columns, axis=-1)


def random_trajectory(robot, count=20):
    rng = np.random.default_rng(4)
    low, high = robot.limits.lower_position, robot.limits.upper_position
    q = rng.uniform(np.maximum(low, -3), np.minimum(high, 3), (count, robot.joint_count))
    return q, rng.normal(size=q.shape), rng.normal(size=q.shape)


def deviation_by_position(robot, **shape):
    regions, rng = (
        t.Tube([[0, 0, 0], [1, 0, 0], [1, 1, 0]], **shape).regions,
        np.random.default_rng(3),
    )
    p, segment = rng.uniform(-0.5, 1.5, (200, 3)), np.arange(200) % 2
    return lambda p: regions.deviation(p, segment)[0], p, regions.deviation(p, segment)[1]


def effort_by(argument):
    def case(robot):
        trajectory = list(random_trajectory(robot))

        def effort(x):
            varied = [*trajectory]
            varied[argument] = x
            return robot.inverse_dynamics(*varied)

        exact = robot.inverse_dynamics_derivatives(*trajectory)[argument]
        return effort, trajectory[argument], exact

    return case


def tool_motion_by(argument):
    def case(robot):
        trajectory = list(random_trajectory(robot))

        def motion(x):
            return robot.tool_motion(*trajectory[:argument], x, *trajectory[argument + 1 :])

        exact = robot.tool_motion_derivatives(*trajectory)[argument]
        return motion, trajectory[argument], exact

    return case


def tool_by_joints(robot):
    q, _, _ = random_trajectory(robot)
    return robot.tool_position, q, robot.tool_jacobian(q)[1][:, :3]


def turn_by_joints(robot):
    """The angular rows: d R / d q_j = [w_j] R, compared by the three columns of R."""
    q, _, _ = random_trajectory(robot)
    rotation = robot.tool_pose(q)[0]
    angular = robot.tool_jacobian(q)[1][:, 3:]
    axes_rate = np.cross(
        angular.transpose(0, 2, 1)[:, None], rotation.transpose(0, 2, 1)[:, :, None]
    )
    return lambda x: robot.tool_pose(x)[0].transpose(0, 2, 1), q, axes_rate.transpose(0, 1, 3, 2)


def points_by_joints(robot):
    """A point fixed to every body in turn."""
    q, _, _ = random_trajectory(robot)
    local = np.random.default_rng(7).normal(size=(len(q), 3))
    body = np.arange(len(q)) % robot.body_count

    def points(x):
        rotation, position = robot.body_poses(x)
        rows = np.arange(len(x))
        rotated = np.einsum("nab,nb->na", rotation[rows, body], local)
        return position[rows, body] + rotated

    return points, q, robot.point_jacobian(*robot.body_poses(q), body, points(q))


def rotation_error_by_joints(fraction):
    """The tool beside the middle of a segment, or past the end, where the reference is constant."""

    def case(robot):
        q, _, _ = random_trajectory(robot)
        rotation, tool = robot.tool_pose(q)
        along = np.array([0.7, -0.4, 0.5])
        points = np.array([[0, 0, 0], along]) + tool.mean(axis=0) - fraction * along
        tube = t.Tube(points, 9.0, orientations=TURNED, rotation_tolerance=1.0).rotation

        def error(x):
            rotations, at = robot.tool_pose(x)
            near = tube.error(rotation, tool, 0)
            return nearest_branch(tube.error(rotations, at, 0), near, np.ones(3, dtype=bool))

        jacobian = robot.tool_pose_jacobian(q)[2]
        return error, q, tube.error_jacobian(rotation, tool, jacobian, 0)[1]

    return case


RUBBING = {"armature": 0.3, "viscous_friction": 4.0}
RUBBING |= {"backwards_friction": 5.0, "forwards_friction": 3.0}
TURNED = [[0, 0, 0, 1], [0.5, 0.5, -0.5, 0.5]]


def required_distance_by_joints(robot):
    """Near the start, where the required distance of solids in contact is less."""
    q, _, _ = random_trajectory(robot)
    q = q[0] + 0.02 * (q - q[0])
    tube = t.Tube(robot.tool_position(q[[0, -1]]) + np.diag([0.0, 1.0])[:, [0, 0, 1]], 9.0)
    ball = t.Obstacle.sphere("ball", 0.1, t.placement_of([9.0, 9.0, 9.0]))
    problem = t.PlanningProblem(
        robot, tube, q[0], obstacles=[ball], clearance=30.0, self_collision=False
    )
    link = problem.collision.shapes[problem.collision.pairs[-1, 0]].owner
    reach = 1.5 * np.linalg.norm(robot.tool_position(q) - tube.points[0], axis=1).max()
    problem = replace(problem, contacts=[t.Contact(("ball", link), reach)])
    along, grid = DistancesAlong(problem, q[[0, -1]], 0.0), knot_grid(np.array([0.0, 1.0]), 20)
    samples, pair = grid.samples(np.array([0.5])), np.full(len(q), len(problem.collision.pairs) - 1)

    def required(x):
        return along.of_pairs(grid, samples, x, pair)[0]

    return required, q, along.of_pairs(grid, samples, q, pair)[1]


def trajectory_by_time(order):
    def case(robot):
        rng = np.random.default_rng(6)
        n = robot.joint_count
        trajectory = t.JointTrajectory(robot.joint_names, [0, 0.4, 1.0], rng.normal(size=(6, 2, n)))
        functions = (trajectory.position, trajectory.velocity, trajectory.acceleration)
        times = rng.uniform(0.01, 0.39, (20, 1))
        exact = functions[order + 1](times)[:, 0][:, :, None]
        return lambda t: functions[order](t)[:, 0], times, exact

    return case


def objective_by_variables(minimise, **motors):
    """Derivatives by free control points and by the switching time, with and without motors."""

    def case(robot):
        robot = with_motors(robot, **motors) if motors else robot
        grid, ends = knot_grid(np.array([0.0, 0.4, 1.0]), 7), np.array([0.0, 0.4, 1.0])
        q = random_trajectory(robot)[0]
        points = np.linspace(q[0], q[1], grid.control_point_count)
        points[3:-3] += np.random.default_rng(8).normal(size=points[3:-3].shape)
        points[:3], points[-3:] = points[0], points[-1]
        tube = t.Tube(robot.tool_position(points[[0, 5, -1]]), 9.0)
        problem = t.PlanningProblem(
            robot,
            tube,
            points[0],
            points[-1],
            self_collision=False,
            objective=t.Objective(minimise=minimise),
        )
        links, radius = LinkConstraints(problem), np.full(2, 9.0)
        constraints = SplineConstraints(problem, grid, links, radius, 0.8)
        measures = objective_measures(problem, PhasedSpline(grid, ends, points), 0.8)
        objective, variables = MeasuredObjective(measures, 0.8), ControlVariables(problem, grid)

        def at(x):
            shifted = points + variables.change(x[0, :-1].reshape(variables.lower.shape))
            return constraints.at(PhasedSpline(grid, ends + np.array([0, x[0, -1], 0]), shifted))

        here = np.zeros((1, variables.lower.size + 1))
        begun = PhasedSpline(grid, ends, points)
        regular = StepCost(variables, grid, robot.joint_units).quadratic(begun)
        exact = objective.cost(at(here), variables, regular).gradient - regular.gradient
        return lambda x: np.array([_FIRST_WORTH * objective.value(at(x))]), here, exact[None]

    return case


OF_OBJECTIVES = {
    f"{minimise}{words}": (objective_by_variables(minimise, **motors), 1e-5)
    for minimise in ("smoothness", "energy", "work", "deviation")
    for words, motors in ((" by control points and times", {}), (" with friction", RUBBING))
}
TABLE = {
    "tool position by joints": (tool_by_joints, 1e-8),
    "tool rotation by joints": (turn_by_joints, 1e-8),
    "points of bodies by joints": (points_by_joints, 1e-8),
    "rotation error by joints": (rotation_error_by_joints(0.5), 1e-7),
    "rotation error beyond the end": (rotation_error_by_joints(5.0), 1e-7),
    "required distance by joints": (required_distance_by_joints, 1e-6),
    "deviation by position": (partial(deviation_by_position, radius=[0.1, 0.3]), 1e-7),
    "deviation in boxes": (
        partial(
            deviation_by_position,
            radius=[None, 0.3],
            cross_section=[{"box": [0.3, 0.1], "up": [0, 1, 1]}, None],
        ),
        1e-7,
    ),
    "effort by position": (effort_by(0), 1e-6),
    "effort by velocity": (effort_by(1), 1e-6),
    "effort by acceleration": (effort_by(2), 1e-6),
    "tool motion by position": (tool_motion_by(0), 1e-6),
    "tool motion by velocity": (tool_motion_by(1), 1e-6),
    "tool motion by acceleration": (tool_motion_by(2), 1e-6),
    "trajectory velocity": (trajectory_by_time(0), 1e-7),
    "trajectory acceleration": (trajectory_by_time(1), 1e-7),
    **OF_OBJECTIVES,
}
# What motors cost is the dearest; friction and gravity take the same code for every arm.
ARMS = [
    *(
        (name, arm)
        for name in sorted(TABLE.keys() - OF_OBJECTIVES)
        for arm in ("panda", "on_a_slope")
    ),
    *((name, "two_link") for name in OF_OBJECTIVES),
    ("energy with friction", "on_a_slope"),
]


@pytest.mark.parametrize(("name", "arm"), ARMS)
def test_derivative_agrees_with_finite_differences(name, arm, request):
    (case, tolerance), robot = TABLE[name], request.getfixturevalue(arm)
    function, x, exact = case(robot)
    difference = finite_difference(function, x)
    assert exact.shape == difference.shape
    np.testing.assert_allclose(exact, difference, atol=tolerance * max(1, abs(exact).max()))
