"""SplineConstraints: all constraints at samples, with added samples."""

from dataclasses import replace

import numpy as np
import pytest
from cases import constraints_of, with_motors

from tubeplanner import GoalRegion, PlanningProblem, Tube
from tubeplanner.geometry.tube.rotation import SEGMENT, STAYING, TURNING
from tubeplanner.limits.joint_efforts import EffortRate
from tubeplanner.limits.path_samples import (
    FRICTION_PIECES,
    CoulombFriction,
    PathSamples,
    blended_friction,
)
from tubeplanner.limits.speed_limits import minimum_duration, scaling_factor, speed_limits
from tubeplanner.optimizer.link_constraints import LinkConstraints
from tubeplanner.optimizer.phased_spline import PhasedSpline, VelocityHull, sampled
from tubeplanner.optimizer.region_constraints import (
    EvaluatedRotation,
    evaluated_rotation,
    goal_keys,
)
from tubeplanner.optimizer.rows import EvaluatedSpeedLimit, StepSize
from tubeplanner.optimizer.speed_floors import EvaluatedFloor, EvaluatedGates
from tubeplanner.optimizer.spline_constraints import BLENDED, WIDELY_BLENDED
from tubeplanner.optimizer.stages import SecondStage
from tubeplanner.optimizer.starts import knot_grid
from tubeplanner.optimizer.tube_phases import OrderedSegments
from tubeplanner.robot.joint_limits import EffortRange
from tubeplanner.trajectory.joint_trajectory import from_spline
from tubeplanner.trajectory.parts import common_intervals

ENDS = np.array([0.0, 0.4, 1.0])
STEP = 1e-6
LIMITS = (
    *("effort", "effort_rate", "velocity", "acceleration", "jerk"),
    *("velocity_by_position", "tool_speed", "tool_acceleration", "point_speed"),
)
FRICTION = {"backwards_friction": 4.0, "forwards_friction": 2.0}
ARMED = {"armature": 0.4, "viscous_friction": 3.0}
LINE = {"saturation_effort": 90.0, "no_load_velocity": 7.0}
RANGES = (
    EffortRange(0, np.array([-0.4, 0.3, 2.0]), *np.array([[190.0, 150, 170]] * 2)),
    EffortRange(1, np.zeros(1), np.array([130.0]), np.array([160.0])),
)
# Limits of arms with motors, their friction blended as it is in the optimisation.
MOTORS = {
    "effort with viscous friction": ARMED,
    "effort with Coulomb friction": FRICTION,
    "effort with uncertain friction": {**ARMED, **FRICTION, "friction_uncertainty": 0.3},
    "effort by direction and position": {**FRICTION, "effort_ranges": RANGES},
    "effort_rate with viscous friction": ARMED,
    "motor_curve of an ideal motor": LINE,
    "motor_curve with friction": {**LINE, **ARMED, **FRICTION, "friction_uncertainty": 0.3},
}
# Pieces of blended friction, as they are beyond its kinks.
PIECES = {f"effort with the piece {piece} of friction": piece for piece in FRICTION_PIECES}
MOTORS |= {key: {**FRICTION, "friction_uncertainty": 0.3} for key in PIECES}
ALL_LIMITS = (*LIMITS, *MOTORS)
# The u between which the reference orientation turns.
SPANS = {
    "rotation": SEGMENT,
    "rotation, the reference turning on": TURNING,
    "rotation, the reference stopped": STAYING[0],
}
# Floors of the tool's speed in the second segment, and in a given duration.
FLOORS = {"floor": False, "floor in a given duration": True}
KINDS = (*ALL_LIMITS, "velocity of the hull", *SPANS, "rotation at the goal", "links")
KINDS = (*KINDS, *FLOORS, "gates")


class Kinds:
    """One kind of constraint, at any spline."""

    def __init__(self, kind, case):
        self.kind, (self.problem, spline, self.samples) = kind, case
        if kind in MOTORS:
            robot = with_motors(self.problem.robot, **MOTORS[kind])
            self.problem = replace(self.problem, robot=robot)
        self.links = LinkConstraints(self.problem)
        self.links.set_samples(spline, spline.grid.samples_at(ENDS, np.linspace(0.2, 0.8, 9)))

    def at(self, spline):
        if self.kind == "links":
            return self.links.at(spline)
        points = self.samples
        if self.kind == "velocity of the hull":
            points = VelocityHull(len(spline.control_points))
        if self.kind in ("rotation at the goal", "gates"):  # at samples as good as any
            points = points.where(np.array([4, 9][: 1 + (self.kind == "gates")]))
        at = sampled(spline, points)
        path = PathSamples(
            self.problem, at.by_x, lambda: self.samples.phase, lambda: self.friction(at.by_x[1])
        )
        if self.kind in FLOORS:
            floor, number = np.array([np.inf, 0.4])[path.segment], np.arange(2)[path.segment]
            return EvaluatedFloor(at, path, floor, 0.8, FLOORS[self.kind], number)
        if self.kind == "gates":
            first, middle, last = self.problem.tube.points
            corners = [first, middle, middle + np.array([0.0, 0.1, 0.2]), last]
            speeds = [None, {"between": [0.1, 0.2]}, None]
            return EvaluatedGates(at, path, Tube(corners, 0.2, tool_speed=speeds))
        if self.kind in SPANS:
            own = (np.arange(2), path.segment, SPANS[self.kind])
            return EvaluatedRotation(self.problem.tube.rotation, at, path, 0.005, *own)
        if self.kind == "rotation at the goal":
            goal = GoalRegion(self.problem.tube.points[-1], 0.1, (0.3, np.inf, 0.2))
            ending = replace(self.problem, goal=goal)
            numbers = {key: number for number, key in enumerate(goal_keys(ending))}
            return evaluated_rotation(ending, at, path, numbers)[0]
        limits = {limit.kind: limit for limit in speed_limits(self.problem)}
        limit = limits[self.kind.split()[0]]
        return EvaluatedSpeedLimit(limit, at, path, np.arange(len(limit.keys)))

    def friction(self, rate):
        """Return blended friction whose width does not change with the path."""
        widest = np.append(rate, np.full((1, rate.shape[1]), 8.0), axis=0)
        motors, unknown = self.problem.robot.motors, np.full_like(widest, np.nan)
        blended = blended_friction(motors, widest, unknown, 0.4, piece=PIECES.get(self.kind))
        names = CoulombFriction.__dataclass_fields__
        return CoulombFriction(*(getattr(blended, name)[:-1] for name in names))


@pytest.mark.parametrize("kind", KINDS)
def test_rows_have_the_derivatives_of_their_slack(case, kind):
    """By control points, switching times and the duration together, along a random direction."""
    kinds, spline, duration = Kinds(kind, case), case[1], 0.8
    rows = kinds.at(spline).rows(duration, None)
    assert len(rows) > 0
    rng = np.random.default_rng(5)
    change = rng.normal(size=spline.control_points.shape)
    change[:3] = change[-3:] = 0.0
    switching, eta = rng.normal(size=1), 0.7
    near = change[rows.first[:, None] + np.arange(4)]
    expected = np.einsum("rkj,rkj->r", rows.control, near)
    expected += rows.switching @ switching + rows.duration * eta
    sides = []
    for sign in (STEP, -STEP):
        switching_times = ENDS + sign * np.array([0, switching[0], 0])
        displaced = PhasedSpline(
            spline.grid, switching_times, spline.control_points + sign * change
        )
        sides.append(kinds.at(displaced).slack(duration, 1 + sign * eta)[rows.index])
    numeric = -(sides[0] - sides[1]) / (2 * STEP)
    scale = abs(expected).max()
    np.testing.assert_allclose(numeric / scale, expected / scale, atol=3e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_rows_have_the_slack_of_the_trajectory_and_those_left_out_cannot_be_broken(case, kind):
    """By every control point and switching time, either way."""
    here, size = Kinds(kind, case).at(case[1]), StepSize(0.01, np.array([0.005]))
    every, some, there = here.rows(0.8, None), here.rows(0.8, size), here.slack(0.8, 1.0)
    np.testing.assert_allclose(there[every.index], every.slack, atol=1e-12)
    bounded = np.flatnonzero(np.isfinite(there) & (there < 1 - 0.005 - 1e-12))
    assert set(bounded.tolist()) <= set(every.index.tolist()) <= set(range(len(there)))
    left_out = ~np.isin(every.index, some.index)
    worst = size.control * np.einsum("rkj,rkj->r", every.control, np.sign(every.control))
    worst += abs(every.switching) @ size.switching
    np.testing.assert_allclose(every.reach(size), worst, rtol=1e-12)
    assert (every.slack[left_out] >= worst[left_out]).all()
    np.testing.assert_array_equal(every.where(~left_out).slack, some.slack)


@pytest.mark.parametrize("kind", ALL_LIMITS)
def test_rows_know_what_the_duration_gives(case, kind):
    """At the duration that the limit allows, the tightest row has no slack; beyond it, some."""
    limit = Kinds(kind, case).at(case[1])
    y = float(limit.squared_durations.max())
    rows = limit.rows(np.sqrt(y), None)
    assert rows.slack.min() == pytest.approx(0.0, abs=1e-9)
    eta = 1e-5
    later = limit.rows(np.sqrt(y * (1 + eta)), None)
    tight = int(rows.slack.argmin())
    gained = (later.slack[tight] - rows.slack[tight]) / eta
    assert -rows.duration[tight] == pytest.approx(gained, rel=1e-3)
    used, signs = limit.limit.used(limit.path), limit.limit.signs
    for longer in (0.7, 1.3):
        there, slack = limit.rows(longer * 0.8, None), limit.slack(0.8, longer**2)
        expected = longer**used.degree * there.slack
        np.testing.assert_allclose(slack[there.index], expected, rtol=1e-12, atol=1e-12)
    for i in np.flatnonzero(limit.squared_durations > 0):  # no speed is too fast elsewhere
        own = used.at(limit.squared_durations[i] ** -0.5)[i]
        assert max((sign * own).max() for sign in signs) == pytest.approx(1.0, abs=1e-9)


def test_effort_rates_count_on_both_sides_of_every_knot(case):
    """There the jerk jumps: of two neighbouring intervals, each asks for a duration of its own."""
    problem, spline, _ = case
    iterate = constraints_of(problem, spline.grid).at(spline)
    (rates,) = (part for part in iterate.limits if part.limit.kind == "effort_rate")
    shape = from_spline(problem.robot.joint_names, spline.bspline())
    at_ends = shape.per_piece(2)
    known = (at_ends.position, at_ends.velocity, at_ends.acceleration, shape.jerk_per_piece(2))
    limit = EffortRate(problem.robot.limits.effort_rate)
    used = limit.used(PathSamples(problem, np.stack(known)))
    slowest = used.largest_speed(limit.signs).min(axis=1) ** -2.0
    after, before = slowest[::2], slowest[1::2]
    assert abs(before[:-1] / after[1:] - 1).max() > 0.1
    each = rates.squared_durations.reshape(len(after), 3)
    np.testing.assert_allclose(each[:, 0], after, rtol=1e-6)
    np.testing.assert_allclose(each[:, 2], before, rtol=1e-6)
    assert iterate.squared_duration >= slowest.max() * (1 - 1e-6)


def test_the_rotations_rows_and_its_ball_are_its_margin(case):
    """The tightest of components and angle has the slack that the tube's own margin says."""
    (problem, spline, samples), margin = case, 0.1
    tube, at = problem.tube.rotation, sampled(spline, samples)
    path = PathSamples(problem, at.by_x, lambda: samples.phase)
    evaluated = EvaluatedRotation(tube, at, path, margin, np.arange(2), samples.phase)
    error = tube.error(*problem.robot.tool_pose(at.position), samples.phase)
    used = np.hstack([abs(error), np.linalg.norm(error, axis=1, keepdims=True)])
    used /= tube.bounds[samples.phase]
    np.testing.assert_allclose(evaluated.excess, used[:, :3].max(axis=1) - 1 + margin, atol=1e-12)
    np.testing.assert_allclose(evaluated.angle().excess, used[:, 3] - 1 + margin, atol=1e-12)
    slack = evaluated.slack(1.0, 1.0).reshape(len(used), -1).min(axis=1)
    np.testing.assert_allclose(slack, 1 - margin - used[:, :3].max(axis=1), atol=1e-12)
    assert set(evaluated.rows(1.0, None).limit) == {1}  # components of the second alone


def test_rows_beyond_kinks_leave_more_room_than_those_of_the_rotation(case):
    """At each sample, of the branches that are not its own."""
    problem, spline, samples = case
    tube, at = problem.tube.rotation, sampled(spline, samples)
    path = PathSamples(problem, at.by_x, lambda: samples.phase)
    rotation = EvaluatedRotation(tube, at, path, 0.005, np.arange(2), samples.phase)
    own, u = rotation.slack(1.0, 1.0), tube.projection(path.tool_pose[1], samples.phase)
    sides, counts = len(own) // len(u), []
    for kink in rotation.kinks(np.ones((2, 2), dtype=bool)):
        rows, every = kink.rows(1.0, None), kink.slack(1.0, 1.0)
        np.testing.assert_array_equal(rows.slack, every[rows.index])
        inside = ((u >= 0) & (u <= 1)) == (kink.span != TURNING)
        sample, side = np.divmod(np.arange(len(own)), sides)
        is_bounded = np.isfinite(tube.bounds[samples.phase[sample], side % 3])
        expected = np.flatnonzero(is_bounded & inside[sample] & (every >= own))
        np.testing.assert_array_equal(np.sort(rows.index), expected)
        counts.append(len(rows))
    assert min(counts) > 0
    assert all(not kink.rows(1.0, None) for kink in rotation.kinks(np.zeros((2, 2), dtype=bool)))
    still = replace(rotation, tube=replace(tube, rotation_change=0 * tube.rotation_change))
    assert still.kinks(np.ones((2, 2), dtype=bool)) == []


def test_rows_beyond_kinks_of_friction_leave_more_room(case):
    """Each at the rates of the other one of the two lower pieces, and nowhere else."""
    problem, spline, _ = case
    problem = replace(problem, robot=with_motors(problem.robot, **FRICTION))
    iterate = constraints_of(problem, spline.grid).at(spline)
    (effort,) = (each for each in iterate.limits if each.limit.kind == "effort")
    own, every = effort.rows(0.8, None), effort.slack(0.8, 1.0)
    for kink in iterate.friction_kinks:
        rows = kink.rows(0.8, None)
        assert 0 < len(rows) < len(own)
        assert (rows.slack >= every[rows.index]).all()
        same = own.where(np.searchsorted(own.index, rows.index))
        assert (abs(rows.control - same.control).max(axis=(1, 2)) > 0).all()
    still = replace(problem, robot=with_motors(problem.robot, armature=0.4))
    assert constraints_of(still, spline.grid).at(spline).friction_kinks == ()


def test_a_tool_that_is_free_limits_nothing(case):
    """Only samples of the other segment use something, and all rows are its limit's."""
    problem, spline, samples = case
    problem = problem.with_tube(replace(problem.tube, tool_speed=[None, 0.9]))
    limit = Kinds("tool_speed", (problem, spline, samples)).at(spline)
    assert [(key.joint, key.segment) for key in limit.limit.keys] == [(None, 1)]
    squared = limit.squared_durations.ravel()
    assert (squared[samples.phase == 0] == 0).all()
    assert (squared[samples.phase == 1] > 0).all()
    assert set(limit.rows(np.sqrt(squared.max()), None).limit.tolist()) == {0}


def test_room_is_unused_by_segment(case):
    """A fraction of the region's size that counts as outside; least what is always left."""
    (problem, spline, _), slack = case, np.array([0.3, 0.0])
    plain, kept = (constraints_of(problem, spline.grid, slack=each) for each in (None, slack))
    before, after = (constraints.at(spline).regions[0] for constraints in (plain, kept))
    margin = before.margin
    expected = before.excess + np.maximum(slack[before.segment], margin) - margin
    np.testing.assert_allclose(after.excess, expected, atol=1e-12)
    assert {0, 1} == set(before.segment.tolist())
    free, run = plain.at(spline), constraints_of(problem, spline.grid, run_in=9.0).at(spline)
    assert (free.duration, run.duration) == (np.sqrt(free.squared_duration), 9.0)
    assert run.squared_duration == free.squared_duration


def test_between_samples_changes_nothing(case):
    problem, spline, _ = case
    constraints = constraints_of(problem, spline.grid)
    before, dense = constraints.at(spline), constraints.between_samples(spline)
    assert dense.squared_duration >= before.squared_duration * (1 - 1e-9)
    assert dense.excess >= before.excess - 1e-9
    assert len(dense.regions[0].vector) > 5 * len(before.regions[0].vector)
    again = constraints.at(spline)
    assert again.squared_duration == before.squared_duration
    assert len(again.regions[0].vector) == len(before.regions[0].vector)


@pytest.mark.parametrize("x", [0.0, 0.41, 1.0])
def test_samples_of_the_tube_are_added_on_either_side_of_an_instant_too(case, x):
    """Nearer to each other than those between which nothing is looked at."""
    problem, spline, _ = case
    constraints = constraints_of(problem, spline.grid)
    known = len(constraints._tube_samples.fraction)
    constraints.add_samples(spline, x)
    times = constraints._tube_samples.times(spline.switching_times)[known:]
    spacing = np.diff(spline.grid.breakpoints(spline.switching_times)).max() / 20
    beside = np.unique(np.round(times, 9))
    assert np.diff(beside).max() <= spacing / 4 + 1e-9
    assert [beside[0] < x, beside[-1] > x] == [x > 0, x < 1]
    assert abs(beside - x).max() < spacing


def test_segments_that_a_motion_missed_are_asked_for_from_then_on(case, monkeypatch):
    constraints = constraints_of(case[0], case[1].grid)
    missed = [np.array([True, False]), np.array([False, True]), np.array([True, True])]
    monkeypatch.setattr(OrderedSegments, "missed", lambda self, tool: missed.pop(0))
    requested = []
    for is_new in (True, True, False):
        assert constraints._ask_for_missed(np.zeros((1, 3))) is is_new
        requested.append(constraints._is_requested.tolist())
    assert requested == [[True, False], [True, True], [True, True]]


# Blended friction in the optimisation, beside what is exact: on whole splines.

BRAKING_FRICTION = {"backwards_friction": [0.0, 14.0], "forwards_friction": [0.0, 1.0]}


def step(x):
    return x**3 * (10 - 15 * x + 6 * x**2)


def constraints_and_spline(robot, turns, intervals=60, **motors):
    """Return a motion over many knots; joint 2 brakes, and may come back slowly."""
    robot, grid = with_motors(robot, **motors), knot_grid(ENDS, intervals)
    knots = grid.knots(ENDS)
    x = np.convolve(knots[1:-1], np.full(3, 1 / 3), "valid")[:, None]
    displaced = step(np.minimum(x / 0.35, (1 - x) / 0.65)) if turns else step(x)
    points = np.hstack([0.2 * step(x), 0.8 * displaced - 1.5])
    points[:3], points[-3:] = points[0], points[-1]
    tube = Tube(robot.tool_position(points[[0, len(points) // 2, -1]]), 9.0)
    problem = PlanningProblem(robot, tube, points[0], points[-1], self_collision=False)
    return constraints_of(problem, grid), PhasedSpline(grid, ENDS, points)


def efforts(constraints, spline):
    current = constraints.between_samples(spline)
    return next(part for part in current.limits if part.limit.kind == "effort")


def beyond(constraints, spline, intervals, near=0.15):
    """Return the fraction of the squared duration that efforts ask for beyond what they need."""
    constraints.blend(intervals)
    effort = efforts(constraints, spline)
    exact = scaling_factor(constraints._problem, *effort.at.by_x[:3]) ** -2.0
    x = effort.at.evaluation_points.times(ENDS)
    return (effort.squared_durations / exact - 1)[(x > near) & (x < 1 - near)]


def test_blended_over_fewer_intervals_it_comes_nearer_to_what_is_exact(two_link):
    """And is never less."""
    constraints, spline = constraints_and_spline(two_link, True, **BRAKING_FRICTION)
    wide, narrow, least = (beyond(constraints, spline, k) for k in (WIDELY_BLENDED, BLENDED, 1.0))
    assert least.min() > -1e-9
    assert (narrow - least).min() > -1e-9
    assert (wide - narrow).min() > -1e-9
    affected = [(fraction > 1e-6).mean() for fraction in (wide, narrow, least)]
    assert 0 < affected[2] < affected[1] < affected[0] < 0.2
    assert wide.max() > 0.1
    constraints, spline = constraints_and_spline(two_link, True, intervals=8, **BRAKING_FRICTION)
    squared = []
    for intervals in (len(spline.control_points), 50.0):
        constraints.blend(intervals)
        squared.append(efforts(constraints, spline).squared_durations)
    np.testing.assert_array_equal(*squared)


def test_where_nothing_reverses_it_is_exact_in_the_end(two_link):
    """At start and goal joints are slow, but their directions are known."""
    constraints, spline = constraints_and_spline(two_link, False, **BRAKING_FRICTION)
    blended = constraints.between_samples(spline).duration
    shape = from_spline(two_link.joint_names, spline.bspline())
    assert blended == pytest.approx(minimum_duration(constraints._problem, shape), rel=1e-3)
    for intervals in (WIDELY_BLENDED, BLENDED):
        fraction = beyond(constraints, spline, intervals, 0.02)
        assert fraction.any() == (intervals == WIDELY_BLENDED)


def test_blending_changes_something_only_once_and_only_with_coulomb_friction(two_link):
    constraints, _ = constraints_and_spline(two_link, True, **BRAKING_FRICTION)
    each = [constraints.blend(k) for k in (BLENDED, WIDELY_BLENDED, WIDELY_BLENDED, BLENDED)]
    assert each == [False, True, False, True]
    smooth, _ = constraints_and_spline(two_link, True, viscous_friction=3.0)
    assert not smooth.blend(WIDELY_BLENDED)


def test_a_second_stage_has_time_by_exact_scaling_and_watches_reversals_where_it_has_not(two_link):
    constraints, spline = constraints_and_spline(two_link, True, **BRAKING_FRICTION)
    problem, shape = constraints._problem, from_spline(two_link.joint_names, spline.bspline())
    least = minimum_duration(problem, shape)
    stage = SecondStage(problem, spline, 1.01 * least, 0.0)
    counts = []
    for longest in (1.001 * least, 0.999 * least):
        assert stage._has_time_with_friction(spline, longest) == (longest > least)
        samples = stage._program.iterate(spline).watched[0].evaluation_points
        counts.append(len(samples.phase))
    reversals = common_intervals(shape).start > 0
    assert counts[1] - counts[0] == reversals.sum() > 0
    watched = samples.times(spline.switching_times)[counts[0] :]
    np.testing.assert_allclose(shape.velocity(watched).min(axis=1), 0.0, atol=1e-6)
