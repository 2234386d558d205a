"""`measure_tube`: radii against geometry worked out by hand, and an attack that shares no code."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from measured_tubes import random_attack
from tubeplanner import (
    MeasureOptions,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    Seed,
    Tube,
    measure_tube,
    placement_of,
    plan,
)
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.studies.tubes.measurement import survey_patterns

QUICK = MeasureOptions(samples=500)
LINK, POST, POST_RADIUS = 0.3, np.array([0.4, 0.22]), 0.03


@pytest.fixture(scope="module")
def post(bundled):
    problem = bundled("two_link/around_a_post")
    return problem, measure_tube(problem, QUICK)


def post_in_box(frame, q, center, size):
    """Return the distance of the post's axis to a box carried by a planar frame, (N,)."""
    (x, y), cosine, sine = (POST - frame).T, np.cos(q), np.sin(q)
    turned = np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=1)
    outside = np.maximum(abs(turned - [center, 0]) - np.array(size) / 2, 0)
    return np.linalg.norm(outside, axis=1)


def largest_radius(a, b, most):
    """Return how far the tool may be from a segment before a link meets the post, by a grid."""
    lower, upper = np.minimum(a, b) - most, np.maximum(a, b) + most
    x, y = np.meshgrid(*(np.arange(*bounds, 0.001) for bounds in zip(lower, upper, strict=True)))
    tool = np.stack([x.ravel(), y.ravel()], axis=1)
    fraction = np.clip((tool - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    away = np.linalg.norm(tool - a - fraction[:, None] * (b - a), axis=1)
    reach = np.linalg.norm(tool, axis=1)
    near = (away < most) & (reach > 0.01) & (reach < 2 * LINK)
    tool, away, reach = tool[near], away[near], reach[near]
    bend = -2 * np.arccos(reach / (2 * LINK))  # the elbow's sign
    first = np.arctan2(tool[:, 1], tool[:, 0]) - bend / 2
    elbow = LINK * np.stack([np.cos(first), np.sin(first)], axis=1)
    gap = np.minimum(
        post_in_box(np.zeros_like(tool), first, 0.15, (0.36, 0.05)),
        post_in_box(elbow, first + bend, 0.15, (0.34, 0.04)),
    )
    return away[gap < POST_RADIUS].min(initial=most)


def test_the_radius_is_where_the_link_meets_the_post(post):
    problem, result = post
    assert result.succeeded, result.message
    for segment, (a, b) in zip(result.segments, pairwise(problem.tube.points[:, :2]), strict=True):
        exact = largest_radius(a, b, 0.2)
        assert exact - 0.004 < segment.radius < exact + 1e-3
        assert segment.joint_ranges == {"joint2": (-np.inf, 0.0)}
    binding = result.segments[0].bindings[0]
    assert (binding.bound, binding.location.links) == ("radius", ("link2",))
    assert binding.location.obstacle == "post"


def test_a_measured_tube_is_planned_and_faster(post):
    problem, result = post
    fast = PlanOptions(quality="fast", slack=0.0)
    before, after = plan(problem, fast), plan(result.problem, fast)
    assert after.succeeded, after.message
    assert after.duration < before.duration


@pytest.mark.dear("measures a tube of six joints, and attacks it twice")
def test_six_joints_get_ranges_that_survive(ur5):
    tube = Tube([[0.45, -0.2, 0.4], [0.45, 0.1, 0.4]], 0.05, joint_signs={"elbow_joint": "+"})
    wall = Obstacle.box("wall", [0.6, 0.6, 0.05], placement_of([0.6, 0.0, 0.25]))
    seed = np.array([-0.9, -1.5, 1.8, -1.9, -1.6, 0.0])
    beside_a_wall = PlanningProblem(ur5, tube, Seed(seed), obstacles=[wall], clearance=0.01)
    result = measure_tube(beside_a_wall, QUICK)
    (segment,) = result.segments
    assert 0.005 < segment.radius <= 0.2
    assert len(segment.joint_ranges) == 6
    assert {binding.location.obstacle for binding in segment.bindings} & {"wall"}
    attack = random_attack(result.problem, 0, 600, np.random.default_rng(1))
    assert attack.collisions == 0
    signs_alone = beside_a_wall.with_tube(beside_a_wall.tube.with_radius(segment.radius))
    assert random_attack(signs_alone, 0, 200, np.random.default_rng(1)).collisions > 20


def test_a_blocked_centre_line_is_an_answer(post):
    problem, _ = post
    ball = Obstacle.sphere("ball", 0.02, placement_of([0.45, -0.1, 0]))
    result = measure_tube(replace(problem, obstacles=[ball]), QUICK)
    assert (result.succeeded, result.status, result.problem) == (False, "tube_blocked", None)
    assert (result.location.links, result.location.obstacle) == (("link2",), "ball")
    assert "the arm collides on the centre line of segment 0: link2, to 'ball'" in result.message
    assert "mm too close; move the reference points" in result.message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_radius": 0}, "max_radius is 0 m; it must be > 0 and finite"),
        ({"samples": 0}, "samples is 0; it must be >= 1"),
        ({"seed": -1}, "seed is -1; it must be >= 0"),
        ({"max_segments": 0}, "max_segments is 0; it must be >= 1"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        MeasureOptions(**options)


def test_the_tool_radius_must_fit(post):
    problem, _ = post
    tube = Tube(problem.tube.points, 0.1, tool_radius=0.05, joint_signs={"joint2": "-"})
    with pytest.raises(OptionError, match=r"max_radius is 0\.05 m; it must be above the tool rad"):
        measure_tube(problem.with_tube(tube), MeasureOptions(max_radius=0.05))


def test_too_many_segments_are_refused_at_once(post):
    problem, _ = post
    angles = np.linspace(0, np.pi, 22)[:, None]
    arc = [0.4, 0, 0] + 0.1 * np.hstack([-np.cos(angles), -np.sin(angles), 0 * angles])
    many = problem.along(Tube(arc, 0.02, joint_signs={"joint2": "-"}), Seed(np.array([0, -1.0])))
    said = []
    for measure in (measure_tube, survey_patterns):
        with pytest.raises(OptionError, match="measure: 21 segments; at most 20 are measured"):
            measure(many, QUICK, said.append)
    assert not said


def test_parts_of_a_line_are_measured_as_one_where_there_are_too_many(post):
    problem, whole = post
    count = problem.tube.segment_count
    points = [a + s * (b - a) for a, b in pairwise(problem.tube.points) for s in (0, 0.3, 0.6)]
    divided = Tube(
        [*points, problem.tube.points[-1]],
        np.repeat(problem.tube.radius, 3),
        joint_signs=[signs for signs in problem.tube.joint_signs for _ in range(3)],
    )
    few = replace(QUICK, max_segments=count)
    found = measure_tube(problem.with_tube(divided), few)
    assert found.problem.tube.segment_count == len(found.segments) == 3 * count
    for k, segment in enumerate(found.segments):
        assert segment is found.segments[3 * (k // 3)]
        assert segment.radius == whole.segments[k // 3].radius
    assert found.problem.joined.tube.segment_count == count
    assert found.message == whole.message


def test_a_tube_of_boxes_is_refused_by_name(post):
    problem, _ = post
    section = {"box": [0.1, 0.04], "up": [0, 0, 1]}
    boxes = problem.with_tube(Tube(problem.tube.points, None, cross_section=section))
    with pytest.raises(ProblemError, match=r"segment 0 has a box.*leave out tube.cross_section"):
        measure_tube(boxes)
