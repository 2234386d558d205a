"""Cones of held parts as regions of a step's program."""

from dataclasses import replace

import numpy as np
import pytest

import tubeplanner as t
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.optimizer.cone_constraints import LEAST_AT_REST, EvaluatedCones
from tubeplanner.optimizer.phased_spline import PhasedSpline, sampled
from tubeplanner.optimizer.rows import INNER_MARGIN
from tubeplanner.optimizer.starts import knot_grid
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Holding, Tray

DURATION, TIMES = 0.9, np.array([0.0, 0.45, 1.0])


@pytest.fixture(scope="module")
def carrying():
    problem = t.load_problem("example:ur5/level_tray")
    tray = Tray(0.4, (0.05, 0.04), safety=1.0)
    part = Payload(1.0, (0.0, 0.0, 0.05))
    return replace(problem, holding=(Holding(tray, part),))


def spline(problem, shift=0.0, switching=0.0):
    grid = knot_grid(TIMES, 7)
    points = np.tile(problem.start, (grid.control_point_count, 1))
    points[3:] += 0.05 * np.sin(np.arange(len(points) - 3))[:, None] * (1, 1, -1, 0.5, 2, 1)
    return PhasedSpline(grid, TIMES + np.array([0, switching, 0]), points + shift)


def cones(problem, own, *, is_at_rest, duration=DURATION):
    limit = HoldingLimit(problem, LEAST_AT_REST)
    at = sampled(own, own.grid.samples(np.array([0.2, 0.7])))
    path = PathSamples(problem, at.by_x)
    numbers = np.arange(len(limit.keys)) + 5
    return EvaluatedCones(limit, at, path, duration, numbers, is_at_rest)


@pytest.mark.parametrize("is_at_rest", [True, False])
def test_a_step_predicts_vectors_and_slack_to_first_order(carrying, is_at_rest):
    """The error of a step of half the size is a quarter."""
    own = spline(carrying)
    here = cones(carrying, own, is_at_rest=is_at_rest)
    change = 1e-3 * np.random.default_rng(5).normal(size=own.control_points.shape)
    planes, errors = here.planes, []
    for share in (1.0, 0.5):
        step = (share * change, share * np.array([2e-3]), share * 0.02)
        moved = spline(carrying, share * change, 2e-3 * share)
        exact = cones(carrying, moved, is_at_rest=is_at_rest).vector_in(DURATION, step[2])
        predicted = here.after(*step)
        errors.append(abs(predicted - exact).max())
        assert errors[-1] < 0.05 * abs(exact - here.vector).max()
        used = here.rows(planes).used_by_step(*step)
        np.testing.assert_allclose(
            here.slack(planes) - used, here.slack(planes, predicted - here.vector), atol=1e-12
        )
    assert errors[1] < 0.3 * errors[0]


def test_planes_contain_their_cones_and_part_what_is_outside(carrying):
    here = cones(carrying, spline(carrying), is_at_rest=False)
    rng = np.random.default_rng(1)
    x = rng.normal(size=(len(here.vector), 3))
    outside = np.hstack([x, 0.9 * np.linalg.norm(x, axis=1, keepdims=True)])
    planes = here.planes_where_outside(outside, 0.0)
    kinds = set(here.limit.names)
    assert len(planes) == len(kinds) * len(here.path)
    assert (here.slack(planes, outside - here.vector) < 0).all()
    for _ in range(20):
        y = rng.normal(size=x.shape)
        inside = np.hstack([y, np.linalg.norm(y, axis=1, keepdims=True)])
        assert (here.slack(planes, inside - here.vector) > -1e-12).all()
    assert len(here.planes_where_outside(inside, 0.0)) == 0


def test_a_part_lost_at_rest_has_an_excess_and_a_finite_duration(carrying):
    leaning = spline(carrying, np.array([0, 0, 0, 0.5, 0, 0]))
    here = cones(carrying, leaning, is_at_rest=True)
    lost = here.excess > INNER_MARGIN
    assert lost.any()
    strict, lenient = HoldingLimit(carrying), here.limit
    speeds = [each.used(here.path).largest_speed(each.signs) for each in (strict, lenient)]
    assert (speeds[0][lost].min(axis=1) == 0).all()
    assert (speeds[1] > 0).all()
    level = cones(carrying, spline(carrying), is_at_rest=True)
    assert level.excess.max() <= 0.0
    level_speeds = [each.used(level.path).largest_speed(each.signs) for each in (strict, lenient)]
    np.testing.assert_array_equal(*level_speeds)
