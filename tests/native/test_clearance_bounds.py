"""Lower bounds on clearances of many pairs at many configurations, native and NumPy."""

import numpy as np
import pytest

from tubeplanner import Obstacle, parse_problem, placement_of
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.measurement import clearance_bounds
from tubeplanner.measurement.pair_clearance import PairClearance
from tubeplanner.native.library import LIBRARY, NativeLibrary

NEEDS_LIBRARY = pytest.mark.skipif(
    LIBRARY.functions is None, reason="the native library is left out"
)


# Bounds on clearances found natively, against those of numpy, on bundled arms.


def checker_of(problem):
    round_ones = (
        Obstacle.sphere("ball", 0.1, placement_of([0.3, 0.3, 0.3])),
        Obstacle.capsule("bar", 0.05, 0.4, placement_of([-0.3, 0.3, 0.4])),
    )
    return CollisionChecker(problem.robot, [*problem.obstacles, *round_ones])


@NEEDS_LIBRARY
@pytest.mark.parametrize("near", [0.03, 0.0])
def test_bounds_are_those_of_numpy(near, monkeypatch, bundled):
    problem = bundled("ur5/over_the_wall")
    checker, rng = checker_of(problem), np.random.default_rng(0)
    q = problem.start + rng.normal(scale=0.6, size=(60, len(problem.start)))
    poses = problem.robot.body_poses(q)
    required = rng.uniform(0, 0.02, len(checker.pairs))
    required[::5] = -np.inf  # may touch
    arguments = checker, checker.pairs, required
    found, least = clearance_bounds.ClearanceBounds(*arguments).at(*poses, near)
    monkeypatch.setattr(clearance_bounds, "LIBRARY", NativeLibrary(None, ""))
    expected, expected_least = clearance_bounds.ClearanceBounds(*arguments).at(*poses, near)
    close = np.isfinite(expected)
    assert (np.isfinite(found) == close).all()
    assert not close[:, ::5].any()
    assert 50 < close.sum() < close.size / 2
    assert (expected[close] < 0).any()
    assert found[close] == pytest.approx(expected[close], abs=1e-10)
    told = np.isfinite(expected_least)
    assert (np.isfinite(least) == told).all()
    assert least[told] == pytest.approx(expected_least[told], abs=1e-10)


# How much farther apart pairs of shapes are than they must be.


BARE = {
    "robot": {"urdf": "example:asr_twodof", "tool_frame": "Tip"},
    "start": {"joints": [0.0, 0.9]},
    "goal": {"joints": [1.0, 0.9]},
}


def test_an_arm_without_geometry_is_clear_of_everything():
    problem = parse_problem(BARE, reads_tube=False)
    least = PairClearance(problem, 0.01).least(np.zeros((3, 2)), near=1.0)
    assert (least.clearance == np.inf).all()
