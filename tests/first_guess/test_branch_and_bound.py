"""Phase 1 against enumerating every trajectory, and the rules by which it cuts."""

from itertools import combinations

import numpy as np
import pytest
from cases import waypoints_of, with_motors

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
from tubeplanner.first_guess.branch_and_bound import BranchAndBound
from tubeplanner.first_guess.waypoints import sequential_quartics
from tubeplanner.limits.speed_limits import scaled_to_limits
from tubeplanner.robot.joint_limits import EffortRange

CORNER = ([0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0])


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


def two_link_problem(robot, points=CORNER, radius=0.08, visit="ordered", elbow=-1.0, **more):
    tube = Tube(points, radius, joint_signs={"joint2": "-"}, visit=visit)
    return PlanningProblem(robot, tube, Seed(np.array([0.0, elbow])), **more)


def limited_arm(gravity=0.0, **limits):
    limits = {"velocity": {"joint1": np.inf, "joint2": np.inf}, **limits}
    overrides = LimitOverrides(**limits)
    return load_robot("example:two_link", "hand", gravity=(0, -gravity, 0), limits=overrides)


def past_a_ball(two_link):
    ball = Obstacle.sphere("ball", 0.03, placement_of([0.5, -0.1, 0]))
    return two_link_problem(two_link, radius=0.1, obstacles=[ball], clearance=0.001)


def limited(_):
    """Velocity, acceleration and jerk limits, and a tight position limit of the elbow."""
    robot = limited_arm(
        velocity={"joint1": 3.0, "joint2": 2.5},
        acceleration={"joint1": 20.0},
        jerk={"joint2": 400.0},
        position={"joint2": (-2.45, 0.0)},
    )
    return two_link_problem(robot)


def abrupt(_):
    """Limits on how fast efforts change, of which one is asked often, with gravity."""
    effort, rate = {"joint1": 300.0, "joint2": 100.0}, {"joint1": 900.0, "joint2": 150.0}
    return two_link_problem(limited_arm(9.81, effort=effort, effort_rate=rate))


def geared(_):
    """Friction of both kinds, not known exactly, a torque-speed line, and efforts by position."""
    robot = limited_arm(9.81, effort={"joint1": 200.0, "joint2": 60.0})
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
    return two_link_problem(two_link, points, radius, visit="any", elbow=-1.5)


# By name: what makes a problem of the two-link arm, and from how many waypoints it is searched.
CASES = {
    "direct": (two_link_problem, 3),
    "tight": (lambda robot: two_link_problem(robot, radius=0.04), 8),
    "union": (lambda robot: two_link_problem(robot, radius=0.06, visit="any"), 7),
    "past a ball": (past_a_ball, 8),
    "limited": (limited, 7),
    "abrupt": (abrupt, 7),
    "geared": (geared, 7),
    "six joints": (six_joints, 6),
    "sign change": (sign_change, 7),
    "gap": (gap, 6),
    "nothing": (lambda robot: two_link_problem(robot, radius=0.01), 5),
}


@pytest.mark.parametrize("name", CASES)
def test_it_finds_what_enumerating_every_trajectory_finds(name, two_link):
    """The judge of the enumeration is the certificate."""
    make, count = CASES[name]
    problem = make(two_link)
    motions = every_trajectory(problem, waypoints_of(problem, count))
    certified = (motion for motion in motions if verify(problem, motion[0]).passed)
    best, waypoints = next(certified, (None, ()))
    assert (best is None) == (name == "nothing")
    search = searched(problem, count)
    statistics = search.statistics
    assert search.best_waypoints == waypoints
    assert statistics.nodes <= len(motions)
    if best is None:
        assert search.best is None
        assert statistics.lower_bound is statistics.best_duration is None
    else:
        assert search.certificate.passed
        assert search.best.duration == statistics.lower_bound == best.duration


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
    slow = limited_arm(velocity={"joint1": 0.5, "joint2": 0.5})
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
    robot = limited_arm(position={"joint2": (-2.45, 0.0)})
    search = searched(two_link_problem(robot, obstacles=[ball]), 20)
    assert search.best is not None
    cuts = search.statistics.cuts
    assert set(cuts) == {"joint_limits", "duration", "tube", "collision"}
    assert min(cuts.values()) > 0


@pytest.mark.parametrize(("x", "y", "count", "found"), [(0.45, -0.05, 13, 1), (0.45, -0.1, 12, 0)])
def test_a_beginning_that_failed_between_samples_is_not_tried_again(x, y, count, found, two_link):
    """A needle so thin that samples miss it."""
    needle = Obstacle.cylinder("needle", 0.0005, 0.3, placement_of([x, y, 0]))
    problem = two_link_problem(two_link, obstacles=[needle], radius=0.05)
    search = searched(problem, count)
    assert search.statistics.forgone > 0
    assert search.statistics.motions == search.statistics.refused + found > 3
    assert search.best is None if not found else verify(problem, search.best).passed


def test_a_tube_cut_into_many_segments_gives_the_same_trajectory(two_link):
    start, goal = np.array([0.3, -0.5, 0]), np.array([0.3, 0.5, 0])
    whole, cut = (
        searched(two_link_problem(two_link, np.linspace(start, goal, count), 0.01), 14).best
        for count in (2, 41)
    )
    assert cut.duration == pytest.approx(whole.duration, rel=1e-6)


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
