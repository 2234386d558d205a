"""The browser in which pages are opened."""

import os
import shutil

import pytest

TOLD = "no Chromium found (Debian: apt-get install --no-install-recommends chromium)"


@pytest.fixture(scope="session")
def browser():
    """Return where Chromium is; skip without one, unless TUBEPLANNER_NEEDS_BROWSER asks for it."""
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "chrome"))), None)
    if path is None and os.environ.get("TUBEPLANNER_NEEDS_BROWSER"):
        pytest.fail(TOLD)
    if path is None:
        pytest.skip(TOLD)
    return path
