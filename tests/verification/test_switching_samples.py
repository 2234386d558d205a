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
