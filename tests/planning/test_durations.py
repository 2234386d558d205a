"""Given and cheapest durations, periods, planning times."""

from dataclasses import replace
from functools import cache
from math import ceil

import numpy as np
import pytest
from cases import ANGLE, BRIEF, anywhere, one_joint, quintic

from tubeplanner import JointTrajectory, Objective, PlanOptions, plan, verify
from tubeplanner.limits.peaks import EffortCosts
from tubeplanner.optimizer.stages import Refinement, SecondStage
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.output.files.trajectory_writer import FORMATS, ExportedMotion
from tubeplanner.planning.second_stage import (
    cheapest_duration,
    fewest_periods,
    lengthened,
    most_periods,
    no_longer,
)
from tubeplanner.task.motion import ProblemMotion
from tubeplanner.trajectory.reader import joined_samples

LINE, POST = "two_link/paper_1_30mm", "two_link/around_a_post"
WHOLE = "the duration is a multiple of the period, 0.004 s; the breakpoints are not"
LONGEST = 6.0


# How much time is of use: against the closed form of the energy of a shape.


def asked(robot, minimise):
    return replace(anywhere(robot), objective=Objective(1.0, minimise))


def cheapest_shape(robot, shape):
    """Return the duration at which d/dT (E4/T^3 + E2/T + E0 T) vanishes, by quadrature."""
    x = (np.arange(20_000) + 0.5)[:, None] / 20_000
    state = (shape.position(x)[:, 0], 0 * x, shape.acceleration(x)[:, 0])
    held = robot.gravity_effort(state[0])
    moved = robot.inverse_dynamics(*state) - held
    e4, e2, e0 = (moved**2).mean(), 2 * (moved * held).mean(), (held**2).mean()
    roots = np.roots([e0, 0.0, -e2, 0.0, -3 * e4])
    return roots[(abs(roots.imag) < 1e-9) & (roots.real > 0)].real.max()


def test_energy_has_a_cheapest_duration_where_gravity_is_to_be_held(tmp_path):
    robot = one_joint(tmp_path, mass=0.5)
    expected = cheapest_shape(robot, quintic(ANGLE))
    assert 1.0 < expected < LONGEST
    found = cheapest_duration(asked(robot, "energy"), quintic(ANGLE), LONGEST)
    assert found == pytest.approx(expected, abs=(LONGEST - 1.0) / 49)


def test_all_time_is_of_use_without_gravity_and_for_smoothness(tmp_path):
    for mass, minimise in ((0, "smoothness"), (0, "energy"), (0, "work"), (0.5, "smoothness")):
        problem = asked(one_joint(tmp_path, mass), minimise)
        assert cheapest_duration(problem, quintic(ANGLE), LONGEST) == LONGEST


def test_work_is_least_where_a_bar_swings_by_itself(tmp_path):
    """Down and up again: slower, nothing lifts it; faster, it is to be driven.

    Hardly anything is left of what lifting it takes, as speed carries it up.
    """
    robot, swing = one_joint(tmp_path, mass=0.5), quintic(-np.pi, 0.5)
    problem, tried = asked(robot, "work"), np.linspace(0.5, LONGEST, 50)
    found = cheapest_duration(problem, swing, LONGEST)
    costs = EffortCosts(robot, swing)
    lifting = 0.5 * 9.81 * 0.5
    assert costs.work(LONGEST) > 0.8 * lifting
    assert costs.work(found) == min(map(costs.work, tried)) < 0.5 * lifting
    assert 1.0 < found < 3.0


# Motions in a controller's periods: every sample is the motion, and no time is lost.


@pytest.fixture(scope="module")
def periodic(bundled):
    """Return a function from a period to the problem of a line and its motion."""

    @cache
    def of(period):
        problem = replace(bundled(LINE), period=period)
        return problem, plan(problem)

    return of


@pytest.fixture(scope="module")
def least(planned):
    """The least duration of the line without a period."""
    return planned(LINE, "refinement")[1].duration


def in_periods(times, period):
    """Return numbers of periods, after a look that they are whole."""
    counts = np.asarray(times) / period
    np.testing.assert_allclose(counts, counts.round(), atol=1e-9)
    return counts.round().astype(int)


def test_duration_and_all_breakpoints_are_multiples(periodic, least):
    """What is written, without a rate, is the motion itself, judged as our own trajectories are."""
    period = 0.004
    problem, result = periodic(period)
    for trajectory in (result.trajectory, result.shortest):
        locations = in_periods(trajectory.breakpoints, period)
        assert np.diff(locations).min() >= 1
        np.testing.assert_array_equal(trajectory.breakpoints, locations * period)
        assert verify(problem, trajectory).passed
    assert not any("multiple of the period" in note for note in result.notes)
    exported = ExportedMotion(ProblemMotion(problem, result.trajectory))
    _, csv, _ = FORMATS
    rows = csv.text(exported).splitlines()
    assert exported.notes == ()
    assert len(rows) == 2 + in_periods(result.duration, period)
    samples = result.trajectory.sample(1 / period)
    known = (samples.position, samples.velocity, samples.acceleration)
    joined = joined_samples(result.trajectory.joint_names, samples.time, known)
    assert joined.duration == pytest.approx(result.duration, abs=1e-12)
    assert verify(problem, joined).passed
    # Slack counts from the least multiple that was found.
    fewest = in_periods(result.shortest_duration, period)
    assert ceil(least / period - 1e-3) <= fewest
    # Knots no closer than a period cost a little at every switch.
    assert result.shortest_duration < 1.05 * least
    assert fewest <= in_periods(result.duration, period) == int(1.005 * fewest + 1e-9)


def test_where_smoothing_fails_the_shortest_motion_in_periods_is_left(periodic, monkeypatch):
    problem, result = periodic(0.004)
    shortest = plan(problem, PlanOptions(slack=0))
    assert shortest.shortest is None
    monkeypatch.setattr(SecondStage, "run", lambda self: False)
    rough = plan(problem)
    assert any("the shortest motion, not smoothed" in note for note in rough.notes)
    for each in (shortest, rough):
        np.testing.assert_array_equal(each.trajectory.coefficients, result.shortest.coefficients)


def test_long_periods_make_slow_motions_on_few_knots(periodic):
    problem, result = periodic(1.0)
    count = in_periods(result.duration, 1.0)
    assert count >= 4
    assert len(result.trajectory.widths) == count
    assert verify(problem, result.trajectory).passed


def test_more_phases_than_periods_get_a_period_each(bundled):
    """Of 0.8 s, the post's three segments."""
    problem = replace(bundled(POST), period=0.5)
    result = plan(problem, PlanOptions(slack=0, quality="fast"))
    assert len(in_periods(result.trajectory.breakpoints, 0.5)) >= 5


@pytest.mark.parametrize("error", [None, Infeasible(PlanStatus.NO_TRAJECTORY, "", Location())])
def test_where_none_is_found_the_shortest_motion_is_slowed_down(error, bundled, monkeypatch, least):
    """Its breakpoints are where they were, and a note says so."""
    tried, refine = [], Refinement.run

    def run(self):
        if not self._start.grid.is_fixed:
            return refine(self)
        tried.append(self)
        if error is not None:
            raise error
        return False

    monkeypatch.setattr(Refinement, "run", run)
    result = plan(replace(bundled(LINE), period=0.004))
    assert len(tried) == 8
    assert in_periods(result.duration, 0.004) == ceil(least / 0.004)
    (note,) = [note for note in result.notes if "period" in note]
    assert note.startswith(WHOLE)


def test_an_interrupt_leaves_whole_periods(bundled):
    """While it is looked for: what was found before is slowed down."""
    counted, settled = [], 10**9

    def interrupt(progress):
        counted.append(progress)
        if len(counted) > settled:
            raise KeyboardInterrupt

    problem, options = bundled(LINE), PlanOptions(slack=0)
    plan(problem, options, interrupt)
    settled = len(counted) + 3
    counted.clear()
    result = plan(replace(problem, period=0.004), progress=interrupt)
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    in_periods(result.duration, 0.004)
    assert result.shortest is None


@pytest.mark.parametrize("method", ["branch-and-bound", "stop-at-corners", "suh-bishop"])
def test_other_methods_answers_take_whole_periods(method, bundled):
    problem = bundled(LINE)
    options = PlanOptions(method, candidate_points=15, suh_bishop=BRIEF)
    plain, result = (plan(each, options) for each in (problem, replace(problem, period=0.004)))
    assert (result.succeeded, result.method) == (True, method)
    assert in_periods(result.duration, 0.004) == ceil(plain.duration / 0.004)
    fractions = [each.trajectory.breakpoints / each.duration for each in (result, plain)]
    np.testing.assert_allclose(*fractions, atol=1e-12)
    assert verify(problem, result.trajectory).passed
    assert result.notes[-1].startswith(WHOLE)
    assert (result.search is None) == (plain.search is None)
    assert (result.phase_two is None) == (plain.phase_two is None)


def test_a_slower_motion_that_fails_is_no_answer(bundled, monkeypatch):
    """Motors that cannot hold the arm where it swings through: the answer stays, and says so."""
    options = PlanOptions("stop-at-corners")
    plain = plan(bundled(LINE), options)
    failed = PlanStatus.CERTIFICATE_FAILED
    refused = replace(plain, status=failed, message="too slow", trajectory=None)
    judge = "tubeplanner.planning.second_stage.certified_result"
    monkeypatch.setattr(judge, lambda *arguments: refused)
    result = plan(replace(bundled(LINE), period=0.004), options)
    assert result.duration == plain.duration
    assert result.notes[-1] == (
        "the duration is no multiple of the period, 0.004 s: the slower motion is not certified: "
        "too slow"
    )


# Durations and periods, at the edges of rounding too.

PERIOD = 0.001


@pytest.fixture
def trajectory():
    """A cubic in three pieces that takes 0.3 s, its breakpoints multiples of 0.01 s."""
    coefficients = np.random.default_rng(0).normal(size=(4, 3, 2))
    return JointTrajectory(["a", "b"], [0.0, 0.1, 0.17, 0.3], coefficients)


@pytest.mark.parametrize(
    ("duration", "fewest", "most"),
    [
        (0.5 + 5e-13, 500, 500),
        (0.5 - 5e-13, 500, 500),
        (0.5 + 5e-12, 501, 500),
        (0.5 - 5e-12, 500, 499),
        (0.0004, 1, 0),
        (0.0, 1, 0),
    ],
)
def test_periods_are_counted_but_for_rounding(duration, fewest, most):
    assert fewest_periods(duration, PERIOD) == fewest
    assert most_periods(duration, PERIOD) == most


@pytest.mark.parametrize("period", [0.1, 0.001, 1 / 3, 0.008, 1e-5])
def test_a_multiple_has_as_many_periods_as_it_was_made_of(period):
    for count in (3, 7, 29, 58, 115, 8191):
        whole = count * period
        for duration in (whole, np.nextafter(whole, 0), np.nextafter(whole, 9)):
            assert fewest_periods(duration, period) == most_periods(duration, period) == count


@pytest.mark.parametrize(
    ("duration", "holds"), [(1.0, True), (0.9, True), (1 + 5e-10, True), (1 + 5e-9, False)]
)
def test_durations_are_compared_but_for_rounding(duration, holds):
    assert no_longer(duration, 1.0) is holds
    assert no_longer(3 * duration, 3.0) is holds


def test_a_shorter_motion_is_run_more_slowly_and_a_longer_one_stays_as_it_is(trajectory):
    assert lengthened(trajectory, 0.2) is lengthened(trajectory, 0.2, PERIOD) is trajectory
    slower = lengthened(trajectory, 0.6)
    np.testing.assert_allclose(slower.breakpoints, 2 * trajectory.breakpoints)
    np.testing.assert_allclose(slower.position(0.46), trajectory.position(0.23), rtol=1e-12)


def test_in_periods_rounding_is_taken_off_the_breakpoints_and_no_more(trajectory):
    periods = np.array([0, 10, 17, 30])
    rounded = trajectory.breakpoints / 3 * (1 + 1e-14 * np.arange(4))
    off = JointTrajectory(trajectory.joint_names, rounded, trajectory.coefficients)
    slower = lengthened(off, 30 * 0.02, 0.02)
    np.testing.assert_array_equal(slower.breakpoints, periods * 0.02)
    plain = off.scaled(6 * (1 - 3e-14))
    np.testing.assert_allclose(slower.coefficients, plain.coefficients, rtol=1e-12)
