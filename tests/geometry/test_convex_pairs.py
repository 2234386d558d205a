"""Pairs of convex shapes measured natively, against NumPy, FCL and Coal on bundled arms."""

from typing import NamedTuple

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.geometry.body_shapes import IS_NATIVE, BodyShape, BodyShapes
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.convex_shapes import box, sphere
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


def test_depths_of_overlaps_are_proved_and_lead_from_one_face_to_the_other(bundled, monkeypatch):
    checker = checker_of(bundled("ur5/over_the_wall"))
    q = np.random.default_rng(7).uniform(-2.5, 2.5, (150, checker.robot.joint_count))
    poses = checker.robot.body_poses(q)
    row, pair = np.nonzero(checker.sphere_distances(*poses, checker.pairs) < 0)
    pairs = checker.pairs[pair]
    radii = np.array([each.shape.radius for each in checker.shapes])[pairs].sum(axis=1)
    exact = checker._by_fcl(*poses, pairs, row).distance
    deep = exact + radii < -1e-6
    assert deep.sum() > 80
    monkeypatch.setattr(checker, "_by_fcl", None)  # is called without proof
    result = checker.closest_points(*poses, pairs[deep], row[deep])
    assert (result.distance >= exact[deep] - 1e-9).all()
    gap = (result.distance + radii[deep])[:, None] * result.direction
    np.testing.assert_allclose(result.second - result.first, gap, rtol=0, atol=1e-9)
    along = checker.separations_at(*poses, pairs[deep], row[deep])[1]
    along = checker.separations_along(*poses, pairs[deep], along, row[deep])
    np.testing.assert_allclose(along, result.distance, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("first", "second", "half"),
    [
        (box([0.4, 0.6, 0.8]), box([0.2, 0.2, 0.4]), [0.3, 0.4, 0.6]),
        (box([0.4, 0.6, 0.8]), sphere(0.1), [0.3, 0.4, 0.5]),
    ],
    ids=["boxes", "box and ball"],
)
def test_depths_of_boxes_in_line_are_those_of_a_drawing(first, second, half, two_link):
    """Faces, edges and corners of both meet in lines and planes: little is proved natively."""
    shapes = BodyShapes(two_link, [BodyShape("a", 0, first), BodyShape("b", 1, second)])
    places = np.random.default_rng(1).integers(-2, 3, (60, 3)) * 0.1
    rotation = np.tile(np.eye(3), (60, 3, 1, 1))
    position = np.zeros((60, 3, 3))
    position[:, 1] = places
    result = shapes.closest_points(rotation, position, np.tile([0, 1], (60, 1)))
    expected = np.max(abs(places) - half, axis=1)
    inside = expected < -1e-6
    assert inside.sum() > 20
    np.testing.assert_allclose(result.distance[inside], expected[inside], rtol=0, atol=2e-9)


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
