"""`explain`: reason, remedies, headroom."""

import json
import re
from dataclasses import replace

import pytest
from asked_problems import PLANAR, REMEDY, ROOM
from gantry import gantry

from tubeplanner import Explanation, PlanOptions, explain, parse_problem
from tubeplanner.cli import explain as explain_command
from tubeplanner.cli.explain import explanation_text
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.outcome import Location, PlanStatus
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies import explanation as explain_module

ONE = ("--quality", "fast", "--time-limit", "1000")
# A problem file's contract: what other tools read.
READ = {"field", "from", "to", "unit", "certified", "duration", "text"}
OF_PLAN = {
    *("status", "message", "where", "proved", "starts_tried", "duration", "bound"),
    *(
        "phase1_duration",
        "planning_time",
        "certificate_time",
        "loading_time",
        "stopped_by",
        "certificate",
    ),
}
PROBLEM = parse_problem(PLANAR)
HERE = Location(segment=1)
CLOSE = replace(ROOM, after=0.5, duration=2.25, text="radius 30 -> 5 mm", is_exact=True)


@pytest.fixture(autouse=True)
def tried_here(here):
    """Changes are tried in this process, which has all that is needed loaded."""


@pytest.fixture(scope="module")
def beyond(tmp_path_factory):
    """A goal that a rail of 1 m does not reach."""
    tube = {"points": [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]], "radius": 0.01}
    return gantry(tmp_path_factory.mktemp("beyond"), tube=tube)


@pytest.fixture
def explained(shared, beyond, monkeypatch):
    """What is explained is why that is out of reach; found out once."""

    def found_out():
        return explain(beyond, options=PlanOptions(quality="fast"), time_limit=1000.0)

    explanation = shared("explained.gantry", found_out)
    monkeypatch.setattr(explain_command, "search", lambda *_, **__: explanation)


@pytest.mark.dear("tries a hundred changes")
def test_what_helps_is_a_table_and_the_first_is_ready_to_be_tried(run, here, beyond):
    status, out, err = run("explain", beyond, *ONE, "--processes", "2")
    assert (status, err, here) == (0, "", [(2,)])
    lines = out.splitlines()
    assert re.match(r"beyond\d/gantry: unreachable: segment 0, point 1, tool at \[1\.1", lines[0])
    assert lines[1].startswith("where: along, segment 0, point 1")
    assert "any one of these makes it possible (planned with it and certified)" in lines[2]
    assert "move reference point 1 by 93.1 mm in -x" in out
    assert "along: upper limit 1 -> 1.0931 m" in out
    assert "by itself none of these helps: " in out
    assert "position limits of across (by up to a turn)" in out
    assert lines[-1].endswith("s; all changes were tried")
    (first,) = [line for line in lines if line.startswith("the first one: --set ")]
    change = first.removeprefix("the first one: --set ").strip("'")
    assert change == "tube.points.1=[1.0069, 0.0, 0.0]"
    status, out, _ = run("plan", beyond, "--quality", "fast", "--set", change)
    assert status == 0


@pytest.mark.dear("tries a hundred changes")
def test_json_has_what_plan_has_and_the_remedies_and_a_page_lies_beside(
    run, explained, beyond, tmp_path
):
    page = tmp_path / "why.html"
    status, out, err = run("explain", beyond, *ONE, "--html", page, "--json")
    assert (status, err) == (0, "")
    fields = json.loads(out)
    assert OF_PLAN | {"remedies", "in_vain", "room", "tried", "search_time"} <= set(fields)
    assert (fields["status"], fields["duration"]) == ("unreachable", None)
    assert (fields["where"]["point"], fields["room"], len(fields["remedies"])) == (1, [], 4)
    for remedy in fields["remedies"]:
        assert set(remedy) == READ | {
            *("changes", "cost", "too_little", "too_little_text", "is_smallest")
        }
        assert remedy["certified"] is True
    assert "robot.limits.position.across" in fields["in_vain"]
    assert fields["notes"] == [f"page: {page}"]
    assert "move reference point 1 by 93.1 mm in -x" in page.read_text()
    _, out, _ = run("explain", beyond, *ONE, "--html", page)
    assert out.splitlines()[-1] == f"page: {page}"


def test_no_change_that_helps_is_status_1(run, tmp_path):
    """A rail ends at 1 m, the goal is at 30 m."""
    tube = {"points": [[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]], "radius": 0.01}
    status, out, _ = run("explain", gantry(tmp_path, tube=tube), *ONE)
    assert status == 1
    assert "no single change was found that makes it possible" in out
    assert "the first one" not in out


@pytest.mark.parametrize(
    ("joints", "status", "message"),
    [
        ([-0.03, 0.0], 0, "is outside [0, 1], its position limits"),
        ([0.0, 0.0, 0.0], 2, "start has 3 values for the 2 joints along, across"),
    ],
)
def test_what_cannot_be_posed_is_status_2_if_no_change_helps(
    run, tmp_path, joints, status, message
):
    changes = ("--set", f"start.joints={joints}", "--set", "tube.points.0=[-0.03, 0, 0]")
    ended, out, _ = run("explain", gantry(tmp_path), *ONE, *changes)
    assert ended == status
    assert out.splitlines()[0].partition(": bad_input: ")[2].startswith("start")
    assert message in out


def test_a_cycle_is_refused_with_the_fields_of_plan(run_json, cycle_path):
    status, fields = run_json("explain", cycle_path)
    assert (status, fields["status"]) == (2, "bad_input")
    assert "this is a cycle, where one problem is needed" in fields["message"]
    assert set(fields) == OF_PLAN


def test_ctrl_c_before_anything_is_known_is_status_130(run, tmp_path, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(explain_module, "plan", interrupted)
    status, _, err = run("explain", gantry(tmp_path), *ONE)
    assert status == 130
    assert "interrupted before there was an answer" in err


def test_a_page_is_written_of_what_cannot_be_posed_if_the_tube_can_be_drawn(run, tmp_path):
    page, path = tmp_path / "why.html", gantry(tmp_path)
    _, out, _ = run("explain", path, *ONE, "--set", "tube.radius=-0.1", "--html", page, "--json")
    assert "was not written: the tube cannot be drawn" in json.loads(out)["notes"][0]
    assert not page.exists()
    wrong = ("--set", "start.joints=[1.5, 0]")
    _, out, _ = run("explain", path, *ONE, *wrong, "--html", page, "--json")
    fields = json.loads(out)
    assert (fields["status"], fields["notes"]) == ("bad_input", [f"page: {page}"])
    assert fields["where"]["joint"] == "along"
    assert "outside [0, 1]" in page.read_text()


def text_of(status=PlanStatus.UNREACHABLE, location=HERE, sensitivities=(), **found):
    result = PlanResult(status, "for a reason", location, "refinement", sensitivities=sensitivities)
    return explanation_text(Explanation("ur5/x", PROBLEM, result, None, **found), 12.34)


def cells(text, word):
    """Return the cells of the one row of a table that has a word."""
    (row,) = [line for line in text.splitlines() if word in line and "│" in line]
    return [cell.strip() for cell in row.strip("│").split("│")]


@pytest.mark.parametrize(
    ("stopped_by", "text"),
    [
        ("time_limit", "the time limit passed: with a larger --time-limit there may be more"),
        ("interrupt", "interrupted: there may be more"),
        (None, "all changes were tried"),
    ],
)
def test_how_a_search_ended_comes_last(stopped_by, text):
    last = text_of(stopped_by=stopped_by, tried=7).splitlines()[-1]
    assert last == f"7 plans with a change in 12.3 s; {text}"


def test_a_remedy_has_its_size_and_what_is_not_enough():
    text = text_of(remedies=(REMEDY,))
    assert cells(text, "wider") == ["wider", "0.29 rad", "2", "1.500 s", REMEDY.field]
    open_end = text_of(remedies=(replace(REMEDY, is_smallest=False),))
    assert cells(open_end, "wider")[1] == "0.29 rad (not narrowed)"
    unknown = text_of(remedies=(replace(REMEDY, is_smallest=False, too_little_text=""),))
    assert cells(unknown, "wider")[1] == "(not narrowed)"
    alone = text_of(remedies=(replace(REMEDY, too_little_text=""),))
    assert cells(alone, "wider")[1] == ""


def test_a_name_is_not_read_as_markup():
    named = replace(REMEDY, text="move obstacle '[bold]post' by 1 mm")
    assert cells(text_of(remedies=(named,)), "obstacle")[0] == named.text


def test_a_problem_with_an_answer_shows_what_limits_it_and_its_room():
    dear = Sensitivity("effort", "joint1", None, -0.3, 0.0123)
    free = Sensitivity("velocity", "joint2", None, 0.0, 0.0)
    text = text_of(
        PlanStatus.SUCCESS, Location(), sensitivities=(dear, free), headrooms=(CLOSE, ROOM)
    )
    assert f"raising a limit by 10 % would save:\n  {dear}\n" in text
    assert str(free) not in text
    assert cells(text, "radius 30") == ["radius 30 -> 5 mm", "2.250 s", "0.5 rad", ROOM.field]
    assert cells(text, "not even so")[1:3] == ["", "0.5 rad (not narrowed)"]
    assert "what limits" not in text_of(PlanStatus.SUCCESS, Location())
