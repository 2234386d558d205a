"""view_explanation: blocked arm, blocking solids, remedies."""

from dataclasses import replace

import numpy as np
import pytest
from asked_problems import PLANAR, REMEDY, ROOM
from gantry import HOSTILE, POST, gantry
from gantry import explained as hostile

from tubeplanner import (
    Explanation,
    OptionError,
    ProblemError,
    ProblemSpec,
    load_problem,
    parse_problem,
    plan,
)
from tubeplanner.outcome import Location, PlanStatus
from tubeplanner.output.drawing import BLOCKED_COLOR, rgb
from tubeplanner.output.page.explanation_page import blocked_arm, contact_point, view_explanation
from tubeplanner.output.page.scene import Layer
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies.changes import Question
from tubeplanner.studies.explanation import InvalidProblem, ineffective_text

QUICK = PlanOptions(quality="fast")
PROBLEM = parse_problem(PLANAR)
HERE = np.array([0.4, -1.3])
REACH = 0.6  # of the two links together [m]
BEYOND = {"points": [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]], "radius": 0.01}
RED = rgb(BLOCKED_COLOR)


def blocked_at(location, configuration=None):
    """Return the arm of an explanation with a blockage at a place."""
    result = PlanResult(PlanStatus.TUBE_BLOCKED, "", location, "refinement")
    result = replace(result, configuration=configuration)
    return blocked_arm(PROBLEM, Explanation("name", PROBLEM, result, None))


def known(path, changes=None, **more):
    """Return an explanation before any change is tried."""
    try:
        problem = load_problem(path, changes=changes)
    except ProblemError as error:
        question = Question.of(ProblemSpec.read(path).changed(changes))
        return Explanation("gantry", None, None, InvalidProblem.of(question, error))
    return Explanation("gantry", problem, plan(problem, QUICK), None, **more)


def red(scene):
    return {(item.layer, item.name) for item in scene.items if np.all(item.color == RED)}


def test_the_arm_is_where_planning_met_what_blocks_or_as_near_as_it_comes():
    shown = blocked_at(Location(), HERE)
    np.testing.assert_allclose(shown.tool, PROBLEM.robot.tool_position(HERE[None]))
    assert blocked_at(Location(joint="joint1")) is None
    near = "100 mm from where it must be"
    for far, away, name in ((0.5, 0.0, "where it is blocked"), (REACH + 0.1, 0.1, near)):
        target = np.array([0.6, 0.8, 0]) * far
        shown = blocked_at(Location().at(target))
        assert np.linalg.norm(shown.tool[0] - target) == pytest.approx(away, abs=1e-4)
        assert shown.name == name


def test_solids_touch_between_them_and_of_several_pieces_the_deepest_counts():
    block = {"name": "block", "sphere": 0.05, "position": [0.3, -0.3, 0.45]}
    problem = load_problem("example:ur5/over_the_wall", changes={"obstacles": [block]})
    pairs = problem.collision.between("forearm_link", "block")
    assert pairs.sum() > 1
    location = Location(links=("forearm_link",), obstacle="block")
    point = contact_point(problem, location, problem.start)
    assert np.linalg.norm(point - block["position"]) < 0.3
    assert contact_point(problem, location, None) is None
    assert contact_point(problem, Location(joint="shoulder_pan_joint"), problem.start) is None


def test_the_place_is_marked_and_what_helps_is_listed(tmp_path):
    path = gantry(tmp_path, tube=BEYOND)
    shown = view_explanation(explanation := known(path, remedies=(REMEDY,), ineffective=("tube",)))
    (core,) = [item for item in shown.scene.items if item.name == "core"]
    assert core.surface.vertices.mean(axis=0) == pytest.approx(
        explanation.location.position, abs=1e-3
    )
    assert Layer.BLOCKED in shown.scene.layers
    (standing,) = shown.scene.trajectories
    assert standing.tool[0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)
    assert shown.panel["hint"].startswith("The arm 100 mm from where it must be; no trajectory")
    panel = shown.panel["findings"]
    assert panel["reason"] == f"unreachable: {explanation.message}"
    (line,) = panel["lines"]
    assert line["text"] == "wider"
    assert line["setting"] == "--set 'tube.rotation_tolerance=[[0.3, 0.3, .inf]]'"
    assert (len(line["details"]), line["details"][-1]) == (3, "not enough: 0.29 rad")
    assert panel["more"] == [f"By itself none of these helps: {ineffective_text(('tube',))}"]
    nothing = replace(explanation, remedies=(), ineffective=(), stopped_by="interrupt")
    panel = view_explanation(nothing).panel["findings"]
    assert panel["title"] == "No single change was found that makes it possible"
    assert panel["more"] == ["The search was ended early: there may be more"]


def test_what_is_in_the_way_has_a_colour_of_its_own_and_names_are_no_markup(tmp_path):
    name = "</script><b>post"
    explanation = known(gantry(tmp_path, [{**POST, "name": name}]), {"clearance": 0.4})
    assert explanation.location.obstacle == name
    shown = view_explanation(explanation)
    assert (Layer.OBSTACLES, name) in red(shown.scene)
    assert "<b>post" not in shown.html


def test_an_answer_is_shown_with_its_room_and_nothing_marked(tmp_path):
    shown = view_explanation(known(gantry(tmp_path), headrooms=(ROOM,)))
    assert red(shown.scene) == set()
    assert shown.scene.duration > 0
    findings = shown.panel["findings"]
    (line,) = findings["lines"]
    assert line["text"] == "not even so"
    assert line["details"][0] == "robot.limits.position.turn"
    assert "0.5 rad" in line["details"][1]
    assert shown.panel["trajectories"][0]["verdict"]["passed"]
    assert shown.panel["facts"][0][0] == "raising a limit by 10 % would save"


@pytest.mark.slow  # pages full of names, in a browser
def test_a_browser_shows_names_as_they_are(opened, tmp_path):
    """In one page all that look like markup; none becomes an element or runs."""
    all_of = "[...document.querySelectorAll('*')]"
    kinds = f"[...new Set({all_of}.map((one) => one.tagName))].sort().join()"
    handlers = f"{all_of}.filter((one) => [...one.attributes].some(({{name}}) => /^on/.test(name)))"
    tags = []
    for names in ([f"n{k}" for k in range(8)], HOSTILE):
        view_explanation(hostile(tmp_path, names)).save(tmp_path / "page.html")
        page = opened(tmp_path / "page.html")
        expressions = kinds, "document.scripts.length", f"{handlers}.length"
        tags.append([page.run(each) for each in expressions])
    assert tags[0] == tags[1]
    text = page.run("byId('findings').textContent").replace("\u200b", "")
    assert [name for name in HOSTILE if name not in text] == []


def test_what_cannot_be_posed_is_drawn_with_what_is_wrong(tmp_path):
    explanation = known(gantry(tmp_path, [POST]), {"start.joints": [1.5, 0.0]})
    assert explanation.problem is None
    shown = view_explanation(explanation)
    assert shown.scene.trajectories[0].tool[0] == pytest.approx([1.5, 0.0, 0.0])
    assert {layer for layer, _ in red(shown.scene)} >= {Layer.BLOCKED}
    assert "start: joint 'along' at 1.5 is outside" in shown.panel["findings"]["reason"]
    with pytest.raises(OptionError, match="cannot be drawn"):  # its tube contradicts itself
        view_explanation(known(gantry(tmp_path), {"tube.radius": -0.1}))
