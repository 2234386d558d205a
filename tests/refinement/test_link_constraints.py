"""Links in the optimisation: trajectories that would be faster through something."""

from dataclasses import replace

import numpy as np
import pytest

from cases import SHORTEST, slow_but
from tubeplanner import (
    Obstacle,
    PlanningProblem,
    PlanStatus,
    Seed,
    Tube,
    load_problem,
    placement_of,
    plan,
    verify,
)
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.refinement.spline_start import starting_spline

POINTS = [[0.3, -0.3, 0], [0.3, 0.3, 0]]


def problem_with(two_link, *obstacles, radius=0.08, **more):
    tube = Tube(POINTS, radius, joint_signs={"joint2": "-"})
    return PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])), obstacles=obstacles, **more)


def post(x, y, size=0.03):
    return Obstacle.cylinder("post", size, 0.5, placement_of([x, y, 0.0]))


@pytest.fixture(scope="module")
def elbow(ur5):
    """Return a function that adds obstacles to a problem, its plan, and a ball at the elbow.

    The ball is where the elbow passes on the fastest way; tool, start and goal are clear of it.
    """
    start = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    points = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [0.45, 0.3, 0.5], [0.45, 0.3, 0.2]]
    tube = Tube(points, [0.03, 0.08, 0.03], joint_signs={"elbow_joint": "+"})

    def problem(*obstacles, **more):
        return PlanningProblem(ur5, tube, start, obstacles=obstacles, **more)

    free = plan(problem(), SHORTEST)
    q = free.trajectory.position(0.5 * free.duration)
    body = ur5.link_body["forearm_link"]
    middle = ur5.body_poses(q[None])[1][0, body] + np.array([0.0, 0.0, 0.1])
    return problem, free, Obstacle.sphere("ball", 0.06, placement_of(middle))


def test_an_elbow_that_would_meet_something_is_moved_clear_of_it(elbow):
    problem, free, ball = elbow
    refused = verify(problem(ball), free.trajectory)
    assert refused.conditions["obstacles"].margin < -0.005
    assert refused.failures() == ["obstacles"]
    result = plan(problem(ball), SHORTEST)
    assert result.succeeded
    assert result.method == "refinement"
    assert result.certificate.conditions["obstacles"].margin < 0.002  # it is still in the way
    assert 0.99 * free.duration < result.duration < 1.3 * free.duration


@pytest.mark.parametrize("clearance", slow_but([0.01], [0.002, 0.01]))
def test_the_clearance_is_kept(elbow, clearance):
    problem, _, ball = elbow
    result = plan(problem(ball, clearance=clearance), SHORTEST)
    assert result.succeeded
    assert result.method == "refinement"
    assert -1e-6 <= result.certificate.conditions["obstacles"].margin < 0.002


def test_obstacles_far_away_change_nothing(two_link):
    free = plan(problem_with(two_link), SHORTEST)
    far = plan(problem_with(two_link, post(-0.5, 0.5)), SHORTEST)
    np.testing.assert_array_equal(free.trajectory.coefficients, far.trajectory.coefficients)


def test_a_tube_that_is_blocked_is_reported_with_links_and_depth(two_link):
    """The tool itself cannot pass: the wall is wider than the tube."""
    wall = Obstacle.box("wall", [0.5, 0.04, 0.5], placement_of([0.3, 0.0, 0.0]))
    result = plan(problem_with(two_link, wall, radius=0.03), SHORTEST)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert result.place.obstacle == "wall"
    assert "mm into 'wall'" in result.message
    assert result.trajectory is None
    assert result.path_minimum is None
    assert (result.notes, result.sensitivities) == ((), ())  # nothing is said of no trajectory


def test_what_was_far_off_at_the_last_look_is_seen_once_it_comes_near(two_link):
    """A second look finds what a first one would, however the spline has moved in between."""
    problem = problem_with(two_link, post(0.46, 0.0))
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    far = starting_spline(problem, branch, 12)
    bent = far.control_points.copy()
    bent[3:-3, 1] *= 0.4
    near = PhasedSpline(far.grid, far.switching_times, bent)
    known, fresh = LinkConstraints(problem), LinkConstraints(problem)
    assert not known.look(far)
    assert known.look(near)
    assert fresh.look(near)
    found = [links.at(near).closest.distance.min() for links in (known, fresh)]
    assert found[0] == pytest.approx(found[1], abs=1e-12)
    assert found[0] < -0.005


@pytest.mark.parametrize("has_plate", [True, False])
def test_links_that_pass_between_coarse_samples_are_given_up_on_the_finest(has_plate):
    """A thin plate across the tube is jumped over where there is no sample."""
    problem = load_problem("example:panda/between_shelves")
    plate = Obstacle.box("plate", [0.08, 0.14, 0.02], placement_of([0.38, 0, 0.6]))
    if has_plate:
        problem = replace(problem, obstacles=[*problem.obstacles, plate])
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    start = starting_spline(problem, branch, 18)
    refinement = Refinement(problem, start, (4,))
    refinement.run()
    assert refinement.gave_up == has_plate
    # Not for what it looked like on coarse knots.
    assert refinement.spline.grid.interval_count == 4 * start.grid.interval_count


def test_room_beyond_what_is_asked_is_kept_from_obstacles(two_link):
    """As if the clearance were larger by it, between links and obstacles."""
    wanted, room = 0.01, 0.015
    problem = problem_with(two_link, post(0.46, 0.0), clearance=wanted)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    spline = starting_spline(problem, branch, 12)
    with_room = LinkConstraints(problem, room)
    wider = LinkConstraints(replace(problem, clearance=wanted + room))
    plain = LinkConstraints(problem)
    samples = spline.grid.samples_at(spline.switching_times, np.linspace(0.2, 0.8, 7))
    for links in (with_room, wider, plain):
        links.look_at(spline, samples)
    found, expected, less = (
        np.sort(links.at(spline).slack(1.0, 1.0)) for links in (with_room, wider, plain)
    )
    np.testing.assert_array_equal(found, expected)
    assert len(less) == 0 or less[0] > found[0]
