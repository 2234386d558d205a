"""Rows of the optimisation: against the limits themselves and against finite differences."""

import numpy as np
import pytest

from tubeplanner import LimitOverrides, PlanningProblem, Tube, load_robot
from tubeplanner.constraints import (
    least_squared_durations,
    limit_rows,
    sampled_motion,
    tube_excess,
    tube_rows,
)
from tubeplanner.spline_start import knot_grid

GATES = np.array([0.0, 0.4, 1.0])
STEP = 1e-6


def limited(robot_name):
    """Return an arm with every kind of limit."""
    tool = {"two_link": "hand", "ur5": "tool0", "panda": "panda_hand_tcp"}[robot_name]
    plain = load_robot(f"example:{robot_name}", tool)
    names = plain.joint_names
    return load_robot(
        f"example:{robot_name}",
        tool,
        gravity=(0, 0, -9.81) if robot_name != "two_link" else (0, 0, 0),
        limits=LimitOverrides(
            acceleration=dict.fromkeys(names, 15.0), jerk=dict.fromkeys(names[:1], 400.0)
        ),
    )


@pytest.fixture(scope="module", params=["two_link", "ur5", "panda"])
def case(request):
    robot = limited(request.param)
    shape = knot_grid(GATES, 10)
    rng = np.random.default_rng(1)
    start = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])[: robot.joint_count]
    points = start + np.cumsum(
        rng.uniform(-0.1, 0.15, (shape.control_point_count, robot.joint_count)), axis=0
    )
    points[:3], points[-3:] = points[0], points[-1]
    hand = robot.tool_position(points[[0, 6, -1]])
    problem = PlanningProblem(robot, Tube(hand, [0.1, 0.2]), points[0])
    return problem, shape, points, shape.samples(np.array([0.2, 0.7]))


def rows_at(case, kind, points, gates, duration):
    problem, shape, _, samples = case
    motion = sampled_motion(shape.basis(samples, gates), points, duration)
    if kind == "limits":
        return limit_rows(problem.robot, motion)
    return tube_rows(problem, motion, samples.phase, 0.005)


@pytest.mark.parametrize("kind", ["limits", "tube"])
def test_rows_have_the_derivatives_of_their_room(case, kind):
    """The tube's planes turn with the hand; to first order, that of the outward one is a distance.

    Efforts are judged times y: what the row takes from eta is checked against that product.
    """
    _, _, points, _ = case
    duration = 0.8
    rows = rows_at(case, kind, points, GATES, duration)
    rng = np.random.default_rng(5)
    change = rng.normal(size=points.shape)
    change[:3] = change[-3:] = 0.0
    gate = rng.normal(size=1)
    taken = change[rows.first[:, None] + np.arange(4)]
    expected = np.einsum("rkj,rkj->r", rows.control, taken) + rows.gate @ gate
    sides = []
    for sign in (1, -1):
        gates = GATES + sign * STEP * np.array([0, gate[0], 0])
        moved = rows_at(case, kind, points + sign * STEP * change, gates, duration)
        sides.append(moved.room)
    numeric = -(sides[0] - sides[1]) / (2 * STEP)
    if kind == "tube":  # outward normals only: the others are planes fixed to the hand's place
        count = len(rows) // 11
        expected, numeric = expected[:count], numeric[:count]
    scale = abs(expected).max()
    np.testing.assert_allclose(numeric / scale, expected / scale, atol=3e-4)


def test_rows_know_what_the_duration_gives(case):
    """At the duration that the limits allow, the tightest row has no room; beyond it, some."""
    problem, shape, points, samples = case
    motion = sampled_motion(shape.basis(samples, GATES), points, 1.0)
    y = float(least_squared_durations(problem.robot, motion).max())
    rows = rows_at(case, "limits", points, GATES, np.sqrt(y))
    assert rows.room.min() == pytest.approx(0.0, abs=1e-9)
    eta = 1e-5
    later = rows_at(case, "limits", points, GATES, np.sqrt(y * (1 + eta)))
    tight = int(rows.room.argmin())
    gained = (later.room[tight] - rows.room[tight]) / eta
    assert -rows.duration[tight] == pytest.approx(gained, rel=1e-3)


def test_the_least_duration_is_that_of_every_limit(case):
    """Run in it, some limit is just met, and none is broken."""
    problem, shape, points, samples = case
    robot, limits = problem.robot, problem.robot.limits
    motion = sampled_motion(shape.basis(samples, GATES), points, 1.0)
    for i, y in enumerate(least_squared_durations(robot, motion)):
        at = sampled_motion(shape.basis(samples, GATES), points, float(np.sqrt(y)))
        q, v, a, j = (x[i : i + 1] for x in (at.position, at.rate(1), at.rate(2), at.rate(3)))
        used = [
            abs(robot.inverse_dynamics(q, v, a)) / limits.effort,
            abs(v) / limits.velocity,
            abs(a) / limits.acceleration,
            abs(j) / limits.jerk,
        ]
        assert np.max(used) == pytest.approx(1.0, abs=1e-9)


def test_planes_hold_the_capsule_and_touch_it(case):
    """A hand behind every plane is inside; the outward plane's room is the distance to the wall."""
    problem, shape, points, samples = case
    motion = sampled_motion(shape.basis(samples, GATES), points, 1.0)
    excess = tube_excess(problem, motion, samples.phase, 0.005)
    rows = rows_at(case, "tube", points, GATES, 1.0)
    by_plane = -rows.room.reshape(11, len(excess))
    np.testing.assert_allclose(by_plane[0], excess, atol=1e-9)
    assert (by_plane <= excess + 1e-9).all()
