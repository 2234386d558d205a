import itertools

import numpy as np
import pytest

from tubeplanner.verification.switching_samples import best_switching_samples


def worst_margin(margin, switching_samples):
    """Return the worst margin of an ordered visit: a switching time counts in both its segments."""
    bounds = [0, *switching_samples, len(margin) - 1]
    return min(margin[a : b + 1, k].min() for k, (a, b) in enumerate(itertools.pairwise(bounds)))


@pytest.mark.parametrize("seed", range(20))
def test_no_other_choice_leaves_more(seed):
    rng = np.random.default_rng(seed)
    samples, segments = rng.integers(4, 12), rng.integers(1, 5)
    margin = np.round(rng.normal(size=(samples, segments)), 1)
    choices = itertools.combinations_with_replacement(range(samples), segments - 1)
    best = max(worst_margin(margin, choice) for choice in choices)
    found = best_switching_samples(margin)
    assert (np.diff(found) >= 0).all()
    assert worst_margin(margin, found) == best


def test_switching_times_may_share_an_instant():
    margin = np.array([[1.0, -1, -1], [1, 1, 1], [-1, -1, 1]])
    assert best_switching_samples(margin).tolist() == [1, 1]


def test_of_equal_choices_the_one_deepest_in_both_segments_is_taken():
    margin = np.array([[0.1, 0.1], [0.5, 0.2], [0.5, 0.5], [0.2, 0.5], [0.1, 0.1]])
    assert best_switching_samples(margin).tolist() == [2]


def test_the_segment_before_counts_as_much_as_the_one_after():
    margin = np.array([[0.1, 0.1], [0.2, 0.5], [0.5, 0.5], [0.5, 0.2], [0.1, 0.1]])
    assert best_switching_samples(margin).tolist() == [2]


def chain(margin):
    """Return the largest worst margin of an ordered visit: sample after sample, segment by segment.

    Whoever is in segment k was there at the sample before, or in segment k-1 at this one.
    """
    best = np.minimum.accumulate(margin[:, 0])
    for inside in margin.T[1:]:
        arrived, last = best.copy(), -np.inf
        for i, here in enumerate(inside):
            last = best[i] = min(here, max(last, arrived[i]))
    return best[-1]


@pytest.mark.parametrize("seed", range(20))
def test_no_other_choice_leaves_more_among_many_samples(seed):
    rng = np.random.default_rng(seed)
    drift = np.linspace(-3, 3, 60)[:, None] - np.array([-2.0, 0.0, 2.0])
    margin = rng.normal(size=(60, 3)) - 0.3 * drift**2
    found = best_switching_samples(margin)
    assert worst_margin(margin, found) == chain(margin)


def passing_margin(margin, passing, switching_samples):
    """Return the worst margin of a visit that passes points in one of the segments beside them."""
    ends = [0, *switching_samples, len(margin) - 1]
    passed = [inside[ends[k - 1] : ends[k + 1] + 1].max() for k, inside in passing.items()]
    return min([worst_margin(margin, switching_samples), *passed])


@pytest.mark.parametrize("seed", range(30))
def test_no_other_choice_passes_points_better(seed):
    rng = np.random.default_rng(seed)
    samples, segments = rng.integers(4, 10), rng.integers(2, 5)
    margin = np.round(rng.normal(size=(samples, segments)), 1)
    points = rng.permutation(np.arange(1, segments))[: rng.integers(1, segments)]
    passing = {int(k): np.round(rng.normal(size=samples), 1) for k in sorted(points)}
    choices = itertools.combinations_with_replacement(range(samples), segments - 1)
    best = max(passing_margin(margin, passing, choice) for choice in choices)
    found = best_switching_samples(margin, passing)
    assert (np.diff(found) >= 0).all()
    assert passing_margin(margin, passing, found) == best


def test_a_point_may_be_passed_before_or_after_the_switching_time():
    margin = np.ones((5, 2))
    for at in (0, 4):
        inside = np.where(np.arange(5) == at, 0.5, -1.0)
        found = best_switching_samples(margin, {1: inside})
        assert passing_margin(margin, {1: inside}, found) == 0.5
