"""The search for collisions in the set of a segment; measured segments serve again."""

import numpy as np
import pytest

from tubeplanner import MeasureOptions
from tubeplanner.first_guess.branches import redundancy_rules, reference_branch
from tubeplanner.studies.tubes.clearance_bounds import PairClearance, search_counterexamples
from tubeplanner.studies.tubes.configuration_sets import ConfigurationSet
from tubeplanner.studies.tubes.segment_measurement import BranchNeighbourhood

QUICK = MeasureOptions(samples=300)


@pytest.fixture(scope="module")
def post(bundled):
    return bundled("two_link/around_a_post")


def allowed(problem, radius):
    lower, upper = problem.joint_lower[0], problem.joint_upper[0]
    return ConfigurationSet(problem, 0, lower, upper, radius)


def searched(problem, radius, samples=400):
    clearance, rng = PairClearance(problem, 0.0), np.random.default_rng(2)
    return search_counterexamples(allowed(problem, radius), clearance, samples, rng), clearance


def test_collisions_are_in_the_set_and_collide(post):
    found, clearance = searched(post, 0.1)
    assert not found.failed
    assert allowed(post, 0.1).contains(found.q).all()
    assert (clearance.of_pairs(found.q, found.pair)[0] < 0).all()
    free, _ = searched(post, 0.02)
    assert free.failed and free.least_clearance > 0


def test_beside_a_collision_there_are_more(post):
    found, _ = searched(post, 0.055)
    assert len(found.q) > 0.1 * found.samples


def test_descents_find_what_chance_does_not(post):
    """The post is 46.6 mm from the tool's way here: few samples of a set 48 mm wide collide."""
    found, clearance = searched(post, 0.048, samples=100)
    drawn = allowed(post, 0.048).sample(100, np.random.default_rng(2))
    assert (clearance.least(drawn, 0.0).clearance >= 0).all()
    assert not found.failed


def test_a_measured_segment_serves_again_where_it_is_the_same(post):
    branch, kept = reference_branch(post, redundancy_rules(post)[0]), {}
    first, second, *_ = branch.segments
    around = BranchNeighbourhood(post, branch, QUICK)
    found = around.kept_search(0, first, kept)
    again = BranchNeighbourhood(post, branch, MeasureOptions(samples=300, seed=9))
    same = again.kept_search(0, first, kept)
    assert same.box is found.box and same.last is found.last
    assert again.described(0, same).radius == found.allowed.radius
    assert around.kept_search(1, second, kept).box is not found.box
    # It does not serve a branch that leaves the set.
    ((boxes, _),) = next(iter(kept.values()))
    assert boxes.moved_to(post, 0, found, first) is not None
    assert boxes.moved_to(post, 0, found, first + np.array([0.5, 0.0])) is None
