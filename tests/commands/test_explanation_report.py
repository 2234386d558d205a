"""What was found out, as text."""

import shlex
from dataclasses import replace

import pytest

from asked_problems import PLANAR, REMEDY, ROOM
from tubeplanner import Explanation, parse_problem
from tubeplanner.commands.explanation_report import explanation_text
from tubeplanner.documents import parse_yaml
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.refinement.sensitivities import Sensitivity

PROBLEM = parse_problem(PLANAR)
HERE = Place(segment=1)
CLOSE = replace(
    ROOM,
    after=0.5,
    duration=2.25,
    text="radius 30 -> 5 mm",
    too_much=0.004,
    too_much_text="4 mm",
    is_exact=True,
)


def text_of(status=PlanStatus.UNREACHABLE, place=HERE, sensitivities=(), **found):
    result = PlanResult(status, "for a reason", place, "refinement", sensitivities=sensitivities)
    return explanation_text(Explanation("ur5/x", PROBLEM, result, None, **found), 12.34)


def cells(text, word):
    """Return the cells of the one row of a table that has a word."""
    (row,) = [line for line in text.splitlines() if word in line and "│" in line]
    return [cell.strip() for cell in row.strip("│").split("│")]


def test_how_it_ended_comes_first_and_the_search_last():
    lines = text_of(tried=7).splitlines()
    assert lines[:2] == ["ur5/x: unreachable: for a reason", "where: segment 1"]
    assert lines[-1] == "7 plans with a change in 12.3 s; all changes were tried"
    assert text_of(place=Place()).splitlines()[1].startswith("no single change was found")


@pytest.mark.parametrize(
    ("stopped_by", "text"),
    [
        ("time_limit", "the time limit passed: with a larger --time-limit there may be more"),
        ("interrupt", "interrupted: there may be more"),
    ],
)
def test_a_search_that_was_stopped_says_so(stopped_by, text):
    assert text_of(stopped_by=stopped_by).endswith(f"s; {text}")


def test_a_remedy_has_its_size_and_what_is_not_enough():
    text = text_of(remedies=(REMEDY,))
    assert cells(text, "wider") == ["wider", "0.29 rad", "2", "1.500 s", REMEDY.field]
    open_end = text_of(remedies=(replace(REMEDY, is_smallest=False),))
    assert cells(open_end, "wider")[1] == "0.29 rad (not narrowed)"
    unknown = text_of(remedies=(replace(REMEDY, is_smallest=False, too_little_text=""),))
    assert cells(unknown, "wider")[1] == "(not narrowed)"
    alone = text_of(remedies=(replace(REMEDY, too_little_text=""),))
    assert cells(alone, "wider")[1] == ""


def test_what_helps_nothing_is_listed():
    assert "\nby itself none of these helps: clearance (down to 0); b.c\n" in text_of(
        in_vain=("clearance", "b.c")
    )
    assert "by itself" not in text_of()


@pytest.mark.parametrize(
    "value",
    [
        *(0.0735, 1, True, None, "none", "-", float("inf"), -float("inf"), [0.1, None, 0.2]),
        {"joint2": "-", "joint1": [-3.0, float("inf")]},
        [{"box": [0.1, 0.2], "up": [0, 0, 1]}, None],
    ],
)
def test_the_first_remedy_is_given_as_commands_take_it(value):
    text = text_of(remedies=(replace(REMEDY, changes={"a.b": value, "c": 1}),))
    (line,) = [line for line in text.splitlines() if line.startswith("the first one: ")]
    option, first, *second = shlex.split(line.removeprefix("the first one: "))
    assert [option, *second] == ["--set", "--set", "c=1"]
    path, _, given = first.partition("=")
    assert path == "a.b"
    assert parse_yaml(given) == value


def test_a_problem_with_an_answer_shows_what_limits_it_and_its_room():
    dear = Sensitivity("effort", "joint1", None, -0.3, 0.0123)
    free = Sensitivity("velocity", "joint2", None, 0.0, 0.0)
    text = text_of(PlanStatus.SUCCESS, Place(), sensitivities=(dear, free), rooms=(CLOSE, ROOM))
    assert f"what limits it most; 10 % more would save:\n  {dear}\n" in text
    assert str(free) not in text
    assert cells(text, "radius 30") == ["radius 30 -> 5 mm", "2.250 s", "4 mm", ROOM.field]
    assert cells(text, "not even so")[1:3] == ["", "0.5 rad (not narrowed)"]
    assert "what limits" not in text_of(PlanStatus.SUCCESS, Place())
