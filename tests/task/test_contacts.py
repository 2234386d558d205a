"""Clearances of pairs and segments, and contacts: what is accepted, and what is required where."""

import numpy as np
import pytest
from cases import refusal

from tubeplanner import Contact, Obstacle, PlanningProblem, ProblemError, Tube, placement_of
from tubeplanner.task.problem_format import (
    ClearanceFields,
    ContactFields,
    clearances_of,
    contacts_of,
    segment_clearances,
)
from tubeplanner.task.required_distances import RequiredDistances, in_contact, required_everywhere

BALL = Obstacle.sphere("ball", 0.05, placement_of([1.5, 0.7, 0.0]))
BLOCK = Obstacle.box("block", [0.2, 0.2, 0.2], placement_of([-1.5, -1.5, 0.0]))
OBSTACLES = {"ball", "block"}
START, GOAL = np.array([0.2, 0.3]), np.array([0.9, 0.5])
PAIR = ("ball", "link2")
TOUCHING = [Contact(PAIR, 0.1)]


@pytest.fixture
def problem(two_link):
    """Return a function that makes a problem from START to GOAL in a tube about their line."""
    tool = two_link.tool_position(np.array([START, (START + GOAL) / 2, GOAL]))

    def make(goal=GOAL, clearances=None, **others):
        tube = Tube(tool, 0.3, clearance=clearances)
        return PlanningProblem(two_link, tube, START, goal, obstacles=[BALL, BLOCK], **others)

    return make


def names_of(problem):
    """Return the names of each pair of shapes."""
    checker = problem.collision
    return [{checker.shapes[index].owner for index in pair} for pair in checker.pairs]


def distance(problem, names, q):
    """Return the distance of two solids [m]."""
    checker = problem.collision
    rotation, position = (poses[0] for poses in problem.robot.body_poses(q[None]))
    pairs = [k for k, pair in enumerate(names_of(problem)) if pair == set(names)]
    return checker.distances(rotation, position, checker.pairs[pairs]).min()


def required(problem, segment, q, goal=GOAL):
    """Return the required distances by the names of the pairs."""
    tool = problem.robot.tool_position(q[None])
    (distances,) = RequiredDistances(problem, START, goal).at(np.array([segment]), tool)
    return {tuple(sorted(names)): x for names, x in zip(names_of(problem), distances, strict=True)}


def test_a_pair_comes_before_a_segment_and_that_before_the_default(problem):
    built = problem(clearance=0.01, clearances=[None, 0.02], pair_clearances={PAIR: 0.03})
    for segment, of_segment in ((0, 0.01), (1, 0.02)):
        distances = required(built, segment, START)
        assert distances[PAIR] == 0.03
        others = [x for names, x in distances.items() if "block" in names]
        assert others and all(x == of_segment for x in others)
    most = dict(zip(map(frozenset, names_of(built)), required_everywhere(built), strict=True))
    assert most[frozenset(PAIR)] == 0.03
    assert most[frozenset(("block", "link2"))] == 0.02


@pytest.mark.parametrize(("end", "segment", "q"), [("start", 0, START), ("goal", 1, GOAL)])
def test_near_an_end_as_much_is_required_as_there_if_that_is_less(problem, end, segment, q):
    there = distance(problem(), PAIR, q)
    contacts = [Contact(PAIR, 0.1, (end,))]
    built = problem(clearance=there + 0.05, contacts=contacts)
    assert required(built, segment, q)[PAIR] == pytest.approx(there)
    # In the other segment, or farther away, the clearance holds; and of other pairs always.
    assert required(built, 1 - segment, q)[PAIR] == pytest.approx(there + 0.05)
    away = q + np.array([0.2, 0.0])
    assert required(built, segment, away)[PAIR] == pytest.approx(there + 0.05)
    block = [x for pair, x in required(built, segment, q).items() if "block" in pair]
    assert block == [pytest.approx(there + 0.05)] * len(block)
    near = problem(clearance=there - 0.01, contacts=contacts)
    assert required(near, segment, q)[PAIR] == pytest.approx(there - 0.01)


def test_the_boundary_of_the_distance_belongs_to_it(problem):
    built = problem(clearance=5.0, contacts=[Contact(PAIR, 0.25, ("start",))])
    near = RequiredDistances(built, START, GOAL).near_ends[0]
    tool = near.tool + np.array([[0.25, 0, 0], [0.25 + 1e-9, 0, 0]])
    assert near.holds(np.array([0, 0]), tool).tolist() == [True, False]
    assert near.holds(np.array([1, 0]), tool).tolist() == [False, False]


def test_at_an_open_goal_solids_must_not_overlap(problem):
    """At an open goal the distance of the solids is unknown."""
    built = problem(goal=None, clearance=0.5, contacts=TOUCHING)
    assert required(built, 1, GOAL)[PAIR] == 0.0
    assert required(built, 0, START)[PAIR] > 0.0


def test_room_or_a_problem_farther_apart_ask_more_of_obstacles_alone(problem):
    contacts = [Contact(("block", "link2"), 0.1)]
    pairs = {PAIR: 0.03}
    built = problem(
        clearance=0.01, clearances=[None, 0.02], pair_clearances=pairs, contacts=contacts
    )
    farther = built.farther_apart(0.004)
    plain = RequiredDistances(built, START, GOAL).by_segment
    expected = plain + 0.004 * np.array([bool(names & OBSTACLES) for names in names_of(built)])
    for distances in (
        RequiredDistances(built, START, GOAL, 0.004),
        RequiredDistances(farther, START, GOAL),
    ):
        np.testing.assert_allclose(distances.by_segment, expected)
    assert farther.contacts == built.contacts
    block = [names == {"block", "link2"} for names in names_of(built)]
    np.testing.assert_array_equal(in_contact(built), block)
    assert problem().has_one_clearance
    assert not built.has_one_clearance


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"pair_clearances": {("ball", "blok"): 0.1}}, "clearance.pairs: unknown link with collis"),
        (
            {"pair_clearances": {("ball", "block"): 0.1}},
            "clearance.pairs: 'ball' and 'block' are not checked against each other (no joint "
            "moves one against the other): remove the pair",
        ),
        ({"contacts": TOUCHING, "ignore_collisions": [PAIR]}, "contacts: 'ball' and 'link2' are"),
        ({"pair_clearances": {PAIR: -0.1}}, "clearance.pairs: clearance is -0.1 m for 'ball' and"),
        ({"pair_clearances": {"ball": 0.1}}, "clearance.pairs: 'ball' is no pair of names of dif"),
        ({"pair_clearances": [0.1]}, "clearance.pairs is [0.1]; give a map from pairs of names to"),
        ({"contacts": ["ball"]}, "contacts[0] is 'ball'; give Contact"),
    ],
)
def test_a_fault_of_a_problem_is_named(problem, fields, message):
    assert refusal(ProblemError, problem, **fields).startswith(message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((("a", "a"), 0.1), "('a', 'a') is no pair of names of different links or obstacles"),
        ((("a", "b"), 0.0), "within is 0 m for 'a' and 'b'; 1e-06 to 10000 m are accepted"),
        ((("a", "b"), 0.1, ("end",)), "unknown end 'end'; there is: start, goal"),
    ],
)
def test_a_fault_of_a_contact_is_named(arguments, message):
    assert refusal(ProblemError, Contact, *arguments) == f"contacts: {message}"
    assert Contact(("a", "b"), 0.1, "goal") == Contact(("a", "b"), 0.1, ("goal",))


def test_a_clearance_is_a_number_or_a_map_with_default_pairs_and_segments():
    assert clearances_of(0.01) == {"clearance": 0.01}
    assert segment_clearances(0.01) is None
    pairs = [{"links": ["hand", "wall"], "clearance": 0.03}]
    fields = ClearanceFields(default=0.01, pairs=pairs, segments=[None, 0.02])
    assert clearances_of(fields) == {
        "clearance": 0.01,
        "pair_clearances": {("hand", "wall"): 0.03},
    }
    assert segment_clearances(fields) == [None, 0.02]


def contact(segments):
    return [ContactFields(links=["hand", "wall"], within=0.1, segments=segments)]


@pytest.mark.parametrize(
    ("segments", "count", "ends"),
    [
        (None, 3, ("start", "goal")),
        ([-1], 3, ("goal",)),
        ([0, 2], 3, ("start", "goal")),
        ([0], 1, ("start", "goal")),
        ([-1], None, ("goal",)),
    ],
)
def test_segments_of_a_contact_are_the_first_and_the_last(segments, count, ends):
    (meant,) = contacts_of(contact(segments), count)
    assert meant == Contact(("hand", "wall"), 0.1, ends)


@pytest.mark.parametrize(("count", "last"), [(3, "2 (or -1), the last"), (None, "-1, the last")])
def test_a_segment_between_is_refused(count, last):
    message = refusal(ProblemError, contacts_of, contact([1]), count)
    assert message.startswith("contacts[0].segments has 1; ") and "give 0" in message
    assert last in message
