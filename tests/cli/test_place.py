"""`place` as a user meets it."""

import pytest
from gantry import BEST_DURATION, FLOOR, POST, gantry

from tubeplanner.cli import place as place_command

REGION = ("--region", "-0.3,-0.3,0,0", "--points", "8", "--quality", "fast")


@pytest.fixture(autouse=True)
def tried_here(here):
    """Places are tried in this process, which has all that is needed loaded."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("gantry")


@pytest.mark.dear("plans at some twenty places")
def test_the_best_place_is_written_and_planned_again(run, run_json, here, folder):
    problem, best, figure = gantry(folder, [FLOOR, POST]), folder / "best.yaml", folder / "map.png"
    options = ("--stands-on", "floor", "-o", best, "--plot", figure, "--processes", "3")
    status, out, err = run("place", problem, *REGION, *options)
    assert (status, err, here) == (0, "", [(3,)])
    assert "places tried, 8 on the grid" in out
    assert "as given: [0, 0, 0] m, yaw 0 rad (0.0 deg): 0.8" in out
    assert "best: [-0.3, 0, 0] m, yaw -0.9" in out
    assert "less than as given" in out
    assert f"problem: {best}\nmap: {figure}\njournal: {best.with_suffix('.jsonl')}\n" in out
    assert figure.read_bytes().startswith(b"\x89PNG")
    _, again = run_json("plan", best, "--quality", "fast")
    assert f"{again['duration']:.4f} s, " in out
    status, fields = run_json("place", problem, *REGION, *options, "--slack", "0")
    assert (status, fields["status"]) == (0, "success")
    assert fields["restored"] == fields["tried"] == len(fields["rows"])
    assert BEST_DURATION < fields["duration"] < 1.015 * BEST_DURATION
    assert fields["files"]["problem"] == str(best)
    assert fields["certificate"] is not None


def test_no_place_is_status_1_and_says_why(run, run_json, folder, tmp_path):
    problem, best = gantry(folder, [FLOOR, POST]), tmp_path / "best.yaml"
    inside = ("--region=-0.3,-0.3,0.3,0.3", *REGION[2:], "--stands-on", "floor")
    elsewhere = ("--set", "start.joints=[0.9, 0.9]", "-o", best)
    status, out, _ = run("place", problem, *inside, *elsewhere)
    assert status == 1
    assert "as given: [0, 0, 0] m, yaw 0 rad (0.0 deg): start: the tool is at [0.9, 0.9" in out
    assert "base in obstacle: 'base' in 'post'" in out
    assert "no place of 8 has a motion" in out
    assert not best.exists()
    status, fields = run_json("place", problem, *inside)
    assert (status, fields["status"], fields["duration"]) == (1, "no_trajectory", None)


def test_the_problem_is_not_overwritten(run, folder):
    problem = gantry(folder, [FLOOR, POST])
    status, _, err = run("place", problem, *REGION, "--stands-on", "floor", "-o", problem)
    assert (status, "is the same file as" in err) == (2, True)


def test_a_robot_may_stand_on_none_of_the_obstacles(run, folder, monkeypatch):
    stood_on = []

    def search(*_, stands_on, **__):
        stood_on.append(stands_on)
        raise KeyboardInterrupt

    monkeypatch.setattr(place_command, "search", search)
    for words in ((), ("--stands-on", "none"), ("--stands-on", "floor")):
        assert run("place", gantry(folder, [FLOOR, POST]), *REGION, *words)[0] == 130
    assert stood_on == [None, (), ("floor",)]
