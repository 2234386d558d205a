"""Steps as legs and rests: what runs without a stop, and what the arm carries when."""

from dataclasses import replace

import numpy as np
import pytest

from cycles import HOME, PICK, PLACE, move, planar_arm, weight
from tubeplanner import Attach, Detach, Event, ProblemError, Tube, load_robot
from tubeplanner.cycle.leg import legs_of
from tubeplanner.outcome import Place
from two_link_cycles import cycle_of
from two_link_cycles import move as named_move

GRAVITY = (0.0, -9.81, 0.0)
ARM = planar_arm(GRAVITY)
GO, ON, BACK = (
    move(ARM, name, *ends)
    for name, ends in (("go", (HOME, PICK)), ("on", (PICK, PLACE)), ("back", (PLACE, HOME)))
)
THROUGH = replace(ON, passes_through=True)


def test_moves_that_pass_through_are_one_leg():
    legs, after = legs_of([GO, THROUGH, Event("a"), BACK, Event("b")])
    assert [leg.name for leg in legs] == ["go, on", "back"]
    assert [len(leg.before.steps) for leg in legs] == [0, 1]
    assert [step.name for step in after.steps] == ["b"]


def test_a_segment_of_a_leg_is_one_of_a_move():
    points = ARM.tool_position(np.linspace(HOME, PICK, 4))
    leg = legs_of([replace(GO, tube=Tube(points, 0.2)), THROUGH])[0][0]
    assert leg.first_segments == (0, 3)
    found = [(found.name, k) for found, k in map(leg.move_of, range(4))]
    assert found == [("go", 0), ("go", 1), ("go", 2), ("on", 0)]


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ([THROUGH], "move 'on': pass_through: nothing comes before it, not a move"),
        ([GO, Event("a"), THROUGH], "move 'on': pass_through: event, at rest, comes before it"),
        ([GO, Attach("a"), THROUGH], "move 'on': pass_through: attach, at rest, comes before it"),
        ([GO, Detach("a"), THROUGH], "move 'on': pass_through: detach, at rest, comes before it"),
    ],
)
def test_what_begins_at_rest_passes_through_nothing(steps, message):
    with pytest.raises(ProblemError, match=message):
        legs_of(steps)


def gravity_efforts(arms, q=PICK):
    return np.array([arm.gravity_effort(q) for arm in arms])


def test_the_arm_feels_what_it_carries_when_it_carries_it():
    """Held efforts are the empty arm's, and the sum of what each weighs through the Jacobian."""
    first, second = weight(1.5, (0.1, 0.0, 0.0)), weight(0.5, (-0.2, 0.1, 0.0))
    steps = [GO, Attach("a", first), Attach("b", second), ON, Detach("a"), BACK, Detach("b")]
    legs, after = legs_of(steps)
    alone = {
        load: gravity_efforts([load_robot("example:two_link", "hand", gravity=GRAVITY, payload=p)])
        for load, p in (("", None), ("a", first), ("b", second))
    }
    both = alone["a"] + alone["b"] - alone[""]
    found = gravity_efforts(leg.robot for leg in legs)
    np.testing.assert_allclose(found, np.vstack([alone[""], both, alone["b"]]), atol=1e-10)
    at_pick = gravity_efforts(legs[1].before.arms)
    np.testing.assert_allclose(at_pick, np.vstack([alone[""], alone["a"], both]), atol=1e-10)
    at_end = gravity_efforts(after.arms)
    np.testing.assert_allclose(at_end, np.vstack([alone["b"], alone[""]]), atol=1e-10)


def test_what_is_attached_adds_to_the_robots_own_payload():
    own, added = weight(0.8, (0.05, 0.0, 0.0)), weight(1.5, (0.1, 0.0, 0.0))
    loaded = planar_arm(GRAVITY, payload=own)
    legs, _ = legs_of(
        [move(loaded, "go", HOME, PICK), Attach("a", added), replace(ON, robot=loaded)]
    )
    expected = load_robot("example:two_link", "hand", gravity=GRAVITY, payload=own.plus(added))
    np.testing.assert_allclose(
        gravity_efforts([legs[1].robot]), gravity_efforts([expected]), atol=1e-12
    )
    assert legs[0].robot is loaded


def test_arms_that_carry_the_same_are_one():
    """What is computed of an arm is computed once."""
    load = weight(1.0)
    steps = [Attach("a", load), GO, Event("x"), ON, Detach("a"), BACK]
    legs, after = legs_of(steps)
    assert legs[0].robot is legs[1].robot is legs[2].before.arms[0]
    assert legs[2].robot is after.arms[0] is ARM


def test_a_rest_names_what_changes_hands():
    steps = [GO, Event("x"), Attach("a", weight(1.0)), Detach("a"), BACK]
    assert legs_of(steps)[0][1].before.handed_over == ("a", "a")


def test_a_place_in_a_leg_is_told_as_one_of_its_moves_in_the_cycle():
    passing = {**named_move("second", "cd"), "pass_through": True}
    cycle = cycle_of(named_move("first", "abc"), passing, named_move("third", "dc"))
    leg = cycle.legs[0]
    places = [leg.in_cycle(Place(segment=segment, time=1.0), 2.0) for segment in range(3)]
    told = [(place.move, place.segment, place.time) for place in places]
    assert told == [("first", 0, 3.0), ("first", 1, 3.0), ("second", 0, 3.0)]
    whole = leg.in_cycle(Place(joint="joint1"), 2.0)
    assert whole == Place(move="first, second", joint="joint1")
    assert [cycle.called(k) for k in (0, 1)] == [
        "moves 1 to 2 of 3, 'first', 'second'",
        "move 3 of 3, 'third'",
    ]
