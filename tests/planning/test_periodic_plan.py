"""Motions in a controller's periods: every sample is the motion, and no time is lost."""

from dataclasses import replace
from functools import cache
from math import ceil
from pathlib import Path

import numpy as np
import pytest

from cases import slow_but
from tubeplanner import Planner, PlanOptions, plan, verify
from tubeplanner.files.trajectory_writer import TrajectoryFiles
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.refinement.second_stage import SecondStage
from tubeplanner.trajectory.trajectory_file import joined_samples

LINE, POST, WALL = "two_link/paper_1_30mm", "two_link/around_a_post", "ur5/over_the_wall"
CASES = [(LINE, 0.001), (LINE, 0.004), (LINE, 0.008), (POST, 0.004), (WALL, 0.008), (WALL, 0.001)]
WHOLE = "the duration is a multiple of the period, 0.004 s; the breakpoints are not"


@pytest.fixture(scope="module")
def periodic(bundled):
    """Return a function from a problem's name and a period to the problem and its motion."""

    @cache
    def of(name, period):
        problem = replace(bundled(name), period=period)
        return problem, plan(problem)

    return of


@pytest.fixture(scope="module")
def least(bundled):
    """Return a function from a problem's name to its least duration without a period."""
    return cache(lambda name: plan(bundled(name), PlanOptions(slack=0)).duration)


def in_periods(times, period):
    """Return numbers of periods, after a look that they are whole."""
    counts = np.asarray(times) / period
    np.testing.assert_allclose(counts, counts.round(), atol=1e-9)
    return counts.round().astype(int)


@pytest.mark.parametrize(("name", "period"), slow_but(CASES[:5], CASES))
def test_duration_and_all_breakpoints_are_multiples(name, period, periodic):
    problem, result = periodic(name, period)
    assert result.succeeded
    for trajectory in (result.trajectory, result.shortest):
        places = in_periods(trajectory.breakpoints, period)
        assert np.diff(places).min() >= 1
        np.testing.assert_array_equal(trajectory.breakpoints, places * period)
        assert verify(problem, trajectory).passed
    assert not any("multiple of the period" in note for note in result.notes)


@pytest.mark.parametrize(("name", "period"), slow_but(CASES[:5], CASES))
def test_what_is_written_is_the_motion_itself(name, period, periodic):
    """Without a rate, and judged as our own trajectories are."""
    problem, result = periodic(name, period)
    contents, notes = TrajectoryFiles(csv=Path("t.csv")).contents(result.trajectory, problem)
    assert notes == ()
    rows = contents[Path("t.csv")].decode().splitlines()
    assert len(rows) == 2 + in_periods(result.duration, period)
    samples = result.trajectory.sample(1 / period)
    known = (samples.position, samples.velocity, samples.acceleration)
    joined = joined_samples(result.trajectory.joint_names, samples.time, known)
    assert joined.duration == pytest.approx(result.duration, abs=1e-12)
    assert verify(problem, joined).passed


@pytest.mark.parametrize(("name", "period"), slow_but(CASES[:4], CASES))
def test_slack_counts_from_the_least_multiple_that_was_found(name, period, periodic, least):
    _, result = periodic(name, period)
    fewest = in_periods(result.shortest_duration, period)
    assert ceil(least(name) / period - 1e-3) <= fewest
    # Knots no closer than a period cost a little at every switch.
    assert result.shortest_duration < 1.05 * least(name)
    most = int(1.005 * fewest + 1e-9)
    assert fewest <= in_periods(result.duration, period) == most


def test_slack_zero_is_the_shortest_motion_in_periods(periodic):
    problem, result = periodic(LINE, 0.004)
    shortest = plan(problem, PlanOptions(slack=0))
    np.testing.assert_array_equal(shortest.trajectory.coefficients, result.shortest.coefficients)
    assert shortest.shortest is None


def test_where_smoothing_fails_the_shortest_motion_is_in_periods(periodic, monkeypatch):
    problem, result = periodic(LINE, 0.004)
    monkeypatch.setattr(SecondStage, "run", lambda self: False)
    shortest = plan(problem)
    np.testing.assert_array_equal(shortest.trajectory.coefficients, result.shortest.coefficients)
    assert any("the shortest motion, not smoothed" in note for note in shortest.notes)


@pytest.mark.parametrize("period", [0.05, 0.3, 1.0])
def test_long_periods_make_slow_motions_on_few_knots(period, periodic):
    """At least as many as leave a control point that may move."""
    problem, result = periodic(LINE, period)
    count = in_periods(result.duration, period)
    assert count >= 4
    assert len(result.trajectory.widths) == count
    assert verify(problem, result.trajectory).passed


def test_more_phases_than_periods_get_a_period_each(periodic):
    """Of 0.8 s, the post's three segments."""
    _, result = periodic(POST, 0.5)
    assert len(in_periods(result.trajectory.breakpoints, 0.5)) >= 5


@pytest.mark.parametrize("error", [None, Infeasible(PlanStatus.NO_TRAJECTORY, "", Place())])
def test_where_none_is_found_the_shortest_motion_is_slowed_down(error, bundled, monkeypatch, least):
    """Its breakpoints are where they were, and a note says so."""
    tried = []

    def run_on(self):
        tried.append(self._start.grid.is_fixed)
        if error is not None:
            raise error
        return False

    monkeypatch.setattr(Refinement, "run_on", run_on)
    result = plan(replace(bundled(LINE), period=0.004))
    assert tried == [True] * 8
    assert result.succeeded
    assert in_periods(result.duration, 0.004) == ceil(least(LINE) / 0.004)
    (note,) = [note for note in result.notes if "period" in note]
    assert note.startswith(WHOLE)


@pytest.mark.parametrize("after", [1, 3])
def test_an_interrupt_leaves_whole_periods(after, bundled, least):
    """While it is looked for: what was found before is slowed down."""
    counted = []

    def interrupt(progress):
        found = progress.best_duration
        counted.append(found is not None and found < 1.02 * least(LINE))
        if len(counted) > settled + after:
            raise KeyboardInterrupt

    problem = bundled(LINE)
    settled = 10**9
    plan(problem, PlanOptions(slack=0), progress=interrupt)
    settled = len(counted)
    counted.clear()
    result = plan(replace(problem, period=0.004), progress=interrupt)
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    in_periods(result.duration, 0.004)
    assert result.shortest is None


def test_planning_again_says_that_it_began_with_the_last_motion(periodic):
    problem, _ = periodic(LINE, 0.004)
    planner = Planner(problem, PlanOptions(slack=0))
    first = planner.plan()
    again = planner.replan(problem.with_tube(problem.tube.scaled(1.02)))
    assert "planned from the last motion, not afresh" in again.notes
    assert "planned from the last motion, not afresh" not in first.notes
    in_periods(again.trajectory.breakpoints, 0.004)
    assert again.motion.spline.grid.is_fixed is False


@pytest.mark.parametrize(
    "method",
    slow_but(
        ("branch-and-bound", "stop-at-corners"),
        ["branch-and-bound", "stop-at-corners", "suh-bishop"],
    ),
)
def test_other_methods_answers_take_whole_periods(method, bundled):
    problem = bundled(LINE)
    plain, result = (
        plan(each, PlanOptions(method)) for each in (problem, replace(problem, period=0.004))
    )
    assert (result.succeeded, result.method) == (True, method)
    assert in_periods(result.duration, 0.004) == ceil(plain.duration / 0.004)
    np.testing.assert_allclose(
        result.trajectory.breakpoints / result.duration,
        plain.trajectory.breakpoints / plain.duration,
        atol=1e-12,
    )
    assert verify(problem, result.trajectory).passed
    assert result.notes[-1].startswith(WHOLE)
    assert (result.search is None) == (plain.search is None)
    assert (result.phase_two is None) == (plain.phase_two is None)


def test_without_an_answer_a_period_changes_nothing(bundled):
    problem = bundled(LINE)
    points = problem.tube.points + np.array([3.0, 0, 0])
    far = problem.with_tube(replace(problem.tube, points=points))
    plain, result = plan(far), plan(replace(far, period=0.004))
    assert not plain.succeeded
    assert (result.status, result.message, result.notes) == (
        plain.status,
        plain.message,
        plain.notes,
    )


def test_a_slower_motion_that_fails_is_no_answer(bundled, monkeypatch):
    """Motors that cannot hold the arm where it swings through: the answer stays, and says so."""
    refused = replace(
        plan(bundled(LINE), PlanOptions("stop-at-corners")),
        status=PlanStatus.CERTIFICATE_FAILED,
        message="too slow",
        trajectory=None,
    )
    monkeypatch.setattr(
        "tubeplanner.planning.followed_plan.certified_result", lambda *arguments: refused
    )
    options = PlanOptions("stop-at-corners")
    plain, result = (
        plan(problem, options) for problem in (bundled(LINE), replace(bundled(LINE), period=0.004))
    )
    assert result.duration == plain.duration
    assert result.notes[-1] == (
        "the duration is no multiple of the period, 0.004 s: the slower motion is not certified: "
        "too slow"
    )
