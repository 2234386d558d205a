"""Defects that last a fraction of a millisecond, where 2,000 samples see nothing."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tubeplanner import (
    AttachedSolid,
    JointTrajectory,
    Obstacle,
    PlanningProblem,
    Tube,
    placement_of,
    verify,
)

SAMPLES = 2000


def with_bump(trajectory, joint, begin, width, size):
    """Return the trajectory with a short smooth bump of one joint, of this size [rad]."""
    end = trajectory.duration
    cuts = [0.0, begin, begin + width, end]
    parts = [trajectory.between(low, high) for low, high in pairwise(cuts)]
    # 64 u^3 (1 - u)^3 has the value 1 at u = 1/2, and no slope or curvature at its ends.
    bump = 64 * size * np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
    coefficients = []
    for part in parts:
        zeros = np.zeros((7 - len(part.coefficients), *part.coefficients.shape[1:]))
        coefficients.append(np.concatenate([zeros, part.coefficients]))
    assert coefficients[1].shape[1] == 1, "the bump must lie within one piece"
    coefficients[1][:, 0, joint] += bump
    starts = [part.breakpoints[:-1] + low for part, low in zip(parts, cuts[:-1], strict=True)]
    breakpoints = np.append(np.concatenate(starts), end)
    return JointTrajectory(
        trajectory.joint_names, breakpoints, np.concatenate(coefficients, axis=1)
    )


def between_samples(trajectory, near, width):
    """Return a time after `near` at which samples of the trajectory miss what lasts so long."""
    spacing = trajectory.duration / (SAMPLES - 1)
    begin = (np.ceil(near / spacing) + 0.5) * spacing - width / 2
    inside = (trajectory.breakpoints > begin) & (trajectory.breakpoints < begin + width)
    assert width < spacing
    assert not inside.any()
    return begin


def sampled(trajectory):
    return trajectory.at(np.linspace(0, trajectory.duration, SAMPLES))


def test_an_effort_above_its_limit_for_a_tenth_of_a_millisecond(stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    slow = trajectory.scaled(1.5)
    begin = between_samples(slow, 0.9, 2e-4)
    spiked = with_bump(slow, 1, begin, 2e-4, 2.5e-7)
    samples = sampled(spiked)
    tau = problem.robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    assert (abs(tau) < 0.99 * problem.robot.limits.effort).all()
    certificate = verify(problem, spiked)
    assert certificate.failures() == ["effort"]
    condition = certificate.conditions["effort"]
    dense = spiked.at(np.linspace(begin, begin + 2e-4, 20_001))
    tau = problem.robot.inverse_dynamics(dense.position, dense.velocity, dense.acceleration)
    used = abs(tau) / problem.robot.limits.effort
    assert condition.margin == pytest.approx(1 - used.max(), abs=1e-6)
    assert begin <= condition.where.time <= begin + 2e-4
    joint = problem.robot.joint_names[int(used.max(axis=0).argmax())]
    assert condition.where.joint == joint
    assert condition.coverage == "for all t"


def test_a_tool_outside_the_tube_for_a_tenth_of_a_millisecond(stored):
    """A radius that the trajectory just keeps, and a spike of 0.6 mm at its worst place."""
    problem, trajectory = stored("two_link/paper_1_30mm", "branch-and-bound")
    least = verify(problem, trajectory).conditions["tube"]
    radius = problem.tube.radius - (least.margin - 1e-4)
    tube = Tube(problem.tube.points, radius, joint_signs=problem.tube.joint_ranges)
    tight = PlanningProblem(problem.robot, tube, problem.start)
    begin = between_samples(trajectory, least.where.time, 2e-4)
    spiked = with_bump(trajectory, 0, begin, 2e-4, 2e-3)
    other = with_bump(trajectory, 0, begin, 2e-4, -2e-3)
    failing = [verify(tight, trajectory).conditions["tube"] for trajectory in (spiked, other)]
    worst = min(failing, key=lambda condition: condition.margin)
    assert worst.margin < -2e-5
    assert begin <= worst.where.time <= begin + 2e-4
    assert worst.where.segment == least.where.segment
    for trajectory in (spiked, other):
        tool = problem.robot.tool_position(sampled(trajectory).position)
        assert tube.margin(tool).max(axis=1).min() > 0


@pytest.mark.parametrize("free_by", [None, 1e-5])
def test_a_thin_plate_passed_between_two_samples(two_link, free_by):
    """A grain of 0.1 mm crosses a plate of 0.1 mm at 2.4 m/s; or passes beside it."""
    ball = Obstacle.sphere("grain", 5e-5, placement_of([0, 0, 0]))
    grain = AttachedSolid("grain", ball.shapes, touch_links=("link2",))
    trajectory = JointTrajectory(two_link.joint_names, [0, 0.25], [[[4.0, 0]], [[-0.5, -0.3]]])
    crossing = between_samples(trajectory, 0.125, 0.0)
    tool = two_link.tool_position(trajectory.position(np.array([crossing, crossing + 1e-6])))
    along = (tool[1] - tool[0]) / np.linalg.norm(tool[1] - tool[0])
    angle = np.arctan2(along[1], along[0])
    outwards = tool[0] / np.linalg.norm(tool[0])
    # The plate lies across the way; its inner edge just reaches the grain, or just does not.
    reach = 0.01 + 5e-5 + (free_by or -4e-5)
    placement = placement_of(tool[0] + reach * outwards, rpy=(0, 0, angle))
    plate = Obstacle.box("plate", [1e-4, 0.02, 0.02], placement)
    tube = Tube(tool[0] + np.array([[-1, 0, 0], [1, 0, 0]]), 2.0)
    start = trajectory.position(0.0)
    problem = PlanningProblem(two_link, tube, start, obstacles=[plate], attached=[grain])
    checker = problem.collision
    grain_pair = [p for p in checker.obstacle_pairs if checker.owners(p)[0] == ("grain",)]
    rotation, position = two_link.body_poses(sampled(trajectory).position)
    seen = [
        checker.distances(r, p, np.array(grain_pair))[0]
        for r, p in zip(rotation, position, strict=True)
    ]
    assert min(seen) > 0
    others = [p for p in checker.obstacle_pairs if checker.owners(p)[0] != ("grain",)]
    apart = PlanningProblem(
        two_link,
        tube,
        start,
        obstacles=[plate],
        attached=[grain],
        ignore_collisions=[(checker.owners(p)[0][0], "plate") for p in others],
    )
    condition = verify(apart, trajectory).conditions["obstacles"]
    if free_by is None:
        assert condition.margin < -1e-5
        assert condition.where.links == ("grain",)
        assert condition.where.time == pytest.approx(crossing, abs=5e-5)
    else:
        assert 0 < condition.margin < 2e-5


def test_a_speed_above_its_limit_for_a_fraction_of_a_millisecond(stored):
    """A bump of a joint of some micrometres, where 2,000 samples of the tool see nothing."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")

    def speeds(of, time):
        at = of.at(time)
        return np.linalg.norm(problem.robot.tool_velocity(at.position, at.velocity)[0], axis=1)

    samples = np.linspace(0, trajectory.duration, 2000)
    speed = speeds(trajectory, samples)
    limit = 1.001 * speed.max()
    width = 1e-4
    begin = samples[speed.argmax()] + (samples[1] - width) / 2
    spiked = with_bump(trajectory, 0, begin, width, 1e-6)
    assert speeds(spiked, samples).max() < limit
    tube = replace(problem.tube, tool_speed=limit)
    before, after = (verify(problem.with_tube(tube), each) for each in (trajectory, spiked))
    assert before.passed
    assert "tool_speed" in after.failures()
    condition = after.conditions["tool_speed"]
    dense = speeds(spiked, np.linspace(begin, begin + width, 20_001)).max()
    assert condition.margin == pytest.approx(1 - dense / limit, rel=0.02)
    assert begin <= condition.where.time <= begin + width
