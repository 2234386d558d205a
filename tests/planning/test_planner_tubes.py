"""Plans in tubes of every kind: boxes, contacts, goal regions, narrow ones."""

from copy import deepcopy
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import yaml
from cases import BRIEF, SHORTEST, study_but

from outside.trajectory import read_trajectory
from outside_judge import Judge, passes
from tubeplanner import (
    GoalRegion,
    MeasureOptions,
    PlanningProblem,
    PlanOptions,
    RouteOptions,
    Seed,
    Tube,
    compare,
    load_problem,
    measure_tube,
    plan,
    verify,
)
from tubeplanner.first_guess.baselines import BASELINES, judged_baseline
from tubeplanner.limits.speed_limits import unused_speed
from tubeplanner.output.files.trajectory_writer import trajectory_json
from tubeplanner.studies.tubes.route import find_route

FAST = PlanOptions(slack=0.0, quality="fast")

# Planning in tubes of boxes: certified, no slower than the discs inside, with prices by side.

POINTS = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
UP = [0, 0, 1]  # of the plane in which the two-link arm moves
NARROW = 0.02


def problem_in(arm, sections=None, radius=None, points=POINTS, **others):
    tube = Tube(points, radius, cross_section=sections, joint_signs={"joint2": "-"}, **others)
    return PlanningProblem(arm, tube, Seed(np.array([0.0, -1.0])))


def boxes(width, height, up=UP):
    return {"box": [width, height], "up": up}


@pytest.fixture(scope="module")
def answer_in(two_link):
    """Return a function from a name to problem and answer: a disc, boxes of several shapes."""
    sections = {
        "square": boxes(2 * NARROW, 2 * NARROW),
        "flat": boxes(6 * NARROW, 2 * NARROW),
        "tall": boxes(2 * NARROW, 6 * NARROW),
        "turned": boxes(2 * NARROW, 6 * NARROW, [0.8, -0.3, 0]),
    }
    problems = {name: problem_in(two_link, section) for name, section in sections.items()}
    problems["disc"] = problem_in(two_link, radius=NARROW)
    problems["wide disc"] = problem_in(two_link, radius=3 * NARROW)
    return cache(lambda name: (problems[name], plan(problems[name], SHORTEST)))


@pytest.mark.parametrize(
    ("name", "side"),
    [("square", "width"), ("flat", "width"), ("tall", "width"), ("turned", "height")],
)
def test_boxes_are_certified_and_the_side_in_the_plane_has_the_price(answer_in, name, side):
    problem, answer = answer_in(name)
    assert answer.method == "refinement"
    assert verify(problem, answer.trajectory).conditions["tube"].margin >= 0
    prices = {"width": 0.0, "height": 0.0, "radius": 0.0}
    for one in answer.sensitivities:
        if one.segment is not None:
            prices[one.limit] += one.elasticity
    assert prices.pop(side) < -0.02
    assert set(prices.values()) == {0.0}
    assert any(str(one).startswith(f"{side} of segment ") for one in answer.sensitivities)


def test_a_box_is_as_fast_as_what_it_holds_allows(answer_in):
    names = ("disc", "wide disc", "square", "flat", "tall", "turned")
    duration = {name: answer_in(name)[1].duration for name in names}
    assert duration["square"] <= 1.001 * duration["disc"]
    assert duration["flat"] < 0.97 * duration["square"]
    assert duration["flat"] <= 1.01 * duration["wide disc"]  # but for the ends it is the strip
    assert duration["turned"] == pytest.approx(duration["flat"], rel=1e-3)  # the same strip
    # The arm moves in a plane: height is of no use.
    assert duration["tall"] == pytest.approx(duration["square"], rel=1e-3)


def test_discs_and_boxes_mix(two_link, answer_in):
    mixed = problem_in(two_link, [None, boxes(6 * NARROW, 2 * NARROW)], [NARROW, None])
    answer = plan(mixed, SHORTEST)
    assert answer.certificate.passed
    durations = [answer_in(name)[1].duration for name in ("flat", "disc")]
    assert durations[0] * 0.999 <= answer.duration <= durations[1] * 1.001
    names = {(p.limit, p.segment) for p in answer.sensitivities if p.segment is not None}
    assert names <= {("radius", 0), ("width", 1), ("height", 1)}


def test_equal_boxes_on_one_line_are_one_segment(two_link):
    divided = np.insert(np.array(POINTS), 1, [0.45, -0.1, 0], axis=0)
    flat = boxes(6 * NARROW, 2 * NARROW)
    assert problem_in(two_link, [flat] * 3, points=divided).joined.tube.segment_count == 2
    for other in (boxes(5 * NARROW, 2 * NARROW), boxes(6 * NARROW, 2 * NARROW, [0, 1e-3, 1]), None):
        radius = [None, NARROW if other is None else None, None]
        apart = problem_in(two_link, [flat, other, flat], radius, points=divided)
        assert apart.joined is apart


def test_out_and_back_passes_the_compulsory_point(two_link):
    points = [POINTS[0], POINTS[1], POINTS[0]]
    problem = problem_in(two_link, boxes(0.2, 0.04), points=points)
    certificate = plan(problem, SHORTEST).certificate
    assert certificate.passed
    assert 0 <= certificate.conditions["points"].margin <= 0.02


@pytest.mark.parametrize(
    ("method", "visit"),
    [("stop-at-corners", "ordered"), ("branch-and-bound", "any"), ("suh-bishop", "ordered")],
)
def test_other_methods_keep_a_box(two_link, method, visit):
    problem = problem_in(two_link, boxes(0.12, 0.04), visit=visit)
    options = PlanOptions(method, candidate_points=15, slack=0.0, suh_bishop=BRIEF)
    answer = plan(problem, options)
    assert verify(problem, answer.trajectory).passed


def test_a_thin_box_is_planned(two_link):
    """It is widened on coarse knots, as a whole."""
    problem = problem_in(two_link, boxes(0.1, 0.002, [0.8, -0.3, 0]))
    answer = plan(problem, SHORTEST)
    assert (answer.method, answer.certificate.passed) == ("refinement", True)
    assert answer.duration <= 1.001 * plan(problem_in(two_link, radius=0.001), SHORTEST).duration


# Plans that begin or end in contact: certified, judged by other code, or refused by name.

DOWN = [0.7071068, -0.7071068, 0.0, 0.0]
UPRIGHT = [0.0524, 0.0524, float("inf")]
PART = {
    "name": "part",
    "box": [0.06, 0.06, 0.1],
    "position": [0, 0, 0.05],
    "touch_links": ["wrist_3_link"],
}
PICK = {
    "robot": {
        "urdf": "example:ur5",
        "tool_frame": "tool0",
        "payload": {"mass": 1.0, "com": [0, 0, 0.05], "inertia": [0.004, 0.004, 0.007, 0, 0, 0]},
        "attached": [PART],
    },
    "tube": {
        "points": [[0.45, -0.3, 0.1], [0.45, -0.3, 0.4], [0.45, 0.3, 0.4], [0.45, 0.3, 0.1]],
        "radius": [0.03, 0.08, 0.03],
        "joint_signs": {"elbow_joint": "+"},
        "orientations": [DOWN] * 4,
        "rotation_tolerance": [UPRIGHT, [0.1, 0.1, float("inf")], UPRIGHT],
    },
    "start": {"seed": [-0.791217, -1.311999, 1.900383, -2.159181, -1.570796, 0.0]},
    "goal": {"seed": [0.4, -1.311999, 1.900383, -2.159181, -1.570796, 0.0]},
    "obstacles": [
        {"name": "wall", "box": [0.6, 0.05, 0.2], "position": [0.6, 0, 0.1]},
        {"name": "table", "box": [0.9, 1.6, 0.04], "position": [0.75, 0, -0.02]},
    ],
    "clearance": 0.01,
    "contacts": [{"links": ["part", "table"], "within": 0.03}],
}


@pytest.fixture
def solved(tmp_path):
    """Return a function from a problem's fields to problem, plan, and the outside judge's word."""

    def solve(fields):
        path = tmp_path / "pick.yaml"
        path.write_text(yaml.safe_dump(fields))
        problem = load_problem(path)
        result = plan(problem, SHORTEST)
        if result.trajectory is None:
            return problem, result, None
        (tmp_path / "plan.json").write_text(trajectory_json(result.trajectory))
        found = Judge(path).judge(read_trajectory(tmp_path / "plan.json"), 1000)
        return problem, result, found

    return solve


# The hand begins 5 mm below a ball.
TOUCHING = {
    "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
    "tube": {
        "points": [[0.45, -0.3, 0], [0.45, 0.1, 0]],
        "radius": 0.05,
        "joint_signs": {"joint2": "-"},
    },
    "start": {"seed": [0.0, -1.0]},
    "obstacles": [{"name": "ball", "sphere": 0.02, "position": [0.45, -0.3, 0.065]}],
    "clearance": 0.01,
    "contacts": [{"links": ["link2", "ball"], "within": 0.1}],
}


@pytest.mark.dear("plans; the outside judge")
def test_a_plan_begins_in_contact_and_other_code_confirms_it(solved):
    _, result, verdict = solved(TOUCHING)
    assert result.succeeded, result.message
    assert passes(verdict)
    assert result.certificate.conditions["obstacles"].where.obstacle == "ball"
    _, refused, _ = solved({key: value for key, value in TOUCHING.items() if key != "contacts"})
    assert refused.status == "tube_blocked"
    assert "contacts" in refused.message


@pytest.mark.slow  # plans for an arm of six joints, as all below that are
def test_a_part_is_carried_from_a_table_to_a_table(solved):
    """Contact costs next to nothing: within 1 % of the motion that ignores the pair."""
    _, result, verdict = solved(PICK)
    assert result.succeeded, result.message
    assert passes(verdict)
    ignoring = {"contacts": [], "collision": {"ignore": [["part", "table"]]}}
    _, other, _ = solved(PICK | ignoring)
    assert result.duration <= 1.01 * other.duration
    assert result.certificate.conditions["obstacles"].where.obstacle == "table"


@pytest.mark.slow
def test_a_goal_that_is_open_may_be_in_contact_and_must_not_overlap(solved):
    """A millimetre above the table: less than the clearance, and more than nothing."""
    fields = deepcopy(PICK)
    del fields["goal"]
    fields["tube"]["points"][-1] = [0.45, 0.3, 0.104]
    _, result, found = solved(fields)
    assert result.succeeded, result.message
    assert passes(found)
    del fields["contacts"]
    fields["tube"]["points"][0] = [0.45, -0.3, 0.12]
    _, without, _ = solved(fields)
    assert not without.succeeded


@pytest.mark.slow
def test_tubes_are_measured_and_routes_found_in_contact(solved):
    """Measured tubes claim nothing of pairs in contact: of a metre, they would end at the table."""
    problem, result, _ = solved(PICK)
    measured = measure_tube(problem, MeasureOptions(max_radius=0.05))
    assert measured.succeeded
    unmeasured = "; not measured, since they may be in contact: 'part' and 'table'"
    assert measured.message.endswith(unmeasured)
    ends = result.trajectory.position([0.0, result.duration])
    way = find_route(replace(problem, start=ends[0], goal=ends[1]), RouteOptions(time_limit=60.0))
    assert way.succeeded, way.message


# Plans to tool positions: exact ones as an open goal, balls used to save time, orientations.

POST, TRAY = "two_link/around_a_post", "ur5/level_tray"


def with_goal(problem, *values, position=None):
    position = problem.tube.points[-1] if position is None else position
    return replace(problem, goal=GoalRegion(position, *values))


def away(problem, result):
    tool = problem.robot.tool_position(result.trajectory.position(result.duration))
    return float(np.linalg.norm(tool - problem.goal.position))


@pytest.mark.dear("plans six goals")
def test_the_larger_the_ball_the_shorter_the_motion_and_its_price_says_by_how_much(bundled):
    """Without a tolerance, it is as a goal that is left out; a tiny one costs nothing.

    The price is of 10 % more; against planning again with 30 % more.
    """
    problem = replace(bundled(POST), goal=None)
    results = {None: plan(problem, SHORTEST)}
    for tolerance in (0.0, 1e-4, 0.005, 0.02, 0.026):
        ball = with_goal(problem, tolerance)
        results[tolerance] = plan(ball, SHORTEST)
        assert 0.9 * tolerance - 1e-9 < away(ball, results[tolerance]) < tolerance + 1e-6
    duration = {tolerance: result.duration for tolerance, result in results.items()}
    assert duration[None] == pytest.approx(duration[0.0], rel=1e-3)
    assert duration[0.0] > 1.002 * duration[0.005] > 1.004 * duration[0.02]
    assert duration[1e-4] < 1.002 * duration[0.0]
    price = next(one for one in results[0.02].sensitivities if one.limit == "tolerance")
    assert str(price).startswith("tolerance of the goal: ")
    assert duration[0.02] - duration[0.026] == pytest.approx(3 * price.saved, rel=0.2)
    ends = "the tool ends 19.9 mm from the goal's position; the goal was left open"
    assert ends in results[0.02].message


@pytest.mark.parametrize(
    ("position", "tolerance"),
    [
        ([0.21, 0.44, 0.0], 0.0),  # beside the last segment
        ([0.2, 0.25, 0.0], 0.01),  # half way along it
        ([0.2, 0.1, 0.0], 0.0),  # where it begins, so that its leg has no length
        ([0.2, 0.45, 0.0], 0.5),  # the ball holds the capsule
    ],
)
def test_the_end_is_in_ball_and_capsule(position, tolerance, bundled):
    problem = with_goal(bundled(POST), tolerance, position=position)
    result = plan(problem, SHORTEST)
    assert result.duration < 0.85
    assert away(problem, result) <= tolerance + 1e-6
    goal = result.certificate.conditions["goal"]
    assert goal.margin == pytest.approx(tolerance - away(problem, result), abs=1e-9)


def test_a_ball_is_reached_where_its_centre_is_not(bundled):
    """The arm ends 5 mm short of a point that it does not reach, within 1 cm of it."""
    problem = bundled(POST)
    reach = 0.6
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [np.sqrt(reach**2 - 0.1**2) + 0.005, 0.1, 0]]
    tube = Tube(points, 0.03, joint_signs={"joint2": "+"})
    open_end = replace(problem, tube=tube, goal=None, obstacles=())
    assert plan(with_goal(open_end, 0.0), SHORTEST).status == "unreachable"
    assert plan(with_goal(open_end, 0.01), SHORTEST).succeeded
    refused = plan(with_goal(open_end, 0.003), SHORTEST)
    assert refused.status == "unreachable"
    assert "and 0.003 m of tolerance; the goal is " in refused.message


@pytest.mark.parametrize(("bound", "tolerance"), [((0.02, 0.02, np.inf), 0.0), (0.002, 0.02)])
def test_the_end_may_be_turned_less_than_the_way(bound, tolerance, stored):
    problem, loosely_turned = stored(TRAY, "refinement")
    free = problem.with_tube(replace(problem.tube, rotation_tolerance=np.inf))
    turned = with_goal(free, tolerance, bound)
    result = plan(turned, FAST)
    rotation = result.certificate.conditions["rotation"]
    assert -1e-6 <= rotation.margin < 0.1 * np.min(bound)
    assert rotation.coverage == "at the goal"
    assert any(one.limit == "rotation_tolerance" for one in result.sensitivities)
    assert all(one.saved < 0.05 for one in result.sensitivities)
    assert "rotation" in verify(turned, loosely_turned).failures()


@pytest.mark.parametrize(
    ("method", "visit"),
    [("stop-at-corners", "ordered"), ("branch-and-bound", "any"), ("suh-bishop", "ordered")],
)
def test_every_method_ends_in_the_ball(method, visit, bundled):
    problem = bundled(POST)
    tube = Tube(problem.tube.points, problem.tube.radius, visit=visit)
    problem = with_goal(replace(problem, tube=tube), 0.02, position=[0.22, 0.44, 0.0])
    result = plan(problem, PlanOptions(method, candidate_points=15, suh_bishop=BRIEF))
    assert result.succeeded
    assert away(problem, result) <= 0.02


def test_baselines_end_in_the_ball(bundled):
    problem = with_goal(bundled(POST), 0.02, position=[0.21, 0.44, 0.0])
    _, certificate = judged_baseline(problem, "bounded-deviation")
    assert certificate.conditions["goal"].margin >= -1e-6


# Tubes of millimetres: planned as well as wide ones, and never slower than what else there is.

# The shortest durations [s] over the processor types of `test_planner.py`, by radius [mm].
BEST = {
    ("ur5/over_the_wall", 1.0): 0.63905,
    ("panda/between_shelves", 1.0): 0.78570,
    ("ur10/onto_a_conveyor", 0.5): 1.04888,
    ("xarm7/from_crate_to_crate", 0.5): 0.66030,
}


def narrowed(name, millimetres):
    problem = load_problem(f"example:{name}")
    return replace(problem, tube=problem.tube.with_radius(millimetres / 1000))


# Narrow tubes of arms with six and seven joints, of seconds each.
@pytest.mark.parametrize(("name", "millimetres"), study_but([("ur5/over_the_wall", 1.0)], BEST))
def test_a_narrow_tube_takes_no_longer_than_the_best_known(name, millimetres):
    """And less than every scheme."""
    problem = narrowed(name, millimetres)
    result = plan(problem, SHORTEST)
    assert result.method == "refinement"
    assert result.duration <= 1.01 * BEST[name, millimetres]
    assert unused_speed(problem, result.trajectory) < 0.01
    smoothed = [name for name in BASELINES if name.startswith("smoothed")]
    rows = compare(problem, methods=smoothed).rows
    assert result.duration < min(row.duration for row in rows if row.certified)


@pytest.mark.parametrize(
    ("name", "radii"),
    [
        ("two_link/around_a_post", (0.5, 30, 100)),
        pytest.param("ur5/over_the_wall", (0.5, 2, 10, 30, 100), marks=pytest.mark.slow),
    ],
)
def test_a_wider_tube_is_never_slower(name, radii):
    results = [plan(narrowed(name, radius), FAST) for radius in radii]
    for narrow, wide in pairwise(results):
        assert wide.duration <= 1.01 * narrow.duration
    assert results[0].method == "refinement"
