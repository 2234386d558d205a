"""Which tube segments make up a phase."""

from types import SimpleNamespace

import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.refinement.tube_chains import largest_kink, sharpest_bend, tube_chains


def problem(points, radius=0.01, **more):
    """Return what a chain is told by: a tube."""
    return SimpleNamespace(tube=Tube(points, radius, **more))


def circle(count):
    angles = np.linspace(0, 2 * np.pi, count + 1)
    return 0.07 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])


def right_angle(parts):
    """Return two legs of 20 cm, each cut into parts."""
    s = np.linspace(0, 0.2, parts + 1)[:, None]
    return np.vstack([s * [1, 0, 0], [0.2, 0, 0] + s[1:] * [0, 1, 0]])


@pytest.mark.parametrize("points", [right_angle(1), right_angle(6), circle(12)])
def test_of_few_points_every_one_ends_a_phase(points):
    chains = tube_chains(problem(points))
    assert chains == tuple(range(k, k + 1) for k in range(len(points) - 1))


@pytest.mark.parametrize("radius", [0.01, 0.002])
@pytest.mark.parametrize("count", [25, 100, 1000])
def test_a_circle_of_many_chords_is_one_chain(count, radius):
    assert tube_chains(problem(circle(count), radius)) == (range(count),)


@pytest.mark.parametrize("parts", [16, 100])
def test_a_sharp_corner_between_short_segments_ends_a_chain(parts):
    assert tube_chains(problem(right_angle(parts))) == (range(parts), range(parts, 2 * parts))


def test_noise_is_no_corner():
    points = circle(200)
    noise = np.random.default_rng(0).normal(size=points.shape)
    noise[[0, -1]] = 0
    assert tube_chains(problem(points + 0.0002 * noise, 0.002)) == (range(200),)


def test_of_many_corners_the_sharpest_end_a_phase():
    legs = np.arange(131)
    zigzag = np.column_stack([0.01 * legs, 0.03 * (legs % 2), 0 * legs])
    assert len(tube_chains(problem(zigzag[:61], 0.002))) == 60
    assert len(tube_chains(problem(zigzag, 0.002))) == 101


def test_a_chain_ends_where_joint_ranges_change():
    signs = [{"turn": [-1.0, 1.0 if k < 30 else 2.0]} for k in range(100)]
    changing = problem(circle(100), joint_signs=signs)
    assert tube_chains(changing) == (range(30), range(30, 100))


def test_a_chain_ends_where_the_rotation_bound_changes():
    upright = np.tile([0.0, 0.0, 0.0, 1.0], (101, 1))
    bounds = [0.1] * 70 + [0.2] * 30
    bounded = problem(circle(100), orientations=upright, rotation_tolerance=bounds)
    assert tube_chains(bounded) == (range(70), range(70, 100))


def test_a_kink_is_what_samples_miss_at_the_inner_side_of_a_corner():
    """Two samples as far before as behind the corner, on the inner wall of either leg."""
    turn, spacing, radius = 0.1, 0.002, 0.01
    points = [[-1, 0, 0], [0, 0, 0], [np.cos(turn), np.sin(turn), 0]]
    tube = Tube(points, radius)
    kink = largest_kink(tube, (range(2),), spacing)
    along = np.array([[-1.0, 0.0, 0.0], points[2]])
    apex = radius * np.array([-np.tan(turn / 2), 1.0, 0.0])  # where the two inner walls meet
    samples = apex + spacing / 2 * along
    np.testing.assert_allclose(tube.margin(samples).max(axis=1), 0.0, atol=1e-5)
    outside = -tube.margin(samples.mean(axis=0)[None]).max() / radius
    assert outside == pytest.approx(kink, rel=0.01)
    assert largest_kink(tube, (range(1), range(1, 2)), spacing) == 0.0


@pytest.mark.parametrize("radius", [0.01, 0.002])
def test_a_circle_bends_by_its_radius_of_curvature_in_radii(radius):
    bend = sharpest_bend(Tube(circle(1000), radius))
    assert bend == pytest.approx(radius / 0.07, abs=2 * np.pi / 1000)


def test_a_corner_that_ends_a_phase_is_no_bend_of_chains():
    tube = Tube(right_angle(16), 0.01)
    assert sharpest_bend(tube) == pytest.approx(np.pi / 2)
    assert sharpest_bend(tube, (range(16), range(16, 32))) == pytest.approx(0.0, abs=1e-9)
