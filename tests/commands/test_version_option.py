"""Which build runs: what `--version`, `plan --json` and `check --json` say, and files do not."""

import json

import pytest

import tubeplanner
from tubeplanner.native import library
from tubeplanner.native.library import LIBRARY, NativeLibrary

PROBLEM = "example:two_link/around_a_post"


@pytest.mark.parametrize("build", ["native (c++, baseline)", "pure Python (for a test)"])
def test_the_version_names_the_build(build, run, monkeypatch):
    monkeypatch.setattr(library, "LIBRARY", NativeLibrary(None, build))
    assert run("--version") == (0, f"tubeplanner {tubeplanner.__version__}, {build}\n", "")


def test_plan_and_check_name_the_build_and_files_do_not(run, tmp_path):
    path = tmp_path / "t.json"
    _, out, _ = run("plan", PROBLEM, "-o", path, "--json")
    assert json.loads(out)["build"] == LIBRARY.build
    _, out, _ = run("check", PROBLEM, path, "--json")
    assert json.loads(out)["build"] == LIBRARY.build
    assert "build" not in json.loads(path.read_text())
