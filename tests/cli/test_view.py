"""The commands view and plot with cycle files."""

import json
import re

import pytest
from cases import SLIDE, rest_to_rest
from shown_cycle import data_of

from tubeplanner.output.files.trajectory_writer import write_cycle_motion
from tubeplanner.task.cycle_file import load_cycle
from tubeplanner.task.motion import LegMotion, cycle_motion

START, END = [0.0, 0.0, 0.0], [0.4, 0.1, 0.2]
SLOW, FAST = 1.5, 0.1  # [s] of a move; motors can do the first
ANOTHER = ("--set", "moves.home.tube.radius=0.39")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A cycle, and a motion of it that passes and one that does not."""
    folder = tmp_path_factory.mktemp("cell")
    (folder / "slide.urdf").write_text(SLIDE)
    points = [[0.6, 0, 0.5], [0.65, 0.28, 0.5]]
    moves = [
        {"name": "out", "tube": {"points": points, "radius": 0.4}, "goal": {"joints": END}},
        {"event": "grip", "dwell": 0.1},
        {"attach": "part", "payload": {"mass": 1.0}},
        {
            "name": "home",
            "tube": {"points": points[::-1], "radius": 0.4},
            "goal": {"joints": START},
        },
    ]
    part = {"name": "part", "box": [0.05, 0.05, 0.05], "position": [0.6, 0.6, 0.1]}
    fields = {
        "format": "tubeplanner/cycle",
        "robot": {"urdf": "slide.urdf", "tool_frame": "tip"},
        "start": {"joints": START},
        "obstacles": [part],
        "collision": {"self": False},
        "moves": moves,
    }
    (folder / "cycle.yaml").write_text(json.dumps(fields))
    cycle = load_cycle(folder / "cycle.yaml")
    for name, duration in (("slow", SLOW), ("fast", FAST)):
        ends = ((START, END), (END, START))
        legs = [rest_to_rest(cycle.robot.joint_names, *pair, duration) for pair in ends]
        motion = cycle_motion(cycle, [LegMotion(leg) for leg in legs])
        write_cycle_motion(folder / f"{name}.json", motion)
    return folder


@pytest.mark.dear("makes a page of two motions")
def test_a_page_has_the_motions_of_files_their_verdicts_and_what_differs(folder, run):
    page = folder / "page.html"
    files = [folder / name for name in ("cycle.yaml", "slow.json", "fast.json")]
    status, out, _ = run("view", *files, *ANOTHER, "--html", page)
    assert status == 0
    assert "note: slow.json: passes every condition" in out
    assert re.search(r"note: fast.json: fails: .*out: effort", out)
    assert "what differs: tube of move 'home'" in out
    panel = data_of(page.read_text())
    assert [each["name"] for each in panel["trajectories"]] == ["slow.json", "fast.json"]
    assert len(panel["timelines"]) == 2


def test_a_figure_of_a_motion_made_for_another_cycle_says_so(folder, run):
    status, out, _ = run("plot", folder / "cycle.yaml", folder / "slow.json", *ANOTHER)
    assert status == 0
    assert "note: the trajectory was made for another cycle" in out


def test_a_cell_is_shown_before_anything_is_planned(folder, run):
    page = folder / "page.html"
    assert run("view", folder / "cycle.yaml", "--html", page)[0] == 0
    assert "closed cycle" not in page.read_text()
    assert "The arm at its start" in page.read_text()


@pytest.mark.parametrize("goal", [{"position": [0.65, 0.28, 0.5], "tolerance": 0.02}, None])
def test_a_cell_without_a_tube_is_shown_with_the_arm_at_its_start(goal, folder, run):
    wall = {"name": "wall", "box": [0.1, 0.1, 0.1], "position": [0.2, 0.9, 0.5]}
    fields = {
        "robot": {"urdf": "slide.urdf", "tool_frame": "tip"},
        "start": {"joints": START},
        "obstacles": [wall],
        **({} if goal is None else {"goal": goal}),
    }
    path, page = folder / "cell.yaml", folder / "cell.html"
    path.write_text(json.dumps(fields))
    status, out, _ = run("view", path, "--html", page)
    assert (status, out.count("note: there is no tube: the tool may be anywhere; ")) == (0, 1)
    data = data_of(page.read_text())
    labels = {layer["name"]: layer["label"] for layer in data["layers"]}
    assert "tube" not in labels and labels["obstacles"] == "Obstacles: wall"
    assert labels.get("reference") == (goal and "Goal of the tool, goal's ball")


@pytest.mark.slow  # draws a cycle
def test_a_figure_is_drawn_also_of_what_fails(folder, run, drawn):
    assert run("plot", folder / "cycle.yaml", folder / "fast.json")[0] == 0
    assert (folder / "fast.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("marks", "message"),
    [
        ({}, "bare.json has no marks"),
        ({"marks": [{"time": 0.0, "move": "other"}]}, "bare.json: marks are move other; the "),
    ],
)
def test_a_file_without_marks_or_with_others_is_refused(marks, message, folder, run):
    fields, bare = json.loads((folder / "slow.json").read_text()), folder / "bare.json"
    del fields["marks"]
    bare.write_text(json.dumps(fields | marks))
    for command in ("view", "plot"):
        status, _, error = run(command, folder / "cycle.yaml", bare)
        assert status == 2
        assert message in error
