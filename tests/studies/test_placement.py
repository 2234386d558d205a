"""place: grid and pattern search for the base pose of the shortest motion."""

import json
import math
import pickle
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import pytest
from gantry import BEST_DURATION, BEST_YAW, FLOOR, POST, gantry

from tubeplanner import (
    BasePlacement,
    OptionError,
    PlaceOptions,
    ProblemError,
    load_problem,
    place,
    plan,
)
from tubeplanner.outcome import Location
from tubeplanner.output.files.problem_file import with_placement
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies import placement as module
from tubeplanner.studies.base_regions import MovableProblem, Region
from tubeplanner.studies.placement import (
    SEARCH_OPTIONS,
    PlacementRow,
    _neighbours,
    _starts,
    grouped,
    pattern_search,
    tried,
)
from tubeplanner.studies.problem_spec import ProblemSpec

LOW, HIGH = -2.0, 3.0
FEW = PlaceOptions(points=8, quality="fast", slack=0.0)
ONE = replace(FEW, points=1)
HERE = [-0.3, -0.3, 0.0, 0.0]  # one place: only the angle is open
IN_POST = [-0.3, -0.3, 0.3, 0.3]
ANSWERS = {}


def neighbours(point, fraction):
    """Return the neighbours of a point in a square, first steps one long."""
    x, y = point
    moved = [(x + fraction, y), (x - fraction, y), (x, y + fraction), (x, y - fraction)]
    return [tuple(min(max(v, LOW), HIGH) for v in each) for each in moved]


def lowest(function, starts, halvings=8):
    """Return the best point that the search finds, and all that it tried."""
    points_tried = []

    def values(points):
        points_tried.extend(points)
        return [function(*point) for point in points]

    ends = pattern_search([(s, function(*s)) for s in starts], neighbours, values, halvings)
    assert [value for _, value in ends] == [function(*point) for point, _ in ends]
    return min(ends, key=lambda end: end[1])[0], points_tried


def test_the_search_finds_the_bottom_within_bounds_and_round_what_has_no_value():
    def bowl(x, y):
        return 1 + (x - 0.7) ** 2 + 3 * (y + 0.4) ** 2

    point, _ = lowest(bowl, [(3.0, 3.0)])
    assert point == pytest.approx((0.7, -0.4), abs=0.02)
    point, points_tried = lowest(lambda x, y: 10 + x + y, [(0.3, 0.2)])
    assert point == (LOW, LOW)
    assert all(LOW <= value <= HIGH for each in points_tried for value in each)

    def walled(x, y):
        return math.inf if abs(x) < 0.4 and y > -1 else 2 + (x - 1) ** 2 + y**2

    point, _ = lowest(walled, [(-1.0, 1.0), (2.0, -2.0)])
    assert point == pytest.approx((1.0, 0.0), abs=0.05)


def test_steps_halve_so_often_and_gains_too_small_do_not_count():
    tries = [len(lowest(lambda x, y: 1.0, [(0.0, 0.0)], halvings)[1]) for halvings in (0, 1, 5)]
    assert tries == [4, 8, 24]
    assert lowest(lambda x, y: 10 - 0.005 * x, [(0.0, 0.0)], 0)[0] == (0.0, 0.0)
    assert lowest(lambda x, y: 10 - 0.02 * x, [(0.0, 0.0)], 0)[0] == (HIGH, 0.0)
    sizes = []

    def values(points):
        sizes.append(len(points))
        return [1.0] * len(points)

    pattern_search([((0.0, 0.0), 1.0), ((2.0, 2.0), 1.0)], neighbours, values, 2)
    assert sizes == [8, 8, 8]  # all ways go on side by side
    assert pattern_search([], neighbours, values, 2) == []


def answer(fn, *args):
    """Return what a call gives, made once: many searches try the same places."""
    key = pickle.dumps((fn, args))
    if key not in ANSWERS:
        ANSWERS[key] = fn(*args)
    return ANSWERS[key]


class Here(Executor):
    """Calls in this process, one after the other; one of them fails."""

    def __init__(self, fails_at=None, error=None):
        self.calls, self._fails_at, self._error = 0, fails_at, error

    def submit(self, fn, /, *args):
        self.calls += 1
        future = Future()
        if self.calls != self._fails_at:
            future.set_result(answer(fn, *args))
        elif self._error is not None:
            future.set_exception(self._error)
        else:
            raise KeyboardInterrupt
        return future


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("gantry")


def placed(path, region=HERE, executor=None, **others):
    """Return what the search finds in a region, with few angles unless told otherwise."""
    return place(path, region, executor=executor or Here(), **{"options": FEW, **others})


@pytest.fixture(scope="module")
def placement(folder, shared):
    return shared("placement.of_gantry", lambda: placed(gantry(folder)))


@pytest.fixture
def grid_alone(monkeypatch):
    """The search ends with the grid and first neighbours."""
    monkeypatch.setattr(module, "_HALVINGS", 0)


@pytest.mark.dear("plans at some twenty places, for all tests of this file")
def test_the_best_angle_is_the_one_that_uses_both_axes_fully(placement, folder):
    assert placement.best.base_placement == pytest.approx((-0.3, 0.0, 0.0, BEST_YAW), abs=0.05)
    assert BEST_DURATION < placement.duration < 1.015 * BEST_DURATION
    feasible = [row.duration for row in placement.rows if row.is_feasible]
    assert placement.duration == min(feasible)
    assert (placement.succeeded, placement.stopped_by) == (True, None)
    # What was tried is the grid, and then downhill.
    assert {row.base_placement for row in placement.rows[:8]} == set(placement.grid.base_placements)
    assert len({row.base_placement for row in placement.rows}) == len(placement.rows) > 12
    assert all(placement.region.holds(row.base_placement) for row in placement.rows)
    others = [row for row in placement.rows if not row.is_feasible]
    assert {row.status for row in others} == {"unreachable"}
    ((reason, count, _),) = placement.reasons
    assert (reason, count) == ("unreachable: segment 0", len(others))
    given = plan(load_problem(gantry(folder)), PlanOptions(quality="fast", slack=0.0))
    assert (placement.given.base_placement, placement.given.duration) == (
        (0, 0, 0, 0),
        given.duration,
    )
    assert placement.gain == pytest.approx(1 - placement.duration / given.duration)
    unplanned = replace(placement, result=None, best=None)
    text = f"none of the {placement.feasible_count} places that have a mo"
    assert unplanned.message.startswith(text)


def test_the_best_is_planned_again_to_the_same_bits(placement, folder):
    path = gantry(folder)
    (folder / "there").mkdir()
    target = folder / "there" / "best.yaml"
    target.write_bytes(with_placement(path, target, placement.changes))
    best = placement.result.trajectory
    for problem in (load_problem(target), load_problem(path, changes=placement.changes)):
        again = plan(problem, PlanOptions(quality="fast", slack=0.0)).trajectory
        np.testing.assert_array_equal(again.coefficients, best.coefficients)
        np.testing.assert_array_equal(again.breakpoints, best.breakpoints)


@pytest.mark.slow  # two searches
def test_the_search_has_no_period_and_the_answer_is_rounded(folder):
    path, period = gantry(folder, name="period", period=0.05), 0.05
    found = placed(path, [-0.1, 0.0, 0.0, 0.0])
    durations = [row.duration for row in found.rows if row.is_feasible]
    assert max(abs(each / period - round(each / period)) for each in durations) > 0.01
    assert found.best.duration == min(durations) <= found.duration
    assert found.duration / period == pytest.approx(round(found.duration / period))
    assert found.problem.period == period
    short = placed(
        path, [0.0] * 4, changes={"objective": {"duration": 0.1}}, options=PlaceOptions(1)
    )
    assert "the best of them: objective.duration is 0.1 s, but the shortest" in short.message


@pytest.mark.dear("three searches")
def test_a_journal_goes_on_where_a_run_was_ended(placement, folder, tmp_path):
    journal = tmp_path / "best.jsonl"
    rows = [row.as_dict() for row in placement.rows]
    ended = placed(gantry(folder), executor=Here(fails_at=11), journal=journal)
    assert ended.stopped_by == "interrupt"
    assert [row.as_dict() for row in ended.rows] == rows[:10]
    assert ended.best.duration == min(row.duration for row in ended.rows if row.is_feasible)
    assert ended.duration == ended.best.duration
    again = placed(gantry(folder), executor=(second := Here()), journal=journal)
    assert (second.calls, again.restored) == (len(rows) - 10, 10)
    expected = placement.as_dict() | {"restored": 10, "problem": again.problem.name}
    assert json.loads(json.dumps(again.as_dict())) == json.loads(json.dumps(expected))


def test_ended_before_the_first_place_there_is_no_answer_but_what_a_journal_has(folder, tmp_path):
    journal = tmp_path / "best.jsonl"
    with pytest.raises(KeyboardInterrupt):
        placed(gantry(folder), executor=Here(fails_at=1), journal=journal)
    placed(gantry(folder), executor=Here(fails_at=2), journal=journal)
    ended = placed(gantry(folder), executor=Here(fails_at=1), journal=journal)
    assert (ended.stopped_by, ended.restored, len(ended.rows)) == ("interrupt", 1, 1)


def test_a_journal_knows_what_a_robot_stands_on(folder, tmp_path):
    path = gantry(folder, [FLOOR], "on_floor")
    others = {"options": ONE, "journal": tmp_path / "best.jsonl"}
    others |= {"changes": {"robot.base.position": [0, 0, -0.05]}}
    placed(path, stands_on=["floor"], **others)
    other = placed(path, stands_on=[], **others)
    assert other.restored == 0
    assert {row.status for row in other.rows} == {"base_in_obstacle"}


def test_a_place_at_which_a_worker_fails_is_one_row(folder, grid_alone):
    workers = Here(fails_at=2, error=RuntimeError("out of memory"))
    result = placed(gantry(folder), executor=workers)
    assert result.rows[1].status == "crashed"
    assert result.rows[1].message == "RuntimeError: out of memory"
    assert result.succeeded


def test_a_base_in_an_obstacle_is_refused_and_no_place_at_all_is_an_answer(folder):
    path = gantry(folder, [FLOOR, POST], "blocked")
    result = placed(path, IN_POST, stands_on=["floor"])
    assert (result.succeeded, result.best, result.result, result.gain) == (False, None, None, None)
    assert [(row.status, row.location.obstacle) for row in result.rows] == [
        ("base_in_obstacle", "post")
    ] * 8
    ((reason, count, _),) = result.reasons
    assert (reason, count, result.changes) == ("base in obstacle: 'base' in 'post'", 8, {})
    text = "no place of 8 has a motion; the most frequent reason, 8 times"
    assert result.message.startswith(text)
    assert json.loads(json.dumps(result.as_dict()))["best"] is None


def test_a_given_base_in_an_obstacle_is_said(folder):
    path = gantry(folder, [POST], "inside", start={"seed": [0.5, 0.5]})
    base = {"robot.base.position": [-0.3, 0.3, 0]}
    given = placed(path, IN_POST, stands_on=(), changes=base, options=ONE).given
    assert given.result is None
    assert given.message.startswith("'base', which no joint moves, stands")
    on_post = placed(path, IN_POST, stands_on=["post"], changes=base, options=ONE)
    assert "which no joint moves" not in on_post.given.message


def test_a_problem_that_cannot_be_posed_as_given_is_placed(folder, grid_alone):
    path = gantry(folder, name="elsewhere", start={"joints": [0.9, 0.9]})
    result = placed(path, options=ONE)
    assert result.given.result is None
    assert "outside the capsule of segment 0" in result.given.message
    assert (result.gain, result.succeeded) == (None, True)


def test_the_given_place_counts_if_it_is_in_the_region(folder, grid_alone):
    base = {"robot.base": {"position": [0.0, 0.0, 0.0], "rpy": [0, 0, -0.9272952]}}
    given = BasePlacement(0.0, 0.0, 0.0, -0.927295)
    inside, outside = (
        placed(gantry(folder), region, changes=base, options=ONE)
        for region in ([-0.3, 0.0, -0.3, 0.0], HERE)
    )
    assert inside.rows[1].base_placement == given
    assert given not in {row.base_placement for row in outside.rows}


def test_what_cannot_be_searched_is_refused(folder):
    path, free = gantry(folder, [FLOOR, POST], "blocked"), gantry(folder)
    for arguments, others, message in (
        ((path, HERE), {}, r"stands_on is required .* .floor, post.: name what"),
        ((free, HERE), {"stands_on": ["floor"]}, r"unknown obstacle 'floor'.*there is: none"),
        (("example:ur5/through_the_door", HERE), {}, "this is a cycle"),
        ((free, HERE), {"changes": {"tube.radius": -1}}, r"tube.radius"),
    ):
        with pytest.raises((OptionError, ProblemError), match=message):
            place(*arguments, **others)
    for options, message in (({"points": 0}, "points is 0"), ({"quality": "quick"}, "unknown qu")):
        with pytest.raises(OptionError, match=message):
            PlaceOptions(**options)


def test_the_search_goes_on_from_different_places_first():
    def row(x, yaw, duration):
        return PlacementRow(BasePlacement(x, 0, 0, yaw), "success", "", duration=duration)

    one = [row(0, yaw, 1 + yaw / 100) for yaw in range(8)]
    others = [row(x, 0, 1 + x) for x in (3, 2, 1)]
    none = PlacementRow(BasePlacement(9, 0, 0, 0), "unreachable", "")
    starts = _starts([none, *one[::-1], *others])
    assert [(each.base_placement.x, each.base_placement.yaw) for each in starts] == [
        *((0, 0), (1, 0), (2, 0), (3, 0)),
        (0, 1),
    ]


def test_a_start_that_is_blocked_elsewhere_is_reached_in_another_way(tmp_path):
    document = {
        "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
        "tube": {"points": [[0.4, 0, 0], [0.35, 0, 0]], "radius": 0.02},
        "start": {"joints": [-0.8411, 1.6821]},  # the elbow is in the post
        "obstacles": [{"name": "post", "cylinder": [0.03, 0.4], "position": [0.2, -0.22, 0]}],
    }
    movable = MovableProblem.of(ProblemSpec(document, tmp_path, "two_link"))
    row = tried((movable, movable.given, (), SEARCH_OPTIONS))
    assert row.is_feasible
    assert row.seeds["start"][1] < 0
    again = plan(movable.load(row.base_placement, row.seeds), SEARCH_OPTIONS)
    assert again.duration == row.duration


def test_neighbours_are_half_a_cell_away_on_both_sides_and_in_the_region():
    region = Region.of([0.0, 2.0, 0.0, 0.0], 0.0)
    grid = region.grid(32, 0.0)
    turned = round(np.pi / 16, 6)
    beside = _neighbours(region, grid, BasePlacement(0.5, 0.0, 0.0, 0.0), 0.5)
    assert {each[:2] for each in beside} == {(0.625, 0.0), (0.375, 0.0), (0.5, 0.0)}
    assert sorted(each.yaw for each in beside) == [-turned, 0.0, 0.0, turned]
    at_the_edge = _neighbours(region, grid, BasePlacement(2.0, 0.0, 0.0, 0.0), 1.0)
    assert {each.x for each in at_the_edge} == {1.75, 2.0}
    assert len(at_the_edge) == 3


def test_the_largest_group_comes_first():
    rows = [
        PlacementRow(BasePlacement(x, 0, 0, 0), status, "") for x, status in enumerate("abbcbc")
    ]
    groups = grouped(rows, lambda row: row.status)
    assert [(key, len(found)) for key, found in groups] == [("b", 3), ("c", 2), ("a", 1)]
    at_a_limit = PlacementRow(BasePlacement(0, 0, 0, 0), "unreachable", "", Location(joint="along"))
    assert at_a_limit.reason == "unreachable: along"
