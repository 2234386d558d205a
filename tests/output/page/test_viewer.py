"""The page: what is recorded for the viewer, what the panel says, where it is written."""

import html
import json
import os
import re
import subprocess
import sys
import tempfile
import webbrowser
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from cases import changed, followed
from shown_cycle import data_of, materials_of
from stored_trajectories import REFINEMENT, STOP, stored_path

from tubeplanner import (
    OptionError,
    OutputError,
    PlanningProblem,
    Seed,
    TrajectoryError,
    Tube,
    load_robot,
)
from tubeplanner.output.drawing import EXECUTED_COLOR, SEGMENT_COLORS, WARNING_COLOR
from tubeplanner.output.page.panel import panel_data
from tubeplanner.output.page.scene import Layer
from tubeplanner.output.page.viewer import recorded_commands, view
from tubeplanner.resources import bundled_folder

MEGABYTE = 1e6


def of_layer(scene, layer):
    return [item for item in scene.items if item.layer == layer]


def test_every_link_that_has_looks_has_a_mesh_and_the_page_can_be_mailed(shown):
    scene, page = shown("ur5/over_the_wall").scene, shown("ur5/over_the_wall").html
    urdf = scene.task.robot.urdf
    option_sets = {
        name for name in urdf.links if urdf.link_element(name).find("visual") is not None
    }
    drawn = {path for path in materials_of(recorded_commands(scene)) if "/arm/0/" in path}
    assert {path.split("/")[-2] for path in drawn} == option_sets
    assert MEGABYTE < len(page.encode()) < 4 * MEGABYTE
    assert "{{" not in page[:20000]
    loads = re.findall(r"""<(?:script|link|img|iframe)[^>]*(?:src|href)=["']?[^>]*""", page[:20000])
    assert loads == []
    assert "MIT" in page or "SPDX" in page


def test_the_tube_has_one_colour_per_segment_and_solids_are_there(shown):
    scene = shown("ur5/level_tray", REFINEMENT).scene
    materials = materials_of(recorded_commands(scene))
    for k, color in enumerate(SEGMENT_COLORS[:3]):
        segment = materials[f"/meshcat/tube/0/body_0/segment_{k}"]
        assert (segment["color"], segment["transparent"]) == (int(color[1:], 16), True)
    for obstacle in scene.task.obstacles:
        assert f"/meshcat/obstacles/0/body_0/{obstacle.name}" in materials
    for solid in scene.task.attached:
        assert f"/meshcat/carried/0/body_6/{solid.name}" in materials


def test_the_animation_is_the_trajectory(shown, stored):
    problem, trajectory = stored("two_link/around_a_post")
    scene = shown("two_link/around_a_post").scene
    (animation,) = (c for c in recorded_commands(scene) if c["type"] == "set_animation")
    last = {}
    for track in animation["animations"]:
        position = track["clip"]["tracks"][0]
        assert track["clip"]["fps"] == 1  # times are seconds
        assert position["keys"][0]["time"] == 0
        assert position["keys"][-1]["time"] == pytest.approx(trajectory.duration)
        last[track["path"]] = position["keys"][-1]["value"]
    q = trajectory.reordered(problem.robot.joint_names).position([trajectory.duration])
    expected = problem.robot.body_poses(q)[1][0]
    bodies = {problem.robot.link_body[item.name.split("/")[0]] for item in of_layer(scene, "arm")}
    for body in bodies - {0}:
        assert last[f"/meshcat/arm/0/body_{body}"] == pytest.approx(expected[body], abs=1e-9)


def test_the_links_stay_in_the_space_they_are_said_to_sweep(shown):
    scene = shown("two_link/around_a_post").scene
    (swept,) = of_layer(scene, Layer.SWEPT)
    low, high = swept.surface.vertices.min(axis=0), swept.surface.vertices.max(axis=0)
    for item in of_layer(scene, Layer.ARM)[1:]:
        for step in (0, 30, 60, -1):
            points = item.surface.moved(scene.trajectories[0].placement(step, item.body)).vertices
            assert (item.body == 0) or ((points > low - 0.02) & (points < high + 0.02)).all()


def test_the_panel_says_what_is_seen(shown):
    scene = shown("ur5/level_tray", REFINEMENT).scene
    data = panel_data(scene)
    assert data["title"] == "ur5/level_tray"
    assert data["trajectories"][0]["lasts"] == f"{scene.duration:.3f} s"
    labels = {layer["name"]: layer for layer in data["layers"]}
    assert "tray" in labels["carried"]["label"]
    assert labels["tool"]["scale"]["ticks"][-1] == f"{scene.peak_speed:.2f} m/s"
    radius = 1000 * scene.task.tube.radius[0]
    assert labels["tube"]["entries"][0]["text"] == f"segment 0: radius {radius:.3g} mm"
    assert not labels["swept"]["visible"]


def test_many_segments_are_named_by_the_first_few_and_boxes_by_their_sides(bundled):
    problem = bundled("two_link/around_a_post")
    points = np.column_stack([np.linspace(0.4, 0.5, 10), np.linspace(-0.3, 0.3, 10), np.zeros(10)])
    sections = [{"box": [0.2, 0.08], "up": [0, 0, 1]}] + [None] * 8
    tube = Tube(points, 0.05, cross_section=sections)
    entries = panel_data(view(problem.with_tube(tube)).scene)["layers"][1]["entries"]
    texts = [entry["text"] for entry in entries]
    assert len(texts) == 7
    assert texts[:2] == ["segment 0: box 200 x 80 mm", "segment 1: radius 50 mm"]
    assert "9 segments" in texts[-1]
    assert texts[-1].endswith("40 to 50 mm (of boxes, half the smaller side)")


def test_trajectories_stand_side_by_side(stored):
    problem, slow = stored("two_link/around_a_post")
    _, fast = stored("two_link/around_a_post", REFINEMENT)
    shown = view(problem, fast, slow, names=["fast", "slow"])
    scene = shown.scene
    assert scene.duration == slow.duration
    commands = recorded_commands(scene)
    placed = {c["path"]: c["matrix"] for c in commands if c["type"] == "set_transform"}
    assert placed["/meshcat/arm/1"][12:15] == pytest.approx(scene.frame.offset)
    assert np.count_nonzero(scene.frame.offset) == 1
    assert [label["text"][:4] for label in panel_data(scene)["labels"]] == ["fast", "slow"]


def test_without_a_trajectory_the_arm_is_at_its_start_or_its_seed(bundled):
    problem = bundled("ur5/over_the_wall")
    scene = view(problem).scene
    assert scene.duration == 0
    tool = problem.robot.tool_position(problem.start[None])[0]
    assert scene.trajectories[0].tool[0] == pytest.approx(tool)
    assert not [c for c in recorded_commands(scene) if c["type"] == "set_animation"]
    assert "at its start" in panel_data(scene)["hint"]
    tube, robot = Tube([[2.0, 0, 0], [2.0, 0.3, 0]], 0.05), bundled("two_link/around_a_post").robot
    scene = view(PlanningProblem(robot, tube, Seed(np.zeros(2)))).scene  # it leads nowhere
    assert "drawn at the seed" in scene.notes[0]
    assert panel_data(scene)["notes"] == list(scene.notes)


def test_joints_are_known_by_name_and_others_are_refused_by_it(shown, bundled, stored):
    problem, trajectory = stored("two_link/around_a_post")
    reordered = view(problem, trajectory.reordered(problem.robot.joint_names[::-1])).scene
    usual = shown("two_link/around_a_post").scene
    assert reordered.trajectories[0].tool == pytest.approx(usual.trajectories[0].tool)
    other = bundled("ur5/over_the_wall")
    with pytest.raises(TrajectoryError, match=r"elbow\.json: the trajectory moves the joints"):
        view(other, trajectory, names=["elbow.json"])
    with pytest.raises(OptionError, match="one each, all different"):
        view(other, trajectory, names=["a", "b"])


def test_a_link_whose_mesh_is_missing_is_drawn_by_its_collision_geometry(tmp_path, bundled):
    urdf = tmp_path / "arm.urdf"
    text = (bundled_folder() / "two_link/two_link.urdf").read_text()
    mesh = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual>'
    for replacement, note in ((mesh, "gone.stl"), ("", "no visual geometry")):
        urdf.write_text(re.sub(r"<visual>.*?</visual>", replacement, text, flags=re.S))
        problem = replace(bundled("two_link/around_a_post"), robot=load_robot(urdf, "hand"))
        scene = view(problem).scene
        assert note in scene.notes[0] and of_layer(scene, Layer.ARM)


def test_a_page_is_saved_whole_or_not_at_all_and_a_notebook_gets_it(shown, tmp_path):
    page = shown("two_link/around_a_post")
    frame = page._repr_html_()
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', frame).group(1)) == page.html
    page.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text() == page.html
    with pytest.raises(OutputError, match="does not exist"):
        page.save(tmp_path / "nowhere" / "page.html")


def test_what_a_name_holds_does_not_break_the_page(stored):
    problem, trajectory = stored("two_link/around_a_post")
    named = changed(problem, name="</script><b>&")
    page = view(named, trajectory, names=["</script>"]).html
    assert page.count("</script>") == 5
    assert data_of(page)["trajectories"][0]["name"] == "</script>"


@pytest.mark.slow  # a page is made in two processes
def test_the_page_is_the_same_in_another_process(tmp_path, run):
    """Whatever is a hash, a time or an address there."""
    stored = stored_path("two_link/around_a_post", STOP)
    pages = [tmp_path / name for name in ("here.html", "there.html")]
    here, there = (
        ["view", "example:two_link/around_a_post", str(stored), "--html", str(page)]
        for page in pages
    )
    assert run(*here)[0] == 0
    command = f"from tubeplanner.cli.main import main; main({there})"
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    subprocess.run([sys.executable, "-c", command], env=environment, check=True)
    assert pages[0].read_bytes() == pages[1].read_bytes()


@pytest.mark.parametrize(
    ("refused", "error", "message"),
    [
        ("tempfile.mkdtemp", OSError(28, "No space left on device"), "on device; name a file for"),
        ("tubeplanner.output.page.viewer.write_files", OutputError("no room"), "no room"),
    ],
)
def test_a_page_that_there_is_no_room_for_leaves_no_folder(
    refused, error, message, shown, monkeypatch, tmp_path
):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(refused, Mock(side_effect=error))
    with pytest.raises(OutputError, match=message):
        shown("two_link/around_a_post").open()
    assert list(tmp_path.iterdir()) == []


def test_the_command_says_where_the_page_is_if_no_browser_opens(monkeypatch, run):
    urls = []
    monkeypatch.setattr(webbrowser, "open", urls.append)
    status, out, _ = run("view", "example:two_link/around_a_post")
    assert status == 0
    assert "no browser could be opened" in out
    path = Path(re.search(r"view: (\S+\.html)", out).group(1))
    assert urls == [path.as_uri()]
    assert path.read_text().startswith("<!DOCTYPE html>")
    status, out, _ = run("view", "example:two_link/around_a_post", "--json")
    assert (status, Path(json.loads(out)["html"]).exists()) == (0, True)


@pytest.mark.dear("judges three files")
def test_the_command_shows_files_of_every_kind(stored, run, tmp_path):
    problem, trajectory = stored("two_link/around_a_post")
    names, page = ["t.json", "t.csv", "t.yaml"], tmp_path / "page.html"
    files = [tmp_path / name for name in names]
    for file in files:
        trajectory.save(file, problem)
    status, out, _ = run("view", "example:two_link/around_a_post", *files, "--html", page)
    assert status == 0
    assert out.endswith(f"view: {page}\n")
    verdicts = [line for line in out.splitlines() if "passes every condition" in line]
    assert verdicts == [f"note: {name}: passes every condition" for name in names]
    assert [motion["name"] for motion in data_of(page.read_text())["trajectories"]] == names


def test_executed_paths_are_lines_that_change_colour_outside_the_tube(stored):
    """Of three arms that follow the plan round a post, one stands 60 mm aside."""
    problem, trajectory = stored("two_link/around_a_post", REFINEMENT)
    runs = followed(problem, trajectory, [[0, 0, 0], [0, 0, 0.001], [0.06, 0, 0]])
    page = view(problem, trajectory, names=["plan"], execution=runs)
    scene = page.scene
    lines = {
        command["path"].rpartition("/")[2]: command["object"]
        for command in recorded_commands(scene)
        if command["type"] == "set_object" and "/executed/0/" in command["path"]
    }
    for name, color in (("inside", EXECUTED_COLOR), ("outside", WARNING_COLOR)):
        assert lines[name]["materials"][0]["color"] == int(color[1:], 16)
        assert lines[name]["object"]["type"] == "LineSegments"
    (executed,) = (each for each in panel_data(scene)["layers"] if each["name"] == "executed")
    assert executed["label"] == "Executed paths of the tool: 3 runs"
    assert [entry["color"] for entry in executed["entries"]] == [EXECUTED_COLOR, WARNING_COLOR]
    with pytest.raises(OptionError, match="execution goes with one trajectory, not 2"):
        view(problem, trajectory, trajectory, execution=runs)
