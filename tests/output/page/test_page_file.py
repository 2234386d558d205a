"""The page in use: every button pressed, the slider dragged, layers hidden, at three widths.

Pictures are compared where something must have changed, and nothing may be complained of.
"""

import re

import numpy as np
import pytest
from cases import followed
from shown_cycle import motion_of, shown_cycle
from stored_trajectories import REFINEMENT, STOP

from tubeplanner import PlanningProblem, verify, view
from tubeplanner.geometry.solids import Obstacle
from tubeplanner.output.drawing import CARRIED_COLOR, WARNING_COLOR, rgb
from tubeplanner.output.page.viewer import view_cycle

pytestmark = pytest.mark.slow  # a browser that draws without a graphics card
USUAL, NARROW = (800, 600), (500, 900)
NAME = "<i>post</i>"  # names are text, never markup
RESET = (
    "setPanel(true); setOverlaid(false); setFollowing(false); setPlaying(false); setTime(0.3); "
    "see([1, 1, 1])"
)
HIDDEN_AT_FIRST = ("swept", "axes", "ghosts")


@pytest.fixture(scope="module")
def file(stored, tmp_path_factory):
    """A page of two motions around a post whose name looks like markup."""
    problem, fast = stored("two_link/around_a_post", REFINEMENT)
    _, slow = stored("two_link/around_a_post", STOP)
    (post,) = problem.obstacles
    obstacles = [Obstacle(NAME, post.shapes)]
    named = PlanningProblem(
        problem.robot, problem.tube, problem.start, obstacles=obstacles, self_collision=False
    )
    path = tmp_path_factory.mktemp("page") / "page.html"
    view(named, fast, slow, names=["fast", "slow"]).save(path)
    return path


@pytest.fixture
def page(browser_page, file):
    """The page that most tests look at: opened once, then as it was at first."""
    browser_page.complaints.clear()
    address = f"{file.as_uri()}#t=0.3"
    if browser_page.run("location.href") != address:
        browser_page.open(address, *USUAL)
        assert browser_page.run("time") == pytest.approx(0.3)
        assert browser_page.run("byId('panel').classList.contains('open')")
    browser_page.resize(*USUAL)
    browser_page.run(RESET)
    browser_page.settle()
    yield browser_page
    assert browser_page.complaints == []


def scene_of(page):
    """Return the part of the picture that panel, tools and controls leave free."""
    slack = page.run("covered()")
    height = page.run("window.innerHeight")
    return page.picture()[round(slack["above"]) : height - round(slack["below"]), slack["left"] :]


def at(page, time):
    """Return the scene at a time [s]."""
    page.run(f"setTime({time})")
    return scene_of(page)


def colours(picture):
    """Return the number of colours of a picture; 1 if blank."""
    return len(np.unique(picture @ [1 << 16, 1 << 8, 1]))


def near(picture, color, most):
    """Return the number of points near a colour."""
    return (abs(picture - 255 * rgb(color)).max(axis=2) < most).sum()


def changed(before, after):
    """Return the fraction of points that differ."""
    height = min(len(before), len(after))
    return (abs(before[:height] - after[:height]).max(axis=2) > 20).mean()


@pytest.mark.parametrize(("width", "height"), [(1400, 900), NARROW])
def test_all_is_legible_and_the_arm_is_seen(width, height, page):
    page.resize(width, height)
    page.settle()
    narrow = page.run(
        "[...document.querySelectorAll('#panel *, #controls *, #tools *')].filter((each) => "
        "!each.children.length && each.textContent.length > 5 && each.offsetWidth > 0 && "
        "each.offsetWidth < 30 && !each.matches('.band, .happens, option'))"
        ".map((each) => each.textContent)"
    )
    assert narrow == []
    outside = page.run(
        "[...document.querySelectorAll('button')].filter((each) => {"
        "const {left, right, top, bottom} = each.getBoundingClientRect();"
        "return left < 0 || top < 0 || right > innerWidth || bottom > innerHeight; })"
        ".map((each) => each.textContent)"
    )
    assert outside == []
    scene = scene_of(page)
    assert scene[..., 0].size > 0.2 * width * height
    assert colours(scene) > 300


def test_the_eye_looks_from_where_a_button_says(page):
    away = "viewer.camera.position.clone().sub(viewer.controls.target).normalize().toArray()"
    for k, direction in enumerate(([0, 1, 0], [1, 0, 0], [0, 0, 1]), 1):  # the viewer has y up
        page.press(f"#views button:nth-child({k})")
        assert page.run(away) == pytest.approx(direction, abs=2e-3)
    page.press("#follow")
    page.run("setTime(0.5)")
    assert page.run("viewer.controls.target.distanceTo(toolPoint())") < 1e-9
    page.press("#views button:nth-child(4)")
    outwards = page.run("upright(data.direction)")
    assert page.run(away) == pytest.approx(outwards, abs=1e-6)
    assert page.run("followed") is None


def test_motions_are_laid_over_each_other(page):
    beside = page.run("objectAt('arm', '1').position.toArray()")
    assert beside == pytest.approx(page.run("data.offset"))
    colors = "objectAt('arm', '1').getObjectByProperty('isMesh', true).material.color.getHex()"
    own, before = page.run(colors), scene_of(page)
    page.press("#overlay")
    assert page.run("objectAt('arm', '1').position.length()") == 0
    for name in ("tube", "obstacles"):
        assert page.run(f"objectAt('{name}', '1').visible") is False
    assert page.run(colors) != own
    assert changed(before, scene_of(page)) > 0.05
    page.press("#overlay")
    assert page.run(colors) == own


def test_curves_say_what_the_data_say(page):
    page.run("setCurves(true)")  # the window is too low to begin with them
    page.press("#tabs [data-tab=speed]")
    text = page.run("[...document.querySelectorAll('.value')].map((each) => each.textContent)")
    speeds = page.run("data.trajectories.map(({speed, duration}) => at(speed, time, duration))")
    assert text == [f"{name} {v:.2f} m/s" for name, v in zip(("fast", "slow"), speeds, strict=True)]
    page.press("#tabs [data-tab=clearance]")
    text = page.run("byId('values').textContent")
    assert f"to obstacles {page.run('gaps[0].label.textContent')}"[:-5] in text
    assert NAME in text
    page.press("#curves")
    assert page.run("byId('plot').offsetHeight") == 0


def test_what_is_under_the_pointer_is_named(page):
    page.run("see([0, -0.001, 1])")
    page.settle()
    box = "new MeshCat.THREE.Box3().setFromObject(objectAt('obstacles', '0'))"
    location = f"{box}.getCenter(new MeshCat.THREE.Vector3()).project(viewer.camera)"
    on_screen = "(({x, y}) => [(x + 1) / 2 * innerWidth, (1 - y) / 2 * innerHeight])"
    x, y = page.run(f"{on_screen}({location})")
    page.hover(x, y)
    page.hover(x + 1, y)
    assert page.run("byId('pointed').textContent") == f"obstacle {NAME}"
    assert page.run("document.querySelectorAll('i').length") == 0


def test_a_video_of_one_run_is_recorded(page):
    page.run("save = (blob) => { window.saved = [blob.size, blob.type]; }; true")
    page.press("#record")
    assert page.run("byId('record').textContent").startswith("Recording")
    page.wait("window.saved && !recorder")
    size, kind = page.run("window.saved")
    assert size > 1000
    assert kind.startswith("video/")
    assert page.run("byId('record').textContent") == "Record video"
    assert page.run("(delete window.MediaRecorder, whyNot())") == (
        "this browser has no MediaRecorder"
    )


def test_every_button_is_pressed_every_layer_hidden_and_the_slider_dragged(opened, file):
    page = opened(file, 0.29, *NARROW)
    assert not page.run("byId('panel').classList.contains('open')")
    before, duration = scene_of(page), page.run("data.duration")
    page.run("setPlaying(true)")
    page.drag("#slider", 0.3 / duration, 0.7)
    assert page.run("playing") is False
    assert page.run("time") == pytest.approx(0.7 * duration, abs=0.05 * duration)
    assert changed(before, scene_of(page)) > 0.002
    page.drag(".line", 0.2, 0.4)
    assert page.run("time") == pytest.approx(0.4 * duration, abs=0.01 * duration)
    count = page.run("document.querySelectorAll('button').length")
    assert count > 14
    for k in range(count):
        page.run(f"document.querySelectorAll('button')[{k}].click()")
        page.run("stopRecording()")
    page.run(f"{RESET}; setPanel(false); see([1, 1, 1])")  # the panel may cover what changes
    for k, layer in enumerate(page.run("data.layers.map(({name}) => name)")):
        box = f"document.querySelectorAll('.layer input')[{k}]"
        shown = page.run(f"{box}.checked")
        assert shown == (layer not in HIDDEN_AT_FIRST)
        before = scene_of(page)
        page.run(f"{box}.click()")
        assert page.run(f"objectAt('{layer}').visible") is not shown
        assert changed(before, scene_of(page)) > 0
        page.run(f"{box}.click()")


def test_the_arm_is_seen_and_moves_beside_panel_and_controls(opened, stored, tmp_path):
    problem, trajectory = stored("ur5/over_the_wall")
    path = tmp_path / "wall.html"
    view(problem, trajectory).save(path)
    page = opened(path, 0.2)
    text = page.run("byId('panel').textContent").replace("\u200b", "")
    for words in ("over_the_wall", "segment 2: radius 30 mm", "Space the links sweep"):
        assert words in text
    assert "0.25\u00d7" in page.run("byId('controls').textContent")
    assert "cannot show" not in page.run("document.body.innerText")
    start, middle = (at(page, t) for t in (0, trajectory.duration / 2))
    assert min(colours(start), colours(middle)) > 2000
    assert changed(start, middle) > 0.01
    runs = followed(problem, trajectory, [[0.02, 0, 0], [0.04, 0, 0], [0.05, 0, 0]])
    view(problem, trajectory, execution=runs).save(path)
    page = opened(path, 0)
    assert near(scene_of(page), WARNING_COLOR, 25) > 100  # where they leave the tube
    assert near(start, WARNING_COLOR, 25) < 20
    assert "Executed paths of the tool: 3 runs" in page.run("byId('panel').textContent")


def test_the_printed_page_is_one_with_the_verdict_and_a_picture(opened, stored, tmp_path):
    problem, trajectory = stored("ur5/over_the_wall")
    path = tmp_path / "wall.html"
    view(problem, trajectory, certificates=[verify(problem, trajectory)]).save(path)
    page = opened(path, 0.2)
    assert page.run("byId('verdict').textContent").startswith("certified, ")
    page.press("#more")
    assert "payload" in page.run("byId('trajectories').innerText")
    before = page.run("viewer.camera.view.enabled")
    assert len(re.findall(rb"/Type\s*/Page\b", page.printed())) == 1
    assert page.run("byId('picture').naturalWidth") > 500
    assert page.run("viewer.camera.view.enabled") == before


def test_a_motion_plays_by_itself_and_a_problem_alone_has_no_controls(opened, file, bundled):
    page = opened(file)
    assert page.run("byId('play').textContent") == "Pause"
    alone = file.with_name("alone.html")
    view(bundled("two_link/around_a_post")).save(alone)
    page = opened(alone)
    assert page.run("byId('controls').hidden")
    assert "at its start" in page.run("document.body.textContent")


def test_the_present_step_of_a_cycle_is_marked_and_parts_come_and_go(opened, tmp_path):
    """A cap, 2 % of all that is brown, is there only while it is carried."""
    cycle, path = shown_cycle(tmp_path), tmp_path / "cycle.html"
    view_cycle(cycle, [motion_of(cycle)]).save(path)
    present = "[...document.querySelectorAll('.band.present')].map((each) => each.textContent)"
    page = opened(path, 0)
    for time, bands, step in ((1.3, ["carry"], "carry"), (2.2, [], "grip 'open' (0.2 s)")):
        page.run(f"setTime({time})")
        assert page.run(present) == bands
        readout = page.run("byId('readout').textContent")
        assert f"{time:.3f} s of 3.300 s, {step}, tool at" in readout
    before, during, after = (near(at(page, time), CARRIED_COLOR, 60) for time in (1.0, 1.2, 3.0))
    assert during > 1.2 * max(before, after)
    assert min(before, after) > 50
