"""Clearances of pairs and segments, and contacts: what is accepted, and what is required where."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import Contact, Obstacle, PlanningProblem, ProblemError, Tube, placement_of
from tubeplanner.problem.required_distances import (
    RequiredDistances,
    in_contact,
    required_everywhere,
)

POINTS = [[1.5, 0.5, 0.0], [1.2, 1.0, 0.0], [0.8, 1.3, 0.0]]
BALL = Obstacle.sphere("ball", 0.05, placement_of([1.5, 0.7, 0.0]))
BLOCK = Obstacle.box("block", [0.2, 0.2, 0.2], placement_of([-1.5, -1.5, 0.0]))
START, GOAL = np.array([0.2, 0.3]), np.array([0.9, 0.5])


@pytest.fixture
def problem(two_link):
    """Return a maker of a problem whose ends are START and GOAL, its tube about the way between."""
    tool = two_link.tool_position(np.array([START, (START + GOAL) / 2, GOAL]))

    def make(goal=GOAL, clearances=None, **others):
        tube = Tube(tool, 0.3, clearance=clearances)
        return PlanningProblem(two_link, tube, START, goal, obstacles=[BALL, BLOCK], **others)

    return make


def distance(problem, names, q):
    """Return how far apart two solids are, pair by pair of their shapes."""
    checker = problem.collision
    rotation, position = (poses[0] for poses in problem.robot.body_poses(q[None]))
    pairs = [
        pair
        for pair in checker.pairs
        if {checker.shapes[index].owner for index in pair} == set(names)
    ]
    return min(checker.distances(rotation, position, np.array([pair]))[0] for pair in pairs)


def names_of(problem):
    checker = problem.collision
    return [{checker.shapes[index].owner for index in pair} for pair in checker.pairs]


def required(problem, segment, q, goal=GOAL):
    """Return what is required by the names of the pairs."""
    found = RequiredDistances(problem, START, goal).at(
        np.array([segment]), problem.robot.tool_position(q[None])
    )[0]
    return {tuple(sorted(names)): x for names, x in zip(names_of(problem), found, strict=True)}


def test_a_pair_comes_before_a_segment_and_that_before_the_default(problem):
    links = next(name for name in names_of(problem()) if "ball" in name) - {"ball"}
    link = links.pop()
    made = problem(clearance=0.01, clearances=[None, 0.02], pair_clearances={("ball", link): 0.03})
    for segment, of_segment in ((0, 0.01), (1, 0.02)):
        found = required(made, segment, START)
        assert found[tuple(sorted(("ball", link)))] == 0.03
        others = [x for names, x in found.items() if "block" in names]
        assert others and all(x == of_segment for x in others)
    most = dict(zip(map(frozenset, names_of(made)), required_everywhere(made), strict=True))
    assert most[frozenset(("ball", link))] == 0.03
    assert most[frozenset(("block", link))] == 0.02


def test_room_is_added_to_distances_from_obstacles(problem):
    made = problem(clearance=0.01, clearances=[None, 0.02])
    plain, wide = (RequiredDistances(made, START, GOAL, room).by_segment for room in (0.0, 0.005))
    is_obstacle = np.array([bool(names & {"ball", "block"}) for names in names_of(made)])
    np.testing.assert_allclose((wide - plain)[:, is_obstacle], 0.005)
    np.testing.assert_allclose((wide - plain)[:, ~is_obstacle], 0.0)


@pytest.mark.parametrize(("end", "segment", "q"), [("start", 0, START), ("goal", 1, GOAL)])
def test_near_an_end_as_much_is_required_as_there_if_that_is_less(problem, end, segment, q):
    link = next(iter(next(names for names in names_of(problem()) if "ball" in names) - {"ball"}))
    names = tuple(sorted(("ball", link)))
    there = distance(problem(), names, q)
    made = problem(clearance=there + 0.05, contacts=[Contact(names, 0.1, (end,))])
    assert required(made, segment, q)[names] == pytest.approx(there)
    # In the other segment, or farther away, the clearance holds; and of other pairs always.
    assert required(made, 1 - segment, q)[names] == pytest.approx(there + 0.05)
    away = q + np.array([0.2, 0.0])
    assert required(made, segment, away)[names] == pytest.approx(there + 0.05)
    block = [x for pair, x in required(made, segment, q).items() if "block" in pair]
    assert block == [pytest.approx(there + 0.05)] * len(block)
    near = problem(clearance=there - 0.01, contacts=[Contact(names, 0.1, (end,))])
    assert required(near, segment, q)[names] == pytest.approx(there - 0.01)


def test_the_boundary_of_the_distance_belongs_to_it(problem):
    made = problem(clearance=5.0, contacts=[Contact(("ball", "link2"), 0.25, ("start",))])
    near = RequiredDistances(made, START, GOAL).near_ends[0]
    tool = near.tool + np.array([[0.25, 0, 0], [0.25 + 1e-9, 0, 0]])
    assert near.holds(np.array([0, 0]), tool).tolist() == [True, False]
    assert near.holds(np.array([1, 0]), tool).tolist() == [False, False]


def test_at_an_open_goal_solids_must_not_overlap(problem):
    """What they are apart there is not given: it may be anything."""
    made = problem(goal=None, clearance=0.5, contacts=[Contact(("ball", "link2"), 0.1)])
    assert required(made, 1, GOAL)[("ball", "link2")] == 0.0
    assert required(made, 0, START)[("ball", "link2")] > 0.0


def test_solids_farther_apart_ask_more_everywhere_but_in_contact(problem):
    made = problem(
        clearance=0.01,
        clearances=[None, 0.02],
        pair_clearances={("ball", "link2"): 0.03},
        contacts=[Contact(("block", "link2"), 0.1)],
    )
    farther = made.farther_apart(0.004)
    np.testing.assert_allclose(
        RequiredDistances(farther, START, GOAL).by_segment,
        RequiredDistances(made, START, GOAL).by_segment
        + 0.004 * np.array([bool(n & {"ball", "block"}) for n in names_of(made)]),
    )
    assert farther.contacts == made.contacts
    np.testing.assert_array_equal(
        in_contact(made), [n == {"block", "link2"} for n in names_of(made)]
    )
    assert problem().has_one_clearance
    assert not made.has_one_clearance


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: {"pair_clearances": {("ball", "blok"): 0.1}},
            "clearance.pairs: unknown link with collision geometry or obstacle 'blok' (did you "
            "mean 'block'?); there is: base, link1, link2, ball, block",
        ),
        (
            lambda: {"pair_clearances": {("ball", "block"): 0.1}},
            "clearance.pairs: 'ball' and 'block' are not checked against each other (no joint "
            "moves one against the other): remove the pair",
        ),
        (
            lambda: {
                "contacts": [Contact(("ball", "link2"), 0.1)],
                "ignore_collisions": [("ball", "link2")],
            },
            "contacts: 'ball' and 'link2' are not checked against each other (ignored): remove "
            "the pair",
        ),
        (
            lambda: {"pair_clearances": {("ball", "link2"): -0.1}},
            "clearance.pairs: clearance is -0.1 m for 'ball' and 'link2'; 0 to 10000 m are "
            "accepted",
        ),
        (
            lambda: {"pair_clearances": {"ball": 0.1}},
            "clearance.pairs: 'ball' is no pair of names of different links or obstacles",
        ),
        (
            lambda: {"pair_clearances": [0.1]},
            "clearance.pairs is [0.1]; give a map from pairs of names to distances [m]",
        ),
        (
            lambda: {"contacts": [Contact(("ball", "ball"), 0.1)]},
            "contacts: ('ball', 'ball') is no pair of names of different links or obstacles",
        ),
        (
            lambda: {"contacts": [Contact(("ball", "link2"), 0.0)]},
            "contacts: within is 0 m for 'ball' and 'link2'; 1e-06 to 10000 m are accepted",
        ),
        (
            lambda: {"contacts": [Contact(("ball", "link2"), 0.1, ("end",))]},
            "contacts: unknown end 'end'; there is: start, goal",
        ),
        (lambda: {"contacts": ["ball"]}, "contacts[0] is 'ball'; give Contact"),
    ],
)
def test_a_fault_is_named(problem, make, message):
    with pytest.raises(ProblemError) as error:
        problem(**make())
    assert str(error.value) == message


def test_one_end_may_be_given_as_a_word():
    assert Contact(("a", "b"), 0.1, "goal") == Contact(("a", "b"), 0.1, ("goal",))


def test_a_problem_with_another_tube_keeps_its_pairs(problem):
    made = problem(contacts=[Contact(("ball", "link2"), 0.1)])
    other = replace(made, tube=made.tube.with_radius(0.4))
    assert other.contacts == made.contacts
