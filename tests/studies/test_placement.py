"""Where a gantry is to stand: its best angle is known, and so is what stands in its way."""

import json
import random
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from gantry import BEST_DURATION, BEST_YAW, FLOOR, POST, gantry
from tubeplanner import OptionError, PlaceOptions, ProblemError, Stand, load_problem, place, plan
from tubeplanner.errors import OutputError
from tubeplanner.files.problem_file import with_placement
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.studies.movable_problem import MovableProblem
from tubeplanner.studies.placement import _neighbours, _starts
from tubeplanner.studies.placement_region import Region
from tubeplanner.studies.placement_row import PlacementRow, grouped, tried
from tubeplanner.studies.placement_trials import SEARCH_OPTIONS

FEW = PlaceOptions(points=8, quality="fast", slack=0.0)
HERE = [-0.3, -0.3, 0.0, 0.0]  # one place: only the angle is open


class Here(Executor):
    """Calls in this process, one after the other; one of them fails."""

    def __init__(self, fails_at=None, error=None):
        self.calls, self._fails_at, self._error = 0, fails_at, error

    def submit(self, fn, /, *args):
        self.calls += 1
        future = Future()
        if self.calls != self._fails_at:
            future.set_result(fn(*args))
        elif self._error is not None:
            future.set_exception(self._error)
        else:
            raise KeyboardInterrupt
        return future


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("gantry")


@pytest.fixture(scope="module")
def found(folder):
    return place(gantry(folder), HERE, options=FEW, executor=Here())


def test_the_best_angle_is_the_one_that_uses_both_axes_fully(found):
    assert found.best.stand.yaw == pytest.approx(BEST_YAW, abs=0.05)
    assert found.best.stand[:3] == (-0.3, 0.0, 0.0)
    assert BEST_DURATION < found.duration < 1.015 * BEST_DURATION
    assert found.duration == min(row.duration for row in found.rows if row.is_feasible)
    assert found.succeeded
    assert found.stopped_by is None


def test_what_was_tried_is_the_grid_and_then_downhill(found):
    grid = {row.stand for row in found.rows[:8]}
    assert grid == set(found.grid.stands)
    assert len(found.rows) > 12
    assert len({row.stand for row in found.rows}) == len(found.rows)
    assert all(found.region.holds(row.stand) for row in found.rows)


def test_the_gain_is_that_over_the_problem_as_given(found, folder):
    given = plan(load_problem(gantry(folder)), PlanOptions(quality="fast", slack=0.0))
    assert found.given.stand == Stand(0, 0, 0, 0)
    assert found.given.duration == given.duration
    assert found.gain == pytest.approx(1 - found.duration / given.duration)
    assert found.gain > 0.2


def test_angles_out_of_reach_have_their_reason(found):
    others = [row for row in found.rows if not row.is_feasible]
    assert {row.status for row in others} == {"unreachable"}
    ((reason, count, example),) = found.reasons
    assert (reason, count) == ("unreachable: segment 0", len(others))
    assert "position limits are in the way" in example


def test_the_best_is_planned_again_to_the_same_bits(found, folder):
    path = gantry(folder)
    (folder / "there").mkdir()
    target = folder / "there" / "best.yaml"
    target.write_bytes(with_placement(path, target, found.changes))
    for problem in (load_problem(target), load_problem(path, changes=found.changes)):
        again = plan(problem, PlanOptions(quality="fast", slack=0.0)).trajectory
        np.testing.assert_array_equal(again.coefficients, found.result.trajectory.coefficients)
        np.testing.assert_array_equal(again.breakpoints, found.result.trajectory.breakpoints)


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_depends_on_the_order_of_work(seed, found, folder):
    with ThreadPoolExecutor(3) as threads:
        other = place(gantry(folder), HERE, options=FEW, executor=_Shuffled(threads, seed))
    assert [row.as_dict() for row in other.rows] == [row.as_dict() for row in found.rows]
    assert other.changes == found.changes
    assert other.duration == found.duration


class _Shuffled(Executor):
    """Another executor's, each call held up for a time of its own."""

    def __init__(self, threads, seed):
        self._threads, self._draw = threads, random.Random(seed)

    def submit(self, fn, /, *args):
        return self._threads.submit(_late, self._draw.uniform(0, 0.2), fn, *args)


def _late(seconds, fn, *args):
    time.sleep(seconds)
    return fn(*args)


def test_a_journal_goes_on_where_a_run_was_ended(found, folder, tmp_path):
    journal = tmp_path / "best.jsonl"
    first = Here(fails_at=11)
    ended = place(gantry(folder), HERE, options=FEW, executor=first, journal=journal)
    assert ended.stopped_by == "interrupt"
    assert [row.as_dict() for row in ended.rows] == [row.as_dict() for row in found.rows[:10]]
    assert ended.best.duration == min(row.duration for row in ended.rows if row.is_feasible)
    assert ended.duration == ended.best.duration
    second, third = Here(), Here()
    again = place(gantry(folder), HERE, options=FEW, executor=second, journal=journal)
    assert second.calls == len(found.rows) - 10
    assert again.restored == 10
    assert [row.as_dict() for row in again.rows] == [row.as_dict() for row in found.rows]
    once_more = place(gantry(folder), HERE, options=FEW, executor=third, journal=journal)
    assert (third.calls, once_more.restored) == (0, len(found.rows))
    assert json.loads(json.dumps(once_more.as_dict())) == {
        **json.loads(json.dumps(found.as_dict())),
        "restored": len(found.rows),
    }


def test_ended_before_the_first_place_there_is_no_answer_but_what_a_journal_has(folder, tmp_path):
    journal = tmp_path / "best.jsonl"
    asked = {"options": FEW, "journal": journal}
    with pytest.raises(KeyboardInterrupt):
        place(gantry(folder), HERE, executor=Here(fails_at=1), **asked)
    place(gantry(folder), HERE, executor=Here(fails_at=2), **asked)
    ended = place(gantry(folder), HERE, executor=Here(fails_at=1), **asked)
    assert (ended.stopped_by, ended.restored, len(ended.rows)) == ("interrupt", 1, 1)


def test_places_that_cannot_be_planned_once_more_are_told(found):
    planned = replace(found, result=None, best=None)
    assert planned.message.startswith(f"none of the {found.feasible_count} places that have a mo")


def test_a_journal_knows_what_a_robot_stands_on(folder, tmp_path):
    path, journal = gantry(folder, [FLOOR], "on_floor"), tmp_path / "best.jsonl"
    common = {"options": PlaceOptions(points=1, quality="fast"), "journal": journal}
    low = {"robot.base.position": [0, 0, -0.05]}
    place(path, HERE, stands_on=["floor"], changes=low, executor=Here(), **common)
    other = place(path, HERE, stands_on=[], changes=low, executor=Here(), **common)
    assert other.restored == 0
    assert {row.status for row in other.rows} == {"base_in_obstacle"}


def test_a_place_at_which_a_worker_fails_is_one_row(folder):
    workers = Here(fails_at=2, error=RuntimeError("out of memory"))
    result = place(gantry(folder), HERE, options=FEW, executor=workers)
    assert result.rows[1].status == "crashed"
    assert result.rows[1].message == "RuntimeError: out of memory"
    assert result.succeeded


@pytest.fixture(scope="module")
def blocked(folder):
    """A region all around the post, in which the base stands where it is not nearer than 50 mm."""
    path = gantry(folder, [FLOOR, POST], "blocked")
    options = PlaceOptions(points=9 * 8, quality="fast")
    region = [-0.45, -0.15, 0.15, 0.45]
    return place(path, region, stands_on=["floor"], options=options, executor=Here())


def test_a_base_in_an_obstacle_is_refused_before_anything_is_planned(blocked):
    rows = [row for row in blocked.rows if row.status == "base_in_obstacle"]
    assert len(rows) >= 8
    inside = [row for row in blocked.rows if max(abs(np.array(row.stand[:2]) - (-0.3, 0.3))) < 0.1]
    assert {row.status for row in inside} == {"base_in_obstacle"}
    assert {row.place.obstacle for row in rows} == {"post"}
    reasons = {reason: example for reason, _, example in blocked.reasons}
    assert "which no joint moves, stands" in reasons["base in obstacle: 'base' in 'post'"]


def test_no_place_at_all_is_an_answer(folder):
    path = gantry(folder, [FLOOR, POST], "blocked")
    few = PlaceOptions(points=8, quality="fast")
    result = place(path, [-0.3, -0.3, 0.3, 0.3], stands_on=["floor"], options=few, executor=Here())
    assert (result.succeeded, result.best, result.result, result.gain) == (False, None, None, None)
    assert len(result.rows) == 8
    assert result.reasons[0][:2] == ("base in obstacle: 'base' in 'post'", 8)
    assert result.message.startswith(
        "no place of 8 has a motion; the most frequent reason, 8 times"
    )
    assert result.changes == {}
    assert json.loads(json.dumps(result.as_dict()))["best"] is None


def test_a_problem_that_cannot_be_posed_as_given_is_placed(folder):
    path = gantry(folder, name="elsewhere", start={"joints": [0.9, 0.9]})
    result = place(path, HERE, options=FEW, executor=Here())
    assert result.given.result is None
    assert "outside the capsule of segment 0" in result.given.message
    assert result.gain is None
    assert result.duration < 1.015 * BEST_DURATION


def test_the_given_place_counts_if_it_is_in_the_region(folder):
    path = gantry(folder, name="turned")
    base = {"robot.base": {"position": [0.0, 0.0, 0.0], "rpy": [0, 0, -0.9272952]}}
    one = PlaceOptions(points=1, quality="fast", slack=0.0)
    result = place(path, [-0.3, 0.0, -0.3, 0.0], changes=base, options=one, executor=Here())
    assert result.rows[1].stand == Stand(0.0, 0.0, 0.0, -0.927295)
    outside = place(path, HERE, changes=base, options=one, executor=Here())
    assert Stand(0.0, 0.0, 0.0, -0.927295) not in {row.stand for row in outside.rows}


def test_names_of_what_it_stands_on_are_asked_for_and_checked(folder):
    path = gantry(folder, [FLOOR, POST], "blocked")
    with pytest.raises(OptionError, match=r"stands_on is required .* .floor, post.: name what"):
        place(path, HERE)
    with pytest.raises(OptionError, match=r"unknown obstacle 'flour'.*floor, post"):
        place(path, HERE, stands_on=["floor", "flour"])
    with pytest.raises(OptionError, match=r"unknown obstacle 'floor'.*there is: none"):
        place(gantry(folder), HERE, stands_on=["floor"])


def test_what_cannot_be_searched_is_refused(folder):
    with pytest.raises(ProblemError, match="this is a cycle"):
        place("example:ur5/through_the_door", HERE)
    with pytest.raises(OptionError, match="points is 0"):
        PlaceOptions(points=0)
    with pytest.raises(OptionError, match="unknown quality 'quick'"):
        PlaceOptions(quality="quick")
    with pytest.raises(ProblemError, match=r"tube.radius"):
        place(gantry(folder), HERE, changes={"tube.radius": -1})


def test_the_search_goes_on_from_different_places_first():
    def row(x, yaw, duration):
        return PlacementRow(Stand(x, 0, 0, yaw), "success", "", duration=duration)

    one = [row(0, yaw, 1 + yaw / 100) for yaw in range(8)]
    others = [row(x, 0, 1 + x) for x in (3, 2, 1)]
    none = PlacementRow(Stand(9, 0, 0, 0), "unreachable", "")
    starts = _starts([none, *one[::-1], *others])
    assert [(each.stand.x, each.stand.yaw) for each in starts] == [
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
    movable = MovableProblem.of(PosedProblem(document, tmp_path, "two_link"))
    row = tried((movable, movable.given, (), SEARCH_OPTIONS))
    assert row.is_feasible
    assert row.seeds["start"][1] < 0
    again = plan(movable.load(row.stand, row.seeds), SEARCH_OPTIONS)
    assert again.duration == row.duration


def test_neighbours_are_half_a_cell_away_on_both_sides_and_in_the_region():
    region = Region.of([0.0, 2.0, 0.0, 0.0], 0.0)
    grid = region.grid(16, 0.0)
    turned = round(np.pi / 16, 6)
    beside = _neighbours(region, grid, Stand(0.5, 0.0, 0.0, 0.0), 0.5)
    assert {each[:2] for each in beside} == {(0.75, 0.0), (0.25, 0.0), (0.5, 0.0)}
    assert sorted(each.yaw for each in beside) == [-turned, 0.0, 0.0, turned]
    at_the_edge = _neighbours(region, grid, Stand(2.0, 0.0, 0.0, 0.0), 1.0)
    assert {each.x for each in at_the_edge} == {1.5, 2.0}
    assert len(at_the_edge) == 3


def test_the_largest_group_comes_first():
    rows = [PlacementRow(Stand(x, 0, 0, 0), status, "") for x, status in enumerate("abbcbc")]
    groups = grouped(rows, lambda row: row.status)
    assert [(key, len(found)) for key, found in groups] == [("b", 3), ("c", 2), ("a", 1)]


def test_a_given_base_in_an_obstacle_is_said(folder):
    path = gantry(folder, [POST], "inside", start={"seed": [0.5, 0.5]})
    base, one = {"robot.base.position": [-0.3, 0.3, 0]}, PlaceOptions(points=1, quality="fast")
    region = [-0.3, -0.3, 0.3, 0.3]
    result = place(path, region, stands_on=(), changes=base, options=one, executor=Here())
    assert result.given.result is None
    assert result.given.message.startswith("'base', which no joint moves, stands")
    on_post = place(path, region, stands_on=["post"], changes=base, options=one, executor=Here())
    assert "which no joint moves" not in on_post.given.message


def test_an_answer_that_was_edited_is_refused_with_its_file(folder, tmp_path):
    journal = tmp_path / "best.jsonl"
    place(gantry(folder), HERE, options=FEW, executor=Here(fails_at=3), journal=journal)
    journal.write_text(journal.read_text().replace('"yaw": ', '"yaw": "up", "_": ', 1))
    with pytest.raises(OutputError, match=r"best\.jsonl: the line of key .* holds no answer"):
        place(gantry(folder), HERE, options=FEW, executor=Here(), journal=journal)
