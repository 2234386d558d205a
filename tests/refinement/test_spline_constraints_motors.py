"""Blended friction in the optimisation, beside what is exact: on whole splines."""

import numpy as np
import pytest

from cases import with_motors
from tubeplanner import PlanningProblem, Tube
from tubeplanner.constraints.time_scaling import minimum_duration, scaling_factor
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.second_stage import SecondStage
from tubeplanner.refinement.spline_constraints import BLENDED, WIDELY_BLENDED, SplineConstraints
from tubeplanner.refinement.spline_start import knot_grid
from tubeplanner.trajectory.directed_stretches import common_stretches
from tubeplanner.trajectory.joint_trajectory import from_spline

ENDS = np.array([0.0, 0.4, 1.0])
FRICTION = {"backwards_friction": [0.0, 14.0], "forwards_friction": [0.0, 1.0]}


def step(x):
    return x**3 * (10 - 15 * x + 6 * x**2)


def constraints_and_spline(robot, turns, intervals=60, **motors):
    """Return a motion over many knots; joint 2 brakes, and may come back slowly."""
    robot, grid = with_motors(robot, **motors), knot_grid(ENDS, intervals)
    knots = grid.knots(ENDS)
    x = np.convolve(knots[1:-1], np.full(3, 1 / 3), "valid")[:, None]
    moved = step(np.minimum(x / 0.35, (1 - x) / 0.65)) if turns else step(x)
    points = np.hstack([0.2 * step(x), 0.8 * moved - 1.5])
    points[:3], points[-3:] = points[0], points[-1]
    tube = Tube(robot.tool_position(points[[0, len(points) // 2, -1]]), 9.0)
    problem = PlanningProblem(robot, tube, points[0], points[-1], self_collision=False)
    links, radius = LinkConstraints(problem), np.full(2, 9.0)
    return SplineConstraints(problem, grid, links, radius), PhasedSpline(grid, ENDS, points)


def efforts(constraints, spline):
    current = constraints.between_samples(spline)
    return next(part for part in current.limits if part.limit.kind == "effort")


def beyond(constraints, spline, intervals, near=0.15):
    """Return by what share efforts ask for more than they need, blended over so many intervals.

    Of the squared duration, at samples that are not so near to an end; what they need is by the
    direction there.
    """
    constraints.blend(intervals)
    effort = efforts(constraints, spline)
    exact = scaling_factor(constraints._problem, *effort.at.by_x[:3]) ** -2.0
    x = effort.at.evaluation_points.times(ENDS)
    return (effort.squared_durations / exact - 1)[(x > near) & (x < 1 - near)]


def test_blended_over_fewer_intervals_it_comes_nearer_to_what_is_exact(two_link):
    """And is never less."""
    constraints, spline = constraints_and_spline(two_link, True, **FRICTION)
    wide, narrow, least = (beyond(constraints, spline, k) for k in (WIDELY_BLENDED, BLENDED, 1.0))
    assert least.min() > -1e-9
    assert (narrow - least).min() > -1e-9
    assert (wide - narrow).min() > -1e-9
    affected = [(share > 1e-6).mean() for share in (wide, narrow, least)]
    assert 0 < affected[2] < affected[1] < affected[0] < 0.2
    assert wide.max() > 0.1


def test_where_nothing_reverses_it_is_exact_in_the_end(two_link):
    """From the start to the goal: there joints are slow, but their directions are known."""
    constraints, spline = constraints_and_spline(two_link, False, **FRICTION)
    blended = constraints.between_samples(spline).duration
    shape = from_spline(two_link.joint_names, spline.bspline())
    assert blended == pytest.approx(minimum_duration(constraints._problem, shape), rel=1e-3)
    assert not beyond(constraints, spline, BLENDED, 0.02).any()
    assert beyond(constraints, spline, WIDELY_BLENDED, 0.02).any()


def test_widely_blended_only_the_outermost_intervals_know_their_direction(two_link):
    """In the end, all in which joints get fast."""
    constraints, spline = constraints_and_spline(two_link, False, **FRICTION)
    unsure = {}
    for intervals in (WIDELY_BLENDED, BLENDED):
        constraints.blend(intervals)
        effort = efforts(constraints, spline)
        friction, interval = effort.path.coulomb_friction, effort.at.evaluation_points.interval
        differs = (friction.most > friction.least).any(axis=1)
        unsure[intervals] = sorted(set(interval[differs]))
    last = spline.grid.interval_count - 1
    assert {1, last - 1} <= set(unsure[WIDELY_BLENDED])
    assert not {0, last} & set(unsure[WIDELY_BLENDED])
    assert unsure[BLENDED] == []


def test_blending_changes_something_only_once_and_only_with_coulomb_friction(two_link):
    constraints, _ = constraints_and_spline(two_link, True, **FRICTION)
    assert not constraints.blend(BLENDED)
    assert constraints.blend(WIDELY_BLENDED)
    assert not constraints.blend(WIDELY_BLENDED)
    assert constraints.blend(BLENDED)
    smooth, _ = constraints_and_spline(two_link, True, viscous_friction=3.0)
    assert not smooth.blend(WIDELY_BLENDED)


def test_few_knots_are_blended_all_over(two_link):
    """More intervals than there are: the share is all of the largest velocity, and no more."""
    constraints, spline = constraints_and_spline(two_link, True, intervals=8, **FRICTION)
    found = []
    for intervals in (len(spline.control_points), 50.0):
        constraints.blend(intervals)
        found.append(efforts(constraints, spline).squared_durations)
    np.testing.assert_array_equal(*found)


def test_a_second_stage_has_time_by_exact_scaling_and_watches_reversals_where_it_has_not(two_link):
    constraints, spline = constraints_and_spline(two_link, True, **FRICTION)
    problem = constraints._problem
    shape = from_spline(two_link.joint_names, spline.bspline())
    least = minimum_duration(problem, shape)
    stage = SecondStage(problem, spline, 1.01 * least, 0.0)
    counts = []
    for longest in (1.001 * least, 0.999 * least):
        assert stage._has_time_with_friction(spline, longest) == (longest > least)
        samples = stage._program.iterate(spline).watched[0].evaluation_points
        counts.append(len(samples.phase))
    reversals = common_stretches(shape).start > 0
    assert counts[1] - counts[0] == reversals.sum() > 0
    watched = samples.times(spline.switching_times)[counts[0] :]
    np.testing.assert_allclose(shape.velocity(watched).min(axis=1), 0.0, atol=1e-6)
