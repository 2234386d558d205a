"""Planning in tubes of boxes: certified, no slower than the discs inside, with prices by side."""

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import (
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    Seed,
    Tube,
    load_robot,
    plan,
    verify,
)

POINTS = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
UP = [0, 0, 1]  # of the plane in which the two-link arm moves
NARROW = 0.02
START = Seed(np.array([0.0, -1.0]))
EVERY = {"joint1": np.inf, "joint2": np.inf}


@pytest.fixture(scope="module")
def arm():
    limits = LimitOverrides(velocity=EVERY)
    return load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)


def problem_in(arm, sections=None, radius=None, points=POINTS, start=START, **others):
    tube = Tube(points, radius, cross_section=sections, joint_signs={"joint2": "-"}, **others)
    return PlanningProblem(arm, tube, start)


def boxes(width, height, up=UP):
    return {"box": [width, height], "up": up}


@pytest.fixture(scope="module")
def planned(arm):
    """Return the answers in a disc, and in boxes that are square, flat, tall, and turned."""
    square, flat, tall = ((2, 2), (6, 2), (2, 6))
    sections = {
        n: boxes(NARROW * w, NARROW * h)
        for n, (w, h) in zip(("square", "flat", "tall"), (square, flat, tall), strict=True)
    }
    sections["turned"] = boxes(2 * NARROW, 6 * NARROW, [0.8, -0.3, 0])
    problems = {name: problem_in(arm, section) for name, section in sections.items()}
    problems["disc"] = problem_in(arm, radius=NARROW)
    problems["wide disc"] = problem_in(arm, radius=3 * NARROW)
    return {name: (problem, plan(problem, SHORTEST)) for name, problem in problems.items()}


@pytest.mark.parametrize("name", ["square", "flat", "tall", "turned"])
def test_boxes_are_planned_by_refinement_and_certified(planned, name):
    problem, answer = planned[name]
    assert answer.method == "refinement"
    assert answer.certificate.passed
    assert verify(problem, answer.trajectory).conditions["tube"].margin >= 0


def test_a_box_is_as_fast_as_what_it_holds_allows(planned):
    duration = {name: answer.duration for name, (_, answer) in planned.items()}
    assert duration["square"] <= 1.001 * duration["disc"]
    assert duration["flat"] < 0.97 * duration["square"]
    assert duration["flat"] <= 1.01 * duration["wide disc"]  # but for the ends it is the strip
    assert duration["turned"] == pytest.approx(duration["flat"], rel=1e-3)  # the same strip
    # The arm moves in a plane: height is of no use.
    assert duration["tall"] == pytest.approx(duration["square"], rel=1e-3)


@pytest.mark.parametrize(
    ("name", "side"),
    [("square", "width"), ("flat", "width"), ("tall", "width"), ("turned", "height")],
)
def test_the_side_in_the_plane_has_the_price(planned, name, side):
    _, answer = planned[name]
    prices = {"width": 0.0, "height": 0.0, "radius": 0.0}
    for one in answer.sensitivities:
        if one.segment is not None:
            prices[one.limit] += one.elasticity
    assert prices.pop(side) < -0.02
    assert set(prices.values()) == {0.0}
    assert any(str(one).startswith(f"{side} of segment ") for one in answer.sensitivities)


def test_discs_and_boxes_mix(arm, planned):
    mixed = problem_in(arm, [None, boxes(6 * NARROW, 2 * NARROW)], [NARROW, None])
    answer = plan(mixed, SHORTEST)
    assert answer.certificate.passed
    durations = [planned[name][1].duration for name in ("flat", "disc")]
    assert durations[0] * 0.999 <= answer.duration <= durations[1] * 1.001
    names = {(p.limit, p.segment) for p in answer.sensitivities if p.segment is not None}
    assert names <= {("radius", 0), ("width", 1), ("height", 1)}


def test_equal_boxes_on_one_line_are_one_segment(arm, planned):
    divided = np.insert(np.array(POINTS), 1, [0.45, -0.1, 0], axis=0)
    flat = boxes(6 * NARROW, 2 * NARROW)
    one = problem_in(arm, [flat] * 3, points=divided)
    assert one.joined.tube.segment_count == 2
    np.testing.assert_array_equal(
        plan(one, SHORTEST).trajectory.breakpoints, planned["flat"][1].trajectory.breakpoints
    )
    for other in (boxes(5 * NARROW, 2 * NARROW), boxes(6 * NARROW, 2 * NARROW, [0, 1e-3, 1]), None):
        radius = [None, NARROW if other is None else None, None]
        apart = problem_in(arm, [flat, other, flat], radius, points=divided)
        assert apart.joined is apart


def test_out_and_back_passes_the_compulsory_point(arm):
    points = [POINTS[0], POINTS[1], POINTS[0]]
    problem = problem_in(arm, boxes(0.2, 0.04), points=points)
    answer = plan(problem, SHORTEST)
    assert answer.certificate.passed
    found = answer.certificate.conditions["points"]
    assert 0 <= found.margin <= 0.02


METHODS = ["stop-at-corners", pytest.param("suh-bishop", marks=pytest.mark.slow)]


@pytest.mark.parametrize("method", METHODS)
def test_other_methods_keep_a_box(arm, method):
    problem = problem_in(arm, boxes(0.12, 0.04))
    answer = plan(problem, PlanOptions(method, time_limit=20.0, slack=0.0))
    assert answer.succeeded
    assert verify(problem, answer.trajectory).passed


def test_the_union_of_boxes_is_planned(arm):
    problem = problem_in(arm, boxes(0.12, 0.08), visit="any")
    answer = plan(problem, PlanOptions("branch-and-bound", time_limit=20.0))
    assert answer.certificate.passed


def test_a_thin_box_is_planned(arm):
    """It is widened on coarse knots, as a whole."""
    problem = problem_in(arm, boxes(0.1, 0.002, [0.8, -0.3, 0]))
    answer = plan(problem, SHORTEST)
    assert (answer.method, answer.certificate.passed) == ("refinement", True)
    assert answer.duration <= 1.001 * plan(problem_in(arm, radius=0.001), SHORTEST).duration


def arc(count):
    """Return points on a quarter of a circle of 0.2 m about (0.25, 0, 0)."""
    angle = np.linspace(-np.pi / 2, np.pi / 4, count + 1)
    return np.column_stack([0.25 + 0.2 * np.cos(angle), 0.2 * np.sin(angle), 0 * angle])


@pytest.fixture(scope="module")
def dense(arm):
    problem = problem_in(arm, boxes(2 * NARROW, 0.2), points=arc(40))
    return problem, plan(problem, SHORTEST)


def test_a_dense_path_of_boxes_is_planned_as_a_chain(arm, dense):
    _, answer = dense
    assert (answer.method, answer.certificate.passed) == ("refinement", True)
    disc = plan(problem_in(arm, radius=NARROW, points=arc(40)), SHORTEST)
    assert answer.duration == pytest.approx(disc.duration, rel=2e-3)
    prices = {p.limit for p in answer.sensitivities if p.segment is not None}
    assert prices <= {"width", "height"}
    of_discs = sum(p.elasticity for p in disc.sensitivities if p.limit == "radius")
    of_boxes = sum(p.elasticity for p in answer.sensitivities if p.limit == "width")
    assert of_boxes == pytest.approx(of_discs, rel=0.1)
