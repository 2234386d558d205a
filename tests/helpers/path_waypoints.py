"""Waypoints on the reference path of a problem."""

from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.waypoint_search.candidate_waypoints import candidate_waypoints


def waypoints_of(problem, count):
    """Return so many configurations, equally spaced along the path, start and goal included."""
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    return candidate_waypoints(problem, branch, count)
