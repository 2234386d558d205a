"""Motions whose measures have closed forms, for the tests of the second stage's measures."""

import numpy as np
from begun_splines import constraints_of
from cases import one_joint
from scipy.interpolate import BSpline

from tubeplanner import PlanningProblem, Tube
from tubeplanner.refinement.interval_motion import IntervalMotion
from tubeplanner.refinement.phased_spline import DEGREE, PhasedSpline
from tubeplanner.refinement.spline_start import knot_grid

SWITCHING_TIMES = np.array([0.0, 0.4, 1.0])
RUN_IN = 0.8


def monotone(joints, travel, seed=2):
    """Return a spline of joints that go so far, each without turning back."""
    grid = knot_grid(SWITCHING_TIMES, 10)
    steps = np.random.default_rng(seed).uniform(0.2, 1.0, (grid.control_point_count - 1, joints))
    steps[:2] = steps[-2:] = 0.0
    course = np.vstack([np.zeros(joints), np.cumsum(steps, axis=0)])
    return PhasedSpline(grid, SWITCHING_TIMES, course / course[-1] * travel)


def evaluated(problem, spline, run_in=RUN_IN):
    return constraints_of(problem, spline.grid, run_in=run_in).at(spline)


def motion(problem, spline, run_in=RUN_IN):
    """Return a spline as measures take it."""
    return IntervalMotion(evaluated(problem, spline, run_in), run_in)


def curve(spline):
    """Return scipy's spline."""
    return BSpline(spline.grid.knots(spline.switching_times), spline.control_points, DEGREE)


def at_knots(spline):
    """Return accelerations at the knots, jerks between them, and widths."""
    knots, found = spline.grid.breakpoints(spline.switching_times), curve(spline)
    return found(knots, 2), found((knots[1:] + knots[:-1]) / 2, 3), np.diff(knots)[:, None]


def unbounded(robot):
    """A problem of two segments that asks nothing of a robot but its limits."""
    joints = robot.joint_count
    tool = robot.tool_position(np.zeros((1, joints)))[0]
    tube = Tube(tool + np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]]), 1000.0)
    return PlanningProblem(robot, tube, np.zeros(joints), self_collision=False)


def bar(tmp_path, **limits):
    """A bar in free rotation: its effort is its inertia times its acceleration."""
    return unbounded(one_joint(tmp_path, **limits))
