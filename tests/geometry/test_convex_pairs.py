"""Pairs of convex shapes measured natively, against NumPy, FCL and Coal on bundled arms."""

from typing import NamedTuple

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.geometry.body_shapes import IS_NATIVE
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.studies.tubes.clearance_bounds import PairClearance

pytestmark = pytest.mark.skipif(not IS_NATIVE, reason="the native library is left out")

PAIRS = 500  # of each arm
NEAR = 0.15  # [m]: pairs with more room do not matter
PROBLEMS = ("two_link/paper_1_30mm", "ur5/over_the_wall")


class Placed(NamedTuple):
    """A native checker, a checker without native library, and pairs in configurations."""

    native: CollisionChecker
    other: CollisionChecker
    rotation: np.ndarray
    position: np.ndarray
    pairs: np.ndarray
    row: np.ndarray

    def radii(self, pairs):
        return np.array([each.shape.radius for each in self.native.shapes])[pairs].sum(axis=1)


def checker_of(problem):
    """Return a checker that has round solids too."""
    round_ones = (
        Obstacle.sphere("ball", 0.1, placement_of([0.3, 0.3, 0.3])),
        Obstacle.capsule("bar", 0.05, 0.4, placement_of([-0.3, 0.3, 0.4])),
    )
    return CollisionChecker(problem.robot, [*problem.obstacles, *round_ones])


@pytest.fixture(scope="module", params=PROBLEMS)
def placed(request, bundled):
    native, other = (checker_of(bundled(request.param)) for _ in range(2))
    vars(other)["_native"] = None
    rng = np.random.default_rng(5)
    q = rng.uniform(-2.5, 2.5, (PAIRS // 5, native.robot.joint_count))
    pairs = native.pairs[rng.integers(0, len(native.pairs), PAIRS)]
    row = rng.integers(0, len(q), PAIRS)
    return Placed(native, other, *native.robot.body_poses(q), pairs, row)


def test_quick_bounds_are_those_of_numpy(placed):
    native, other, rotation, position, pairs, row = placed
    pairs = np.concatenate([pairs[::2], pairs[1::2, ::-1]])  # round ones come first as well
    direction = np.random.default_rng(6).normal(size=(PAIRS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    for name, arguments in (
        ("sphere_distances", (native.pairs,)),
        ("box_distances", (row, pairs)),
        ("separations_along", (pairs, direction, row)),
    ):
        result, expected = (
            getattr(checker, name)(rotation, position, *arguments) for checker in (native, other)
        )
        np.testing.assert_allclose(result, expected, rtol=0, atol=1e-13, err_msg=name)


def test_closest_points_are_never_looser_than_those_of_fcl_and_their_own_proof(placed):
    native, other, rotation, position, pairs, row = placed
    expected = other.closest_points(rotation, position, pairs, row)
    result = native.closest_points(rotation, position, pairs, row)
    more = result.distance - expected.distance
    assert more.min() > -1e-9
    assert more.max() < 2e-5
    apart = expected.distance > 1e-6
    gap = (result.second - result.first)[apart]
    size = (result.distance + placed.radii(pairs))[apart]
    along = np.einsum("pi,pi->p", gap, result.direction[apart])
    for length in (np.linalg.norm(gap, axis=1), along):
        np.testing.assert_allclose(length, size, rtol=0, atol=1e-9)
    for checker, closest in ((native, result), (other, expected)):
        distance, direction = checker.separations_at(rotation, position, pairs, row)
        np.testing.assert_allclose(distance, closest.distance, rtol=0, atol=1e-12)
        along = checker.separations_along(rotation, position, pairs, direction, row)
        np.testing.assert_allclose(along, distance, rtol=0, atol=1e-9)


@pytest.mark.parametrize("near", [0.03, 0.0])
def test_bounds_on_clearances_are_those_of_numpy(near, bundled):
    problem = bundled("ur5/over_the_wall")
    clearance, rng = PairClearance(problem, 0.0), np.random.default_rng(0)
    q = problem.start + rng.normal(scale=0.6, size=(60, len(problem.start)))
    poses = problem.robot.body_poses(q)
    required = clearance.required = rng.uniform(0, 0.02, len(clearance.pairs))
    required[::5] = -np.inf  # may touch
    result, least = clearance.bounds(*poses, near)
    clearance._table = None
    expected, expected_least = clearance.bounds(*poses, near)
    close = np.isfinite(expected)
    assert not close[:, ::5].any()
    assert 50 < close.sum() < close.size / 2
    assert (expected[close] < 0).any()
    for one, other in ((result, expected), (least, expected_least)):
        np.testing.assert_array_equal(np.isfinite(one), np.isfinite(other))
        finite = np.isfinite(other)
        assert one[finite] == pytest.approx(other[finite], abs=1e-10)
