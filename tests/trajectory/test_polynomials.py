"""Piecewise polynomials; rigorous bounds by Bernstein coefficients."""

import numpy as np
import pytest
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same
from scipy.interpolate import PPoly

from tubeplanner.trajectory.polynomials import (
    PiecewisePolynomial,
    bernstein_coefficients,
    halves,
    maxima,
    peak_magnitudes,
    restricted,
)


@pytest.mark.parametrize("degree", [0, 1, 5])
def test_values_and_derivatives_are_those_of_scipy(degree):
    rng = np.random.default_rng(degree)
    breakpoints = np.cumsum([0.0, *rng.uniform(0.1, 0.5, 4)])
    coefficients = rng.normal(size=(degree + 1, 4, 2))
    reference = PPoly(coefficients, breakpoints)
    t = np.append(rng.uniform(-0.1, breakpoints[-1] + 0.1, 55), breakpoints).reshape(12, 5)
    for order in range(4):
        derivative = PiecewisePolynomial(coefficients, breakpoints).derivative(order)
        close(derivative(t), reference(t, order), rtol=1e-12, atol=1e-12)
        assert derivative.coefficients.shape == reference.derivative(order).c.shape
    assert derivative(t[0, 0]).shape == (2,)


DEGREES = (1, 4, 7)


def random_polynomials(degree, pieces=5, n=3):
    """Return coefficients (degree+1, pieces, n) and widths (pieces,)."""
    rng = np.random.default_rng(degree)
    return rng.normal(size=(degree + 1, pieces, n)), rng.uniform(0.1, 2.0, pieces)


def values(coefficients, times):
    """Return polynomials (degree+1, ...) at times that broadcast with (...)."""
    total = np.zeros(np.broadcast_shapes(coefficients.shape[1:], np.shape(times)))
    for coefficient in coefficients:
        total = total * times + coefficient
    return total


def exact_maximum(polynomial, width):
    """Return the largest value of one polynomial on [0, width], by the roots of its slope."""
    roots = np.roots(np.polyder(polynomial))
    stationary = roots.real[(abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < width)]
    return np.polyval(polynomial, np.concatenate([[0.0, width], stationary])).max()


@pytest.mark.parametrize("degree", [0, *DEGREES])
def test_a_polynomial_lies_in_the_hull_of_its_coefficients_whose_ends_are_its_values(degree):
    coefficients, widths = random_polynomials(degree)
    start = np.linspace(0, 0.3, len(widths))
    bounds = bernstein_coefficients(coefficients, start, widths)
    assert bounds.shape == coefficients.shape
    times = start + np.linspace(0, 1, 500)[:, None] * widths
    sampled = np.array([values(coefficients, t[:, None]) for t in times])
    close(bounds[[0, -1]], sampled[[0, -1]], rtol=1e-9, atol=1e-9)
    assert (sampled <= bounds.max(axis=0) + 1e-9).all()
    assert (sampled >= bounds.min(axis=0) - 1e-9).all()


@pytest.mark.parametrize("degree", DEGREES)
def test_restricted_polynomials_are_the_same_in_the_time_of_the_interval(degree):
    coefficients, widths = random_polynomials(degree)
    start, width = 0.2 * widths, 0.7 * widths
    parts = restricted(coefficients, start, width)
    assert parts.shape == coefficients.shape
    for fraction in (0.0, 0.3, 1.0):
        expected = values(coefficients, (start + fraction * width)[:, None])
        close(values(parts, fraction), expected, atol=1e-12)


def test_the_coefficients_are_those_of_a_textbook_example():
    """The parabola t^2 on [0, 1] has the control points 0, 0, 1; on [1, 3] they are 1, 3, 9."""
    square = np.array([1.0, 0.0, 0.0])[:, None, None] * np.ones((1, 2, 1))
    bounds = bernstein_coefficients(square, np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    close(bounds[:, :, 0].T, [[0, 0, 1], [1, 3, 9]], atol=1e-14)


@pytest.mark.parametrize("degree", DEGREES)
def test_maxima_are_those_by_the_roots_of_the_derivative_and_attained_where_they_say(degree):
    coefficients, widths = random_polynomials(degree, pieces=12, n=4)
    exact = np.array(
        [
            [exact_maximum(coefficients[:, piece, k], widths[piece]) for k in range(4)]
            for piece in range(12)
        ]
    )
    extrema = maxima(coefficients, widths)
    close(extrema.value, exact.max(axis=0), rtol=1e-9, atol=1e-12)
    same(extrema.piece, exact.argmax(axis=0))
    assert ((extrema.local_time >= 0) & (extrema.local_time <= widths[extrema.piece])).all()
    polynomials = coefficients[:, extrema.piece, np.arange(4)]
    close(values(polynomials, extrema.local_time), extrema.value, atol=1e-11)


@pytest.mark.parametrize("degree", [0, 7])
def test_a_constant_is_its_own_maximum_and_the_largest_of_several_is_found(degree):
    coefficients = np.zeros((degree + 1, 3, 2))
    coefficients[-1] = [[1.0, 5.0], [3.0, 4.0], [2.0, -1.0]]
    extrema = maxima(coefficients, np.array([0.5, 1.0, 2.0]))
    assert extrema.value.tolist() == [3.0, 5.0]
    assert extrema.piece.tolist() == [1, 0]


@pytest.mark.parametrize("touch", [0.0, 0.3])
@pytest.mark.parametrize("power", [2, 6])
def test_a_polynomial_that_only_touches_zero_has_maximum_zero(power, touch):
    polynomial = -np.poly([touch] * power)
    extrema = maxima(polynomial[:, None, None], np.array([0.7]))
    close(extrema.value, [0.0], atol=1e-15)
    assert abs(extrema.local_time[0] - touch) < 0.02


def test_a_narrow_peak_between_samples_is_not_missed():
    spike = np.array([-1.0, 1e-3, 0.0])[:, None, None]
    flat = np.zeros((3, 1, 1))
    extrema = maxima(np.concatenate([flat, spike, flat], axis=1), np.array([1.0, 1e-3, 1.0]))
    close(extrema.value, [2.5e-7], rtol=1e-9)
    assert extrema.piece.tolist() == [1]
    close(extrema.local_time, [5e-4], rtol=1e-4)


@pytest.mark.parametrize("degree", DEGREES)
def test_peak_magnitudes_are_the_larger_of_maximum_and_minimum(degree):
    coefficients, widths = random_polynomials(degree)
    peaks = peak_magnitudes(coefficients, widths)
    for j, (value, piece) in enumerate(zip(peaks.value, peaks.piece, strict=True)):
        pieces = zip(coefficients[:, :, j].T, widths, strict=True)
        both = [exact_maximum(sign * p, width) for p, width in pieces for sign in (1, -1)]
        assert value == pytest.approx(max(both), rel=1e-9)
        there = np.polyval(coefficients[:, piece, j], peaks.local_time[j])
        assert abs(there) == pytest.approx(value, rel=1e-12)


def test_halves_of_intervals_cover_them_in_turn():
    start, width = halves(np.array([0.0, 3.0]), np.array([1.0, 4.0]))
    assert start.tolist() == [0.0, 0.5, 3.0, 5.0]
    assert width.tolist() == [0.5, 0.5, 2.0, 2.0]
