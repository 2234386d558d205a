"""SecondStage one spline: against the minimum-jerk motion, within its time, room and samples."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import constraints_of
from scipy.optimize import brentq

from tubeplanner import PlanOptions, Tube, plan, verify
from tubeplanner.limits.speed_limits import scaled_to_limits
from tubeplanner.optimizer import motion_measures as smoothness_measures
from tubeplanner.optimizer import stages as second_stage
from tubeplanner.optimizer.phased_spline import segments_of_pieces
from tubeplanner.optimizer.stages import SecondStage
from tubeplanner.outcome import Infeasible, PlanStatus

TRAVEL = 0.6  # [m], of the slider
MIN_JERK, MIN_VARIATION = 720.0, 16.0  # of one metre from rest to rest in one second


@pytest.fixture(scope="module")
def sliding(slider):
    return plan(slider, PlanOptions(slack=0))


def smoothed(problem, shortest, slack):
    """Return a smoothing that has run, within a slack."""
    longest = shortest.duration * (1 + slack)
    result = SecondStage(problem, shortest.motion.spline, longest, 0.0)
    assert not result.has_spline
    assert result.run()
    assert result.has_spline
    return result


def integral(trajectory, power):
    """Return the integral of a power of the jerk of one metre, in one second."""
    jerk = trajectory.scaled(1 / trajectory.duration).derivative_coefficients(3)[-1]
    return ((jerk / TRAVEL) ** power * trajectory.widths[:, None]).sum() / trajectory.duration


def variation(trajectory):
    """Return the total variation of the acceleration of one metre, in one second: at knots."""
    acceleration = trajectory.scaled(1 / trajectory.duration).derivative_coefficients(2)
    knots = np.append(acceleration[-1][:, 0], 0.0)
    return abs(np.diff(knots)).sum() / TRAVEL


def quintic(x):
    return TRAVEL * x**3 * (10 - 15 * x + 6 * x**2)


def least_fourth_power():
    """By Euler and Lagrange the jerk's third power is a parabola, here about the middle.

    Its roots are where the acceleration vanishes at the end.
    """
    x = (np.arange(200_000) + 0.5) / 200_000
    root = brentq(lambda r: np.cbrt((x - 0.5) ** 2 - r).mean(), 0.01, 0.2)
    jerk = np.cbrt((x - 0.5) ** 2 - root)
    return (jerk**4).mean() / ((1 - x) ** 2 / 2 * jerk).mean() ** 4


def test_with_time_enough_the_least_jerk_is_what_calculus_says(slider, sliding, monkeypatch):
    """Where jerk vanishes its fourth power is flat: the last tenths are found slowly, if at all."""
    monkeypatch.setattr(smoothness_measures, "_WEIGHTS", (0.0, 0.0, 4.0))
    result = smoothed(slider, sliding, 2.0).trajectory
    least = least_fourth_power()
    assert least <= integral(result, 4) < 1.3 * least


def test_the_mixture_is_no_worse_than_the_quintic_and_within_what_is_possible(slider, sliding):
    """No motion has less jerk than the quintic, nor less variation than a bang-bang one."""
    longest = 4 * sliding.duration
    result = smoothed(slider, sliding, 3.0)
    assert integral(result.trajectory, 2) >= MIN_JERK
    assert variation(result.trajectory) >= MIN_VARIATION
    grid, objective = sliding.motion.spline.grid, result._objective
    knots, count = grid.knots(np.array([0.0, 1.0])), grid.control_point_count
    # A cubic of nearly the quintic: control points at the means of their knots.
    x = np.mean([knots[k : k + count] for k in (1, 2, 3)], axis=0)
    points = quintic(x)[:, None]
    points[:3], points[-3:] = 0.0, TRAVEL
    at = result._program.iterate(replace(sliding.motion.spline, control_points=points))
    assert at.squared_duration < longest**2
    assert objective.value(result._best) < objective.value(at) + 0.05


@pytest.fixture(scope="module")
def post(planned):
    return planned("two_link/around_a_post", "refinement")


def stage(post, longer, clearance=0.0, *checkpoint):
    """Return a stage that has not run, within a multiple of the shortest duration."""
    problem, shortest = post
    longest = longer * shortest.duration
    return SecondStage(problem, shortest.motion.spline, longest, clearance, *checkpoint), longest


def test_it_runs_in_its_time_between_samples_too(post):
    problem, shortest = post
    result = smoothed(problem, shortest, 0.005)
    segments = result.segments
    np.testing.assert_array_equal(segments, segments_of_pieces(shortest.motion.spline.grid))
    assert len(segments) == len(result.trajectory.widths)
    fastest = scaled_to_limits(problem, result.trajectory, segments=segments)
    assert fastest.duration <= 1.005 * shortest.duration * (1 + 1e-6)
    assert verify(problem, result.trajectory.scaled(1.005 * shortest.duration)).passed
    assert not result.gave_up


@pytest.mark.parametrize(
    ("excess", "longer", "is_answer"),
    [(0.0, 0.9998, True), (0.01, 0.9998, False), (0.0, 1.0, False)],
)
def test_what_is_outside_or_late_between_samples_is_no_answer(excess, longer, is_answer, post):
    result, longest = stage(post, 1.005)
    constraints = result._program.constraints
    here = constraints.at(post[1].motion.spline)
    dense = replace(here, excess=excess, squared_duration=longer * longest**2)
    constraints.add_samples_between = lambda iterate: (dense, False)
    assert result._looked_at(here) is is_answer


def test_without_time_or_a_start_there_is_nothing(post):
    fresh, _ = stage(post, 0.95)
    with pytest.raises(RuntimeError, match="the second stage has not run"):
        _ = fresh.trajectory
    assert not fresh.run()  # in less than the shortest motion takes
    assert not fresh.has_spline
    blocked, _ = stage(post, 1.005)
    here = blocked._program.iterate(post[1].motion.spline)
    blocked._program.iterate = lambda spline: replace(here, squared_duration=np.inf)
    with pytest.raises(Infeasible, match="no trajectory to start from") as caught:
        blocked.run()
    assert caught.value.status is PlanStatus.NO_TRAJECTORY


def test_its_checkpoint_gets_the_duration_and_ends_it(post):
    heard = []

    def checkpoint(duration):
        heard.append(duration)
        if len(heard) == 2:
            raise TimeoutError

    result, longest = stage(post, 1.01, 0.0, checkpoint)
    with pytest.raises(TimeoutError):
        result.run()
    assert heard == [longest, longest]


def test_it_answers_a_certificate_with_samples_where_that_fails(post, monkeypatch):
    problem, shortest = post
    result, longest = smoothed(problem, shortest, 0.005), 1.005 * shortest.duration
    added, before = [], result.spline
    kind = type(result._program.constraints)
    monkeypatch.setattr(kind, "add_samples", lambda self, spline, x: added.append((spline, x)))
    passed = verify(problem, result.trajectory.scaled(longest))
    tube = passed.conditions["tube"]
    failed = replace(tube, margin=-1.0, where=replace(tube.where, time=0.25 * longest))
    certificate = replace(passed, conditions={**passed.conditions, "tube": failed})
    assert result.answer(certificate, longest)
    assert added == [(before, 0.25)]
    assert not result.answer(passed, longest)  # nothing to do
    assert not result.has_spline


@pytest.mark.parametrize(("clearance", "kept"), [(-0.01, 0.0), (0.01, 0.009), (0.5, 0.018)])
def test_most_of_the_distance_from_obstacles_is_kept(clearance, kept, post, monkeypatch):
    """A tenth of it may go, and of more than 2 cm all that is beyond."""
    clearances, links = [], second_stage.LinkConstraints

    def spy(problem, slack=0.0):
        clearances.append(slack)
        return links(problem, slack)

    monkeypatch.setattr(second_stage, "LinkConstraints", spy)
    stage(post, 1.005, clearance)
    assert clearances[-1] == pytest.approx(kept, abs=1e-15)


def test_room_is_what_the_worst_instant_leaves_by_segment(slider, sliding):
    """The slider goes along the middle of its tube, or beside it."""
    spline = sliding.motion.spline
    for beside, slack in ((0.0, 1.0), (0.04, 0.6)):
        problem = slider.with_tube(Tube([[0, beside, 0], [TRAVEL, beside, 0]], 0.1))
        dense = constraints_of(problem, spline.grid).between_samples(spline)
        assert second_stage._slack(problem, dense) == pytest.approx([slack], abs=1e-9)


def test_there_is_no_room_beside_a_compulsory_point():
    """There the tool must come closer to the point than to the wall."""
    tube = Tube([[0, 0, 0], [0.3, 0, 0], [0, 0, 0.001], [0, 0.5, 0]], 0.1)
    assert tube.compulsory_points.tolist() == [1]
    fraction, segment = np.array([0.2, 0.4, 0.5, 0.3, 0.1]), np.array([0, 0, 1, 2, 2])
    of_regions = SimpleNamespace(fraction=lambda vector, segment: fraction)
    regions = SimpleNamespace(regions=of_regions, vector=None, segment=segment)
    problem, dense = SimpleNamespace(tube=tube), SimpleNamespace(regions=(regions,))
    np.testing.assert_allclose(second_stage._slack(problem, dense), [0.0, 0.0, 0.7])
