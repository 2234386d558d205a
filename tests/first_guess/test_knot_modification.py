"""The discretised gradient against trying every direction, and moving knots along it."""

from itertools import product

import numpy as np
import pytest
from cases import waypoints_of

from tubeplanner import (
    Obstacle,
    OptionError,
    PlanningProblem,
    Seed,
    Tube,
    placement_of,
    quartic_spline,
    sequential_quartics,
    verify,
)
from tubeplanner.first_guess.knot_modification import (
    DirectionSearch,
    KnotModification,
    ModificationOptions,
    feasible_trajectory,
    unit_response,
)
from tubeplanner.first_guess.segment_rules import LinkClearance

STEP = 0.05  # [rad]


def through_knots(problem, count, construction=sequential_quartics):
    """Return a trajectory through knots on the reference path, closer together at its ends."""
    way = np.linspace(0, 1, count)
    knots = waypoints_of(problem, 61)[np.rint(60 * way**2 * (3 - 2 * way)).astype(int)]
    return feasible_trajectory(problem, knots, construction, LinkClearance(problem, knots))


def searched(problem, candidate, budget=10_000, step=STEP):
    increments = np.full(problem.robot.joint_count, step)
    clearance = LinkClearance(problem, candidate.knots)
    search = DirectionSearch(problem, candidate, increments, clearance, candidate.duration)
    search.run(budget)
    return search


def every_direction(problem, candidate):
    """Return the fastest trajectory of all (2n+1)^(K-2), each judged as a whole."""
    clearance, n = LinkClearance(problem, candidate.knots), problem.robot.joint_count
    moves = np.concatenate([np.zeros((1, n)), STEP * np.eye(n), -STEP * np.eye(n)])
    best = candidate
    for choice in product(moves, repeat=len(candidate.knots) - 2):
        knots = candidate.knots + np.vstack([np.zeros(n), *choice, np.zeros(n)])
        moved = feasible_trajectory(
            problem, knots, candidate.construction, clearance, best.duration
        )
        best = moved or best
    return best


def problem_of(robot, points=((0.45, -0.3, 0), (0.45, 0.2, 0)), radius=0.12, **more):
    tube = Tube(points, radius, joint_signs={"joint2": "-"})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])), **more)


def tight(two_link):
    return problem_of(two_link, radius=0.03)


def corner(two_link):
    return problem_of(two_link, [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0]], 0.15)


def past_a_ball(two_link):
    ball = Obstacle.sphere("ball", 0.03, placement_of([0.55, 0.0, 0]))
    return problem_of(two_link, obstacles=[ball])


@pytest.mark.parametrize(
    ("make", "count"),
    [(problem_of, 3), (tight, 5), (corner, 4), (past_a_ball, 4)],
)
def test_it_finds_what_trying_every_direction_finds(make, count, two_link):
    problem = make(two_link)
    candidate = through_knots(problem, count)
    direction, best = searched(problem, candidate), every_direction(problem, candidate)
    assert direction.proved
    assert best is not candidate
    np.testing.assert_array_equal(direction.best.knots, best.knots)
    assert direction.nodes <= 5 ** (count - 2)


def test_a_spline_s_direction_is_faster_and_at_most_the_best(two_link):
    """Segments of a spline depend on knots not yet chosen: the best may be lost."""
    problem = problem_of(two_link)
    candidate = through_knots(problem, 4, quartic_spline)
    found, best = searched(problem, candidate).best, every_direction(problem, candidate)
    assert best.duration <= found.duration < candidate.duration
    assert found.duration == pytest.approx(best.duration, rel=0.01)


def test_the_budget_ends_a_search_with_a_direction_that_is_not_proved(two_link):
    problem = corner(two_link)
    candidate = through_knots(problem, 8)
    early = searched(problem, candidate, budget=1)
    assert early.best.duration < candidate.duration
    assert not early.proved
    assert early.nodes <= 7 * 60  # one sweep


def test_where_no_knot_may_move_there_is_no_direction(two_link):
    problem = tight(two_link)
    direction = searched(problem, through_knots(problem, 5), step=1.5)
    assert (direction.best, direction.proved) == (None, True)


@pytest.mark.parametrize("construction", [sequential_quartics, quartic_spline])
def test_polynomials_are_linear_in_the_knots(construction):
    knots = np.random.default_rng(1).normal(size=(7, 2))
    moved = np.einsum("csk,kn->csn", unit_response(construction, 7), knots)
    np.testing.assert_allclose(moved, construction(["a", "b"], knots).coefficients, atol=1e-12)


def test_sequential_quartics_depend_on_no_knot_after_the_one_they_aim_at():
    response = unit_response(sequential_quartics, 8)
    for segment in range(5):
        assert not response[:, segment, segment + 3 :].any()
        assert response[:, segment, segment + 2].any()


@pytest.mark.parametrize("construction", [sequential_quartics, quartic_spline])
def test_moving_knots_never_makes_it_slower(construction, two_link):
    problem = problem_of(two_link)
    work = KnotModification(
        problem, through_knots(problem, 5, construction), ModificationOptions(halvings=1)
    )
    last = work.run(np.inf)
    durations = [candidate.duration for candidate in work.candidates]
    assert durations == sorted(durations, reverse=True)
    assert last is work.candidates[-1]
    assert last.duration < 0.95 * durations[0]
    assert verify(problem, last.trajectory).passed
    np.testing.assert_array_equal(last.knots[[0, -1]], work.candidates[0].knots[[0, -1]])
    assert work.directions >= len(durations) - 1


def test_two_knots_are_left_alone(two_link):
    problem = problem_of(two_link, [[0.45, 0, 0], [0.45, 0.01, 0]], 0.05)
    candidate = through_knots(problem, 2)
    work = KnotModification(problem, candidate, ModificationOptions())
    assert work.run(np.inf) is candidate
    assert work.nodes == 0


def test_a_trajectory_through_an_obstacle_or_out_of_the_tube_is_refused(two_link):
    free = problem_of(two_link)
    knots = through_knots(free, 5).knots
    way = two_link.tool_position(knots)
    ball = Obstacle.sphere("ball", 0.02, placement_of(way[2]))
    blocked = PlanningProblem(two_link, free.tube, knots[0], obstacles=[ball])
    thin = free.with_tube(free.tube.with_radius(0.001))
    for problem in (blocked, thin):
        clearance = LinkClearance(problem, knots)
        assert feasible_trajectory(problem, knots, sequential_quartics, clearance) is None


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"increment": 0}, "increment is 0; it must be > 0 and finite"),
        ({"linear_increment": np.inf}, "linear_increment is inf; it must be > 0 and finite"),
        ({"halvings": -1}, "halvings is -1; it must be >= 0"),
        ({"growth": 1}, "growth is 1; it must be > 1 and finite"),
        ({"min_gain": 0}, "min_gain is 0; it must be > 0 and < 1"),
        ({"direction_nodes": 0}, "direction_nodes is 0; it must be >= 1"),
    ],
)
def test_options_are_checked(wrong, message):
    with pytest.raises(OptionError, match=message):
        ModificationOptions(**wrong)
