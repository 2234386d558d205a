"""Compiled distances from axes and planes against those in numpy."""

import numpy as np
import pytest

from tubeplanner.native import regions
from tubeplanner.native.library import LIBRARY
from tubeplanner.refinement.region_constraints import EvaluatedRegions, Planes
from tubeplanner.tube.segment_regions import Capsules

pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")

RNG = np.random.default_rng(2)
BEGIN = RNG.normal(size=(4, 3))
END = np.vstack([RNG.normal(size=(3, 3)), BEGIN[3:]])  # the last one is a ball
CAPSULES = Capsules(BEGIN, END, np.array([0.1, 0.3, 0.2, np.inf]))


@pytest.mark.parametrize("shape", [(20, 3), (5, 20, 3), (5, 1, 3), (0, 20, 3)])
def test_points_are_as_far_from_axes(shape, monkeypatch):
    p, segment = RNG.normal(size=shape), np.arange(20) % 4
    compiled = CAPSULES.margin(p, segment)
    monkeypatch.setattr(regions, "_away", None)
    np.testing.assert_allclose(compiled, CAPSULES.margin(p, segment), rtol=1e-13)


def test_normals_point_the_same_way(monkeypatch):
    p, segment = RNG.normal(size=(20, 3)), np.arange(20) % 4
    p[:4] = BEGIN
    compiled = CAPSULES.outward(p, segment)
    assert not compiled[:4].any()
    monkeypatch.setattr(regions, "_away", None)
    np.testing.assert_allclose(compiled, CAPSULES.outward(p, segment), atol=1e-14)


@pytest.mark.parametrize("bend", [None, RNG.normal(size=(8, 3))])
def test_planes_have_the_same_slack(bend, monkeypatch):
    own = np.arange(8) % 4
    at = EvaluatedRegions(
        None, RNG.normal(size=(8, 3)), None, CAPSULES, own, None, None, RNG.uniform(0, 0.1, 8), None
    )
    sample = np.array([0, 1, 2, 4, 5, 6, 3, 7])
    normal = RNG.normal(size=(8, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    other = np.array([1, 2, 0, 0, 1, 0, 3, 3])
    planes = Planes(sample, normal, other)
    compiled = at.slack(planes, bend)
    monkeypatch.setattr(regions, "_slack", None)
    np.testing.assert_allclose(compiled, at.slack(planes, bend), rtol=1e-11, atol=1e-12)
