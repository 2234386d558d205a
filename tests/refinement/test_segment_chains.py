"""Chains of segments per phase; the segment of each sample."""

from dataclasses import replace
from itertools import combinations_with_replacement
from types import SimpleNamespace

import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.refinement.ordered_segments import (
    OrderedSegments,
    ordered_choice,
    ordered_choice_paying,
)
from tubeplanner.refinement.phased_spline import KnotGrid
from tubeplanner.refinement.tube_chains import largest_kink, sharpest_bend, tube_chains

# Which tube segments make up a phase.


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


@pytest.mark.parametrize(("count", "radius"), [(25, 0.01), (300, 0.002)])
def test_a_circle_of_many_chords_is_one_chain(count, radius):
    assert tube_chains(problem(circle(count), radius)) == (range(count),)


def test_a_sharp_corner_between_short_segments_ends_a_chain():
    parts = 16
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


def test_a_circle_bends_by_its_radius_of_curvature_in_radii():
    radius = 0.01
    bend = sharpest_bend(Tube(circle(1000), radius))
    assert bend == pytest.approx(radius / 0.07, abs=2 * np.pi / 1000)


def test_a_corner_that_ends_a_phase_is_no_bend_of_chains():
    tube = Tube(right_angle(16), 0.01)
    assert sharpest_bend(tube) == pytest.approx(np.pi / 2)
    assert sharpest_bend(tube, (range(16), range(16, 32))) == pytest.approx(0.0, abs=1e-9)


# The segments of a chain's samples: in order, and as near as can be.


@pytest.mark.parametrize("pays", [False, True])
@pytest.mark.parametrize("shape", [(2, 2), (5, 3), (4, 6)])
def test_no_other_choice_in_order_is_cheaper(shape, pays):
    """Of all never decreasing choices from the first to the last; it may pay what it leaves out."""
    generator, (count, choices) = np.random.default_rng(0), shape
    for _ in range(20):
        cost = generator.uniform(size=shape)
        passing = 0.5 * generator.uniform(size=(count - 1, choices)) * pays

        def price(choice, cost=cost, passing=passing):
            steps = zip(passing, choice, choice[1:], strict=False)
            left_out = sum(row[before + 1 : after].sum() for row, before, after in steps)
            return cost[np.arange(count), list(choice)].sum() + left_out

        choice = ordered_choice_paying(cost, passing) if pays else ordered_choice(cost)
        assert (choice[0], choice[-1]) == (0, choices - 1)
        assert (np.diff(choice) >= 0).all()
        cheapest = min(
            price(other)
            for other in combinations_with_replacement(range(choices), count)
            if other[0] == 0 and other[-1] == choices - 1
        )
        assert price(choice) == pytest.approx(cheapest, abs=1e-12)


def test_where_the_nearest_are_in_order_they_are_chosen():
    cost = abs(np.linspace(0, 7, 40)[:, None] - np.arange(8))
    np.testing.assert_array_equal(ordered_choice(cost), cost.argmin(axis=1))


def circle_tube(count):
    return Tube(circle(count), 0.01)


def on_circle(share):
    return 0.07 * np.column_stack([np.cos(2 * np.pi * share), np.sin(2 * np.pi * share), 0 * share])


def test_a_closed_path_begins_in_its_first_segment_and_ends_in_its_last():
    tube, grid = circle_tube(100), KnotGrid((np.linspace(0, 1, 41),), (range(100),))
    samples = grid.samples(np.arange(3) / 3).and_also(grid.phase_ends())
    segments = OrderedSegments(tube.points, tube.radius, grid.chains, samples)
    assert segments.in_chain.all()
    # The tool hurries ahead of the middle of every chord and strays over the seam at both ends.
    share = samples.share + 0.004 * np.sin(2 * np.pi * samples.share - 0.5)
    found = segments.at(on_circle(share))
    order = np.argsort(samples.share)
    assert (np.diff(found[order]) >= 0).all()
    assert found[order][[0, -1]].tolist() == [0, 99]
    expected = np.clip(np.floor(100 * share), 0, 99)
    inner = (share > 0.02) & (share < 0.98)
    assert abs(found - expected)[inner].max() <= 1


def test_phases_of_one_segment_keep_it_wherever_the_tool_is():
    tube = circle_tube(6)
    grid = KnotGrid((np.linspace(0, 1, 4),) * 3, (range(1), range(1, 5), range(5, 6)))
    samples = grid.samples(np.arange(3) / 3)
    segments = OrderedSegments(tube.points, tube.radius, grid.chains, samples)
    found = segments.at(np.zeros((len(samples.phase), 3)))
    assert set(found[samples.phase == 0]) == {0}
    assert set(found[samples.phase == 2]) == {5}
    np.testing.assert_array_equal(segments.in_chain, samples.phase == 1)
    in_chain = found[samples.phase == 1]
    assert (in_chain[0], in_chain[-1]) == (1, 4)


def test_samples_may_come_in_any_order():
    tube, grid = circle_tube(50), KnotGrid((np.linspace(0, 1, 21),), (range(50),))
    samples = grid.samples(np.arange(3) / 3)
    mixed = np.random.default_rng(3).permutation(len(samples.phase))
    tool = on_circle(samples.share)
    one = OrderedSegments(tube.points, tube.radius, grid.chains, samples)
    other = OrderedSegments(tube.points, tube.radius, grid.chains, samples.where(mixed))
    np.testing.assert_array_equal(one.at(tool)[mixed], other.at(tool[mixed]))


def hairpin():
    """Return a tube along two legs of 40 mm, 10 mm apart, in segments of 1 mm."""
    out = np.linspace(0, 0.04, 41)
    across = np.linspace(0, 0.01, 11)[1:]
    x = np.concatenate([out, np.full(10, 0.04), out[-2::-1]])
    y = np.concatenate([np.zeros(41), across, np.full(40, 0.01)])
    return Tube(np.column_stack([x, y, 0 * x]), 0.008)


def passed(tube, turns_at):
    """Return segments and distances, in radii, of a tool that goes that far along both legs."""
    count = tube.segment_count
    grid = KnotGrid((np.linspace(0, 1, 31),), (range(count),))
    samples = grid.samples(np.arange(3) / 3).and_also(grid.phase_ends())
    segments = OrderedSegments(tube.points, tube.effective_radius, grid.chains, samples)
    to_and_fro = turns_at * (1 - abs(2 * samples.share - 1))
    tool = np.column_stack([to_and_fro, 0.01 * samples.share, 0 * to_and_fro])
    found = segments.at(tool)
    distance = [
        tube.distance(p[None], slice(k, k + 1)).min() for p, k in zip(tool, found, strict=True)
    ]
    return found[np.argsort(samples.share)], np.array(distance) / 0.008


def test_a_short_cut_that_leaves_a_bend_out_is_outside():
    """Half-way between the legs the tool is in the capsules of either."""
    tube = hairpin()
    found, distance = passed(tube, 0.025)
    assert (np.diff(found) >= 0).all()
    assert 1.5 < distance.max() < 2.1  # the bend is 15 mm away, 1.9 radii


def test_a_tool_about_to_leave_a_bend_out_is_held_to_it():
    found, distance = passed(hairpin(), 0.034)
    assert (np.diff(found) >= 0).all()
    assert distance.max() < 1
    assert ((found >= 40) & (found < 50)).any()


@pytest.mark.parametrize(
    ("beside", "is_missed", "knots"), [(0.0072, True, 31), (0.0072, True, 6), (0.0068, False, 31)]
)
def test_a_notch_that_the_tool_does_not_reach_is_missed_until_asked_for(beside, is_missed, knots):
    """It is shorter than half a radius, or than a step: no short cut, and no sample tells."""
    x = np.linspace(0, 0.04, 41)
    y = np.where(np.isin(np.arange(41), (20, 21)), -0.001, 0.0)
    tube = Tube(np.column_stack([x, y, 0 * x]), 0.008)
    grid = KnotGrid((np.linspace(0, 1, knots),), (range(40),))
    samples = grid.samples(np.arange(3) / 3).and_also(grid.phase_ends())
    segments = OrderedSegments(tube.points, tube.effective_radius, grid.chains, samples)
    across = np.full(len(samples.share), beside)
    tool = np.column_stack([0.04 * samples.share, across, 0 * across])
    missed = segments.missed(tool)
    assert np.flatnonzero(missed).tolist() == ([20] if is_missed else [])
    found = segments.at(tool)
    assert 20 not in found
    for asked in (missed, np.arange(40) == 20):
        held = replace(segments, is_asked=asked).at(tool)
        assert (20 in held) == asked.any()
        assert (np.diff(held[np.argsort(samples.share)]) >= 0).all()


@pytest.mark.parametrize(("asked", "given"), [([], 0), ([2], 2), ([2, 4], 4)])
def test_of_several_that_are_asked_for_the_farthest_comes_first(asked, given):
    """The first sample and the last stay in their segments: there is one for one of them."""
    points = np.column_stack([np.arange(7), [0, 0, -1, -1, -2, -2, 0], np.zeros(7)])
    grid = KnotGrid((np.array([0.0, 1.0]),), (range(6),))
    samples = grid.samples(np.array([0.0, 0.5, 1.0]))
    is_asked = np.isin(np.arange(6), asked)
    segments = OrderedSegments(points, np.full(6, 100.0), grid.chains, samples, is_asked)
    tool = np.array([[0.0, 0, 0], [1, 0, 0], [6, 0, 0]])
    assert segments.at(tool).tolist() == [0, given, 5]
