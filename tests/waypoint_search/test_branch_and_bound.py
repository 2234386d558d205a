"""Phase 1 against enumerating every trajectory, and the rules by which it cuts."""

from itertools import combinations

import numpy as np
import pytest
from cases import with_motors

from tubeplanner import (
    LimitOverrides,
    Obstacle,
    PlanningProblem,
    Seed,
    Tube,
    load_problem,
    load_robot,
    placement_of,
    verify,
)
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.constraints.time_scaling import scaled_to_limits
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.waypoint_search.branch_and_bound import BranchAndBound
from tubeplanner.waypoint_search.candidate_waypoints import candidate_waypoints
from tubeplanner.waypoint_search.waypoint_interpolation import sequential_quartics

CORNER = ([0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0])


def waypoints_of(problem, count):
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    return candidate_waypoints(problem, branch, count)


def searched(problem, count, **options):
    search = BranchAndBound(problem, waypoints_of(problem, count), **options)
    while not search.finished:
        search.expand()
    return search


def every_trajectory(problem, waypoints):
    """Return all 2^(M-2) trajectories with their waypoints, the fastest first."""
    inner = range(1, len(waypoints) - 1)
    subsets = [s for size in range(len(waypoints) - 1) for s in combinations(inner, size)]
    motions = []
    for subset in subsets:
        chosen = (0, *subset, len(waypoints) - 1)
        shape = sequential_quartics(problem.robot.joint_names, waypoints[list(chosen)])
        motions.append((scaled_to_limits(problem, shape), chosen))
    return sorted(motions, key=lambda trajectory: trajectory[0].duration)


def two_link_problem(two_link, points=CORNER, radius=0.08, **more):
    tube = Tube(points, radius, joint_signs={"joint2": "-"}, visit=more.pop("visit", "ordered"))
    return PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])), **more)


def tight(two_link):
    return two_link_problem(two_link, radius=0.04)


def union(two_link):
    return two_link_problem(two_link, radius=0.06, visit="any")


def past_a_ball(two_link):
    ball = Obstacle.sphere("ball", 0.03, placement_of([0.5, -0.1, 0]))
    return two_link_problem(two_link, radius=0.1, obstacles=[ball], clearance=0.001)


def limited(_):
    """Velocity, acceleration and jerk limits, and a tight position limit of the elbow."""
    limits = LimitOverrides(
        velocity={"joint1": 3.0, "joint2": 2.5},
        acceleration={"joint1": 20.0},
        jerk={"joint2": 400.0},
        position={"joint2": (-2.45, 0.0)},
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    return two_link_problem(robot)


def abrupt(_):
    """Limits on how fast efforts change, of which one is asked often, with gravity."""
    limits = LimitOverrides(
        velocity={"joint1": np.inf, "joint2": np.inf},
        effort={"joint1": 300.0, "joint2": 100.0},
        effort_rate={"joint1": 900.0, "joint2": 150.0},
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0), limits=limits)
    return two_link_problem(robot)


def geared(_):
    """Friction of both kinds, not known exactly, a torque-speed line, and efforts by position."""
    limits = LimitOverrides(
        velocity={"joint1": np.inf, "joint2": np.inf}, effort={"joint1": 200.0, "joint2": 60.0}
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0), limits=limits)
    table = EffortRange(1, np.array([-2.5, -1.0]), np.array([60.0, 40.0]), np.array([50.0, 60.0]))
    motors = {
        "viscous_friction": [5.0, 2.0],
        "forwards_friction": [30.0, 4.0],
        "backwards_friction": [15.0, 3.0],
        "saturation_effort": [220.0, np.inf],
        "no_load_velocity": [6.0, np.inf],
    }
    return two_link_problem(with_motors(robot, [table], **motors, friction_uncertainty=0.2))


def six_joints(_):
    wall = load_problem("example:ur5/over_the_wall")
    tube = Tube(wall.tube.points[:3], 0.15, joint_signs={"elbow_joint": "+"})
    return PlanningProblem(wall.robot, tube, wall.start, obstacles=wall.obstacles)


@pytest.mark.parametrize(
    ("make", "count"),
    [
        (two_link_problem, 3),
        (tight, 8),
        (union, 7),
        (past_a_ball, 8),
        (limited, 7),
        (abrupt, 7),
        (geared, 7),
        (six_joints, 7),
    ],
)
def test_it_finds_what_enumerating_every_trajectory_finds(make, count, two_link):
    """The judge of the enumeration is the certificate."""
    problem = make(two_link)
    motions = every_trajectory(problem, waypoints_of(problem, count))
    best, waypoints = next(m for m in motions if verify(problem, m[0]).passed)
    search = searched(problem, count)
    assert search.best_waypoints == waypoints
    assert search.best.duration == best.duration
    assert search.statistics.lower_bound == best.duration
    assert search.statistics.nodes <= len(motions)


def test_where_no_trajectory_is_certified_it_finds_none(two_link):
    problem = two_link_problem(two_link, radius=0.01)
    motions = every_trajectory(problem, waypoints_of(problem, 5))
    assert not any(verify(problem, trajectory).passed for trajectory, _ in motions)
    search = searched(problem, 5)
    assert search.best is None
    assert search.best_waypoints == ()
    assert search.statistics.lower_bound is None
    assert search.statistics.best_duration is None


def test_the_lower_bound_never_exceeds_what_is_found_later(two_link):
    problem = limited(two_link)
    search = BranchAndBound(problem, waypoints_of(problem, 14))
    bounds = []
    while not search.finished:
        bounds.append(search.statistics.lower_bound)
        search.expand()
    assert bounds == sorted(bounds)
    assert bounds[-1] <= search.best.duration


def test_the_bound_knows_what_velocity_limits_ask_for(two_link):
    """Where a velocity limit alone decides, fewer nodes are left than without that knowledge."""
    limits = LimitOverrides(velocity={"joint1": 0.5, "joint2": 0.5})
    slow = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    problem = two_link_problem(slow, radius=0.1)
    search = BranchAndBound(problem, waypoints_of(problem, 16))
    search.expand()
    way = abs(waypoints_of(problem, 16)[-1] - waypoints_of(problem, 16)[0]).max()
    assert search.statistics.lower_bound >= way / 0.5


def test_only_faster_trajectories_than_the_bound_given_are_of_interest(two_link):
    problem = two_link_problem(two_link)
    free = searched(problem, 16)
    again = searched(problem, 16, upper_bound=free.best.duration * (1 + 1e-9))
    assert again.best_waypoints == free.best_waypoints
    assert searched(problem, 16, upper_bound=free.best.duration).best is None


def test_the_same_search_twice_is_the_same_to_the_last_node(two_link):
    problem = past_a_ball(two_link)
    first, second = searched(problem, 13), searched(problem, 13)
    assert first.statistics == second.statistics
    assert first.best_waypoints == second.best_waypoints
    np.testing.assert_array_equal(first.best.coefficients, second.best.coefficients)


def test_the_budget_ends_it_with_the_best_so_far(two_link):
    problem = two_link_problem(two_link)
    whole = searched(problem, 18)
    early = searched(problem, 18, node_budget=whole.statistics.nodes // 2)
    assert early.finished
    assert early.statistics.budget_reached
    assert not whole.statistics.budget_reached
    assert early.statistics.lower_bound <= whole.best.duration <= early.best.duration
    assert "the node budget ended it" in str(early.statistics)


def test_every_rule_cuts_and_is_counted(two_link):
    ball = Obstacle.sphere("ball", 0.03, placement_of([0.5, -0.1, 0]))
    limits = LimitOverrides(
        velocity={"joint1": np.inf, "joint2": np.inf}, position={"joint2": (-2.45, 0.0)}
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    search = searched(two_link_problem(robot, obstacles=[ball]), 20)
    assert search.best is not None
    cuts = search.statistics.cuts
    assert set(cuts) == {"joint_limits", "duration", "tube", "collision"}
    assert min(cuts.values()) > 0


def test_a_beginning_that_failed_between_samples_is_not_tried_again(two_link):
    """A needle so thin that samples miss it."""
    needle = Obstacle.cylinder("needle", 0.0005, 0.3, placement_of([0.43, 0.05, 0]))
    problem = two_link_problem(two_link, obstacles=[needle], radius=0.05)
    search = searched(problem, 11)
    assert search.statistics.forgone > 0
    assert search.statistics.refused == search.statistics.motions > 10
    assert search.best is None


@pytest.mark.parametrize(
    ("x", "y"),
    [(0.45, 0.0)],
)
def test_what_it_finds_past_a_needle_is_certified(x, y, two_link):
    """Among them, searches whose last open nodes all begin like one that failed."""
    needle = Obstacle.cylinder("needle", 0.0005, 0.3, placement_of([x, y, 0]))
    problem = two_link_problem(two_link, obstacles=[needle], radius=0.05)
    search = searched(problem, 12)
    assert search.best is None or verify(problem, search.best).passed


def sign_change(two_link):
    """The shoulder is positive in the first segment and negative in the second."""
    q = np.array([[0.5, -1.0], [0.0, -1.2], [-0.5, -1.0]])
    signs = [{"joint1": "+", "joint2": "-"}, {"joint1": "-", "joint2": "-"}]
    tube = Tube(two_link.tool_position(q), 0.05, joint_signs=signs)
    return PlanningProblem(two_link, tube, q[0])


def gap(two_link):
    """Two parallel legs, their capsules 2 mm apart but at the end: a union with a gap."""
    radius, x, width = 0.04, 0.25, 0.002
    far = x + 2 * radius + width
    points = [[x, -0.15, 0], [x, 0.15, 0], [far, 0.15, 0], [far, -0.15, 0]]
    tube = Tube(points, radius, joint_signs={"joint2": "-"}, visit="any")
    return PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.5])))


@pytest.mark.parametrize(("make", "count"), [(sign_change, 7), (gap, 7)])
def test_switching_times_and_gaps_between_samples_are_judged_exactly(make, count, two_link):
    problem = make(two_link)
    motions = every_trajectory(problem, waypoints_of(problem, count))
    best = next((m for m in motions if verify(problem, m[0]).passed), None)
    search = searched(problem, count)
    assert search.best_waypoints == (() if best is None else best[1])
    assert search.best is None or search.certificate.passed


def test_a_tube_cut_into_many_segments_gives_the_same_trajectory(two_link):
    start, goal = np.array([0.3, -0.5, 0]), np.array([0.3, 0.5, 0])
    found = []
    for pieces in (1, 40):
        points = [start + (goal - start) * i / pieces for i in range(pieces + 1)]
        tube = Tube(points, 0.01, joint_signs={"joint2": "-"})
        found.append(PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0]))))
    whole, *cut = [searched(problem, 14) for problem in found]
    for search in cut:
        assert search.best.duration == pytest.approx(whole.best.duration, rel=1e-6)


def test_a_start_a_hair_outside_its_sign_is_planned_from(two_link):
    """The input is accepted to 1e-6."""
    q = np.array([-0.5, 8e-7])
    tool = two_link.tool_position(np.array([q, [0.3, -0.4]]))
    tube = Tube(tool, 0.3, joint_signs={"joint2": "-"})
    exact = PlanningProblem(two_link, tube, np.array([-0.5, 0.0]))
    above = PlanningProblem(two_link, tube, q)
    assert searched(above, 12).best.duration == pytest.approx(
        searched(exact, 12).best.duration, rel=1e-3
    )
