"""The page in use: every button pressed, the slider dragged, layers hidden, at three widths.

Pictures are compared where something must have changed, and nothing may be complained of.
"""

import numpy as np
import pytest
from browser_page import BrowserPage
from stored_trajectories import REFINEMENT, STOP

from tubeplanner import PlanningProblem, view
from tubeplanner.collision.obstacle import Obstacle

SIZES = [
    pytest.param(1400, 900, marks=pytest.mark.slow),
    pytest.param(800, 700, marks=pytest.mark.slow),
    (500, 900),
]
NAME = "<i>post</i>"  # names are text, never markup
HIDDEN_AT_FIRST = ("swept", "axes", "ghosts")


@pytest.fixture(scope="module")
def file(stored, tmp_path_factory):
    """A page of two motions around a post whose name looks like markup."""
    problem, fast = stored("two_link/around_a_post", REFINEMENT)
    _, slow = stored("two_link/around_a_post", STOP)
    (post,) = problem.obstacles
    named = PlanningProblem(
        problem.robot,
        problem.tube,
        problem.start,
        obstacles=[Obstacle(NAME, post.shapes)],
        self_collision=False,
    )
    path = tmp_path_factory.mktemp("page") / "page.html"
    view(named, fast, slow, names=["fast", "slow"]).save(path)
    return path


@pytest.fixture(scope="module")
def started(browser, tmp_path_factory):
    page = BrowserPage(browser, tmp_path_factory.mktemp("profile"))
    yield page
    page.close()


@pytest.fixture
def opened(started, file):
    """Return a function that opens the page in a window of a size, standing still."""

    def of(width=1400, height=900, path=file):
        started.open(f"{path.as_uri()}#t=0.3", width, height)
        return started

    yield of
    assert started.complaints == []


def scene_of(page):
    """Return the part of the picture that panel, tools and controls leave free."""
    room = page.run("covered()")
    height = page.run("window.innerHeight")
    return page.picture()[round(room["above"]) : height - round(room["below"]), room["left"] :]


def changed(before, after):
    """Return the share of points that differ."""
    return (abs(before - after).max(axis=2) > 20).mean()


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_every_button_is_pressed_and_every_layer_hidden(width, height, opened):
    page = opened(width, height)
    count = page.run("document.querySelectorAll('button').length")
    assert count > 14
    for k in range(count):
        page.run(f"document.querySelectorAll('button')[{k}].click()")
        page.run("stopRecording()")
    page.run(
        "setPanel(true); setOverlaid(false); setFollowing(false); setTime(0.3); see([1, 1, 1])"
    )
    assert page.run("playing") is False
    for layer in page.run("data.layers.map(({name}) => name)"):
        box = f"document.querySelectorAll('.layer input')[{page_index(page, layer)}]"
        shown = page.run(f"{box}.checked")
        assert shown == (layer not in HIDDEN_AT_FIRST)
        before = scene_of(page)
        page.run(f"{box}.click()")
        assert page.run(f"objectAt('{layer}').visible") is not shown
        assert changed(before, scene_of(page)) > 0
        page.run(f"{box}.click()")


def page_index(page, layer):
    """Return which box is that of a layer."""
    return page.run(f"data.layers.findIndex(({{name}}) => name === '{layer}')")


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_the_slider_is_dragged(width, height, opened):
    page = opened(width, height)
    duration = page.run("data.duration")
    before = scene_of(page)
    page.run("setPlaying(true)")
    page.drag("#slider", 0.3 / duration, 0.7)
    assert page.run("playing") is False
    assert page.run("time") == pytest.approx(0.7 * duration, abs=0.05 * duration)
    assert changed(before, scene_of(page)) > 0.002
    told = page.run("byId('readout').textContent")
    assert told.startswith(f"{1000 * page.run('time'):.0f} ms of")
    page.drag(".line", 0.2, 0.4)
    assert page.run("time") == pytest.approx(0.4 * duration, abs=0.01 * duration)


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_all_is_legible_and_the_arm_is_seen(width, height, opened):
    page = opened(width, height)
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
    assert len(np.unique(scene @ [1 << 16, 1 << 8, 1])) > 300
    assert page.run("byId('panel').classList.contains('open')") is (width > 640)


def test_the_eye_looks_from_where_a_button_says(opened):
    page = opened()
    away = "viewer.camera.position.clone().sub(viewer.controls.target).normalize().toArray()"
    for k, direction in enumerate(([0, 1, 0], [1, 0, 0], [0, 0, 1]), 1):  # the viewer has y up
        page.press(f"#views button:nth-child({k})")
        assert page.run(away) == pytest.approx(direction, abs=2e-3)
    page.press("#follow")
    before = page.run("viewer.controls.target.toArray()")
    page.run("setTime(0.5)")
    assert page.run("viewer.controls.target.distanceTo(toolPoint())") < 1e-9
    assert np.linalg.norm(np.subtract(page.run("toolPoint().toArray()"), before)) > 0.01
    page.press("#views button:nth-child(4)")
    outwards = page.run("upright(data.direction)")
    assert page.run(away) == pytest.approx(outwards, abs=1e-6)
    assert page.run("followed") is None


def test_motions_are_laid_over_each_other(opened):
    page = opened()
    beside = page.run("objectAt('arm', '1').position.toArray()")
    assert beside == pytest.approx(page.run("data.offset"))
    colors = "objectAt('arm', '1').getObjectByProperty('isMesh', true).material.color.getHex()"
    own, before = page.run(colors), scene_of(page)
    page.press("#overlay")
    assert page.run("objectAt('arm', '1').position.length()") == 0
    assert page.run("['tube', 'obstacles'].map((name) => objectAt(name, '1').visible)") == [
        False,
        False,
    ]
    assert page.run(colors) != own
    assert changed(before, scene_of(page)) > 0.05
    page.press("#overlay")
    assert page.run(colors) == own
    assert changed(before, scene_of(page)) < 0.001


def test_curves_say_what_the_data_say(opened):
    page = opened()
    page.press("#tabs [data-tab=speed]")
    told = page.run("[...document.querySelectorAll('.value')].map((each) => each.textContent)")
    speeds = page.run("data.trajectories.map(({speed, duration}) => at(speed, time, duration))")
    assert told == [f"{name} {v:.2f} m/s" for name, v in zip(("fast", "slow"), speeds, strict=True)]
    page.press("#tabs [data-tab=clearance]")
    told = page.run("byId('values').textContent")
    assert f"to obstacles {page.run('gaps[0].label.textContent')}"[:-5] in told
    assert NAME in told
    before = page.picture()
    page.press("#curves")
    assert page.run("byId('plot').offsetHeight") == 0
    assert changed(before, page.picture()) > 0.05


def test_the_line_between_the_closest_points_is_as_long_as_it_says(opened):
    page = opened()
    for time in (0.1, 0.4):
        page.run(f"setTime({time})")
        length = page.run("gaps[0].line.scale.y")
        told = float(page.run("gaps[0].label.textContent").removesuffix(" mm"))
        assert 1000 * length == pytest.approx(told, abs=0.6)  # points are rounded to 0.1 mm


def test_what_is_under_the_pointer_is_named(opened):
    page = opened()
    page.run("see([0, -0.001, 1])")
    page.settle()
    box = "new MeshCat.THREE.Box3().setFromObject(objectAt('obstacles', '0'))"
    middle = f"{box}.getCenter(new MeshCat.THREE.Vector3())"
    place = f"{middle}.project(viewer.camera)"
    x, y = page.run(
        f"(({{x, y}}) => [(x + 1) / 2 * innerWidth, (1 - y) / 2 * innerHeight])({place})"
    )
    page.hover(x, y)
    page.hover(x + 1, y)
    assert page.run("byId('pointed').textContent") == f"obstacle {NAME}"
    assert page.run("document.querySelectorAll('i').length") == 0
    page.hover(x, 45)
    page.hover(x + 1, 45)
    assert page.run("byId('pointed').hidden")


@pytest.mark.slow
def test_a_video_of_one_run_is_recorded(opened):
    page = opened()
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


@pytest.mark.slow
def test_pages_of_a_cone_and_of_ghosts(opened, stored, tmp_path):
    """Of an arm with many triangles: what moves is drawn where it is at that time."""
    path = tmp_path / "tray.html"
    view(*stored("ur5/level_tray", REFINEMENT)).save(path)
    page = opened(path=path)
    tip = "objectAt('rotation', '0').children[{}].matrixWorld.elements.slice(12, 15)"
    assert page.run("objectAt('rotation', '0').children.length") == 2
    page.run("viewer.render()")
    cone = page.run(tip.format(1))
    assert cone == pytest.approx(page.run("toolPoint().toArray()"), abs=5e-3)
    before = scene_of(page)
    page.run("show('ghosts', true)")
    assert changed(before, scene_of(page)) > 0.02
    assert page.run("objectAt('ghosts', '0').children.length") == 2
