"""How fine pictures are, views that several tests look at, and the browser that opens pages."""

import os
import shutil
from functools import cache

import pytest
from browser_page import BrowserPage
from stored_trajectories import STOP

from tubeplanner import view
from tubeplanner.output import link_visuals
from tubeplanner.output.figures import figure_files
from tubeplanner.output.figures import rendering as rendered_solids
from tubeplanner.output.figures import space_panel as space_solids
from tubeplanner.output.page import motion_scene

NO_BROWSER = "no Chromium found (Debian: apt-get install --no-install-recommends chromium)"


@pytest.fixture(scope="session", autouse=True)
def quick_pictures():
    """Draw with few pixels, and read the meshes of a robot once; the content is the same."""
    known = {}

    def link_parts(robot, max_faces):
        placed = tuple((name, robot.link_placement[name].tobytes()) for name in robot.link_body)
        key = robot.urdf.xml, robot.urdf.path, placed, max_faces
        if key not in known:
            known[key] = link_visuals.link_parts(robot, max_faces)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure_files, "_DPI", 40)
        patch.setattr(rendered_solids, "_PIXELS", 60)
        for module in (motion_scene, space_solids):
            patch.setattr(module, "link_parts", link_parts)
        yield


@pytest.fixture
def undrawn(monkeypatch):
    """Save figures without drawing, which takes a second or two; return the saved bytes."""
    monkeypatch.setattr(figure_files, "figure_file", lambda figure, path: b"a figure")
    return b"a figure"


@pytest.fixture(scope="session")
def shown(stored):
    """Return a function from a bundled problem's name to the view of a stored trajectory."""
    return cache(lambda name, method=STOP: view(*stored(name, method)))


@pytest.fixture(scope="session")
def browser_page(tmp_path_factory):
    """The one Chromium of all tests, its page empty: started once, it takes seconds."""
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
    if path is None and os.environ.get("TUBEPLANNER_NEEDS_BROWSER"):
        pytest.fail(NO_BROWSER)
    if path is None:
        pytest.skip(NO_BROWSER)
    page = BrowserPage(path, tmp_path_factory.mktemp("profile"))
    yield page
    page.close()


@pytest.fixture
def opened(browser_page):
    """Return a function that opens a file in a window of a size, at a time [s] if one is given.

    No page may complain of anything.
    """
    browser_page.complaints.clear()

    def of(file, time=None, width=800, height=600):
        fragment = "" if time is None else f"#t={time}"
        browser_page.open(f"{file.as_uri()}{fragment}", width, height)
        return browser_page

    yield of
    assert browser_page.complaints == []
