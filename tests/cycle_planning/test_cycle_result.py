"""Where a leg has no answer, told as a place of its moves."""

from tubeplanner.cycle_planning.cycle_result import at_move
from tubeplanner.outcome import Place
from two_link_cycles import cycle_of, move


def test_a_segment_counted_over_a_leg_is_that_of_its_move() -> None:
    passing = {**move("second", "cd"), "pass_through": True}
    cycle = cycle_of(move("first", "abc"), passing, move("third", "dc"))
    places = [at_move(Place(segment=segment), cycle, 0) for segment in range(3)]
    told = [(place.move, place.segment) for place in places]
    assert told == [("first", 0), ("first", 1), ("second", 0)]
    assert at_move(Place(joint="joint1"), cycle, 0) == Place(move="first, second", joint="joint1")
    assert at_move(Place(segment=0), cycle, 1) == Place(move="third", segment=0)
