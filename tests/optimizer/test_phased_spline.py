"""PhasedSpline: cubic B-splines over phases of tube segments, native and NumPy basis."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from tubeplanner.native.library import LIBRARY
from tubeplanner.optimizer import phased_spline as spline_basis
from tubeplanner.optimizer.phased_spline import (
    DEGREE,
    KnotGrid,
    PhasedSpline,
    SampledSpline,
    VelocityHull,
    _basis,
    sampled,
    segments_of_pieces,
)
from tubeplanner.optimizer.starts import knot_grid, subdivided

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")


TIMES = np.array([0.0, 0.1, 0.3, 0.34, 0.7, 1.0])
# A phase of one interval: knots of its neighbours' samples lie in three phases and more.
FRACTIONS = [[0, 0.5, 1], [0, 1], [0, 0.3, 1], [0, 0.1, 0.5, 0.6, 1], [0, 1]]
GRID = KnotGrid(tuple(np.array(fraction, dtype=float) for fraction in FRACTIONS))
POINTS = [
    GRID.samples(np.array([0.0, 0.3, 1.0])).and_also(GRID.phase_ends()),
    VelocityHull(GRID.control_point_count),
]


def sampled_anew(points) -> SampledSpline:
    control = np.random.default_rng(3).normal(size=(GRID.control_point_count, 7))
    _basis.cache_clear()
    return sampled(PhasedSpline(GRID, TIMES, control), points)


@NEEDS_LIBRARY
@pytest.mark.parametrize("points", POINTS)
def test_values_and_changes_agree_to_rounding(points, monkeypatch):
    """All changes by switching times are within those that are named."""

    def parts():
        at = sampled_anew(points)
        change = np.random.default_rng(4).normal(size=at.spline.control_points.shape)
        displaced = at.change(change, np.array([0.1, -0.2, 0.3, 0.1]))
        return at, (at.basis, at.by_x, at.by_switching, displaced)

    at, compiled = parts()
    if points is POINTS[0]:
        number = np.arange(len(at.by_switching))[:, None]
        first, stop = at.switching_range.T
        outside = (number < first) | (number >= stop)
        assert outside.any()
        assert not at.by_switching.transpose(0, 2, 1, 3)[outside].any()
    for name in ("_weights", "_by_switching", "_values"):
        monkeypatch.setattr(spline_basis, name, None)
    for ours, numpys in zip(compiled, parts()[1], strict=True):
        np.testing.assert_allclose(ours, numpys, rtol=1e-11, atol=1e-11 * abs(numpys).max())


SWITCHING_TIMES = np.array([0.0, 0.3, 0.55, 1.0])
SMALL_GRID = KnotGrid(
    (np.array([0, 0.3, 0.5, 1.0]), np.array([0, 0.2, 1.0]), np.array([0, 0.5, 0.8, 1.0]))
)


def control_points(seed=0, grid=SMALL_GRID):
    """Return random control points of two joints, at rest at both ends."""
    points = np.random.default_rng(seed).normal(size=(grid.control_point_count, 2))
    points[:3], points[-3:] = points[0], points[-1]
    return points


def test_the_basis_is_that_of_scipys_spline():
    """Samples are found by their times."""
    samples = SMALL_GRID.samples(np.array([0.1, 0.45, 0.9]))
    points = control_points()
    phased = sampled(PhasedSpline(SMALL_GRID, SWITCHING_TIMES, points), samples)
    spline = BSpline(SMALL_GRID.knots(SWITCHING_TIMES), points, DEGREE)
    x = SWITCHING_TIMES[samples.phase] + np.diff(SWITCHING_TIMES)[samples.phase] * samples.fraction
    np.testing.assert_allclose(samples.times(SWITCHING_TIMES), x)
    for order in range(4):
        np.testing.assert_allclose(phased.by_x[order], spline(x, order), rtol=1e-9, atol=1e-9)
    again = SMALL_GRID.samples_at(SWITCHING_TIMES, x)
    np.testing.assert_array_equal(again.phase, samples.phase)
    np.testing.assert_array_equal(again.interval, samples.interval)
    np.testing.assert_allclose(again.fraction, samples.fraction, atol=1e-12)
    ends = SMALL_GRID.samples_at(SWITCHING_TIMES, np.array([0.0, 1.0]))
    assert ends.interval.tolist() == [0, SMALL_GRID.interval_count - 1]
    assert ends.phase.tolist() == [0, 2]


def test_samples_at_a_switching_time_belong_to_the_phases_on_both_sides():
    samples = SMALL_GRID.samples(np.array([0.0, 1.0]))
    at_end = np.isin(samples.fraction, (0.0, 1.0))
    assert samples.phase[at_end].tolist() == [0, 0, 1, 1, 2, 2]
    assert samples.fraction[at_end].tolist() == [0.0, 1.0] * 3
    # Pieces are of their phase's first segment.
    chained = KnotGrid(SMALL_GRID.fractions, (range(0, 2), range(2, 5), range(5, 6)))
    assert segments_of_pieces(chained).tolist() == [0, 0, 0, 2, 2, 5, 5, 5]
    assert segments_of_pieces(SMALL_GRID).tolist() == [0, 0, 0, 1, 1, 2, 2, 2]


def test_the_velocity_stays_within_its_hull_and_touches_it():
    hull = VelocityHull(SMALL_GRID.control_point_count)
    for seed in range(20):
        phased = PhasedSpline(SMALL_GRID, SWITCHING_TIMES, control_points(seed))
        bound = sampled(phased, hull).by_x[1]
        velocity = phased.bspline()(np.linspace(0, 1, 2000), 1)
        assert (velocity.max(axis=0) <= bound.max(axis=0) + 1e-12).all()
        assert (velocity.min(axis=0) >= bound.min(axis=0) - 1e-12).all()
    derivative = phased.bspline().derivative()
    np.testing.assert_allclose(bound, derivative.control_points, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("intervals", [8, 64])
def test_knots_cluster_at_the_ends_and_have_about_the_number_asked_for(intervals):
    grid = knot_grid(SWITCHING_TIMES, intervals)
    assert abs(grid.interval_count - intervals) <= 2
    width = np.diff(grid.breakpoints(SWITCHING_TIMES))
    assert width[0] < 0.5 * width[len(width) // 2] > width[-1]


@pytest.mark.parametrize("parts", [2, 3])
def test_divided_knots_hold_the_same_trajectory(parts):
    grid = knot_grid(SWITCHING_TIMES, 12)
    phased = PhasedSpline(grid, SWITCHING_TIMES, control_points(grid=grid))
    finer = subdivided(phased, parts)
    assert finer.grid.interval_count == parts * grid.interval_count
    old, new = grid.breakpoints(SWITCHING_TIMES), finer.grid.breakpoints(SWITCHING_TIMES)
    np.testing.assert_allclose(new[::parts], old, atol=1e-15)
    assert (np.diff(new) > 0).all()
    x = np.linspace(0, 1, 500)
    np.testing.assert_allclose(finer.bspline()(x), phased.bspline()(x), atol=1e-6)
    np.testing.assert_array_equal(finer.control_points[[0, -1]], phased.control_points[[0, -1]])


def test_directions_near_the_ends_are_known_until_a_joint_is_fast():
    """The first turns once it was fast, the second before, the third goes on, the fourth rests."""
    times = np.array([0.0, 0.4, 1.0])
    grid = knot_grid(times, 12)
    knots, steps = grid.knots(times), np.zeros((grid.control_point_count - 1, 4))
    last = grid.interval_count - 1
    steps[2:-2, 0] = [-1, -2, -3, 1, 1, *[1] * (len(steps) - 9)]
    steps[2:-2, 1] = [-1, 1, *[1] * (len(steps) - 6)]
    steps[2:-2, 2] = 1.0
    spans = (knots[4:-1] - knots[1:-4])[:, None] / 3
    points = np.concatenate([np.zeros((1, 4)), np.cumsum(steps * spans, axis=0)])
    spline = PhasedSpline(grid, times, points)
    samples = grid.samples(np.array([0.0, 0.99]))
    interval, at = samples.interval, sampled(spline, samples)
    signs = spline.end_directions(samples, np.array([1.5, 1.5, 1.5, 1.5]))
    begins, ends = interval == 0, interval == last
    expected = np.full(signs.shape, np.nan)
    expected[interval <= 1, 0] = -1.0  # fast from the second control point on
    expected[begins, 1] = -1.0
    expected[ends, :2] = 1.0  # never fast
    expected[begins | ends, 2] = 1.0
    expected[:, 3] = 0.0
    np.testing.assert_array_equal(signs, expected)
    moves = ~np.isnan(signs) & (abs(at.by_x[1]) > 1e-9)
    np.testing.assert_array_equal(np.sign(at.by_x[1][moves]), signs[moves])
    exact = spline.end_directions(samples, np.full(4, 0.5))
    assert not np.isnan(exact[begins | ends]).any()
    assert np.isnan(exact[~(begins | ends), :3]).all()
