"""Polynomials through samples are those of another library, and join without jumps."""

import numpy as np
import pytest
from scipy.interpolate import BPoly, PPoly

from tubeplanner.trajectory.hermite_pieces import hermite_pieces


@pytest.mark.parametrize("orders", [1, 2, 3])
def test_they_are_those_of_another_library(orders):
    random = np.random.default_rng(orders)
    time = np.cumsum(random.uniform(0.1, 0.6, 9))
    known = [random.normal(size=(9, 3)) for _ in range(orders)]
    expected = PPoly.from_bernstein_basis(BPoly.from_derivatives(time, np.stack(known, axis=1)))
    np.testing.assert_allclose(hermite_pieces(time, known), expected.c, rtol=1e-9, atol=1e-9)


def test_samples_a_millisecond_apart_join_to_rounding():
    """Far from zero, where positions have the fewest digits behind the point."""
    time = np.arange(2000) / 1000
    known = [3 + np.sin(time), np.cos(time), -np.sin(time)]
    pieces = PPoly(hermite_pieces(time, [k[:, None] for k in known]), time)
    ends = np.nextafter(time[1:-1], 0.0)
    for order, size in ((0, 3.0), (1, 1.0), (2, 1.0)):
        left, right = pieces(ends, order), pieces(time[1:-1], order)
        assert abs(left - right).max() <= 1e-11 * size
