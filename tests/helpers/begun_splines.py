"""Splines that a refinement begins with, and their constraints."""

from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.spline_constraints import SplineConstraints
from tubeplanner.refinement.spline_start import starting_spline


def begun(problem, intervals):
    """Return the spline on the branch by the first rule for redundant joints."""
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    return starting_spline(problem, branch, intervals)


def constraints_of(problem, grid, **more):
    """Return the constraints of a problem on a knot grid."""
    radius = problem.tube.effective_radius
    return SplineConstraints(problem, grid, LinkConstraints(problem), radius, **more)
