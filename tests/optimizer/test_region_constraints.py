"""Region constraints on the tool: segment, compulsory point, rotation tolerance, goal."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import begun

from tubeplanner import GoalRegion, Tube
from tubeplanner.geometry.tube.regions import Capsules
from tubeplanner.geometry.tube.rotation import SEGMENT, STAYING, TURNING
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.limits.speed_limits import speed_limits
from tubeplanner.optimizer.control_variables import FIXED, ControlVariables
from tubeplanner.optimizer.descent import SequentialProgram
from tubeplanner.optimizer.phased_spline import PhasedSpline, sampled
from tubeplanner.optimizer.region_constraints import (
    EvaluatedRegions,
    EvaluatedRotation,
    Planes,
    evaluated_ball,
    evaluated_points,
    evaluated_speeds,
    goal_keys,
)
from tubeplanner.optimizer.rows import EvaluatedSpeedLimit
from tubeplanner.optimizer.tube_phases import OrderedSegments

STEP = 1e-6
MARGIN = 0.005
NUMBERS = np.array([[7], [8]])
SPANS = {"angle": SEGMENT, "angle, turning on": TURNING, "angle, stopped": STAYING[1]}
SIDE_NUMBERS = np.array([[3, 4], [5, 6]])


def with_boxes(tube):
    """Return a tube with a flat box and a tall one about its two segments."""
    sections = [{"box": [0.3, 0.2], "up": [0.2, 0.5, 1]}, {"box": [0.1, 0.4], "up": [1, 0.3, -2]}]
    return Tube(tube.points, None, cross_section=sections)


def evaluated(kind, case, spline=None):
    problem, own, samples = case
    tube = with_boxes(problem.tube) if kind == "box" else problem.tube
    if kind in ("points", "goal"):  # at a place that is no end, as good as any
        samples = samples.where(np.array([4]))
        tube = replace(tube, pass_through_points="all")
    at = sampled(spline or own, samples)
    path = PathSamples(problem, at.by_x, lambda: samples.phase)
    if kind == "points":
        return evaluated_points(tube, at, path, tube.regions, MARGIN, NUMBERS)
    if kind == "goal":
        ending = replace(problem, goal=GoalRegion(tube.points[-1], 0.1))
        return evaluated_ball(ending, at, path, dict.fromkeys(goal_keys(ending), 7))[0]
    if kind in SPANS:
        turns = (tube.rotation, at, path, MARGIN, np.array([9, 10]), path.segment)
        return EvaluatedRotation(*turns, SPANS[kind]).angle()
    if kind in ("tool_speed", "tool_acceleration", "point_speed"):
        limits = {limit.kind: limit for limit in speed_limits(problem)}
        limit = EvaluatedSpeedLimit(limits[kind], at, path, np.arange(len(limits[kind].keys)))
        return evaluated_speeds(limit, 0.8)[-1]
    numbers = SIDE_NUMBERS if kind == "box" else NUMBERS
    runs = (range(1), range(1, 2))
    segments = OrderedSegments(tube.points, tube.effective_radius, runs, samples)
    tool = (path.tool_pose[1], lambda: {0: path.tool_jacobian[:, :3]})
    margin = np.full(len(path.segment), MARGIN)
    return EvaluatedRegions(at, *tool, tube.regions, path.segment, margin, numbers, segments)


def sizes(here):
    """Return radii of the samples' capsules, and both ends of their axes."""
    regions, segment = here.regions, here.segment
    return regions.radius[segment], regions.begin[segment], regions.end[segment]


def random_planes(here, seed=0):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(40, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    bounded = np.flatnonzero(np.isfinite(here.regions.radius[here.segment]))
    sample = rng.choice(bounded, 40)
    return Planes(sample, normal, here.segment[sample], np.zeros(40, dtype=bool))


@pytest.mark.parametrize(
    "kind",
    ["tube", "box", *SPANS, "points", "goal", "tool_speed", "tool_acceleration", "point_speed"],
)
def test_rows_have_the_derivatives_of_their_slack(case, kind):
    here, spline = evaluated(kind, case), case[1]
    planes = random_planes(here)
    rows = here.rows(planes)
    np.testing.assert_array_equal(rows.slack, here.slack(planes))
    tolerance = here.regions.kind(planes.normal, planes.segment)
    np.testing.assert_array_equal(rows.limit, here.numbers[planes.segment, tolerance])
    rng = np.random.default_rng(5)
    change, switching = rng.normal(size=spline.control_points.shape), rng.normal(size=1)
    near = change[rows.first[:, None] + np.arange(4)]
    expected = np.einsum("rkj,rkj->r", rows.control, near) + rows.switching @ switching
    sides, vectors = [], []
    for sign in (STEP, -STEP):
        switching_times = spline.switching_times + sign * np.array([0, switching[0], 0])
        after = PhasedSpline(spline.grid, switching_times, spline.control_points + sign * change)
        there = evaluated(kind, case, after)
        sides.append(there.slack(planes))
        vectors.append(there.vector)
    numeric = (sides[1] - sides[0]) / (2 * STEP)
    np.testing.assert_allclose(numeric, expected, atol=3e-4 * abs(expected).max())
    after = (vectors[0] - vectors[1]) / (2 * STEP)
    predicted = here.after(change, switching) - here.vector
    np.testing.assert_allclose(after, predicted, atol=3e-4 * abs(predicted).max())
    assert here.after(change, 0 * switching).shape == here.vector.shape


def test_the_excess_is_the_tubes_own_and_planes_are_outward_and_at_both_caps(case):
    problem, _, samples = case
    tube = evaluated("tube", case)
    radius, begin, end = sizes(tube)
    tool = problem.robot.tool_position(tube.at.position)
    own = problem.tube.margin(tool)[np.arange(len(tool)), samples.phase]
    np.testing.assert_allclose(tube.excess - MARGIN, -own / radius, atol=1e-9)
    planes, count = tube.planes, len(tube.vector)
    outward = planes.where(np.arange(count))
    np.testing.assert_allclose(-tube.slack(outward), tube.excess, atol=1e-9)
    axis = (end - begin) / np.linalg.norm(end - begin, axis=1, keepdims=True)
    caps = planes.where(np.arange(count, 3 * count))
    np.testing.assert_allclose(caps.normal, np.concatenate([axis, -axis]))
    none = planes.where(np.zeros(len(planes), dtype=bool))
    assert len(outward.and_also(none)) == len(none.and_also(outward)) == count
    assert len(outward.and_also(outward)) == 2 * count


@pytest.mark.parametrize("kind", ["tube", "box", "angle", "points"])
def test_every_plane_holds_the_region(case, kind):
    """Whatever the normal: what is inside by the distance to the axis is behind the plane."""
    here = evaluated(kind, case)
    planes = random_planes(here)
    assert (-here.slack(planes) <= here.excess[planes.sample] + 1e-9).all()


@pytest.mark.parametrize("kind", ["tube", "box", "angle", "tool_speed", "tool_acceleration"])
def test_tangent_planes_are_where_vectors_are_outside(case, kind):
    here = evaluated(kind, case)
    radius = here.regions.radius[here.segment]
    size = np.where(np.isfinite(radius), radius, 1.0)[:, None]
    direction = np.random.default_rng(2).normal(size=here.vector.shape)
    outside = here.vector + 3 * size * direction
    excess = replace(here, vector=outside).excess
    planes = here.planes_where_outside(outside, 0.5)
    np.testing.assert_array_equal(planes.sample, np.flatnonzero(excess > 0.5 + 0.002))
    assert len(planes) > 0
    there = here.slack(planes, outside - here.vector)
    np.testing.assert_allclose(-there, excess[planes.sample], rtol=1e-9)
    assert len(here.planes_where_outside(outside, excess.max())) == 0


AXES = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
CAPSULES = Capsules(AXES[:-1], AXES[1:], np.array([0.1, 0.2]))


def corner(place, later, predicted, regions=CAPSULES):
    """Return a sample in the first of two regions with a right angle between them, and planes.

    A step would take it to `later`, in the segment `predicted`.
    """
    here = EvaluatedRegions(
        at=None,
        vector=np.array([place]),
        derivative=lambda: {0: np.zeros((1, 3, 2))},
        regions=regions,
        segment=np.zeros(1, dtype=np.int64),
        margin=np.full(1, MARGIN),
        numbers=np.zeros((2, 1 if regions is CAPSULES else 2), dtype=np.int64),
        segments=SimpleNamespace(at=lambda _: np.array([predicted]), in_run=np.ones(1, dtype=bool)),
    )
    return here, here.planes_where_outside(np.array([later]), 0.0)


BOXES = Tube(AXES, None, cross_section={"box": [0.4, 0.1], "up": [0, 0, 1]}).regions


@pytest.mark.parametrize(("regions", "own"), [(CAPSULES, 0.1), (BOXES, 0.05)])
def test_a_chains_plane_is_that_of_the_segment_a_step_would_be_in(regions, own):
    """It touches the second region, which reaches 0.2 m beyond its axis along x."""
    here, planes = corner([0.9, 0.0, 0], [1.3, 0.5, 0], 1, regions)
    np.testing.assert_allclose(planes.normal, [[1, 0, 0]])
    assert planes.segment.tolist() == [1]
    slack = 1 + 0.2 * (1 - MARGIN) - 0.9
    assert here.slack(planes)[0] == pytest.approx(slack / own)


def test_a_chains_plane_never_cuts_the_samples_own_capsule():
    """Samples in chains have no caps."""
    capsules, planes = corner([0.1, 0.0, 0], [0.7, 0.5, 0], 1)
    assert len(planes) == 0  # the plane of the second capsule would be behind the first one's end
    place = (np.zeros(1, dtype=np.int64), np.array([[-1.0, 0, 0]]), np.ones(1, np.int64))
    behind, alone = (Planes(*place, np.array([is_alone])) for is_alone in (False, True))
    assert capsules.slack(behind)[0] == pytest.approx((0.1 + 0.1 * (1 - MARGIN)) / 0.1)
    # In corrections, it holds the second one alone.
    assert capsules.slack(alone)[0] == pytest.approx((0.1 - 1 + 0.2 * (1 - MARGIN)) / 0.1)
    capsules, _ = corner([0.9, 0.05, 0], [0.9, 0.05, 0], 0)
    np.testing.assert_allclose(capsules.planes.normal, [[0, 1, 0]])


def test_a_boxs_rows_name_the_side_that_binds(case):
    here = evaluated("box", case)
    first = np.flatnonzero(here.segment == 0)[:1]
    across, up, along = here.regions.frame[0]
    for normal, number in ((across, 3), (-up, 4), (along, 4)):  # the flat box's reach is its height
        assert here.rows(Planes(first, normal[None], *np.zeros((2, 1), np.int64))).limit == number


def test_a_boxs_planes_are_those_of_all_its_faces(case):
    here = evaluated("box", case)
    planes, count = here.planes, len(here.vector)
    assert len(planes) == 7 * count
    np.testing.assert_allclose(-here.slack(planes.where(np.arange(count))), here.excess, atol=1e-9)
    for k in (0, 1):
        normals = planes.normal[planes.segment == k]
        np.testing.assert_allclose(abs(normals @ here.regions.frame[k].T).max(axis=1), 1.0)
        assert len(np.unique(np.round(normals, 9), axis=0)) == 6
    # As shares of what each reaches, the face that a point is nearest to tells all.
    worst = np.full(count, -np.inf)
    np.maximum.at(worst, planes.sample, -here.slack(planes))
    np.testing.assert_allclose(worst, here.excess, atol=1e-9)


def test_a_ball_in_a_tube_of_boxes_has_the_price_of_the_smaller_side(case):
    problem, own, samples = case
    sections = [{"box": [0.3, 0.2], "up": [0.2, 0.5, 1]}, {"box": [0.25, 0.4], "up": [1, 0.3, -2]}]
    tube = Tube(problem.tube.points, None, cross_section=sections, pass_through_points="all")
    samples = samples.where(np.array([4]))
    at = sampled(own, samples)
    path = PathSamples(problem, at.by_x, lambda: samples.phase)
    ball = evaluated_points(tube, at, path, tube.regions, MARGIN, SIDE_NUMBERS)
    assert ball.numbers.tolist() == [[4]]  # the height of the first: 0.1 m, and 0.125 m beside it
    np.testing.assert_allclose(ball.regions.radius, [0.1])


TOLERANCE = 0.02


@pytest.fixture(scope="module", params=["two_link/around_a_post", "ur5/level_tray"])
def goal_case(request, bundled):
    problem = bundled(request.param)
    problem = replace(problem, goal=GoalRegion(problem.tube.points[-1], TOLERANCE))
    return problem, begun(problem, 12)


def test_the_polyhedron_about_the_ball_is_given_from_the_beginning(goal_case):
    """At its centre, where no plane is near; it reaches little farther than the ball."""
    problem, spline = goal_case
    ball = SequentialProgram(problem, spline.grid).iterate(spline).regions[-1]
    assert len(ball.planes) == 26
    assert ball.is_crossed
    np.testing.assert_allclose(ball.slack(ball.planes), 1 - 0.005, atol=1e-9)
    ways = np.random.default_rng(0).normal(size=(200, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    assert (ways @ ball.planes.normal.T).max(axis=1).min() > 0.85


def test_every_tolerance_of_a_goal_has_its_key(goal_case):
    problem, spline = goal_case

    def with_goal(*tolerances):
        return replace(problem, goal=GoalRegion(problem.goal.position, *tolerances))

    def kinds(problem):
        return [key.kind for key in goal_keys(problem)]

    assert kinds(replace(problem, goal=None)) == kinds(with_goal()) == []
    assert kinds(with_goal(0.01)) == ["tolerance"]
    if problem.tube.rotation is not None:
        rotated = with_goal(0.0, 0.04)
        assert kinds(rotated) == ["rotation_tolerance"]
        iterate = SequentialProgram(rotated, spline.grid).iterate(spline)
        assert iterate.regions[-1].regions.radius[-1] == 0.04
        bounds = with_goal(0.0, (0.04, 0.03, np.inf))
        iterate = SequentialProgram(bounds, spline.grid).iterate(spline)
        assert [len(one.segment) for one in iterate.rotations][-1] == 1


def test_a_step_leads_the_tool_no_farther_than_the_balls_edge(goal_case):
    """Whatever the step, and whether or not joints are redundant for a point."""
    problem, spline = goal_case
    variables = ControlVariables(problem, spline.grid)
    assert (variables.column[-3:] == variables.column.max()).all()
    assert variables.column.max() != FIXED
    points = spline.control_points
    assert len(variables.held(points)) == 0
    step = np.zeros_like(variables.lower)
    for size, off in ((1e-3, None), (0.2, 0.995 * TOLERANCE)):
        step[-1] = size
        tool = problem.robot.tool_position(variables.moved(points, step)[-1:])[0]
        away = np.linalg.norm(tool - problem.goal.position)
        free = problem.robot.tool_position((points + variables.change(step))[-1:])[0]
        expected = np.linalg.norm(free - problem.goal.position) if off is None else off
        assert away == pytest.approx(expected, abs=3e-7)
