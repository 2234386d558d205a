"""Coarse knots in a tube as wide as they are coarse."""

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import Tube, load_problem, plan
from tubeplanner.refinement import refinement
from tubeplanner.refinement.phased_spline import KnotGrid
from tubeplanner.refinement.widened_tube import widened_radius


def grid(*intervals):
    return KnotGrid(tuple(np.linspace(0, 1, count + 1) for count in intervals))


def test_a_straight_segment_is_widened_by_a_fifth_of_a_knot_interval():
    tube = Tube([[0, 0, 0], [0.6, 0, 0]], 0.001)
    assert widened_radius(tube, grid(3)) == pytest.approx(0.2 * 0.6 / 3)
    assert widened_radius(tube, grid(300)) == pytest.approx(0.001)


def test_a_right_angle_is_widened_by_a_tenth_of_its_shorter_leg():
    tube = Tube([[0, 0, 0], [0.6, 0, 0], [0.6, 0.2, 0]], 0.001)
    np.testing.assert_allclose(widened_radius(tube, grid(2, 1)), 0.1 * 0.2)


@pytest.mark.parametrize("turn", [0.02, -0.02])
def test_a_hairpin_is_hardly_widened(turn):
    """Its legs are 2.9 degrees apart: a circle at both has a radius of a fortieth of a leg."""
    tube = Tube([[0, 0, 0], [0.4, 0, 0], [0, turn, 0]], 0.0005)
    assert (widened_radius(tube, grid(3, 3)) < 0.0012).all()


def test_a_straight_continuation_is_no_corner():
    tube = Tube([[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0], [0.6, 0.3, 0]], 0.001)
    widened = widened_radius(tube, grid(2, 2, 2))
    np.testing.assert_allclose(widened, [0.03, 0.03, 0.03])  # the first one by its knots


def test_a_radius_is_never_made_smaller():
    tube = Tube([[0, 0, 0], [0.6, 0, 0], [0.6, 0.2, 0]], [0.15, 0.1])
    np.testing.assert_array_equal(widened_radius(tube, grid(2, 2)), tube.effective_radius)


def test_without_widening_there_is_an_answer_too(monkeypatch):
    """What the widened tube leads astray is planned again in the tube as it is."""
    problem = load_problem("example:two_link/paper_5_10mm")
    widened = []

    def is_hopeless(found):
        """Links count as inside on the coarsest knots: widened starts are given up on them."""
        return found.spline.grid.interval_count == widened[0]

    monkeypatch.setattr(refinement, "_is_hopeless", is_hopeless)
    original = refinement.widened_radius

    def recorded(tube, grid):
        widened.append(grid.interval_count)
        return original(tube, grid)

    monkeypatch.setattr(refinement, "widened_radius", recorded)
    found = plan(problem, SHORTEST)
    assert found.succeeded
    assert found.method == "refinement"
    assert len(widened) > 0


def test_a_box_is_widened_on_all_sides():
    section = {"box": [0.02, 0.004], "up": [0, 0, 1]}
    tube = Tube([[0, 0, 0], [0.6, 0, 0]], None, cross_section=section)
    widened = widened_radius(tube, grid(3))
    assert widened == pytest.approx(0.2 * 0.6 / 3)
    np.testing.assert_allclose(tube.regions_of(widened).half, [[0.2, 0.04, 0.04]])
