"""The list of all speed limits of a problem; use of each limit along a trajectory."""

from dataclasses import replace

import numpy as np
import pytest
from cases import (
    INERTIA,
    anywhere,
    limited_tool,
    one_joint,
    quintic,
    rest_to_rest,
    with_motors,
)

from tubeplanner import (
    JointTrajectory,
    LimitOverrides,
    PlanningProblem,
    PointSpeed,
    Tube,
    load_robot,
    verify,
)
from tubeplanner.constraints.limit_use import limit_uses
from tubeplanner.constraints.unused_speed import unused_speed
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.robot.velocity_by_position import VelocityByPosition

# Shares of limits against the certificate at the same instants, and where they are known.


def only(uses, kind):
    (use,) = uses.of(kind)
    return use


def test_they_leave_what_the_certificate_leaves(stored):
    """Of the rotation tolerance the largest share counts."""
    problem, trajectory = stored("ur5/level_tray", "refinement")
    uses, conditions = limit_uses(problem, trajectory), verify(problem, trajectory).conditions
    names = problem.robot.joint_names
    for kind in ("velocity", "effort"):
        judged, own = conditions[kind], uses.of(kind)
        assert [use.name for use in own] == list(names)
        largest = max(own, key=lambda use: use.share.max())
        assert 1 - largest.share.max() == pytest.approx(judged.margin, abs=2e-4)
        joint = own[names.index(judged.where.joint)]
        sample = abs(uses.samples.time - judged.where.time).argmin()
        assert joint.share[sample] == pytest.approx(1 - judged.margin, abs=5e-3)
    half = (problem.joint_upper - problem.joint_lower)[uses.segment] / 2
    left = [(1 - use.share) * half[:, use.joint] for use in uses.of("position")]
    judged = [conditions[kind].margin for kind in ("position", "joint_signs")]
    expected = min(margin for margin in judged if margin is not None)
    assert np.min(left) == pytest.approx(expected, abs=2e-3)
    left = (1 - only(uses, "tube").share) * problem.tube.effective_radius[uses.segment]
    assert left.min() == pytest.approx(conditions["tube"].margin, abs=2e-4)
    bounds = problem.tube.rotation.bounds
    left = conditions["rotation"].margin / bounds[np.isfinite(bounds)].min()
    assert 1 - only(uses, "rotation").share.max() == pytest.approx(left, abs=2e-3)


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
    for kind, share in expected.items():
        np.testing.assert_allclose(only(uses, kind).share, share, atol=1e-9, err_msg=kind)
    assert {use.kind for use in uses.uses} == {*expected, "tube"}
    assert [use.joint for use in uses.uses][:-1] == [0] * 7


def test_what_jumps_at_a_breakpoint_is_there_on_both_sides(tmp_path):
    robot = one_joint(tmp_path, jerk=10.0)
    coefficients = np.array([[1.0, -0.5], [0, 1.5], [0, 0.75], [0, 0.125]])[:, :, None]
    trajectory = JointTrajectory(["turn"], [0, 0.5, 1.0], coefficients)
    uses = limit_uses(anywhere(robot), trajectory, 3)
    np.testing.assert_allclose(only(uses, "jerk").share, [0.6] * 3 + [0.3] * 3)
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
    np.testing.assert_allclose(only(uses, "effort").share, abs(torque) / allowed, atol=1e-9)


def test_towards_an_end_a_velocity_uses_what_is_allowed_there(tmp_path):
    robot = one_joint(tmp_path)
    law = VelocityByPosition(0, deceleration=4.0, offset=0.0, lower=-9.0, upper=2.0)
    robot = with_motors(robot, limits={})
    limited = robot.with_limits(replace(robot.limits, velocity_by_position=(law,)), robot.motors)
    uses = limit_uses(anywhere(limited), quintic(1.9), 51)
    q, v = uses.samples.position[:, 0], uses.samples.velocity[:, 0]
    share = only(uses, "velocity_by_position").share
    np.testing.assert_allclose(share, v / np.sqrt(2 * 4 * (2 - q)), atol=1e-7)
    back = limit_uses(anywhere(limited), rest_to_rest(["turn"], 1.9, 0.0, 1.0), 51)
    assert only(back, "velocity_by_position").share.max() < 0.5


def test_friction_is_that_of_the_direction_in_which_a_joint_leaves(tmp_path):
    robot = with_motors(one_joint(tmp_path), backwards_friction=1.0, forwards_friction=2.0)
    uses = limit_uses(anywhere(robot), quintic(), 5)
    np.testing.assert_allclose(only(uses, "effort").share[[0, -1]], 2 / 5, atol=1e-9)
    back = limit_uses(anywhere(robot), quintic(-1.0), 5)
    np.testing.assert_allclose(only(back, "effort").share[[0, -1]], 1 / 5, atol=1e-9)


def test_friction_turns_where_a_joint_does_inside_a_piece(tmp_path):
    """It turns back at 0.7 s, between the samples at 0.5 and 0.75 s."""
    robot = with_motors(one_joint(tmp_path), backwards_friction=1.0, forwards_friction=2.0)
    trajectory = JointTrajectory(["turn"], [0, 1.0], np.array([[-0.5], [0.7], [0.0]])[:, None])
    effort = only(limit_uses(anywhere(robot), trajectory, 5), "effort").share
    forwards, backwards = 2.0 - INERTIA, 1.0 + INERTIA
    np.testing.assert_allclose(effort * 5, [forwards] * 3 + [backwards] * 2, atol=1e-9)


def test_in_a_range_without_width_a_joint_is_at_its_end(tmp_path):
    robot = one_joint(tmp_path)
    tool = robot.tool_position(np.zeros((1, 1)))[0]
    tube = Tube([tool, [5.0, 0.0, 0.0]], 9.0, joint_signs={"turn": [0.0, 0.0]})
    problem = PlanningProblem(robot, tube, np.zeros(1), self_collision=False)
    still = JointTrajectory(["turn"], [0, 1.0], np.zeros((2, 1, 1)))
    assert (only(limit_uses(problem, still), "position").share == 1).all()


def test_the_speed_of_the_tool_is_that_of_its_segment():
    problem = limited_tool([0.5, np.inf, 2.0])
    motion = rest_to_rest(["joint1", "joint2"], [0.2, -1.2], [1.4, -1.9], 1.0)
    uses = limit_uses(problem, motion)
    step = 1e-6
    q = [motion.position(uses.samples.time + s) for s in (-step, step)]
    tool = [problem.robot.tool_position(each) for each in q]
    speed = np.linalg.norm(tool[1] - tool[0], axis=1) / (2 * step)
    limit = np.array([0.5, np.inf, 2.0])[uses.segment]
    use = only(uses, "tool_speed")
    np.testing.assert_allclose(use.share[5:-5], (speed / limit)[5:-5], atol=1e-5)
    assert (use.name, use.joint) == ("tool", None)


def test_every_point_whose_speed_is_limited_has_its_own_share():
    points = [PointSpeed("link1", [x, 0, 0], 2.0) for x in (0.5, 1.0)]
    limits = LimitOverrides(point_speed=points)
    robot = load_robot("example:two_link", "hand", limits=limits)
    motion = rest_to_rest(robot.joint_names, [0, 0.5], [1, 0.5], 1.0)
    uses = limit_uses(anywhere(robot), motion)
    first, second = uses.of("point_speed")
    assert (first.name, second.name) == ("point 0 on link1", "point 1 on link1")
    assert (first.point, second.point) == (0, 1)
    velocity = abs(uses.samples.velocity[:, 0])
    np.testing.assert_allclose(first.share, velocity * 0.5 / 2, atol=1e-9)
    np.testing.assert_allclose(second.share, velocity * 1.0 / 2, atol=1e-9)


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (-1.0, 3.0, [0.5, 0.0, 0.5]),
        (-np.inf, 3.0, [0.0, 1 / 3, 2 / 3]),
        (-1.0, np.inf, [2 / 3, 1 / 3, 0.0]),
    ],
)
def test_of_a_range_the_distance_from_its_middle_counts(tmp_path, lower, upper, expected):
    """Of one that is open on one side, that from where the joint is farthest from its end."""
    robot = one_joint(tmp_path, position=[lower, upper])
    uses = limit_uses(anywhere(robot), rest_to_rest(["turn"], 0.0, 2.0, 1.0), 3)
    np.testing.assert_allclose(only(uses, "position").share, expected, atol=1e-12)


def test_a_joint_that_nothing_bounds_has_no_share(tmp_path):
    robot = one_joint(tmp_path, position=[-np.inf, np.inf], velocity=np.inf)
    uses = limit_uses(anywhere(robot), quintic())
    assert {use.kind for use in uses.uses} == {"effort", "tube"}


# How much speed is left: against trajectories that use all of a limit, and slower ones.


NAMES = ("joint1", "joint2")


@pytest.fixture(scope="module")
def fastest(planned):
    problem, result = planned("two_link/paper_1_30mm", "refinement")  # without gravity
    return problem, result.trajectory


def test_a_slower_one_leaves_what_it_is_slower_and_the_fastest_hardly_any(fastest):
    """Without gravity every limit scales alike: b(t) is so many times larger everywhere."""
    (problem, trajectory), slower = fastest, 1.5
    unused = unused_speed(problem, trajectory)
    assert 0 <= unused < 0.01
    expected = 1 - (1 - unused) / slower
    found = unused_speed(problem, trajectory.scaled(slower))
    assert found == pytest.approx(expected, abs=0.003)


@pytest.mark.parametrize("slower", [1.0, 2.0])
def test_a_limit_of_jerk_counts(slower):
    """Jerk at its limit all the time, forth and back; run n times as long, 1/n^3 of it."""
    jerk = 600.0
    limits = LimitOverrides(
        velocity=dict.fromkeys(NAMES, 1e6), effort=dict.fromkeys(NAMES, 1e9), jerk={NAMES[0]: jerk}
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    width, state, pieces = 0.05, np.zeros(3), []
    for sign in (1, -1, -1, 1):
        pieces.append([sign * jerk / 6, state[2] / 2, state[1], state[0]])
        powers = width ** np.arange(4)
        q, v, a = state
        state = np.array(
            [
                q + v * width + a * powers[2] / 2 + sign * jerk * powers[3] / 6,
                v + a * width + sign * jerk * powers[2] / 2,
                a + sign * jerk * width,
            ]
        )
    coefficients = np.zeros((4, 4, 2))
    coefficients[:, :, 0] = np.array(pieces).T
    trajectory = JointTrajectory(NAMES, width * np.arange(5), coefficients).scaled(slower)
    assert unused_speed(anywhere(robot), trajectory) == pytest.approx(1 - 1 / slower, abs=1e-6)
