"""Reference orientations and rotation bounds: closed forms, boundary cases, faults."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tubeplanner import Tube
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.rotation import rotation_bounds

INF = np.inf
LINE = [[0, 0, 0], [1, 0, 0]]
CORNER = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
STILL = [0, 0, 0, 1]


def about(axis, angle):
    return Rotation.from_rotvec(angle * np.array(axis, dtype=float)).as_quat()


def turned(points, orientations, tolerance):
    return Tube(points, 0.1, orientations=orientations, rotation_tolerance=tolerance)


def test_the_reference_turns_about_one_axis_in_proportion_to_the_path():
    """Against scipy's spherical interpolation, between the ends and beyond them."""
    quaternions = Rotation.random(3, random_state=3).as_quat()
    tube = turned(CORNER, quaternions * [[1], [-1], [1]], 1.0)  # q and -q are the same rotation
    u = np.linspace(-0.5, 1.5, 41)
    for k, beside in ((0, [0.0, 0.03, 0.05]), (1, [0.03, 0.0, 0.05])):
        tool = tube.points[k] + u[:, None] * (tube.points[k + 1] - tube.points[k])
        expected = Slerp([0, 1], Rotation.from_quat(quaternions[k : k + 2]))(np.clip(u, 0, 1))
        reference = tube.rotation.reference(tool, k)
        np.testing.assert_allclose(reference, expected.as_matrix(), atol=1e-14)
        np.testing.assert_allclose(tube.rotation.reference(tool + beside, k), reference, atol=1e-14)


def test_a_segment_may_be_named_for_every_sample():
    tube = turned(CORNER, Rotation.random(3, random_state=4).as_quat(), [0.1, [0.2, INF, 0.3]])
    rng = np.random.default_rng(0)
    tool, rotation = rng.uniform(0, 1, (20, 3)), Rotation.random(20, random_state=1).as_matrix()
    segment = rng.integers(0, 2, 20)
    each = [tube.rotation.margin(rotation, tool, k) for k in range(2)]
    margin = tube.rotation.margin(rotation, tool, segment)
    np.testing.assert_allclose(margin, np.where(segment == 0, *each), atol=1e-14)
    np.testing.assert_allclose(tube.rotation_margin(rotation, tool), np.array(each).T, atol=1e-14)
    part = tube.rotation_margin(rotation, tool, slice(1, 2))
    np.testing.assert_allclose(part[:, 0], each[1], atol=1e-14)


def test_a_planar_arm_is_off_by_the_sum_of_its_angles(two_link):
    """Its tool is turned by q1 + q2 about z; the reference goes from 0.2 to 1.0 rad on the way."""
    points = [[0.2, 0, 0], [0.5, 0, 0]]
    tube = turned(points, [about([0, 0, 1], 0.2), about([0, 0, 1], 1.0)], 0.5)
    q = np.random.default_rng(2).uniform(-1.4, 1.4, (50, 2))
    rotation, tool = two_link.tool_pose(q)
    u = np.clip((tool[:, 0] - 0.2) / 0.3, 0, 1)
    expected = q.sum(axis=1) - 0.2 - 0.8 * u
    expected = (expected + np.pi) % (2 * np.pi) - np.pi
    error = tube.rotation.error(rotation, tool, 0)
    np.testing.assert_allclose(error[:, 2], expected, atol=1e-12)
    np.testing.assert_allclose(error[:, :2], 0, atol=1e-12)
    margin = tube.rotation.margin(rotation, tool, 0)
    np.testing.assert_allclose(margin, 0.5 - abs(expected), atol=1e-12)


@pytest.mark.parametrize(
    ("tolerance", "vector", "margin"),
    [
        (0.5, [0.3, -0.4, 0], 0.0),
        ([0.5, 0.5, 0.5], [0.3, -0.4, 0], 0.1),
        ([0.1, 0.2, INF], [0, -0.25, 0], -0.05),
        (4.0, [0, np.pi, 0], 4 - np.pi),
        ([1.0, 1.0, 4.0], [0, 0, -np.pi], 4 - np.pi),
    ],
)
def test_the_margin_is_what_is_left_of_the_tightest_bound(tolerance, vector, margin):
    """Components are those in the frame of the reference, which here is not that of the base."""
    reference = Rotation.from_rotvec([0.4, -1.0, 0.7])
    tube = turned(LINE, [reference.as_quat()] * 2, [tolerance])
    rotation = (reference * Rotation.from_rotvec(vector)).as_matrix()
    slack = tube.rotation.margin(rotation[None], np.array([[0.5, 0, 0]]), 0)
    np.testing.assert_allclose(slack, [margin], atol=1e-14)


def test_the_margin_has_no_jump_at_half_a_turn():
    """There the rotation vector jumps to its opposite; bounds are on magnitudes."""
    axis = np.array([0.1, 0.0, 0.995])
    tube = turned(LINE, [STILL, STILL], [[0.4, 0.4, INF]])
    angle = np.pi + np.linspace(-1e-6, 1e-6, 11)
    rotation = Rotation.from_rotvec(angle[:, None] * axis).as_matrix()
    margin = tube.rotation.margin(rotation, np.zeros((11, 3)), 0)
    assert abs(np.diff(margin)).max() < 1e-6


@pytest.mark.parametrize("segments", [1, 3])
def test_one_number_or_triple_serves_for_all_segments(segments):
    bounds, each = [0.1, 0.2, INF], ((0.1, 0.2, INF),) * segments
    points = [[0.1 * k, 0, 0] for k in range(segments + 1)]
    assert rotation_bounds(0.1, segments) == (0.1,) * segments
    assert rotation_bounds([bounds], segments) == each
    assert turned(points, [STILL] * len(points), [bounds]).rotation_tolerance == each
    flat = tuple(bounds) if segments == 3 else each  # three angles, or one triple
    assert rotation_bounds(bounds, segments) == flat
    assert rotation_bounds(np.array(bounds), segments) == flat


def test_a_segment_may_be_free_beside_one_that_is_not():
    at = np.eye(3)[None], np.zeros((1, 3))
    tube = turned(CORNER, [STILL] * 3, [[INF, INF, INF], 0.2])
    np.testing.assert_array_equal(tube.rotation_margin(*at), [[INF, 0.2]])
    free = turned(CORNER, [STILL] * 3, [[INF, INF, INF], INF])
    assert free.rotation is None
    assert free.rotation_tolerance == ((INF, INF, INF), INF)
    assert (free.rotation_margin(*at) == INF).all()


@pytest.mark.parametrize("angle", [0.0, 179.99, -179.99])
def test_less_than_half_a_turn_is_accepted(angle):
    tube = turned(LINE, [STILL, about([0, 1, 0], np.radians(angle))], 0.1)
    np.testing.assert_allclose(
        tube.rotation.rotation_change[0], [0, np.radians(angle), 0], atol=1e-12
    )


def test_rounded_quaternions_are_made_unit():
    tube = turned(LINE, [[0.7071, 0, 0, 0.7071], [0, 0, 0, 1.0009]], 0.1)
    np.testing.assert_allclose(np.linalg.norm(tube.orientations, axis=1), 1, atol=1e-15)


def fault(message, orientations=(STILL, STILL), tolerance=0.1):
    return orientations, tolerance, message


@pytest.mark.parametrize(
    ("orientations", "tolerance", "message"),
    [
        fault(
            "tube.orientations is given without tube.rotation_tolerance; give an angle or three "
            "bounds [rad] for every segment, or leave both out",
            tolerance=None,
        ),
        fault(
            "tube.rotation_tolerance is given without tube.orientations; give a quaternion "
            "[x, y, z, w] for every reference point, or leave both out",
            None,
        ),
        fault("has 1 quaternions for 2 reference points; give one each", [STILL]),
        fault("tube.orientations: [0, 0, 0, 1] is no list of quaternions [x, y, z, w]", STILL),
        fault("is no list of quaternions [x, y, z, w]", [[0, 0, 1]] * 2),
        fault(
            "tube.orientations[1] [0.0, 0.0, 0.0, 0.9] has the length 0.9; a rotation is a "
            "quaternion [x, y, z, w] of length 1: divide it by its length",
            [STILL, [0, 0, 0, 0.9]],
        ),
        fault(
            "tube.orientations: from point 0 to 1 the tool turns by 180 degrees, so that the "
            "direction is undetermined; add a reference point between them",
            [STILL, [0, 1, 0, 0]],
        ),
        fault(
            "tube.rotation_tolerance has 2 entries for 1 segments; give one angle or triple for "
            "all, or an angle or three bounds each",
            tolerance=[0.1, 0.1],
        ),
        fault("tube.rotation_tolerance[0] is 0 rad; it must be > 0, .inf where", tolerance=[0]),
        fault("tube.rotation_tolerance[0] is nan rad; it must be > 0", tolerance=[np.nan]),
        fault("tolerance[0] is [0.1, 0.0, inf] rad; it must be > 0", tolerance=[[0.1, 0.0, INF]]),
        fault(
            "tube.rotation_tolerance[0] is [0.1, 0.1]; it must be one angle or bounds [x, y, z] on "
            "the components of the rotation vector [rad], .inf where free",
            tolerance=[[0.1, 0.1]],
        ),
        fault("rotation_tolerance[0] is True; it must be one angle or", tolerance=[True]),
    ],
)
def test_a_fault_is_named(orientations, tolerance, message):
    with pytest.raises(ProblemError) as caught:
        turned(LINE, orientations, tolerance)
    assert message in str(caught.value)
