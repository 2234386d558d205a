"""What may be near where something changes hands: by default, and as the cycle says."""

from dataclasses import replace

import numpy as np
import pytest

from cycles import HOME, PICK, PLACE, ball, move, planar_arm
from tubeplanner import Attach, Contact, Cycle, Detach, Obstacle, placement_of
from tubeplanner.task.required_distances import WITHIN

ARM = planar_arm()


def table(q, below, name="table"):
    """Return a slab with its top a distance [m] below the ball of the tool in a configuration."""
    middle = ARM.tool_position(q) + np.array([0, 0, 0.1 - 0.02 - below - 0.005])
    return Obstacle.box(name, [0.05, 0.05, 0.01], placement_of(middle))


def cycle(*obstacles, clearance=0.01, contacts=(), goal=None):
    location = None if goal is None else PLACE
    to_pick, to_place, back = (
        move(ARM, name, *ends, clearance=clearance, **more)
        for name, ends, more in (
            ("to_pick", (HOME, PICK), {"goal": goal}),
            ("to_place", (PICK, PLACE), {"goal": location, "contacts": contacts}),
            ("back", (PLACE, HOME), {}),
        )
    )
    steps = [to_pick, Attach("part"), to_place, Detach("part"), back]
    return Cycle(HOME, steps, [ball(ARM), *obstacles])


def contacts(made, k, **more):
    problem = made.problem(k, [HOME, PICK, PLACE][: k + 1], **more)
    return {(frozenset(each.links), each.ends, each.within) for each in problem.contacts}


def pair(other, end):
    return frozenset(("part", other)), (end,), WITHIN


def test_what_is_taken_may_be_as_near_to_what_it_lies_on_as_it_is():
    built = cycle(table(PICK, 0.009), table(PLACE, 0.2, "far"))
    assert contacts(built, 1, goal=PLACE) == {pair("table", "start")}
    assert contacts(cycle(table(PICK, 0.011)), 1, goal=PLACE) == set()


def test_what_is_let_go_may_come_near_to_what_it_will_lie_on():
    built = cycle(table(PLACE, 0.002), table(PICK, 0.2, "far"))
    assert contacts(built, 1, goal=PLACE) == {pair("table", "goal")}
    # Where that is not known, any obstacle may be near.
    built = cycle(table(PICK, 0.2, "far"), table(PLACE, 0.2, "farther"))
    assert contacts(built, 1) == {pair("far", "goal"), pair("farther", "goal")}


def test_the_hand_may_come_near_to_what_it_will_take_other_links_not():
    """At an open end: links that move with the tool; at a known end: near solids."""
    owners = {shape.owner for shape in cycle().problem(0, [HOME]).collision.shapes}
    of_tool = {name for name in owners if ARM.link_body.get(name) == ARM.link_body["hand"]}
    assert {"link1", "part"} & (owners - of_tool)
    assert contacts(cycle(), 0) == {pair(name, "goal") for name in of_tool}
    assert contacts(cycle(goal=PICK, clearance=0.01), 0) == set()  # it is 0.04 m from the part
    assert contacts(cycle(goal=PICK, clearance=0.09), 0) == {pair(name, "goal") for name in of_tool}


def test_what_was_let_go_may_be_as_near_to_the_hand_as_it_is():
    result = contacts(cycle(clearance=0.09), 2)
    assert result
    assert {ends for _, ends, _ in result} == {("start",)}
    assert contacts(cycle(clearance=0.01), 2) == set()


def test_a_contact_that_is_given_comes_instead():
    own = Contact(("table", "part"), 0.07, ("start",))
    built = cycle(table(PICK, 0.002), contacts=[own])
    result = contacts(built, 1)
    assert (frozenset(own.links), ("start",), 0.07) in result
    assert pair("table", "start") not in result
    assert pair("table", "goal") in result  # at the other end it is the usual one


@pytest.mark.parametrize("steps", [(), (Detach("part"),)])
def test_what_does_not_change_hands_there_gets_no_contact(steps):
    """Only solids attached or detached at a seam get contacts there."""
    built = cycle(table(PLACE, 0.002))
    kept = [each for each in built.steps if not isinstance(each, Detach)][:-1]
    changed = replace(built, steps=[*kept, *steps])
    result = contacts(changed, 1, goal=PLACE)
    assert (pair("table", "goal") in result) == bool(steps)


@pytest.mark.parametrize(("below", "may"), [(-0.0005, True), (-0.003, False)])
def test_what_overlaps_deeper_than_rough_geometry_does_was_not_meant_to_touch(below, may):
    attaching, put = cycle(table(PICK, below)), cycle(table(PLACE, below))
    assert contacts(attaching, 1, goal=PLACE) == ({pair("table", "start")} if may else set())
    assert contacts(put, 1, goal=PLACE) == ({pair("table", "goal")} if may else set())


def test_an_open_end_that_is_known_has_the_contacts_of_that_configuration():
    built = cycle(table(PLACE, 0.002), table(PICK, 0.002, "other"))
    problem = built.problem(1, [HOME, PICK, PLACE])
    assert problem.goal is None
    result = {(frozenset(each.links), each.ends, each.within) for each in problem.contacts}
    assert result == {pair("other", "start"), pair("table", "goal")}
