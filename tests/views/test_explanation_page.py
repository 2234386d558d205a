"""view_explanation: blocked arm, blocking solids, remedies."""

from dataclasses import replace

import numpy as np
import pytest
from asked_problems import PLANAR
from browser_page import BrowserPage
from gantry import POST, gantry
from hostile_names import HOSTILE
from hostile_names import explained as hostile

from tubeplanner import Explanation, explain, load_problem, parse_problem, plan
from tubeplanner.errors import OptionError
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.views.blocked_arm import blocked_arm, contact_point
from tubeplanner.views.explanation_view import view_explanation
from tubeplanner.views.palette import BLOCKED_COLOR, rgb
from tubeplanner.views.scene import Layer

# The arm where it is blocked, and where solids touch.


PROBLEM = parse_problem(PLANAR)
HERE = np.array([0.4, -1.3])
REACH = 0.6  # of the two links together [m]


def found_with(place, configuration=None):
    result = PlanResult(PlanStatus.TUBE_BLOCKED, "", place, "refinement")
    result = replace(result, configuration=configuration)
    return Explanation("name", PROBLEM, result, None)


def test_the_arm_is_where_planning_met_what_blocks():
    shown = blocked_arm(PROBLEM, found_with(Place(), HERE))
    assert shown.name == "where it is blocked"
    np.testing.assert_allclose(shown.tool, PROBLEM.robot.tool_position(HERE[None]))


@pytest.mark.parametrize("away", [0.0, 0.1])
def test_the_arm_is_as_near_to_the_place_as_it_comes(away):
    target = np.array([0.6, 0.8, 0]) * (0.5 if away == 0 else REACH + away)
    shown = blocked_arm(PROBLEM, found_with(Place().at(target)))
    assert np.linalg.norm(shown.tool[0] - target) == pytest.approx(away, abs=1e-4)
    near = "100 mm from where it must be" if away else "where it is blocked"
    assert shown.name == near


def test_of_no_place_nothing_is_known():
    assert blocked_arm(PROBLEM, found_with(Place(joint="joint1"))) is None


def test_solids_touch_between_them():
    post = {"name": "post", "sphere": 0.05, "position": [0.45, -0.3, 0.0]}
    problem = parse_problem({**PLANAR, "obstacles": [post]})
    result = plan(problem, PlanOptions(quality="fast"))
    assert result.place.obstacle == "post"
    point = contact_point(problem, result.place, result.configuration)
    assert np.linalg.norm(point - post["position"]) < 0.1
    assert contact_point(problem, result.place, None) is None
    assert contact_point(problem, Place(joint="joint1"), HERE) is None


def test_of_a_link_of_several_pieces_the_deepest_counts():
    block = {"name": "block", "sphere": 0.05, "position": [0.3, -0.3, 0.45]}
    problem = load_problem("example:ur5/over_the_wall", changes={"obstacles": [block]})
    pairs = problem.collision.between("forearm_link", "block")
    assert pairs.sum() > 1
    point = contact_point(problem, Place(links=("forearm_link",), obstacle="block"), problem.start)
    assert np.linalg.norm(point - block["position"]) < 0.3


# The page of an explanation marks what blocks and where, and says what helps.


QUICK = PlanOptions(quality="fast")
BEYOND = {"points": [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]], "radius": 0.01}


def explained(path, changes=None):
    return explain(path, changes=changes, options=QUICK, time_limit=1000.0)


def red(scene):
    return {(item.layer, item.name) for item in scene.items if np.all(item.color == RED)}


RED = rgb(BLOCKED_COLOR)


def test_the_place_is_marked_and_what_helps_is_listed(tmp_path):
    found = explained(gantry(tmp_path, tube=BEYOND))
    shown = view_explanation(found)
    (core,) = [item for item in shown.scene.items if item.name == "core"]
    assert core.surface.vertices.mean(axis=0) == pytest.approx(found.place.position, abs=1e-3)
    panel = shown.panel["findings"]
    assert panel["reason"] == f"unreachable: {found.message}"
    assert [line["text"] for line in panel["lines"]] == [each.text for each in found.remedies]
    assert panel["lines"][0]["setting"] == "--set 'robot.limits.position.along=[0.0, 1.1]'"
    assert "radius of the tube as a whole" in panel["more"][0]
    assert Layer.BLOCKED in shown.scene.layers


def test_what_is_in_the_way_has_a_colour_of_its_own(tmp_path):
    found = explained(gantry(tmp_path, [POST]), {"clearance": 0.4})
    assert found.place.obstacle == POST["name"]
    assert (Layer.OBSTACLES, POST["name"]) in red(view_explanation(found).scene)


def test_an_answer_is_shown_with_its_room_and_nothing_marked(tmp_path):
    shown = view_explanation(explained(gantry(tmp_path)))
    assert red(shown.scene) == set()
    assert shown.scene.duration > 0
    assert shown.panel["findings"]["title"] == "How much worse one of these may become"
    assert shown.panel["findings"]["lines"]


def test_names_are_no_markup(tmp_path):
    post = {**POST, "name": "</script><b>post"}
    page = view_explanation(explained(gantry(tmp_path, [post]), {"clearance": 0.4})).html
    assert "<b>post" not in page


def test_a_browser_shows_names_as_they_are(browser, tmp_path):
    """In one page all that look like markup; none becomes an element or runs."""
    all_of = "[...document.querySelectorAll('*')]"
    kinds = f"[...new Set({all_of}.map((one) => one.tagName))].sort().join()"
    scripts = "document.scripts.length"
    handlers = f"{all_of}.filter((one) => [...one.attributes].some(({{name}}) => /^on/.test(name)))"
    opened = BrowserPage(browser, tmp_path / "profile")
    try:
        tags, told = [], ""
        for names in ([f"n{k}" for k in range(len(HOSTILE))], HOSTILE):
            view_explanation(hostile(tmp_path, names)).save(tmp_path / "page.html")
            opened.open((tmp_path / "page.html").as_uri(), 1400, 900)
            tags.append([opened.run(each) for each in (kinds, scripts, f"{handlers}.length")])
            told = opened.run("byId('findings').textContent")
        assert tags[0] == tags[1]
        assert opened.complaints == []
    finally:
        opened.close()
    assert [name for name in HOSTILE if name not in told.replace("\u200b", "")] == []


def test_the_arm_stands_where_it_is_blocked(tmp_path):
    found = explained(gantry(tmp_path, tube=BEYOND))
    shown = view_explanation(found)
    (standing,) = shown.scene.trajectories
    assert standing.tool[0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)
    assert shown.panel["hint"].startswith("The arm 100 mm from where it must be; no trajectory")


def test_what_cannot_be_posed_is_drawn_with_what_is_wrong(tmp_path):
    found = explained(gantry(tmp_path, [POST]), {"start.joints": [1.5, 0.0]})
    assert found.problem is None
    shown = view_explanation(found)
    assert shown.scene.trajectories[0].tool[0] == pytest.approx([1.5, 0.0, 0.0])
    assert {layer for layer, _ in red(shown.scene)} >= {Layer.BLOCKED}
    assert {Layer.TUBE, Layer.OBSTACLES, Layer.ARM} <= set(shown.scene.layers)
    assert shown.panel["findings"]["reason"].startswith("bad_input: start: joint 'along' at 1.5")


def test_a_tube_that_contradicts_itself_cannot_be_drawn(tmp_path):
    found = explained(gantry(tmp_path), {"tube.radius": -0.1})
    with pytest.raises(OptionError, match="cannot be drawn"):
        view_explanation(found)
