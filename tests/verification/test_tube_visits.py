from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial

from tubeplanner import JointTrajectory, PlanningProblem, Seed, Tube
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.verification.enclosed_pose import enclosed_tool
from tubeplanner.verification.enclosure import Enclosure
from tubeplanner.verification.switching_samples import best_switching_samples
from tubeplanner.verification.tube_visits import (
    Visit,
    _worst_passing,
    least_margin,
    ordered_switching_samples,
    passages,
    tube_visits,
    visited_parts,
)

SEED = Seed(np.array([0.0, -1.0]))
AXIS = Tube([[-9, 0, 0], [9, 0, 0]], 1.0)
POINTS = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0]]


def wavy(two_link, seed=0, pieces=5):
    """Return cubics that wander about, continuous in position only."""
    rng = np.random.default_rng(seed)
    knots = np.array([0.0, -1.0]) + np.cumsum(rng.uniform(-0.2, 0.25, (pieces + 1, 2)), axis=0)
    bend = rng.uniform(-2, 2, (pieces, 2))
    width = 0.1
    slope = np.diff(knots, axis=0) / width - bend * width
    coefficients = np.stack([bend, slope, knots[:-1]])
    return JointTrajectory(two_link.joint_names, width * np.arange(pieces + 1), coefficients)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("radius", [0.02, 0.1, 0.5])
def test_the_least_margin_is_bracketed(two_link, seed, radius):
    trajectory = wavy(two_link, seed)
    tube = Tube(POINTS, radius)
    tool = enclosed_tool(two_link, trajectory, 1e-7)
    visits = [Visit(0, 0.0, 0.23), Visit(1, 0.23, trajectory.duration)]
    least = least_margin(tube, tool, visits)
    t = np.linspace(0, trajectory.duration, 40_001)
    margin = tube.margin(two_link.tool_position(trajectory.position(t)))
    true = min(margin[t <= 0.23, 0].min(), margin[t >= 0.23, 1].min())
    assert least.lower_bound <= true + 1e-9
    assert least.attained >= true - 1e-6
    assert least.attained - least.lower_bound <= max(5e-7, 0.02 * abs(least.attained) + 2e-7)
    here = tube.margin(two_link.tool_position(trajectory.position(np.array([least.time]))))
    assert here[0, least.segment] == pytest.approx(least.attained, abs=2e-7)


def test_what_the_polynomials_miss_is_taken_off_the_margin(two_link):
    """A tool that may be a millimetre elsewhere: a bound that is lower by as much."""
    trajectory = wavy(two_link, 1)
    tool = enclosed_tool(two_link, trajectory, 1e-7)
    rough = replace(tool, error=tool.error + 1e-3)
    visit = [Visit(0, 0.0, trajectory.duration)]
    exact, least = (least_margin(Tube(POINTS, 0.5), each, visit) for each in (tool, rough))
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


@pytest.mark.parametrize("bow", [0.1, 0.3, 0.9])
def test_a_bow_between_two_ends_is_bracketed(bow):
    """A parabola over one interval, whose hull is twice as high."""
    least = least_margin(AXIS, along_x([-4 * bow, 4 * bow, 0.0]), [Visit(0, 0.0, 1.0)])
    true = 1.0 - bow
    assert least.lower_bound <= true + 1e-12
    assert least.attained >= true - 1e-12
    assert least.attained - least.lower_bound <= 0.02 * abs(least.attained) + 2e-7


@pytest.mark.parametrize("height", np.linspace(1e-3, 6e-3, 11))
def test_what_is_settled_at_once_still_counts(height):
    """A flat bow of 9 mm; and waves that are lower, but whose hull needs to be halved."""
    waves = height * Chebyshev.basis(7, domain=[0, 1]).convert(kind=Polynomial).coef[::-1]
    bow = 9e-3
    least = least_margin(AXIS, along_x([-4 * bow, 4 * bow, 0.0], waves), [Visit(0, 0.0, 2.0)])
    assert 0.975 <= least.lower_bound <= 1.0 - bow + 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_visits_are_covered_whole(two_link, seed):
    """Whenever they begin and end, their parts of intervals are as long as they are."""
    trajectory = wavy(two_link, seed)
    tool = enclosed_tool(two_link, trajectory, 1e-7)
    times = np.sort(np.random.default_rng(seed).uniform(0, trajectory.duration, 3))
    times = [0.0, *times, trajectory.duration]
    visits = [Visit(k, begin, end) for k, (begin, end) in enumerate(pairwise(times))]
    interval, start, width, segment = visited_parts(tool, visits)
    assert (start >= 0).all()
    assert (start + width <= 1 + 1e-12).all()
    covered = np.bincount(segment, width * tool.width[interval])
    np.testing.assert_allclose(covered, np.diff(times), atol=1e-12)


def test_touching_the_wall_is_decided_with_few_intervals(two_link):
    """Contact without crossing it: bounds of first order would need a thousand times as many."""
    trajectory = wavy(two_link, 1)
    tool = enclosed_tool(two_link, trajectory, 1e-7)
    visit = [Visit(0, 0.0, trajectory.duration)]
    wide = least_margin(Tube(POINTS, 1.0), tool, visit)
    touching = least_margin(Tube(POINTS, 1.0 - wide.attained), tool, visit)
    for _ in range(3):  # the wide tube resolves its margin to two per cent only
        touching = least_margin(Tube(POINTS, 1.0 - wide.attained - touching.attained), tool, visit)
    assert -1e-6 < touching.lower_bound <= touching.attained < 1e-6
    assert touching.intervals < 1000


def test_visits_cover_the_trajectory_in_order_and_switching_time_inside_both(stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    tool = enclosed_tool(problem.robot, trajectory, 1e-7)
    visits = tube_visits(problem, trajectory, tool)
    assert [visit.segment for visit in visits] == [0, 1, 2]
    assert visits[0].begin == 0
    assert visits[-1].end == trajectory.duration
    for before, after in pairwise(visits):
        assert before.end == after.begin
        point = problem.robot.tool_position(trajectory.position(np.array([before.end])))
        assert problem.tube.margin(point)[0, [before.segment, after.segment]].min() > 0


def there_and_back(two_link):
    """Return a trajectory along the first leg of a corner and back again."""
    q = [np.array([0.0, -1.0])]
    from tubeplanner.branches.inverse_kinematics import solve_position

    free = np.full(2, np.inf)
    for y in np.linspace(-0.3, 0.25, 12):
        q.append(solve_position(two_link, np.array([0.45, y, 0]), q[-1], -free, free).q)
    path = np.array(q[1:] + q[-2:0:-1])
    coefficients = np.stack([np.diff(path, axis=0) / 0.1, path[:-1]])
    times = 0.1 * np.arange(len(path))
    return JointTrajectory(two_link.joint_names, times, coefficients)


def test_a_union_is_visited_as_often_as_needed(two_link):
    points = [[0.45, -0.3, 0], [0.45, 0.0, 0], [0.45, 0.3, 0]]
    problem = PlanningProblem(two_link, Tube(points, 0.03, visit="any"), SEED)
    trajectory = there_and_back(two_link)
    tool = enclosed_tool(two_link, trajectory, 1e-7)
    visits = tube_visits(problem, trajectory, tool)
    assert [visit.segment for visit in visits] == [0, 1, 0]
    assert least_margin(problem.tube, tool, visits).lower_bound > 0.02


def test_switching_times_that_share_an_instant_stay_in_order(two_link):
    """Three segments through one point: the tube doubles back on itself."""
    points = [[0.45, -0.3, 0], [0.45, 0.0, 0], [0.45, -0.01, 0], [0.45, 0.25, 0]]
    problem = PlanningProblem(two_link, Tube(points, 0.03), SEED)
    trajectory = there_and_back(two_link).between(0.0, 1.1)
    visits = tube_visits(problem, trajectory, enclosed_tool(two_link, trajectory, 1e-7))
    times = [visits[0].begin, *(visit.end for visit in visits)]
    assert times == sorted(times)
    assert [visit.segment for visit in visits] == [0, 1, 2]


def test_a_wide_margin_is_settled_at_once(two_link):
    """Two per cent of half a metre need no halving to a fraction of a micrometre."""
    trajectory = wavy(two_link, 2)
    tool = enclosed_tool(two_link, trajectory, 1e-7)
    least = least_margin(Tube(POINTS, 2.0), tool, [Visit(0, 0.0, trajectory.duration)])
    assert least.attained > 1.0
    assert least.intervals < 2 * len(tool.width)


def test_halving_ends_after_so_many_rows(stored, monkeypatch):
    """The bounds then count as they stand."""
    problem, trajectory = stored("two_link/paper_1_30mm", "branch-and-bound")
    tool = enclosed_tool(problem.robot, trajectory, 1e-7)
    visit = [Visit(0, 0.0, trajectory.duration)]
    wide = least_margin(problem.tube, tool, visit)
    touching = Tube(problem.tube.points, 0.03 - wide.attained)
    whole = least_margin(touching, tool, visit)
    monkeypatch.setattr("tubeplanner.verification.tube_visits._MAX_ROWS", len(tool.width))
    least = least_margin(touching, tool, visit)
    assert least.intervals == len(tool.width) < whole.intervals
    assert least.lower_bound < least.attained - 1e-6


def test_switching_times_are_refined_between_samples(stored):
    """At the corner, a radius that leaves 10 um at the best instant, and less at all others."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    tool = enclosed_tool(problem.robot, trajectory, 1e-7)
    visits = tube_visits(problem, trajectory, tool)
    least = least_margin(problem.tube, tool, visits)
    at_switch = min(abs(least.time - visit.end) for visit in visits[:-1])
    assert at_switch < 1e-6
    radius = problem.tube.radius - least.attained + 1e-5
    tight = Tube(problem.tube.points, radius, joint_signs=problem.tube.joint_ranges)
    narrow = PlanningProblem(problem.robot, tight, problem.start)
    visits = tube_visits(narrow, trajectory, tool)
    again = least_margin(tight, tool, visits)
    assert 5e-6 < again.lower_bound <= again.attained < 1.5e-5


def test_switching_times_are_looked_for_at_two_thousand_samples(stored, monkeypatch):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    seen = []

    def counting(margin):
        seen.append(margin.shape)
        return best_switching_samples(margin)

    monkeypatch.setattr("tubeplanner.verification.tube_visits.best_switching_samples", counting)
    tube_visits(problem, trajectory, enclosed_tool(problem.robot, trajectory, 1e-7))
    (shape,) = seen
    assert shape[0] >= 2000
    assert shape[1] == 3


@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_the_switching_time_is_when_the_joint_ranges_meet(two_link, visit):
    """The elbow must be below -1 rad in one segment and above it in the other."""
    points = [[0.45, -0.3, 0], [0.45, 0.0, 0], [0.45, 0.3, 0]]
    signs = [{"joint2": [-3.0, -1.0]}, {"joint2": [-1.0, 0.0]}]
    tube = Tube(points, 1.0, joint_signs=signs, visit=visit)
    problem = PlanningProblem(two_link, tube, np.array([0.3, -1.5]))
    trajectory = JointTrajectory(two_link.joint_names, [0, 1.0], [[[0.1, 0.7]], [[0.3, -1.5]]])
    visits = tube_visits(problem, trajectory, enclosed_tool(two_link, trajectory, 1e-7))
    assert [visit.segment for visit in visits] == [0, 1]
    assert visits[0].end == pytest.approx(0.5 / 0.7, abs=2e-8)


@pytest.mark.parametrize("shift", [-1e-4, 0.0, 1e-4])
def test_a_breakpoint_beside_the_switching_time_does_not_hide_it(stored, shift):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    tool = enclosed_tool(problem.robot, trajectory, 1e-7)
    expected = tube_visits(problem, trajectory, tool)
    when = expected[0].end + shift
    cut = concatenate(
        [trajectory.between(0.0, when), trajectory.between(when, trajectory.duration)]
    )
    visits = tube_visits(problem, cut, enclosed_tool(problem.robot, cut, 1e-7))
    for before, after in zip(expected, visits, strict=True):
        assert after.end == pytest.approx(before.end, abs=1e-7)


def stroke(two_link, *angles):
    """Return a slow trajectory of the first joint over angles [rad], a second from each to each.

    The second joint rests, so that the tool goes on a circle about the base.
    """
    shape = np.array([-2.0, 3.0, 0.0, 0.0])
    steps = np.column_stack([np.diff(angles), np.zeros(len(angles) - 1)])
    coefficients = shape[:, None, None] * steps
    coefficients[-1] += np.column_stack([angles[:-1], np.full(len(angles) - 1, -1.0)])
    return JointTrajectory(two_link.joint_names, np.arange(float(len(angles))), coefficients)


def places(two_link, *angles):
    """Return where the tool is when the first joint is at angles."""
    q = np.column_stack([angles, np.full(len(angles), -1.0)])
    return two_link.tool_position(q)


def passed(two_link, tube, trajectory):
    """Return the passages of a trajectory, and its visits."""
    problem = PlanningProblem(two_link, tube, SEED).joined
    tool = enclosed_tool(two_link, trajectory, 1e-9)
    visits = tube_visits(problem, trajectory, tool)
    return passages(problem, trajectory, tool, visits), visits


LOW, TIP = 0.0, 0.3


def spike(two_link, radius=0.02, **options):
    low, tip = places(two_link, LOW, TIP)
    return Tube([low, tip, low], radius, **options)


@pytest.mark.parametrize("turned", [0.3, 0.28, 0.2])
def test_a_point_is_passed_as_near_as_the_tool_comes(two_link, turned):
    (passage,), _ = passed(two_link, spike(two_link, 0.1), stroke(two_link, LOW, turned, LOW))
    tip, there = places(two_link, TIP, turned)
    assert passage.point == 1
    assert passage.time == pytest.approx(1.0, abs=1e-4)
    assert passage.margin == pytest.approx(0.1 - np.linalg.norm(tip - there), abs=1e-7)


def test_between_samples_too(two_link):
    """The tool is at the point at an instant that is no sample."""
    tube = spike(two_link, 0.1)
    (passage,), _ = passed(two_link, tube, stroke(two_link, LOW, TIP + 0.2))
    assert passage.margin == pytest.approx(0.1, abs=1e-7)


def test_the_smaller_radius_counts(two_link):
    tube = spike(two_link, [0.1, 0.04], tool_radius=0.01)
    (passage,), _ = passed(two_link, tube, stroke(two_link, LOW, TIP, LOW))
    assert passage.margin == pytest.approx(0.03, abs=1e-7)


def test_only_instants_in_the_two_segments_beside_a_point_count(two_link):
    """The tool is at the first tip only when it is in a later segment, far from it by then."""
    low, tip, far = places(two_link, LOW, TIP, 1.2)
    tube = Tube([low, tip, low, far], 0.01)
    trajectory = stroke(two_link, LOW, 1.2)
    problem = PlanningProblem(two_link, tube, SEED)
    tool = enclosed_tool(two_link, trajectory, 1e-9)
    visits = [Visit(0, 0.0, 0.01), Visit(1, 0.01, 0.02), Visit(2, 0.02, 1.0)]
    first, second = passages(problem, trajectory, tool, visits)
    nearest = places(two_link, *trajectory.position(0.02)[:1])
    assert first.margin == pytest.approx(0.01 - np.linalg.norm(tip - nearest), abs=1e-6)
    assert first.time == pytest.approx(0.02)
    begin = places(two_link, *trajectory.position(0.01)[:1])
    assert second.margin == pytest.approx(0.01 - np.linalg.norm(low - begin), abs=2e-8)


def test_of_strokes_that_look_alike_each_has_its_own(two_link):
    """Down, up, down, up: all capsules are the same, and only the points tell when one ends."""
    low, tip = places(two_link, LOW, TIP)
    tube = Tube([low, tip, low, tip, low], 0.02)
    up_and_down = stroke(two_link, LOW, TIP, LOW, TIP, LOW)
    found, visits = passed(two_link, tube, up_and_down)
    assert [one.point for one in found] == [1, 2, 3]
    assert min(one.margin for one in found) == pytest.approx(0.02, abs=1e-6)
    for k, one in zip((1, 2, 3), found, strict=True):
        assert visits[k - 1].begin <= one.time <= visits[k].end
    short = passed(two_link, tube, stroke(two_link, LOW, 0.1, LOW, 0.1, LOW))[0]
    assert min(one.margin for one in short) < -0.05


def test_a_point_is_not_passed_at_the_cost_of_the_tube(two_link):
    """The tool comes by the tip only after it left the capsules: what is missed is the point."""
    low, tip, far = places(two_link, LOW, TIP, -0.6)
    tube = Tube([low, tip, low, far], 0.02)
    trajectory = stroke(two_link, LOW, -0.6)
    found, visits = passed(two_link, tube, trajectory)
    without = passed(
        two_link, Tube([low, tip, low, far], 0.02, pass_through_points="none"), trajectory
    )[1]
    assert min(one.margin for one in found) < -0.05
    assert visits == without


def test_other_switching_times_pass_a_point_only_if_they_keep_the_rest():
    inside = {1: np.array([-5.0, -5.0, -5.0, 0.5])}
    strict = np.array([[1.0, 1, -1], [-1, 1, 1], [-1, -1, 1], [-1, -1, 1]])
    assert ordered_switching_samples(strict, inside).tolist() == [0, 1]
    wide = np.array([[1.0, 1, -1], [-1, 1, 1], [-1, 0.1, 1], [-1, 0.1, 1]])
    assert ordered_switching_samples(wide, inside).tolist() == [0, 3]
    assert ordered_switching_samples(wide, {}).tolist() == [0, 1]


@pytest.mark.parametrize("at", range(5))
def test_a_point_counts_as_passed_in_both_segments_beside_it(at):
    inside = {2: np.where(np.arange(5) == at, 0.5, -1.0)}
    assert _worst_passing(np.array([1, 2, 3]), inside) == (0.5 if 1 <= at <= 3 else -1.0)


def test_in_the_union_any_instant_counts_at_which_a_segment_beside_the_point_may_hold(two_link):
    low, tip = places(two_link, LOW, TIP)
    signs = [{"joint2": "+"}, {"joint2": "+"}]
    tube = spike(two_link, visit="any")
    (passage,), _ = passed(two_link, tube, stroke(two_link, LOW, TIP + 0.3))
    assert passage.margin == pytest.approx(0.02, abs=1e-7)
    wrong = Tube([low, tip, low], 0.02, visit="any", joint_signs=signs)
    problem = PlanningProblem(two_link, wrong, Seed(np.array([0.0, 1.0])))
    trajectory = stroke(two_link, LOW, TIP)
    tool = enclosed_tool(two_link, trajectory, 1e-9)
    (passage,) = passages(problem, trajectory, tool, tube_visits(problem, trajectory, tool))
    assert passage.margin == pytest.approx(-1.0, abs=1e-7)  # joint2 is at -1
    one = Tube([low, tip, low], 0.02, visit="any", joint_signs=[{"joint2": "-"}, {"joint2": "+"}])
    (passage,), _ = passed(two_link, one, trajectory)
    assert passage.margin == pytest.approx(0.02, abs=1e-7)


def test_what_the_polynomials_miss_is_taken_off_a_passage_too(two_link):
    problem = PlanningProblem(two_link, spike(two_link), SEED)
    trajectory = stroke(two_link, LOW, TIP, LOW)
    tool = enclosed_tool(two_link, trajectory, 1e-9)
    rough = replace(tool, error=tool.error + 1e-3)
    visits = tube_visits(problem, trajectory, tool)
    (exact,), (passage,) = (passages(problem, trajectory, t, visits) for t in (tool, rough))
    assert passage.margin == pytest.approx(exact.margin - 1e-3, abs=1e-12)
