"""Segments that were measured serve again where they are the same, and only there."""

import numpy as np
import pytest

from tubeplanner import MeasureOptions
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.measurement.branch_neighbourhood import BranchNeighbourhood
from tubeplanner.measurement.kept_segments import KeptSegments

QUICK = MeasureOptions(samples=300)


@pytest.fixture(scope="module")
def measured(bundled):
    problem = bundled("two_link/around_a_post")
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    kept = KeptSegments()
    around = BranchNeighbourhood(problem, branch, QUICK)
    part = branch.segments[0]
    return problem, branch, kept, around.kept_search(0, part, kept)


def test_the_same_segment_is_not_measured_again(measured):
    problem, branch, kept, found = measured
    again = BranchNeighbourhood(problem, branch, MeasureOptions(samples=300, seed=9))
    same = again.kept_search(0, branch.segments[0], kept)
    assert same.box is found.box and same.last is found.last
    assert again.described(0, same).radius == found.allowed.radius


def test_another_segment_is(measured):
    problem, branch, kept, found = measured
    around = BranchNeighbourhood(problem, branch, QUICK)
    assert around.kept_search(1, branch.segments[1], kept).box is not found.box


def test_a_branch_outside_of_the_set_does_not_get_it(measured):
    problem, branch, kept, _ = measured
    key = BranchNeighbourhood(problem, branch, QUICK)._key(0)
    assert kept.around(key, problem, 0, branch.segments[0]) is not None
    away = branch.segments[0] + np.array([0.5, 0.0])
    assert kept.around(key, problem, 0, away) is None
