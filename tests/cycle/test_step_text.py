"""Rests in words."""

from small_cycle import small_cycle
from tubeplanner import Event
from tubeplanner.cycle.step_text import rest_text, step_text


def test_a_rest_lists_its_steps_in_order():
    cycle = small_cycle()
    assert rest_text(cycle.legs[0].before) == "nothing"
    assert rest_text(cycle.legs[1].before) == "gripper 'close' (0.05 s), attach part"
    assert rest_text(cycle.legs[2].before) == "gripper 'open' (0.06 s), detach part"
    assert rest_text(cycle.after) == "pause (0.1 s)"


def test_what_an_event_sets_stays_on_one_line():
    assert step_text(Event("weld")) == "weld"
    assert step_text(Event("weld", 3)) == "weld 3"
    assert "\n" not in step_text(Event("weld", "on\noff"))
