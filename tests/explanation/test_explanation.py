"""What was found out, as properties and as JSON."""

import json

from asked_problems import PLANAR, REMEDY, ROOM
from tubeplanner import Explanation, parse_problem
from tubeplanner.explanation.unposed import Unposed
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_result import PlanResult

PROBLEM = parse_problem(PLANAR)
PLACE = Place(segment=1, joint="joint2")


def ended(status):
    return PlanResult(status, "for a reason", PLACE, "refinement")


def test_a_problem_without_an_answer_says_where_and_why():
    found = Explanation("name", PROBLEM, ended(PlanStatus.UNREACHABLE), None, in_vain=("a",))
    assert not found.is_possible
    assert not found.succeeded
    assert (found.status, found.message) == (PlanStatus.UNREACHABLE, "for a reason")
    assert found.place == PLACE
    fields = found.as_dict()
    assert fields["where"]["joint"] == "joint2"
    assert fields["in_vain"] == ["a"]
    assert fields["method"] == "refinement"


def test_a_change_that_helps_is_a_success():
    found = Explanation("name", PROBLEM, ended(PlanStatus.UNREACHABLE), None, (REMEDY,), tried=7)
    assert found.succeeded
    assert not found.is_possible
    fields = found.as_dict()
    assert fields["remedies"] == [REMEDY.as_dict()]
    assert (fields["status"], fields["tried"], fields["stopped_by"]) == ("unreachable", 7, None)


def test_what_cannot_be_posed_is_bad_input():
    unposed = Unposed("start is not there", PLACE, True, None, PROBLEM)
    found = Explanation("name", None, None, unposed, stopped_by="time_limit")
    assert (found.status, found.message) == (PlanStatus.BAD_INPUT, "start is not there")
    assert (found.place, found.succeeded) == (PLACE, False)
    assert (found.drawn, found.configuration) == (PROBLEM, None)
    fields = found.as_dict()
    assert (fields["status"], fields["stopped_by"]) == ("bad_input", "time_limit")
    assert (fields["where"]["joint"], fields["proved"]) == ("joint2", True)


def test_a_problem_with_an_answer_has_room():
    found = Explanation("name", PROBLEM, ended(PlanStatus.SUCCESS), None, rooms=(ROOM,))
    assert found.is_possible and found.succeeded
    fields = found.as_dict()
    assert fields["room"] == [ROOM.as_dict()]
    assert fields["remedies"] == []
    json.dumps(fields, allow_nan=False)
