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
