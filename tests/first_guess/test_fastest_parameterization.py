"""What limits ask along a path, and how fast it is run then, against integrated phase planes."""

from dataclasses import replace

import numpy as np
import pytest
from cases import ANGLE, INERTIA, anywhere, one_joint, with_motors
from scipy.interpolate import CubicSpline
from scipy.optimize import linprog

from tubeplanner import JointTrajectory
from tubeplanner.first_guess.fastest_parameterization import (
    PathRows,
    _corners,
    _fastest_rates,
    fastest_parameterization,
    path_rows,
    with_reversals,
)
from tubeplanner.limits.speed_limits import speed_limits
from tubeplanner.outcome import Infeasible
from tubeplanner.robot.joint_limits import EffortRange
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.studies.comparison import smoothness_class
from tubeplanner.task.holding import Holding, Tray

STRAIGHT = JointTrajectory(["turn"], [0, ANGLE], [[[1.0]], [[0.0]]])
# There and back to where it came from: it reverses at 0.75, between the points where all is judged.
BACK = JointTrajectory(["turn"], [0, 1.0], [[[-1.0]], [[1.5]], [[0.0]]])
FRICTION = {"viscous_friction": 1.0, "forwards_friction": 0.8, "backwards_friction": 0.3}
LINE = {"saturation_effort": 6.0, "no_load_velocity": 3.0}


def effort_rows(problem, path, grid):
    limits = tuple(limit for limit in speed_limits(problem) if limit.kind == "effort")
    return path_rows(problem, path, np.array(grid), limits)


def least_time(forwards, backwards, length=ANGLE, steps=2000):
    """Return the time from rest to rest of a joint with accelerations by velocity and place.

    The phase plane, integrated from both ends by Heun's method: x = v^2, dx/ds = 2 a(v, s). Places
    are counted from the end that the integration begins at.
    """
    step = length / steps

    def squares(acceleration):
        x = np.zeros(steps + 1)
        for k in range(steps):
            slope = 2 * acceleration(np.sqrt(x[k]), k * step)
            ahead = np.sqrt(max(x[k] + step * slope, 0))
            x[k + 1] = x[k] + step / 2 * (slope + 2 * acceleration(ahead, (k + 1) * step))
        return x

    speed = np.sqrt(np.minimum(squares(forwards), squares(backwards)[::-1]))
    return (2 * step / (speed[1:] + speed[:-1])).sum()


def table(position, backwards, forwards):
    sides = (np.array(each, dtype=float) for each in (position, backwards, forwards))
    return {"effort_ranges": [EffortRange(0, *sides)]}


BOUNDED = {"limits": {"velocity": 1.5, "effort": np.inf, "acceleration": 3.0}}
# Motors, and the force that speeds up and slows down, by velocity and place.
PHASE_PLANES = {
    "rotor": ({"armature": 0.4}, lambda v, s: 5, lambda v, s: 5),
    "velocity and acceleration": (BOUNDED, *[lambda v, s: 3 * INERTIA * (v < 1.5)] * 2),
    "friction": (FRICTION, lambda v, s: 4.2 - v, lambda v, s: 5.8 + v),
    "torque-speed line": (LINE, lambda v, s: min(5, 6 - 2 * v), lambda v, s: min(5, 6 + 2 * v)),
    "all, friction uncertain": (
        FRICTION | LINE | {"friction_uncertainty": 0.5},
        lambda v, s: min(5, 6 - 2 * v) - 1.2 - 1.5 * v,
        lambda v, s: 5 + 0.4 + 0.5 * v,
    ),
    "effort by direction": (table([0], [2], [5]), lambda v, s: 5, lambda v, s: 2),
    "effort by position": (
        table([0, 2], [5, 1], [5, 1]),
        lambda v, s: 5 - 2 * s,
        lambda v, s: 5 - 2 * (ANGLE - s),
    ),
}


@pytest.mark.parametrize(
    ("motors", "forwards", "backwards"), PHASE_PLANES.values(), ids=PHASE_PLANES
)
def test_one_joint_takes_what_its_phase_plane_says(motors, forwards, backwards, tmp_path):
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), **motors)
    grid, at_both_ends = np.linspace(0, ANGLE, 1601), motors is not FRICTION
    timing = fastest_parameterization(anywhere(robot), STRAIGHT, grid, at_both_ends=at_both_ends)
    inertia = INERTIA + motors.get("armature", 0.0)
    expected = least_time(
        lambda v, s: forwards(v, s) / inertia, lambda v, s: backwards(v, s) / inertia
    )
    assert timing.duration == pytest.approx(expected, rel=1e-3)
    assert timing.position(timing.duration)[0] == pytest.approx(ANGLE)
    assert smoothness_class(timing) == "C1"


def test_a_motor_that_can_hardly_lift_its_load_creeps_over_the_top(tmp_path):
    """Tangents at what an ideal motor would do there leave it nothing: others must be found."""
    mass, line = 1.1, {"saturation_effort": 6.0, "no_load_velocity": 1.0}
    robot = with_motors(one_joint(tmp_path, mass, velocity=np.inf, effort=50.0), **line)
    path = JointTrajectory(["turn"], [0, 2 * ANGLE], [[[1.0]], [[-ANGLE]]])
    grid = np.linspace(0, 2 * ANGLE, 1601)
    timing = fastest_parameterization(anywhere(robot), path, grid)
    inertia = INERTIA + mass * 0.5**2

    def load(s):
        return mass * 9.81 * 0.5 * np.cos(s - ANGLE)

    expected = least_time(
        lambda v, s: (min(50, 6 * (1 - v)) - load(s)) / inertia,
        lambda v, s: (min(50, 6 * (1 + v)) + load(s)) / inertia,
        2 * ANGLE,
    )
    assert expected > 10
    assert timing.duration == pytest.approx(expected, rel=2e-3)


def test_what_is_found_keeps_the_limits_themselves_and_not_their_tangents(tmp_path):
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), **(FRICTION | LINE))
    problem, grid = anywhere(robot), np.linspace(0, ANGLE, 401)
    limits = tuple(limit for limit in speed_limits(problem) if limit.order == 2)
    begin, _ = path_rows(problem, STRAIGHT, grid, limits)
    timing = fastest_parameterization(problem, STRAIGHT, grid, at_both_ends=False)
    speed = timing.velocity(timing.breakpoints[:-1])
    acceleration = 2 * timing.coefficients[0]
    used = begin.acceleration * acceleration + begin.square * speed**2 + begin.speed * speed
    most = (used - begin.allowed).max(axis=1)
    assert most.max() < 1e-6
    assert (most < -1e-4).sum() <= 1  # every step takes all that there is, but that which switches


def test_points_are_added_where_joints_reverse():
    apart = with_reversals(BACK, np.linspace(0, 1, 5), 1e-3)
    np.testing.assert_allclose(apart, [0, 0.25, 0.5, 0.75, 1.0])  # one of them is there already
    apart = with_reversals(BACK, np.linspace(0, 1, 4), 1e-3)
    np.testing.assert_allclose(apart, [0, 1 / 3, 2 / 3, 0.75, 1.0])
    assert len(with_reversals(BACK, np.linspace(0, 1, 4), 0.1)) == 4


def test_steps_have_the_friction_of_their_own_direction(tmp_path):
    """Before and after the reversal, whatever the velocity is at the ends of the steps."""
    robot = with_motors(one_joint(tmp_path), forwards_friction=0.8, backwards_friction=0.3)
    rows = effort_rows(anywhere(robot), BACK, [0.0, 0.75, 1.0])
    for each in rows:
        allowed = np.array([[5 - 0.8, 5 + 0.8], [5 + 0.3, 5 - 0.3]]) / 5
        np.testing.assert_allclose(each.allowed, allowed)
    begin, end = rows
    np.testing.assert_allclose(begin.acceleration[:, 0] * 5 / INERTIA, [1.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(end.acceleration[:, 0] * 5 / INERTIA, [0.0, -0.5], atol=1e-12)
    np.testing.assert_allclose(begin.square[:, 0] * 5 / INERTIA, -2.0)


def test_where_a_path_begins_to_bend_steps_have_the_bend_of_their_own_side(tmp_path):
    robot = with_motors(one_joint(tmp_path))
    bends = [[[0.0], [1.0]], [[1.0], [1.0]], [[0.0], [0.5]]]  # s, and from 0.5 on s + (s - 0.5)^2
    path = JointTrajectory(["turn"], [0, 0.5, 1.0], bends)
    for each in effort_rows(anywhere(robot), path, [0.0, 0.5, 1.0]):
        np.testing.assert_allclose(each.square[:, 0] * 5 / INERTIA, [0.0, 2.0], atol=1e-12)


def test_tangents_cost_no_less_than_the_root(tmp_path):
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), **FRICTION, **LINE)
    problem = anywhere(robot)
    begin, _ = path_rows(problem, STRAIGHT, np.array([0.0, 1.0]), speed_limits(problem)[:2])
    touches, x = 2.3, np.linspace(0, 9, 50)
    tangent = begin.tangent(np.array([touches]))
    used = begin.square[0] * x[:, None] + begin.speed[0] * np.sqrt(x)[:, None] - begin.allowed[0]
    bound = tangent.square[0] * x[:, None] - tangent.allowed[0]
    costs = begin.speed[0] > 0
    assert costs.any()
    assert (~costs).any()
    assert (bound >= used - 1e-12)[:, costs].all()
    at_touch = tangent.square[0] * touches - tangent.allowed[0]
    exact = begin.square[0] * touches + begin.speed[0] * np.sqrt(touches) - begin.allowed[0]
    np.testing.assert_allclose(at_touch, exact)
    assert not tangent.speed.any()


def test_an_arm_that_friction_stops_is_refused(tmp_path):
    robot = with_motors(one_joint(tmp_path), forwards_friction=5.5)
    with pytest.raises(Infeasible, match=r"needs 5\.50 N m against gravity and friction"):
        fastest_parameterization(anywhere(robot), STRAIGHT, np.linspace(0, ANGLE, 11))


@pytest.mark.parametrize("velocity", [0.0, -1e-17])
def test_what_rounding_makes_of_standing_still_has_no_friction(slide, velocity):
    """A joint that gravity and friction together would stop, and that does not move."""
    start = np.array([0.0, 0.0, 0.5])
    held = float(abs(slide.gravity_effort(start[None])[0, 2]))
    friction = np.array([0.0, 0.0, slide.limits.effort[2] - held / 2])
    robot = with_motors(slide, forwards_friction=friction, backwards_friction=friction)
    path = JointTrajectory(robot.joint_names, [0, 1.0], [[[1.0, 0.0, velocity]], [start]])
    timing = fastest_parameterization(anywhere(robot), path, np.linspace(0, 1, 101))
    assert held > 0.1
    assert timing.duration > 0


def squares_by_linear_programs(arc_length, limits, most):
    """Return the largest s'^2 (N,) of `PathRows`: a linear program over (u, x) for every step."""
    steps, count = np.diff(arc_length), len(arc_length)

    def extreme(k, cost, least, largest, x=(0.0, None)):
        ahead = (0.0, 2 * steps[k])[: len(limits)]
        rows = [
            [e.acceleration[k] + h * e.square[k], e.square[k]]
            for e, h in zip(limits, ahead, strict=True)
        ]
        end = np.array([[2 * steps[k], 1.0]])
        matrix = np.vstack([*(np.array(each).T for each in rows), end, -end])
        bound = np.concatenate([*(each.allowed[k] for each in limits), [largest, -least]])
        box = (x[0], min(most[k] ** 2, np.inf if x[1] is None else x[1]))
        result = linprog(cost, matrix, bound, bounds=[(None, None), box])
        return result.x if result.success else None

    intervals = [(0.0, 0.0)]
    for k in range(count - 2, -1, -1):
        ends = [extreme(k, cost, *intervals[-1]) for cost in ([0, 1.0], [0, -1.0])]
        if ends[0] is None:
            return None
        intervals.append((ends[0][1], ends[1][1]))
    if intervals[-1][0] > 1e-9:
        return None
    squares = [0.0]
    for k, (least, largest) in enumerate(intervals[-2::-1]):
        x = squares[-1]
        u = extreme(k, [-1.0, 0], least, largest, (x * (1 - 1e-9), x * (1 + 1e-9)))[0]
        squares.append(max(x + 2 * steps[k] * u, 0.0))
    return np.array(squares)


@pytest.mark.parametrize("rows", [3, 12, 80])
@pytest.mark.parametrize("at_rest", [0.05, -0.02])
def test_rates_are_those_of_linear_programs_for_every_step(rows, at_rest):
    """With rows that no rest keeps, too: tangents of s' may leave none."""
    random, solved = np.random.default_rng(rows), 0
    for _ in range(4):
        count = 12
        arc_length = np.cumsum(random.uniform(0.02, 0.1, count))
        limits = []
        for _ in range(2):
            a, b = random.normal(size=(2, count - 1, rows))
            g = random.uniform(at_rest, 1, (count - 1, rows))
            limits.append(PathRows(a, b, 0 * a, g, np.zeros((3, count - 1, 0, 4))))
        most = random.uniform(0.2, 2, count)
        rate = _fastest_rates(arc_length, limits, most)
        expected = squares_by_linear_programs(arc_length, limits, most)
        assert (rate is None) == (expected is None)
        if rate is not None:
            solved += 1
            np.testing.assert_allclose(rate**2, expected, atol=1e-6)
    assert solved or at_rest < 0


def bends(joints):
    """Return how far joints go along a path without straight parts, shape (5, n)."""
    return np.linspace(0, 1, 5)[:, None] ** np.linspace(0.5, 2.0, joints) * (-0.7) ** np.arange(
        joints
    )


@pytest.mark.parametrize("name", ["ur5/level_tray", "panda/between_shelves"])
@pytest.mark.parametrize("at_both_ends", [True, False])
def test_the_time_is_that_of_toppra(name, at_both_ends, bundled):
    problem = bundled(name)
    spline = CubicSpline(np.linspace(0, 1, 5), problem.start + bends(problem.robot.joint_count))
    path = JointTrajectory(problem.robot.joint_names, spline.x, spline.c)
    grid = np.linspace(0, path.duration, 301)
    times = [
        fastest_parameterization(
            problem, path, grid, at_both_ends=at_both_ends, by_toppra=by_toppra
        ).duration
        for by_toppra in (False, True)
    ]
    assert times[0] == pytest.approx(times[1], rel=1e-6)


def test_a_part_on_a_tray_is_slid_by_no_more_than_friction(slide):
    """On a straight line at mu g, forwards and backwards."""
    free = np.full(3, np.inf)
    robot = slide.with_limits(replace(slide.limits, effort=free, velocity=free), slide.motors)
    holding = Holding(Tray(0.3, (9.0, 9.0), safety=1.0), Payload(1.0))
    problem = replace(anywhere(robot), holding=(holding,))
    path = JointTrajectory(robot.joint_names, [0, 0.4], [[[0.0, 1.0, 0.0]], [[0.0, 0.0, 0.0]]])
    timing = fastest_parameterization(problem, path, np.linspace(0, 0.4, 101))
    assert timing.duration == pytest.approx(2 * np.sqrt(0.4 / (0.3 * 9.81)), rel=2e-4)


def test_a_tool_speeds_up_and_slows_down_at_its_acceleration(slide):
    free = np.full(3, np.inf)
    limits = replace(slide.limits, effort=free, velocity=free, tool_acceleration=5.0)
    path = JointTrajectory(slide.joint_names, [0, 0.4], [[[0.0, 1.0, 0.0]], [[0.0, 0.0, 0.0]]])
    problem = anywhere(slide.with_limits(limits, slide.motors))
    timing = fastest_parameterization(problem, path, np.linspace(0, 0.4, 101))
    assert timing.duration == pytest.approx(2 * np.sqrt(0.4 / 5.0), rel=2e-4)


def test_a_curve_is_run_at_the_acceleration_that_its_tool_may_have(bundled):
    """Of that of the curve as well as along it."""
    problem = bundled("ur5/level_tray")
    limits = replace(problem.robot.limits, tool_acceleration=3.0)
    problem = replace(problem, robot=problem.robot.with_limits(limits, problem.robot.motors))
    spline = CubicSpline(np.linspace(0, 1, 5), problem.start + bends(6))
    path = JointTrajectory(problem.robot.joint_names, spline.x, spline.c)
    timing = fastest_parameterization(problem, path, np.linspace(0, 1, 401))
    time = np.linspace(0, timing.duration, 2000)[1:-1]
    s, rate, change = (
        f(time)[:, 0] for f in (timing.position, timing.velocity, timing.acceleration)
    )
    slope, bend = path.velocity(s), path.acceleration(s)
    state = path.position(s), slope * rate[:, None], slope * change[:, None]
    a = state[2] + bend * rate[:, None] ** 2
    size = np.linalg.norm(problem.robot.tool_motion(*state[:2], a)[:, :3], axis=1)
    assert size.max() < 3.0 * 1.02
    assert np.median(size) == pytest.approx(3.0, rel=1e-2)


def test_corners_are_found_where_large_terms_cancel():
    """Where rounding keeps a polygon's width from coming to zero, however near its corner."""
    rng = np.random.default_rng(0)
    ratio, rates = rng.uniform(0.1, 0.9, 5000), rng.uniform(0.5, 1.5, (2, 5000, 1))
    rates *= np.geomspace(1e3, 1e13, 5000)[:, None]
    up, down = np.stack([rates * ratio[:, None], rates], axis=1)
    corners = _corners(np.ones(5000), 1.0, up, down)
    np.testing.assert_allclose(corners[:, 0], ratio, rtol=1e-9)


def test_a_curve_is_run_on_the_edge_of_its_cones(bundled):
    """At every step some limit is used, none by more than a ten-thousandth too much."""
    problem = bundled("ur5/level_tray")
    tray = Tray(0.5, 0.02, safety=1.0)
    holding = (Holding(tray, Payload(1.0, (0.0, 0.0, 0.05))),)
    problem = replace(problem, holding=holding)
    tool = [1.0, -0.6, 0.0, 0.6, 0.0, 1.0]  # the wrist keeps the tray level
    spline = CubicSpline([0, 0.4, 1], problem.start + np.outer([0, 0.5, 0.2], tool))
    path = JointTrajectory(problem.robot.joint_names, spline.x, spline.c)
    grid = np.linspace(0, 1, 201)
    timing = fastest_parameterization(problem, path, grid)
    limits = tuple(limit for limit in speed_limits(problem) if limit.order == 2)
    speed, acceleration = (
        timing.velocity(timing.breakpoints)[:, 0],
        2 * timing.coefficients[0, :, 0],
    )
    worst = np.full(200, -np.inf)
    for rows, x in zip(
        path_rows(problem, path, grid, limits), (speed[:-1], speed[1:]), strict=True
    ):
        used = rows.acceleration * acceleration[:, None] + rows.square * x[:, None] ** 2
        by_acceleration, by_square, still = rows.cones
        run = by_acceleration * acceleration[:, None, None] + by_square * x[:, None, None] ** 2
        cones = np.linalg.norm((run + still)[..., :3], axis=2) - (run + still)[..., 3]
        worst = np.maximum(worst, np.hstack([used - rows.allowed, cones]).max(axis=1))
        assert cones.max() > -1e-3  # the part is what limits
    assert worst.max() < 1.01e-4
    assert (worst < -1e-3).sum() <= 3  # steps that switch
