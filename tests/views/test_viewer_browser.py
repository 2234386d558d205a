"""The page in a real browser: pictures are not blank, and time moves the arm.

Skipped where there is no Chromium, unless TUBEPLANNER_NEEDS_BROWSER says that there must be one.
"""

import re
import subprocess
from contextlib import suppress

import numpy as np
import pytest
from PIL import Image

from cases import followed, slow_but
from shown_cycle import motion_of, shown_cycle
from tubeplanner import view
from tubeplanner.views.cycle_view import view_cycle
from tubeplanner.views.palette import CARRIED_COLOR, SEGMENT_COLORS, WARNING_COLOR, rgb

PROBLEMS = ("ur5/over_the_wall", "panda/between_shelves", "two_link/around_a_post")
FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--disable-dev-shm-usage"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"),
    *("--virtual-time-budget=3000", "--window-size=1000,700"),
    "--run-all-compositor-stages-before-draw",  # else, on a busy machine, a picture may never come
    "--host-resolver-rules=MAP * ~NOTFOUND",  # no network
)
SCENE = slice(40, 380), slice(290, None)  # of a picture: neither panel nor controls


def _opened(command, address, folder):
    """Open an address, once more where the browser's virtual time stands still, as it may."""
    for profile, patience in (("profile", 50), ("other profile", 150)):
        with suppress(subprocess.TimeoutExpired):
            return subprocess.run(
                [*command, f"--user-data-dir={folder / profile}", address],
                capture_output=True,
                text=True,
                timeout=patience,
            )
    pytest.fail(f"{command[0]} did not end")


@pytest.fixture
def show(browser, tmp_path):
    """Return a function that opens a page and returns what the browser printed."""

    def of(page, *more, fragment=""):
        file = tmp_path / "page.html"
        page.save(file)
        done = _opened([browser, *FLAGS, *more], f"{file.as_uri()}{fragment}", tmp_path)
        assert "Uncaught" not in done.stderr, done.stderr
        return done.stdout

    return of


@pytest.fixture
def picture(show, tmp_path):
    def of(page, time):
        path = tmp_path / "picture.png"
        show(page, f"--screenshot={path}", fragment=f"#t={time}")
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB")).astype(int)

    return of


@pytest.mark.parametrize("name", slow_but(("two_link/around_a_post",), PROBLEMS))
def test_the_arm_is_seen_and_moves(name, picture, stored):
    problem, trajectory = stored(name)
    page = view(problem, trajectory)
    start, middle = picture(page, 0), picture(page, trajectory.duration / 2)
    for image in (start, middle):
        assert len(np.unique(image @ [1 << 16, 1 << 8, 1])) > 2000  # a blank page has one
    changed = (abs(start - middle).max(axis=2) > 30)[SCENE]
    assert changed.mean() > 0.01
    low, high = np.array([rgb(color) for color in SEGMENT_COLORS[:3]]).argmax(axis=1)[[0, 1]]
    assert (low, high) == (2, 0)  # blue first, orange second: both tints must be in the picture
    red, blue = start[SCENE][..., 0], start[SCENE][..., 2]
    assert (red - blue > 25).mean() > 0.003
    assert (blue - red > 25).mean() > 0.003


def test_the_panel_and_the_controls_are_there(show, stored):
    problem, trajectory = stored("ur5/over_the_wall")
    text = show(view(problem, trajectory), "--dump-dom", fragment="#t=0.2")
    shown = re.sub(r"<[^>]*>", "", text[text.index('<div id="panel"') :][:30000])
    for words in (
        "over_the_wall",
        "segment 2: radius 30 mm",
        "Space the links sweep",
        "0.25\u00d7",
    ):
        assert words in shown.replace("\u200b", "")
    assert f"200 ms of {1000 * trajectory.duration:.0f} ms" in shown
    assert "cannot show" not in shown


@pytest.mark.slow
def test_it_plays_by_itself(show, stored):
    problem, trajectory = stored("two_link/around_a_post")
    text = show(view(problem, trajectory), "--dump-dom")
    assert re.search(r'id="play"[^>]*>Pause<', text)


def test_a_problem_alone_has_no_controls(show):
    from tubeplanner import load_problem

    text = show(view(load_problem("example:two_link/around_a_post")), "--dump-dom")
    assert re.search(r'id="controls" hidden', text)
    assert "at its start" in text


def test_the_present_step_of_a_cycle_is_marked_and_parts_come_and_go(show, picture, tmp_path):
    """A cap, 2 % of all that is brown, is there only while it is carried."""
    cycle = shown_cycle(tmp_path)
    page = view_cycle(cycle, [motion_of(cycle)])
    for time, present, told in ((1.3, ["carry"], "carry"), (2.2, [], "grip 'open' (0.2 s)")):
        text = show(page, "--dump-dom", fragment=f"#t={time}")
        assert re.findall(r'class="band present"[^>]*>([^<]*)<', text) == present
        assert f"{1000 * time:.0f} ms</b> of 3300 ms, <b>{told}</b>, tool at" in text
    assert text.count('class="mark"') == 6
    before, during, after = (picture(page, time) for time in (1.0, 1.2, 3.0))
    brown = [
        (abs(image[SCENE] - 255 * rgb(CARRIED_COLOR)).max(axis=2) < 60).sum()
        for image in (before, during, after)
    ]
    assert brown[1] > 1.2 * max(brown[0], brown[2])
    assert min(brown) > 50


def test_executed_paths_are_seen_where_they_leave_the_tube(picture, show, stored):
    """Of arms that stand 20 mm aside, hidden again where nothing is executed."""
    problem, trajectory = stored("ur5/over_the_wall")
    runs = followed(problem, trajectory, [[0.02, 0, 0], [0.04, 0, 0], [0.05, 0, 0]])
    with_runs = view(problem, trajectory, execution=runs)
    warning = rgb(WARNING_COLOR) * 255
    seen = [
        (abs(picture(page, 0)[SCENE] - warning).max(axis=2) < 25).sum()
        for page in (with_runs, view(problem, trajectory))
    ]
    assert seen[0] > 100
    assert seen[1] < 20
    assert "Executed paths of the tool: 3 runs" in show(with_runs, "--dump-dom")
