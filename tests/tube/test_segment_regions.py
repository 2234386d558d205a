"""Capsules about segments: distances, normals, and the planes that hold them."""

import numpy as np
import pytest

from tubeplanner.tube.segment_regions import Capsules

AXES = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]])
CAPSULES = Capsules(AXES[:-1], AXES[1:], np.array([0.1, 0.5]))
BALL = Capsules(AXES[:1], AXES[:1], np.array([0.3]))
SEGMENT = np.array([0, 0, 1, 1])
POINTS = np.array([[0.5, 0.05, 0], [-0.3, 0.4, 0], [1.0, 1.0, 0.25], [1.0, 3.0, 0.0]])


def test_distances_are_those_to_the_axis_and_its_ends():
    distance = np.array([0.05, 0.5, 0.25, 1.0])
    radius = np.array([0.1, 0.1, 0.5, 0.5])
    np.testing.assert_allclose(CAPSULES.margin(POINTS, SEGMENT), radius - distance)
    np.testing.assert_allclose(CAPSULES.share(POINTS, SEGMENT), distance / radius)


def test_margins_of_many_points_per_segment_are_those_of_each():
    rows = np.stack([POINTS, POINTS + 0.1, POINTS - 0.2])
    found = CAPSULES.margin(rows, SEGMENT)
    np.testing.assert_array_equal(found, [CAPSULES.margin(row, SEGMENT) for row in rows])


def test_normals_lead_away_from_the_axis():
    wanted = [[0, 1, 0], [-0.6, 0.8, 0], [0, 0, 1], [0, 1, 0]]
    np.testing.assert_allclose(CAPSULES.outward(POINTS, SEGMENT), wanted, atol=1e-15)
    on_axis = CAPSULES.outward(np.array([[0.4, 0.0, 0.0], [0.4, 1e-12, 0.0]]), np.array([0, 0]))
    np.testing.assert_array_equal(on_axis, np.zeros((2, 3)))


def test_both_caps_are_faces_and_a_ball_has_none():
    along, back = CAPSULES.faces(np.array([0, 1]))
    np.testing.assert_allclose(along, [[1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(back, -along)
    assert not np.any(BALL.faces(np.array([0])))


@pytest.mark.parametrize("seed", range(3))
def test_a_point_is_inside_just_if_no_plane_is_before_it(seed):
    """n.p <= max(n.A, n.B) + extent for every n; and the outward plane touches the capsule."""
    rng = np.random.default_rng(seed)
    p, segment = rng.uniform(-1, 3, (400, 3)), rng.integers(0, 2, 400)
    normal = rng.normal(size=(400, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    outward = CAPSULES.outward(p, segment)

    def beyond(n):
        ends = (CAPSULES.begin[segment], CAPSULES.end[segment])
        reach = np.maximum(*(np.einsum("ri,ri->r", n, end) for end in ends))
        return np.einsum("ri,ri->r", n, p) - reach - CAPSULES.extent(n, segment)

    margin = CAPSULES.margin(p, segment)
    assert (beyond(normal) <= -margin + 1e-12).all()
    np.testing.assert_allclose(beyond(outward), -margin, atol=1e-12)


def test_their_tolerance_is_the_radius():
    assert CAPSULES.kinds(0) == ("radius",)
    assert CAPSULES.kind(POINTS, SEGMENT).tolist() == [0] * len(POINTS)
