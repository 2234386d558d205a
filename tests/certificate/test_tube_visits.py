"""Which segments a trajectory visits when, and its least margin and passages in them."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import wandering
from numpy.polynomial import Chebyshev, Polynomial

from tubeplanner import (
    JointTrajectory,
    LimitOverrides,
    Obstacle,
    PlanningProblem,
    Seed,
    Tube,
    load_robot,
    placement_of,
    verify,
)
from tubeplanner.certificate.enclosed_quantities import enclosed_tool
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.certificate.segment_margins import best_switching_samples
from tubeplanner.certificate.tube_visits import (
    Visit,
    least_margin,
    passages,
    tube_visits,
    visited_parts,
)
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.trajectory.joint_trajectory import concatenate

SEED = Seed(np.array([0.0, -1.0]))
AXIS = Tube([[-9, 0, 0], [9, 0, 0]], 1.0)
POINTS = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0]]
POST = ("two_link/around_a_post", "branch-and-bound")

# The least margin of known visits, against dense evaluation and closed forms.


def wavy(robot, seed):
    """Return a trajectory that wanders about, and its enclosed tool."""
    trajectory = wandering(robot, seed)
    tube = Tube([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 1.0)
    return trajectory, enclosed_tool(robot, tube, trajectory, 1e-7)


def whole(trajectory):
    return [Visit(0, 0.0, trajectory.duration)]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("radius", [0.02, 0.1, 0.5])
def test_the_least_margin_is_bracketed(two_link, seed, radius):
    trajectory, tool = wavy(two_link, seed)
    tube = Tube(POINTS, radius)

    def margins(time):
        return tube.margin(two_link.tool_position(trajectory.position(time)))

    least = least_margin(tube, tool, [Visit(0, 0.0, 0.23), Visit(1, 0.23, trajectory.duration)])
    t = np.linspace(0, trajectory.duration, 40_001)
    margin = margins(t)
    true = min(margin[t <= 0.23, 0].min(), margin[t >= 0.23, 1].min())
    assert least.lower_bound <= true + 1e-9
    assert least.attained >= true - 1e-6
    assert least.attained - least.lower_bound <= max(5e-7, 0.02 * abs(least.attained) + 2e-7)
    here = margins(np.array([least.time]))[0, least.segment]
    assert here == pytest.approx(least.attained, abs=2e-7)


def test_what_the_polynomials_miss_is_taken_off_the_margin(two_link):
    """A tool that may be a millimetre elsewhere: a bound that is lower by as much."""
    trajectory, tool = wavy(two_link, 1)
    rough = replace(tool, error=tool.error + 1e-3)
    exact, least = (
        least_margin(Tube(POINTS, 0.5), each, whole(trajectory)) for each in (tool, rough)
    )
    assert least.attained == exact.attained
    assert least.lower_bound == pytest.approx(exact.lower_bound - 1e-3, abs=1e-9)


def along_x(*offsets):
    """Return tools that go along x, an interval of a second each, beside it by polynomials."""
    count, degree = len(offsets), max(len(each) for each in offsets) - 1
    coefficients = np.zeros((degree + 1, count, 3))
    coefficients[-2, :, 0] = 1.0
    for i, each in enumerate(offsets):
        coefficients[degree + 1 - len(each) :, i, 1] = each
    return Enclosure(np.arange(count) * 1.0, np.ones(count), coefficients, np.zeros((count, 3)))


@pytest.mark.parametrize("bow", [0.1, 0.9])
def test_a_bow_between_two_ends_is_bracketed(bow):
    """A parabola over one interval, whose hull is twice as high."""
    least = least_margin(AXIS, along_x([-4 * bow, 4 * bow, 0.0]), [Visit(0, 0.0, 1.0)])
    assert least.lower_bound <= 1.0 - bow + 1e-12
    assert least.attained >= 1.0 - bow - 1e-12
    assert least.attained - least.lower_bound <= 0.02 * abs(least.attained) + 2e-7


@pytest.mark.parametrize("height", [1e-3, 3.5e-3, 6e-3])
def test_what_is_settled_at_once_still_counts(height):
    """A flat bow of 9 mm; and waves that are lower, but whose hull needs to be halved."""
    waves = height * Chebyshev.basis(7, domain=[0, 1]).convert(kind=Polynomial).coef[::-1]
    bow = 9e-3
    least = least_margin(AXIS, along_x([-4 * bow, 4 * bow, 0.0], waves), [Visit(0, 0.0, 2.0)])
    assert 0.975 <= least.lower_bound <= 1.0 - bow + 1e-12


@pytest.mark.parametrize("seed", range(2))
def test_visits_are_covered_whole(two_link, seed):
    """Whenever they begin and end, their parts of intervals are as long as they are."""
    trajectory, tool = wavy(two_link, seed)
    times = np.sort(np.random.default_rng(seed).uniform(0, trajectory.duration, 3))
    times = [0.0, *times, trajectory.duration]
    visits = [Visit(k, begin, end) for k, (begin, end) in enumerate(pairwise(times))]
    interval, start, width, segment = visited_parts(tool, visits)
    assert (start >= 0).all()
    assert (start + width <= 1 + 1e-12).all()
    covered = np.bincount(segment, width * tool.width[interval])
    np.testing.assert_allclose(covered, np.diff(times), atol=1e-12)


def test_touching_the_wall_is_decided_with_few_intervals(two_link, monkeypatch):
    """Contact without crossing it: bounds of first order would need a thousand times as many."""
    trajectory, tool = wavy(two_link, 6)
    visit = whole(trajectory)
    wide = least_margin(Tube(POINTS, 1.0), tool, visit)
    touching = least_margin(Tube(POINTS, 1.0 - wide.attained), tool, visit)
    for _ in range(3):  # the wide tube resolves its margin to two per cent only
        tube = Tube(POINTS, 1.0 - wide.attained - touching.attained)
        touching = least_margin(tube, tool, visit)
    assert -1e-6 < touching.lower_bound <= touching.attained < 1e-6
    assert touching.intervals < 1000
    # Halving ends after so many rows; the bounds then count as they stand.
    monkeypatch.setattr("tubeplanner.certificate.tube_visits._MAX_ROWS", len(tool.width))
    rough = least_margin(tube, tool, visit)
    assert rough.intervals == len(tool.width) < touching.intervals
    assert rough.lower_bound < rough.attained - 1e-6


def test_a_wide_margin_is_settled_at_once(two_link):
    """Two per cent of half a metre need no halving to a fraction of a micrometre."""
    trajectory, tool = wavy(two_link, 2)
    least = least_margin(Tube(POINTS, 2.0), tool, whole(trajectory))
    assert least.attained > 1.0
    assert least.intervals < 2 * len(tool.width)


# Visits: in order or in the union, with the best switching times.


def visited(problem, trajectory, accuracy=1e-7):
    """Return the enclosed tool and the visits of a trajectory."""
    tool = enclosed_tool(problem.robot, problem.tube, trajectory, accuracy)
    return tool, tube_visits(problem, trajectory, tool)


def test_visits_cover_the_trajectory_in_order_and_switching_time_inside_both(stored, monkeypatch):
    problem, trajectory = stored(*POST)
    shapes = []

    def counting(margin, gates):
        shapes.append(margin.shape)
        return best_switching_samples(margin)

    monkeypatch.setattr("tubeplanner.certificate.tube_visits.best_switching_samples", counting)
    _, visits = visited(problem, trajectory)
    assert [visit.segment for visit in visits] == [0, 1, 2]
    assert (visits[0].begin, visits[-1].end) == (0, trajectory.duration)
    for before, after in pairwise(visits):
        assert before.end == after.begin
        point = problem.robot.tool_position(trajectory.position(np.array([before.end])))
        assert problem.tube.margin(point)[0, [before.segment, after.segment]].min() > 0
    ((samples, segments),) = shapes
    assert samples >= 2000
    assert segments == 3


def there_and_back(two_link):
    """Return a trajectory along the first leg of a corner and back again."""
    free, q = np.full(2, np.inf), [np.array([0.0, -1.0])]
    for y in np.linspace(-0.3, 0.25, 12):
        q.append(solve_position(two_link, np.array([0.45, y, 0]), q[-1], -free, free).q)
    path = np.array(q[1:] + q[-2:0:-1])
    coefficients = np.stack([np.diff(path, axis=0) / 0.1, path[:-1]])
    return JointTrajectory(two_link.joint_names, 0.1 * np.arange(len(path)), coefficients)


def test_a_union_is_visited_as_often_as_needed(two_link):
    points = [[0.45, -0.3, 0], [0.45, 0.0, 0], [0.45, 0.3, 0]]
    problem = PlanningProblem(two_link, Tube(points, 0.03, visit="any"), SEED)
    tool, visits = visited(problem, there_and_back(two_link))
    assert [visit.segment for visit in visits] == [0, 1, 0]
    assert least_margin(problem.tube, tool, visits).lower_bound > 0.02


def test_switching_times_are_refined_between_samples(stored):
    """At the corner, a radius that leaves 10 um at the best instant, and less at all others."""
    problem, trajectory = stored(*POST)
    tool, visits = visited(problem, trajectory)
    least = least_margin(problem.tube, tool, visits)
    at_switch = min(abs(least.time - visit.end) for visit in visits[:-1])
    assert at_switch < 1e-6
    radius = problem.tube.radius - least.attained + 1e-5
    tight = Tube(problem.tube.points, radius, joint_signs=problem.tube.joint_ranges)
    narrow = PlanningProblem(problem.robot, tight, problem.start)
    again = least_margin(tight, *visited(narrow, trajectory))
    assert 5e-6 < again.lower_bound <= again.attained < 1.5e-5


@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_the_switching_time_is_when_the_joint_ranges_meet(two_link, visit):
    """The elbow must be below -1 rad in one segment and above it in the other."""
    points = [[0.45, -0.3, 0], [0.45, 0.0, 0], [0.45, 0.3, 0]]
    signs = [{"joint2": [-3.0, -1.0]}, {"joint2": [-1.0, 0.0]}]
    tube = Tube(points, 1.0, joint_signs=signs, visit=visit)
    problem = PlanningProblem(two_link, tube, np.array([0.3, -1.5]))
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[0.1, 0.7]], [[0.3, -1.5]]])
    _, visits = visited(problem, trajectory)
    assert [visit.segment for visit in visits] == [0, 1]
    assert visits[0].end == pytest.approx(0.5 / 0.7, abs=2e-8)


@pytest.mark.parametrize("shift", [-1e-4, 0.0, 1e-4])
def test_a_breakpoint_beside_the_switching_time_does_not_hide_it(stored, shift):
    problem, trajectory = stored(*POST)
    _, expected = visited(problem, trajectory)
    when = expected[0].end + shift
    parts = [trajectory.between(0.0, when), trajectory.between(when, trajectory.duration)]
    _, visits = visited(problem, concatenate(parts))
    for before, after in zip(expected, visits, strict=True):
        assert after.end == pytest.approx(before.end, abs=1e-7)


# How near compulsory points are passed: the first joint turns to and fro, the second rests.


LOW, TIP = 0.0, 0.3


def stroke(two_link, *angles):
    """Return a slow trajectory of the first joint over angles [rad], a second from each to each.

    The second joint rests, so that the tool goes on a circle about the base.
    """
    shape = np.array([-2.0, 3.0, 0.0, 0.0])
    steps = np.column_stack([np.diff(angles), np.zeros(len(angles) - 1)])
    coefficients = shape[:, None, None] * steps
    coefficients[-1] += np.column_stack([angles[:-1], np.full(len(angles) - 1, -1.0)])
    return JointTrajectory(two_link.joint_names, np.arange(float(len(angles))), coefficients)


def locations(two_link, *angles):
    """Return where the tool is when the first joint is at angles."""
    q = np.column_stack([angles, np.full(len(angles), -1.0)])
    return two_link.tool_position(q)


def passed(two_link, tube, trajectory, seed=SEED):
    """Return the passages of a trajectory, and its visits."""
    problem = PlanningProblem(two_link, tube, seed).joined
    tool, visits = visited(problem, trajectory, 1e-9)
    return passages(problem, trajectory, tool, visits), visits


def spike(two_link, radius=0.02, **options):
    low, tip = locations(two_link, LOW, TIP)
    return Tube([low, tip, low], radius, **options)


@pytest.mark.parametrize("turned", [0.3, 0.2])
def test_a_point_is_passed_as_near_as_the_tool_comes(two_link, turned):
    (passage,), _ = passed(two_link, spike(two_link, 0.1), stroke(two_link, LOW, turned, LOW))
    tip, there = locations(two_link, TIP, turned)
    assert passage.point == 1
    assert passage.time == pytest.approx(1.0, abs=1e-4)
    assert passage.margin == pytest.approx(0.1 - np.linalg.norm(tip - there), abs=1e-7)


def test_between_samples_too(two_link):
    """The tool is at the point at an instant that is no sample."""
    (passage,), _ = passed(two_link, spike(two_link, 0.1), stroke(two_link, LOW, TIP + 0.2))
    assert passage.margin == pytest.approx(0.1, abs=1e-7)


def test_the_smaller_radius_counts(two_link):
    tube = spike(two_link, [0.1, 0.04], tool_radius=0.01)
    (passage,), _ = passed(two_link, tube, stroke(two_link, LOW, TIP, LOW))
    assert passage.margin == pytest.approx(0.03, abs=1e-7)


def test_only_instants_in_the_two_segments_beside_a_point_count(two_link):
    """The tool is at the first tip only when it is in a later segment, far from it by then."""
    low, tip, far = locations(two_link, LOW, TIP, 1.2)
    trajectory = stroke(two_link, LOW, 1.2)
    problem = PlanningProblem(two_link, Tube([low, tip, low, far], 0.01), SEED)
    tool = enclosed_tool(two_link, problem.tube, trajectory, 1e-9)
    visits = [Visit(0, 0.0, 0.01), Visit(1, 0.01, 0.02), Visit(2, 0.02, 1.0)]
    first, second = passages(problem, trajectory, tool, visits)
    begin, nearest = locations(two_link, *trajectory.position([0.01, 0.02])[:, 0])
    assert first.margin == pytest.approx(0.01 - np.linalg.norm(tip - nearest), abs=1e-6)
    assert first.time == pytest.approx(0.02)
    assert second.margin == pytest.approx(0.01 - np.linalg.norm(low - begin), abs=2e-8)


def test_of_strokes_that_look_alike_each_has_its_own(two_link):
    """Down, up, down, up: all capsules are the same, and only the points tell when one ends."""
    low, tip = locations(two_link, LOW, TIP)
    tube = Tube([low, tip, low, tip, low], 0.02)
    found, visits = passed(two_link, tube, stroke(two_link, LOW, TIP, LOW, TIP, LOW))
    assert [one.point for one in found] == [1, 2, 3]
    assert min(one.margin for one in found) == pytest.approx(0.02, abs=1e-6)
    for visit, one in zip(visits, found, strict=False):
        assert visit.begin <= one.time <= visits[visit.segment + 1].end
    short, _ = passed(two_link, tube, stroke(two_link, LOW, 0.1, LOW, 0.1, LOW))
    assert min(one.margin for one in short) < -0.05


def test_a_point_is_not_passed_at_the_cost_of_the_tube(two_link):
    """The tool comes by the tip only after it left the capsules: what is missed is the point."""
    points, trajectory = locations(two_link, LOW, TIP, LOW, -0.6), stroke(two_link, LOW, -0.6)
    found, visits = passed(two_link, Tube(points, 0.02), trajectory)
    free = Tube(points, 0.02, pass_through_points="none")
    assert min(one.margin for one in found) < -0.05
    assert visits == passed(two_link, free, trajectory)[1]


@pytest.mark.parametrize(
    ("signs", "elbow", "margin"),
    [
        ([{}, {}], -1.0, 0.02),
        ([{"joint2": "+"}, {"joint2": "+"}], 1.0, -1.0),  # joint2 is at -1
        ([{"joint2": "-"}, {"joint2": "+"}], -1.0, 0.02),
    ],
)
def test_in_the_union_any_instant_counts_at_which_a_segment_beside_the_point_may_hold(
    two_link, signs, elbow, margin
):
    tube = spike(two_link, visit="any", joint_signs=signs)
    seed = Seed(np.array([0.0, elbow]))
    (passage,), _ = passed(two_link, tube, stroke(two_link, LOW, TIP + 0.3), seed)
    assert passage.margin == pytest.approx(margin, abs=1e-7)


def test_what_the_polynomials_miss_is_taken_off_a_passage_too(two_link):
    problem = PlanningProblem(two_link, spike(two_link), SEED)
    trajectory = stroke(two_link, LOW, TIP, LOW)
    tool, visits = visited(problem, trajectory, 1e-9)
    rough = replace(tool, error=tool.error + 1e-3)
    (exact,), (passage,) = (passages(problem, trajectory, t, visits) for t in (tool, rough))
    assert passage.margin == pytest.approx(exact.margin - 1e-3, abs=1e-12)


# Where a motion fails: what is broken is named, and nothing that would hold beside it.

SWING = JointTrajectory(
    ("joint1", "joint2"),
    [0.0, 1.0],
    [[[9.0, -4.8]], [[-22.5, 12.0]], [[15.0, -8.0]], [[0, 0]], [[0, 0]], [[-0.5, -1.0]]],
)
OF_SEGMENTS = ("tube", "joint_signs", "rotation", "obstacles", "tool_speed")


def junction(visit, broken=None):
    """Return a problem whose middle segment is as tight about `SWING` as can be, or tighter."""
    factor = dict.fromkeys(OF_SEGMENTS, 1.0) | {broken: 1.5}
    limits = LimitOverrides(effort=1e4, velocity=1e3)
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    times = np.array([0.0, 0.4, 0.6, 1.0])
    q = SWING.position(np.linspace(times[:-1], times[1:], 801).T.ravel()).reshape(3, 801, 2)
    tool = robot.tool_position(q.reshape(-1, 2)).reshape(3, 801, 3)
    points = np.vstack([tool[:, 0], tool[-1:, -1]])
    axis = np.diff(points, axis=0)[:, None]
    along = np.clip(
        (tool - tool[:, :1]) @ axis[:, 0, :, None] / (axis**2).sum(2, keepdims=True), 0, 1
    )
    radius = 1.001 * np.linalg.norm(tool - tool[:, :1] - along * axis, axis=2).max(axis=1)
    turned = SWING.position(times).sum(axis=1)  # about z
    off = abs(q[1].sum(axis=1) - np.interp(along[1, :, 0], [0, 1], turned[1:3])).max()
    speed = np.linalg.norm(np.gradient(tool[1], 0.2 / 800, axis=0), axis=1).max()
    low, high = q[1, :, 0].min() - 1e-4, q[1, :, 0].max() + 1e-4
    post = Obstacle.sphere("post", 0.05, placement_of(tool[1, 400] + [0.12, 0.12, 0]))
    fields = {"obstacles": (post,), "self_collision": False}
    checker = PlanningProblem(robot, Tube(points[[0, -1]], 9.0), SEED, **fields).collision
    poses = zip(*robot.body_poses(q[1]), strict=True)
    gap = min(checker.distances(*pose, checker.pairs).min() for pose in poses)
    high -= (factor["joint_signs"] - 1) * (high - low)
    tube = Tube(
        points,
        radius / [1, factor["tube"], 1],
        visit=visit,
        joint_signs=[{}, {"joint1": [low, high]}, {}],
        orientations=[[0, 0, np.sin(a / 2), np.cos(a / 2)] for a in turned],
        rotation_tolerance=[3.0, 1.001 * off / factor["rotation"], 3.0],
        tool_speed=[None, 1.001 * speed / factor["tool_speed"], None],
        clearance=[0.0, 0.999 * gap * factor["obstacles"], 0.0],
        pass_through_points="none",
    )
    return PlanningProblem(robot, tube, q[0, 0], q[-1, -1], **fields)


@pytest.mark.parametrize(
    ("visit", "broken"),
    [*(("ordered", name) for name in OF_SEGMENTS), ("any", "joint_signs"), ("any", "tool_speed")],
)
def test_the_condition_that_is_broken_is_named_alone(visit, broken):
    """The largest margin of metres, radians and fractions would break others in its stead."""
    certificate = verify(junction(visit, broken), SWING)
    assert certificate.failures() == [broken]
    if broken == "tool_speed":
        assert verify(junction(visit), SWING).passed
        assert certificate.conditions[broken].margin == pytest.approx(-0.5, abs=2e-3)


def test_a_seam_between_two_samples_breaks_no_condition_beside_the_broken_one(two_link):
    """Segment 1 holds from 0.1 ms before the end of segment 0, which is too fast before that."""
    at = 0.40012
    q = SWING.position([0.0, at - 1e-4, at, 0.5, 1.0])
    turned = q.sum(axis=1)  # about z
    tube = Tube(
        two_link.tool_position(q[[0, 3, 4]]),
        9.0,
        orientations=[[0, 0, np.sin(turned[0] / 2), np.cos(turned[0] / 2)]] * 3,
        rotation_tolerance=[turned[2] - turned[0], 3.0],
        joint_signs=[{}, {"joint1": [q[1, 0], 2.0]}],
        tool_speed=[0.2, None],
        pass_through_points="none",
    )
    problem = PlanningProblem(two_link, tube, q[0], q[-1], self_collision=False)
    failed = set(verify(problem, SWING).failures())
    assert failed & {"tube", "rotation", "joint_signs", "tool_speed"} == {"tool_speed"}
