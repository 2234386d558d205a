"""Plans along joint routes: the joint line, stops at corners, the route."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import SHORTEST
from placed_problem import bundled_fields

from tubeplanner import (
    Planner,
    PlanOptions,
    load_problem,
    parse_cycle,
    parse_problem,
    plan,
    plan_cycle,
)
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.first_guess.branches import ReferenceBranch
from tubeplanner.first_guess.joint_routes import RouteSearch
from tubeplanner.geometry.tube.points import densified
from tubeplanner.optimizer.descent import Descent, DescentState, SequentialProgram
from tubeplanner.optimizer.link_constraints import CAUTIOUS_PER_INTERVAL, LinkConstraints
from tubeplanner.optimizer.starts import free_start
from tubeplanner.optimizer.step_search import TrustRegion
from tubeplanner.outcome import PlanningClock, TimeLimitReached
from tubeplanner.output.files.fingerprint import problem_hash
from tubeplanner.output.files.problem_file import with_problem
from tubeplanner.planning.route_plans import RoutePlans

FOLDER = Path("robots/two_link")
STOPS = PlanOptions(method="stop-at-corners")


def free():
    return load_problem("example:two_link/through_the_gap", reads_tube=False)


@pytest.fixture(scope="module")
def gap():
    """Return the problem of the gap with a free route through it."""
    problem = free()
    route = next(RouteSearch(problem, problem.start, problem.goal[None]).routes(1, 400))
    return problem.with_tube(replace(problem.tube, route=route))


@pytest.fixture(scope="module")
def planned(gap):
    return plan(gap, SHORTEST)


def test_a_plan_along_a_route_is_fast_and_stops_at_its_corners_are_certified(gap, planned):
    stopping = plan(gap, STOPS)
    assert planned.succeeded and stopping.succeeded
    assert planned.duration < 0.4 * stopping.duration
    for corner in gap.tube.route:
        q = stopping.trajectory.position(stopping.trajectory.breakpoints)
        assert abs(q - corner).max(axis=1).min() < 1e-9


def test_refinement_of_a_free_route_stays_free(gap, planned):
    plans = RoutePlans(SHORTEST, PlanningClock(None, None))
    plans.refine(gap)
    assert plans.best.certificate.passed
    assert plans.durations == [plans.duration]
    assert plans.duration < 1.05 * planned.duration


def test_the_file_of_a_route_is_planned_alike(gap, planned, tmp_path):
    fields = bundled_fields("two_link/through_the_gap")
    written = json.loads(with_problem(fields, FOLDER, tmp_path / "p.json", gap))
    assert "points" not in written["tube"]
    again = parse_problem(written, tmp_path)
    assert problem_hash(again) == problem_hash(gap) == problem_hash(free())
    assert plan(again, SHORTEST).duration == planned.duration


def test_a_problem_with_a_route_is_planned_again_from_the_last_motion(gap, planned):
    planner = Planner(gap, SHORTEST)
    planner.plan()
    heavier = replace(gap, obstacles=gap.obstacles)
    assert planner.replan(heavier).duration <= 1.001 * planned.duration


def test_stops_at_corners_are_the_answer_when_time_is_over(gap, monkeypatch):
    def late(*_):
        raise TimeLimitReached

    monkeypatch.setattr(RoutePlans, "refine_line", lambda *_: None)
    monkeypatch.setattr(RoutePlans, "refine", late)
    result = plan(gap, SHORTEST)
    assert (result.succeeded, result.method) == (True, "stop-at-corners")
    assert result.stopped_by == "time_limit"


def test_stops_on_a_route_through_an_obstacle_are_refused_with_their_place(gap):
    straight = gap.with_tube(replace(gap.tube, route=gap.tube.route[[0, -1]]))
    result = plan(straight, STOPS)
    assert str(result.status) == "tube_blocked"
    assert result.location.obstacle is not None


@pytest.mark.parametrize(
    ("tube", "said"),
    [
        ({"route": [[-0.3, 0.6]]}, "give at least two configurations"),
        ({"route": [[-0.3, 0.6], [1.5]]}, r"tube.route\[1\] has 1 values for the 2 joints"),
        ({"route": [[0, 0.6], [1.5, 0.6]]}, "begins with joint 'joint1' at 0, the start has it at"),
        ({"route": [[-0.3, 0.6], [1, 0.6]]}, "ends with joint 'joint1' at 1, the goal has it at"),
        ({"route": [[-0.3, 0.6], [9, 0], [1.5, 0.6]]}, r"tube.route\[1\]: joint 'joint1' at 9 is"),
        ({"route": [[-0.3, 0.6], [1.5, 0.6]], "radius": 1}, r"tube\.radius does not go with"),
        ({}, r"tube\.points is required"),
    ],
)
def test_a_route_that_leads_elsewhere_is_refused(tube, said):
    with pytest.raises(ProblemError, match=said):
        parse_problem({**bundled_fields("two_link/through_the_gap"), "tube": tube}, FOLDER)


def test_a_route_needs_configurations_at_its_ends(gap):
    with pytest.raises(ProblemError, match=r"goal\.joints is required: tube\.route leads there"):
        replace(gap, goal=None)


@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_methods_that_follow_points_refuse_a_route(gap, method):
    with pytest.raises(OptionError, match=r"there are none: tube\.route is given; give method"):
        plan(gap, PlanOptions(method=method))


def test_the_tool_keeps_a_speed_limit_beside_a_route(gap, planned):
    slow = replace(gap.tube, tool_speed=0.5)
    result = plan(gap.with_tube(slow), SHORTEST)
    assert result.succeeded
    assert result.duration > planned.duration
    tool = gap.robot.tool_position(result.trajectory.position(np.linspace(0, result.duration, 999)))
    assert np.linalg.norm(np.diff(tool, axis=0), axis=1).max() <= 0.501 * result.duration / 998


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("sweep FILE --radius 0.1", "does not go with a sweep over radii; give points and radii"),
        ("measure FILE", "does not go with measuring, which gives radii"),
        ("explain FILE", "has no points and radii, which are what explain changes"),
        ("place FILE --region=0,1,0,1 --stands-on none", "is for one base pose"),
    ],
)
def test_commands_that_change_radii_or_points_refuse_a_route(run, tmp_path, words, said):
    path = tmp_path / "route.json"
    fields = bundled_fields("two_link/through_the_gap")
    path.write_text(json.dumps({**fields, "tube": {"route": [[-0.3, 0.6], [1.5, 0.6]]}}))
    status, _, err = run(*words.replace("FILE", str(path)).split())
    assert status == 2
    assert "tube.route" in err and said in err


def test_a_route_is_named_by_info_and_view(run, tmp_path, gap):
    path = tmp_path / "route.json"
    path.write_bytes(with_problem(bundled_fields("two_link/through_the_gap"), FOLDER, path, gap))
    out = run("info", path)[1]
    assert f"route of {len(gap.tube.route)} configurations; the tool may be anywhere" in out
    assert (
        "note: there is no tube: the tool may be anywhere\n"
        in run("view", path, "--html", tmp_path / "page.html")[1]
    )


def cycle_of(*moves, **header):
    """Return a cycle in the cell of the gap, from its start."""
    fields = bundled_fields("two_link/through_the_gap")
    cell = {key: fields[key] for key in ("robot", "start", "obstacles")}
    return parse_cycle({"format": "tubeplanner/cycle", **cell, "moves": moves, **header}, FOLDER)


THERE = {"to": "there", "goal": {"joints": [1.5, 0.6]}}
BACK = {"to": "back", "goal": {"joints": [-0.3, 0.6]}}


def test_moves_of_a_cycle_may_have_no_tube(gap, planned, run, tmp_path):
    attach = {"attach": "part", "payload": {"mass": 0.2}}
    result = plan_cycle(cycle_of(THERE, attach, BACK), SHORTEST)
    assert result.succeeded
    first, second = result.legs
    assert first.duration == pytest.approx(planned.duration, rel=0.01)
    assert second.duration > first.duration  # with the part
    for plan_of_leg, end in zip(result.legs, (gap.goal, gap.start), strict=True):
        np.testing.assert_allclose(plan_of_leg.end, end, atol=1e-9)
    path = tmp_path / "cycle.json"
    fields = bundled_fields("two_link/through_the_gap")
    fields |= {"format": "tubeplanner/cycle", "moves": [THERE]}
    del fields["goal"]
    path.write_text(json.dumps(fields))
    pictures = ("--plot", tmp_path / "c.png", "--html", tmp_path / "c.html")
    assert run("plan", path, "--quality", "fast", *pictures)[0] == 0


@pytest.mark.parametrize(
    ("moves", "said"),
    [
        ([{"to": "there"}], "move 'there': goal.group_state 'there' is one of an SRDF"),
        ([THERE, {**BACK, "to": "there"}], "move 'there': 2 moves have this name"),
    ],
)
def test_a_move_without_a_tube_needs_an_end_and_its_own_name(moves, said):
    with pytest.raises(ProblemError, match=said):
        cycle_of(*moves)


def test_a_search_finds_the_routes_where_the_line_leads_nowhere(planned, monkeypatch):
    monkeypatch.setattr(RoutePlans, "refine_line", lambda *_: None)
    result = plan(free(), SHORTEST)
    assert result.succeeded
    assert result.duration < 1.05 * planned.duration


@pytest.mark.parametrize(("is_cautious", "least", "most"), [(True, 0.0, 0.1), (False, 0.5, 9.0)])
def test_cautious_steps_stay_free_where_others_do_not(gap, is_cautious, least, most):
    branch = ReferenceBranch((densified(gap.tube.route, 0.05),))
    spline = free_start(gap, branch)
    links = LinkConstraints(gap, per_interval=CAUTIOUS_PER_INTERVAL)
    program = SequentialProgram(gap, spline.grid, links, is_cautious=is_cautious)
    depths = []

    def look(iterates):
        fresh = LinkConstraints(gap, per_interval=CAUTIOUS_PER_INTERVAL)
        fresh.add_samples(iterates[0].spline)
        depths.append(fresh.at(iterates[0].spline).excess.max(initial=0.0))

    begun = DescentState((program.iterate(spline),), TrustRegion(0.2))
    result = Descent((program,)).improved(begun, min_gain=1e-3, max_steps=20, checkpoint=look)
    assert result.iterate.duration < begun.iterate.duration
    assert least <= max(depths) <= most
