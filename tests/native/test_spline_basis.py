"""Compiled splines against those in numpy, at samples of phases with few and many knots."""

import numpy as np
import pytest

from tubeplanner.native import spline_basis
from tubeplanner.native.library import LIBRARY
from tubeplanner.refinement.phased_spline import KnotGrid, PhasedSpline, VelocityHull
from tubeplanner.refinement.sampled_spline import SampledSpline, _basis

pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")

TIMES = np.array([0.0, 0.1, 0.3, 0.34, 0.7, 1.0])
# A phase of one interval: knots of its neighbours' samples lie in three phases and more.
SHARES = [[0, 0.5, 1], [0, 1], [0, 0.3, 1], [0, 0.1, 0.5, 0.6, 1], [0, 1]]
GRID = KnotGrid(tuple(np.array(share, dtype=float) for share in SHARES))
POINTS = [
    GRID.samples(np.array([0.0, 0.3, 1.0])).and_also(GRID.phase_ends()),
    VelocityHull(GRID.control_point_count),
]


def sampled_anew(points) -> SampledSpline:
    control = np.random.default_rng(3).normal(size=(GRID.control_point_count, 7))
    _basis.cache_clear()
    spline = PhasedSpline(GRID, TIMES, control)
    basis = _basis(GRID, points, TIMES.tobytes())
    values = spline_basis.cubic_values(basis, points.first, control)
    if values is None:
        taken = control[points.first[:, None] + np.arange(4)]
        values = np.einsum("onr,onrj->onj", basis, np.broadcast_to(taken, (*basis.shape, 7)))
    return SampledSpline(spline, points, basis, values)


@pytest.mark.parametrize("points", POINTS)
def test_values_and_changes_agree_to_rounding(points, monkeypatch):
    compiled = sampled_anew(points)
    change = np.random.default_rng(4).normal(size=compiled.spline.control_points.shape)
    found = [compiled.basis, compiled.by_x, compiled.by_switching]
    moved = compiled.change(change, np.array([0.1, -0.2, 0.3, 0.1]))
    for name in ("_weights", "_by_switching", "_values"):
        monkeypatch.setattr(spline_basis, name, None)
    pure = sampled_anew(points)
    for ours, theirs in zip(found, [pure.basis, pure.by_x, pure.by_switching], strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-11 * abs(theirs).max())
    again = pure.change(change, np.array([0.1, -0.2, 0.3, 0.1]))
    np.testing.assert_allclose(moved, again, rtol=1e-11, atol=1e-11)


def test_all_changes_by_switching_times_are_within_those_that_are_named():
    changes = sampled_anew(POINTS[0]).changes
    number = np.arange(len(changes.by_switching))[:, None]
    outside = (number < changes.moved[:, 0]) | (number >= changes.moved[:, 1])
    assert outside.any()
    assert not changes.by_switching.transpose(0, 2, 1, 3)[outside].any()
