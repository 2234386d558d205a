"""Speed limits of joints, tool and points of links; how much of each a trajectory uses."""

from dataclasses import replace

import numpy as np
import pytest
from cases import INERTIA, anywhere, limited_tool, one_joint, quintic, rest_to_rest, with_motors
from scipy.interpolate import PPoly

from tubeplanner import (
    JointTrajectory,
    LimitOverrides,
    PlanningProblem,
    PointSpeed,
    load_robot,
    verify,
)
from tubeplanner.limits.binding_limits import limit_uses
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.limits.rates import PointSpeedLimit, ToolAcceleration, ToolSpeed
from tubeplanner.limits.speed_limits import scaled_to_limits, scaling_factor, unused_speed
from tubeplanner.robot.joint_limits import EffortRange


@pytest.mark.parametrize(
    ("tube_speed", "robot_speed", "expected"),
    [
        (None, None, [np.inf] * 3),
        (None, 0.7, [0.7] * 3),
        (0.6, None, [0.6] * 3),
        ([0.6, None, 0.8], 0.7, [0.6, 0.7, 0.7]),
        ([0.6, None, 0.8], None, [0.6, np.inf, 0.8]),
    ],
)
@pytest.mark.parametrize("kind", [ToolSpeed, ToolAcceleration])
def test_of_the_robots_limit_and_the_tubes_the_smaller_one_counts(
    tube_speed, robot_speed, expected, kind
):
    """A sample has the key of its segment."""
    problem = limited_tool(tube_speed, robot_speed, quantity=kind.kind)
    limit = kind(problem)
    assert limit.limit.tolist() == expected
    limited = np.flatnonzero(np.isfinite(expected)).tolist()
    keys = [(key.kind, key.joint, key.segment) for key in limit.keys]
    assert keys == [(kind.kind, None, k) for k in limited]
    if limited:
        at = PathSamples(problem, np.zeros((3, 3, 2)), lambda: np.array([2, 2, 0]))
        assert limit.key_of(at).tolist() == [[limited.index(k)] for k in (2, 2, 0)]


def tool_speed(robot, samples):
    return np.linalg.norm(robot.tool_velocity(samples.position, samples.velocity)[0], axis=1)


def test_a_shape_is_run_at_the_limit_of_each_segment(stored):
    problem, trajectory = stored("two_link/around_a_post")
    problem = problem.with_tube(replace(problem.tube, tool_speed=[None, 0.3, 0.4]))
    at = trajectory.at(np.linspace(0, trajectory.duration, 50)[1:-1])
    state, speed = (at.position, at.velocity, at.acceleration), tool_speed(problem.robot, at)
    free = scaling_factor(problem, *state, segment=np.zeros(48, dtype=int))
    for segment, limit in ((1, 0.3), (2, 0.4)):
        factor = scaling_factor(problem, *state, segment=np.full(48, segment))
        np.testing.assert_allclose(factor, np.minimum(free, limit / speed), rtol=1e-9)
    pieces = np.full(len(trajectory.widths), 2)
    scaled = scaled_to_limits(problem, trajectory, segments=pieces)
    at = scaled.at(np.linspace(0, scaled.duration, 20_001))
    assert tool_speed(problem.robot, at).max() == pytest.approx(0.4, rel=1e-5)


def test_a_shape_is_run_at_the_limit_on_the_tools_acceleration(stored):
    """Twice as fast, the acceleration is four times as large."""
    problem, trajectory = stored("two_link/around_a_post")
    robot = problem.robot

    def peak(motion):
        at = motion.at(np.linspace(0, motion.duration, 20_001))
        acceleration = robot.tool_motion(at.position, at.velocity, at.acceleration)[:, :3]
        return np.linalg.norm(acceleration, axis=1).max()

    loose = peak(scaled_to_limits(problem, trajectory))
    problem = problem.with_tube(replace(problem.tube, tool_acceleration=[None, None, loose / 9]))
    pieces = np.full(len(trajectory.widths), 2)
    scaled = scaled_to_limits(problem, trajectory, segments=pieces)
    assert peak(scaled) == pytest.approx(loose / 9, rel=1e-5)
    free = scaled_to_limits(problem, trajectory, segments=np.zeros_like(pieces))
    assert scaled.duration == pytest.approx(3 * free.duration, rel=1e-5)


# The limits on the speed of points of the arm: one that turns on a lever of 0.5 m, one of 1.3 m.

POINTS = [PointSpeed("bar", (0.3, 0.4, 0.7), 0.5), PointSpeed("bar", (1.2, -0.5, 0.0), 2.6)]
LEVERS = np.array([0.5, 1.3])


@pytest.fixture
def bar(tmp_path):
    """Return a function from points to a bar that turns about z, in no tube."""
    path = one_joint(tmp_path).urdf.path
    return lambda points: anywhere(
        load_robot(path, "bar", limits=LimitOverrides(point_speed=points))
    )


def test_each_point_is_a_share_of_its_own_limit(bar):
    """Where the point rests its speed does not change with the path."""
    problem = bar(POINTS)
    limit = PointSpeedLimit(problem.robot.limits.point_speed)
    rates = np.array([[0.6], [-1.1], [0.0]])
    at = PathSamples(problem, np.stack([0 * rates, rates, 0 * rates]))
    fractions = abs(rates) * LEVERS / [0.5, 2.6]
    np.testing.assert_allclose(limit.used(at).at(2.0), 2 * fractions, atol=1e-12)
    keys = [(key.kind, key.link, key.point) for key in limit.keys]
    assert keys == [("point_speed", "bar", 0), ("point_speed", "bar", 1)]
    assert limit.key_of(at).tolist() == [[0, 1]]
    expected = 2.0 * np.sign(rates) * LEVERS / [0.5, 2.6]
    np.testing.assert_allclose(limit.by_path(at, 2.0)[1][..., 0], expected, atol=1e-12)


def only(uses, kind):
    (use,) = uses.of(kind)
    return use


def test_they_leave_what_the_certificate_leaves(stored):
    """Of the rotation tolerance the largest fraction counts."""
    problem, trajectory = stored("ur5/level_tray", "refinement")
    uses, conditions = limit_uses(problem, trajectory), verify(problem, trajectory).conditions
    names = problem.robot.joint_names
    for kind in ("velocity", "effort"):
        judged, own = conditions[kind], uses.of(kind)
        assert [use.name for use in own] == list(names)
        largest = max(own, key=lambda use: use.fraction.max())
        assert 1 - largest.fraction.max() == pytest.approx(judged.margin, abs=2e-4)
        joint = own[names.index(judged.where.joint)]
        sample = abs(uses.samples.time - judged.where.time).argmin()
        assert joint.fraction[sample] == pytest.approx(1 - judged.margin, abs=5e-3)
    half = (problem.joint_upper - problem.joint_lower)[uses.segment] / 2
    slack = [(1 - use.fraction) * half[:, use.joint] for use in uses.of("position")]
    judged = [conditions[kind].margin for kind in ("position", "joint_signs")]
    expected = min(margin for margin in judged if margin is not None)
    assert np.min(slack) == pytest.approx(expected, abs=2e-3)
    slack = (1 - only(uses, "tube").fraction) * problem.tube.effective_radius[uses.segment]
    assert slack.min() == pytest.approx(conditions["tube"].margin, abs=2e-4)
    bounds = problem.tube.rotation.bounds
    slack = conditions["rotation"].margin / bounds[np.isfinite(bounds)].min()
    assert 1 - only(uses, "rotation").fraction.max() == pytest.approx(slack, abs=2e-3)


def test_every_limit_on_the_speed_is_there(tmp_path):
    robot = one_joint(tmp_path, velocity=4.0, acceleration=8.0, jerk=100.0, effort_rate=60.0)
    robot = with_motors(robot, saturation_effort=20.0, no_load_velocity=10.0)
    trajectory = quintic(1.0)
    uses = limit_uses(anywhere(robot), trajectory, 101)
    v, a, jerk = (trajectory.derivative_coefficients(k)[:, 0, 0] for k in (1, 2, 3))
    time = uses.samples.time
    v, a, jerk = (np.polyval(row, time) for row in (v, a, jerk))
    expected = {
        "velocity": abs(v) / 4,
        "acceleration": abs(a) / 8,
        "jerk": abs(jerk) / 100,
        "effort": abs(INERTIA * a) / 5,
        "effort_rate": abs(INERTIA * jerk) / 60,
        "motor_curve": np.maximum(abs(INERTIA * a / 20 + v / 10), 0),
        "position": abs(np.polyval(trajectory.coefficients[:, 0, 0], time)) / 9,
    }
    for kind, fraction in expected.items():
        np.testing.assert_allclose(only(uses, kind).fraction, fraction, atol=1e-9, err_msg=kind)
    assert {use.kind for use in uses.uses} == {*expected, "tube"}
    assert [use.joint for use in uses.uses][:-1] == [0] * 7


def test_what_jumps_at_a_breakpoint_is_there_on_both_sides(tmp_path):
    robot = one_joint(tmp_path, jerk=10.0)
    coefficients = np.array([[1.0, -0.5], [0, 1.5], [0, 0.75], [0, 0.125]])[:, :, None]
    trajectory = JointTrajectory(["turn"], [0, 0.5, 1.0], coefficients)
    uses = limit_uses(anywhere(robot), trajectory, 3)
    np.testing.assert_allclose(only(uses, "jerk").fraction, [0.6] * 3 + [0.3] * 3)
    np.testing.assert_allclose(uses.samples.time, [0, 0.25, 0.5, 0.5, 0.75, 1])


def test_a_limit_that_is_less_somewhere_is_used_as_it_is_there(tmp_path):
    """Not as the most that it is anywhere: 3 N m forwards and 2 N m backwards, of at most 5."""
    ends = np.array([-9.0, 9.0])
    effort = EffortRange(0, ends, np.array([2.0, 2.0]), np.array([1.0, 5.0]))
    robot = with_motors(one_joint(tmp_path), [effort])
    trajectory = quintic(0.5)
    uses = limit_uses(anywhere(robot), trajectory, 51)
    torque = INERTIA * uses.samples.acceleration[:, 0]
    allowed = np.where(torque > 0, 3 + 2 / 9 * uses.samples.position[:, 0], 2.0)
    np.testing.assert_allclose(only(uses, "effort").fraction, abs(torque) / allowed, atol=1e-9)


def test_towards_an_end_a_velocity_uses_what_is_allowed_there(tmp_path):
    law = {"deceleration": 4.0, "offset": 0.0, "lower": -9.0, "upper": 2.0}
    problem = anywhere(one_joint(tmp_path, velocity_by_position=law))
    uses = limit_uses(problem, quintic(1.9), 51)
    q, v = uses.samples.position[:, 0], uses.samples.velocity[:, 0]
    fraction = only(uses, "velocity_by_position").fraction
    np.testing.assert_allclose(fraction, v / np.sqrt(2 * 4 * (2 - q)), atol=1e-7)
    back = limit_uses(problem, rest_to_rest(["turn"], 1.9, 0.0, 1.0), 51)
    assert only(back, "velocity_by_position").fraction.max() < 0.5


def test_friction_is_that_of_the_direction_in_which_a_joint_moves_next(tmp_path):
    """It leaves so, or turns back at 0.7 s, between the samples at 0.5 and 0.75 s."""
    robot = with_motors(one_joint(tmp_path), backwards_friction=1.0, forwards_friction=2.0)

    def fraction(trajectory):
        return only(limit_uses(anywhere(robot), trajectory, 5), "effort").fraction

    np.testing.assert_allclose(fraction(quintic())[[0, -1]], 2 / 5, atol=1e-9)
    np.testing.assert_allclose(fraction(quintic(-1.0))[[0, -1]], 1 / 5, atol=1e-9)
    turning = JointTrajectory(["turn"], [0, 1.0], np.array([[-0.5], [0.7], [0.0]])[:, None])
    expected = [2.0 - INERTIA] * 3 + [1.0 + INERTIA] * 2
    np.testing.assert_allclose(fraction(turning) * 5, expected, atol=1e-9)


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (-1.0, 3.0, [0.5, 0.0, 0.5]),
        (-np.inf, 3.0, [0.0, 1 / 3, 2 / 3]),
        (-1.0, np.inf, [2 / 3, 1 / 3, 0.0]),
        (-np.inf, np.inf, None),
    ],
)
def test_of_a_range_the_distance_from_its_middle_counts(tmp_path, lower, upper, expected):
    """Of one that is open on one side, that from where the joint is farthest from its end."""
    robot = one_joint(tmp_path, position=[lower, upper], velocity=np.inf)
    uses = limit_uses(anywhere(robot), rest_to_rest(["turn"], 0.0, 2.0, 1.0), 3)
    if expected is None:
        assert {use.kind for use in uses.uses} == {"effort", "tube"}
    else:
        np.testing.assert_allclose(only(uses, "position").fraction, expected, atol=1e-12)
    tube = replace(anywhere(robot).tube, joint_signs={"turn": [0.0, 0.0]})
    problem = PlanningProblem(robot, tube, np.zeros(1), self_collision=False)
    still = JointTrajectory(["turn"], [0, 1.0], np.zeros((2, 1, 1)))
    assert (only(limit_uses(problem, still), "position").fraction == 1).all()


def test_the_tool_and_every_point_that_is_limited_have_their_own_share():
    """The tool's limit is that of its segment."""
    problem = limited_tool([0.5, np.inf, 2.0])
    motion = rest_to_rest(["joint1", "joint2"], [0.2, -1.2], [1.4, -1.9], 1.0)
    uses = limit_uses(problem, motion)
    tool = only(uses, "tool_speed")
    sides = (motion.position(uses.samples.time + step) for step in (-1e-6, 1e-6))
    before, after = (problem.robot.tool_position(q) for q in sides)
    limit = np.array([0.5, np.inf, 2.0])[uses.segment]
    speed = np.linalg.norm(after - before, axis=1) / 2e-6
    np.testing.assert_allclose(tool.fraction[5:-5], (speed / limit)[5:-5], atol=1e-5)
    assert (tool.name, tool.joint) == ("tool", None)
    points = [PointSpeed("link1", [x, 0, 0], 2.0) for x in (0.5, 1.0)]
    robot = load_robot("example:two_link", "hand", limits=LimitOverrides(point_speed=points))
    uses = limit_uses(anywhere(robot), rest_to_rest(robot.joint_names, [0, 0.5], [1, 0.5], 1.0))
    velocity = abs(uses.samples.velocity[:, 0])
    for k, (use, lever) in enumerate(zip(uses.of("point_speed"), (0.5, 1.0), strict=True)):
        assert (use.name, use.point) == (f"point {k} on link1", k)
        np.testing.assert_allclose(use.fraction, velocity * lever / 2, atol=1e-9)


def test_a_slower_one_leaves_what_it_is_slower_and_the_fastest_hardly_any(planned):
    """Without gravity every limit scales alike: b(t) is so many times larger everywhere."""
    (problem, result), slower = planned("two_link/paper_1_30mm", "refinement"), 1.5
    unused = unused_speed(problem, result.trajectory)
    assert 0 <= unused < 0.01
    expected = 1 - (1 - unused) / slower
    slow_unused = unused_speed(problem, result.trajectory.scaled(slower))
    assert slow_unused == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize("slower", [1.0, 2.0])
def test_a_limit_of_jerk_counts(slower):
    """Jerk at its limit all the time, forth and back; run n times as long, 1/n^3 of it."""
    jerk, names = 600.0, ("joint1", "joint2")
    limits = LimitOverrides(
        velocity=dict.fromkeys(names, 1e6), effort=dict.fromkeys(names, 1e9), jerk={names[0]: jerk}
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    time, coefficients = 0.05 * np.arange(5), np.zeros((4, 4, 2))
    coefficients[:, :, 0] = PPoly(jerk * np.array([[1.0, -1, -1, 1]]), time).antiderivative(3).c
    trajectory = JointTrajectory(names, time, coefficients).scaled(slower)
    assert unused_speed(anywhere(robot), trajectory) == pytest.approx(1 - 1 / slower, abs=1e-6)
