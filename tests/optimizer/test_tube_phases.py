"""Chains of segments per phase; the segment of each sample."""

from dataclasses import replace
from itertools import combinations_with_replacement
from types import SimpleNamespace

import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.optimizer.phased_spline import KnotGrid
from tubeplanner.optimizer.tube_phases import (
    OrderedSegments,
    largest_kink,
    ordered_choice,
    ordered_choice_paying,
    sharpest_bend,
    tube_chains,
)
from tubeplanner.orientation import rotation_matrix


def chains_of(points, radius=0.01, **more):
    return tube_chains(SimpleNamespace(tube=Tube(points, radius, **more)))


def circle(count):
    angles = np.linspace(0, 2 * np.pi, count + 1)
    return 0.07 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])


def right_angle(parts):
    """Return two legs of 20 cm, each cut into parts."""
    s = np.linspace(0, 0.2, parts + 1)[:, None]
    return np.vstack([s * [1, 0, 0], [0.2, 0, 0] + s[1:] * [0, 1, 0]])


@pytest.mark.parametrize("points", [right_angle(1), right_angle(6), circle(12)])
def test_of_few_points_every_one_ends_a_phase(points):
    assert chains_of(points) == tuple(range(k, k + 1) for k in range(len(points) - 1))


@pytest.mark.parametrize(
    ("count", "radius", "noise"), [(25, 0.01, 0.0), (300, 0.002, 0.0), (200, 0.002, 0.0002)]
)
def test_a_circle_of_many_chords_is_one_chain(count, radius, noise):
    """Noise is no corner."""
    points = circle(count)
    points[1:-1] += noise * np.random.default_rng(0).normal(size=points.shape)[1:-1]
    assert chains_of(points, radius) == (range(count),)


def test_a_sharp_corner_between_short_segments_ends_a_chain():
    points, runs = right_angle(16), (range(16), range(16, 32))
    assert chains_of(points) == runs
    assert sharpest_bend(Tube(points, 0.01)) == pytest.approx(np.pi / 2)
    assert sharpest_bend(Tube(points, 0.01), runs) == pytest.approx(0.0, abs=1e-9)


def test_of_many_corners_the_sharpest_end_a_phase():
    legs = np.arange(131)
    zigzag = np.column_stack([0.01 * legs, 0.03 * (legs % 2), 0 * legs])
    assert len(chains_of(zigzag[:61], 0.002)) == 60
    assert len(chains_of(zigzag, 0.002)) == 101


def test_a_chain_ends_where_joint_ranges_or_the_rotation_bound_change():
    signs = [{"turn": [-1.0, 1.0 if k < 30 else 2.0]} for k in range(100)]
    assert chains_of(circle(100), joint_signs=signs) == (range(30), range(30, 100))
    upright, bounds = np.tile([0.0, 0.0, 0.0, 1.0], (101, 1)), [0.1] * 70 + [0.2] * 30
    rotated = chains_of(circle(100), orientations=upright, rotation_tolerance=bounds)
    assert rotated == (range(70), range(70, 100))


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


@pytest.mark.parametrize("pays", [False, True])
@pytest.mark.parametrize("shape", [(2, 2), (5, 3), (4, 6)])
def test_no_other_choice_in_order_is_cheaper(shape, pays):
    """Of all never decreasing choices from the first to the last; it may pay what it leaves out."""
    generator, (count, choices) = np.random.default_rng(0), shape
    others = [
        other
        for other in combinations_with_replacement(range(choices), count)
        if other[0] == 0 and other[-1] == choices - 1
    ]
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
        assert price(choice) == pytest.approx(min(map(price, others)), abs=1e-12)


def on_circle(fraction):
    return 0.07 * np.column_stack(
        [np.cos(2 * np.pi * fraction), np.sin(2 * np.pi * fraction), 0 * fraction]
    )


def chained(tube, knots, is_requested=None):
    """Return the segments of a tube that is one chain, and the samples' shares of it."""
    count = tube.segment_count
    grid = KnotGrid((np.linspace(0, 1, knots),), (range(count),))
    samples = grid.samples(np.arange(3) / 3).and_also(grid.phase_ends())
    radius = tube.effective_radius
    return OrderedSegments(tube.points, radius, grid.runs, samples, is_requested), samples.fraction


def test_a_closed_path_begins_in_its_first_segment_and_ends_in_its_last():
    """Its samples may come in any order."""
    segments, fraction = chained(Tube(circle(100), 0.01), 41)
    assert segments.in_run.all()
    # The tool hurries ahead of the middle of every chord and strays over the seam at both ends.
    hurried = fraction + 0.004 * np.sin(2 * np.pi * fraction - 0.5)
    number = segments.at(on_circle(hurried))
    order = np.argsort(fraction)
    assert (np.diff(number[order]) >= 0).all()
    assert number[order][[0, -1]].tolist() == [0, 99]
    expected = np.clip(np.floor(100 * hurried), 0, 99)
    inner = (hurried > 0.02) & (hurried < 0.98)
    assert abs(number - expected)[inner].max() <= 1
    mixed = np.random.default_rng(3).permutation(len(fraction))
    other = replace(segments, samples=segments.samples.where(mixed))
    np.testing.assert_array_equal(other.at(on_circle(hurried)[mixed]), number[mixed])


@pytest.mark.parametrize(("angle", "expected"), [(0.0, 0), (0.15, 1), (0.3, 1), (0.55, 1)])
def test_a_rotation_outside_the_nearest_segments_tolerance_takes_another_segment(angle, expected):
    """Only if it fits better there: at 0.55 rad it would fit the first leg still less."""
    end = [0, 0, np.sin(0.5), np.cos(0.5)]  # by 1 rad
    upright = [0, 0, 0, 1]
    turns = {"orientations": [upright, upright, end], "rotation_tolerance": 0.2}
    tube = Tube(right_angle(1), 0.1, **turns)
    segments, fraction = chained(tube, 9)
    # At 6 cm from the first leg and 4 cm from the second, where the reference is at 0.3 rad.
    tool = np.tile([0.16, 0.06, 0.0], (len(fraction), 1))
    turned = rotation_matrix(np.tile([0, 0, angle], (len(fraction), 1)))
    number = replace(segments, rotation=(tube.rotation, turned)).at(tool)
    inner = (fraction > 0) & (fraction < 1)
    assert set(number[inner]) == {expected}
    assert set(segments.at(tool)[inner]) == {1}


def test_phases_of_one_segment_keep_it_wherever_the_tool_is():
    tube = Tube(circle(6), 0.01)
    grid = KnotGrid((np.linspace(0, 1, 4),) * 3, (range(1), range(1, 5), range(5, 6)))
    samples = grid.samples(np.arange(3) / 3)
    segments = OrderedSegments(tube.points, tube.radius, grid.runs, samples)
    number = segments.at(np.zeros((len(samples.phase), 3)))
    assert set(number[samples.phase == 0]) == {0}
    assert set(number[samples.phase == 2]) == {5}
    np.testing.assert_array_equal(segments.in_run, samples.phase == 1)
    assert number[samples.phase == 1][[0, -1]].tolist() == [1, 4]


def hairpin():
    """Return a tube along two legs of 40 mm, 10 mm apart, in segments of 1 mm."""
    out = np.linspace(0, 0.04, 41)
    across = np.linspace(0, 0.01, 11)[1:]
    x = np.concatenate([out, np.full(10, 0.04), out[-2::-1]])
    y = np.concatenate([np.zeros(41), across, np.full(40, 0.01)])
    return Tube(np.column_stack([x, y, 0 * x]), 0.008)


@pytest.mark.parametrize("turns_at", [0.025, 0.034])
def test_a_short_cut_that_leaves_a_bend_out_is_outside(turns_at):
    """The bend is 15 mm away, 1.9 radii; a tool that is about to leave it out is held to it."""
    tube = hairpin()
    segments, fraction = chained(tube, 31)
    to_and_fro = turns_at * (1 - abs(2 * fraction - 1))
    tool = np.column_stack([to_and_fro, 0.01 * fraction, 0 * to_and_fro])
    number = segments.at(tool)
    assert (np.diff(number[np.argsort(fraction)]) >= 0).all()
    pairs = zip(tool, number, strict=True)
    distance = [tube.distance(place[None], slice(k, k + 1)).min() for place, k in pairs]
    if turns_at == 0.025:
        assert 1.5 < max(distance) / 0.008 < 2.1
    else:
        assert max(distance) / 0.008 < 1
        assert ((number >= 40) & (number < 50)).any()


@pytest.mark.parametrize(
    ("beside", "is_missed", "knots"), [(0.0072, True, 31), (0.0072, True, 6), (0.0068, False, 31)]
)
def test_a_notch_that_the_tool_does_not_reach_is_missed_until_asked_for(beside, is_missed, knots):
    """It is shorter than half a radius, or than a step: no short cut, and no sample tells."""
    x = np.linspace(0, 0.04, 41)
    y = np.where(np.isin(np.arange(41), (20, 21)), -0.001, 0.0)
    segments, fraction = chained(Tube(np.column_stack([x, y, 0 * x]), 0.008), knots)
    tool = np.column_stack([0.04 * fraction, np.full(len(fraction), beside), 0 * fraction])
    missed = segments.missed(tool)
    assert np.flatnonzero(missed).tolist() == ([20] if is_missed else [])
    assert 20 not in segments.at(tool)
    for asked in (missed, np.arange(40) == 20):
        held = replace(segments, is_requested=asked).at(tool)
        assert (20 in held) == asked.any()
        assert (np.diff(held[np.argsort(fraction)]) >= 0).all()


@pytest.mark.parametrize(("asked", "given"), [([], 0), ([2], 2), ([2, 4], 4)])
def test_of_several_that_are_asked_for_the_farthest_comes_first(asked, given):
    """The first sample and the last stay in their segments: there is one for one of them."""
    points = np.column_stack([np.arange(7), [0, 0, -1, -1, -2, -2, 0], np.zeros(7)])
    grid = KnotGrid((np.array([0.0, 1.0]),), (range(6),))
    samples = grid.samples(np.array([0.0, 0.5, 1.0]))
    is_requested = np.isin(np.arange(6), asked)
    segments = OrderedSegments(points, np.full(6, 100.0), grid.runs, samples, is_requested)
    tool = np.array([[0.0, 0, 0], [1, 0, 0], [6, 0, 0]])
    assert segments.at(tool).tolist() == [0, given, 5]
