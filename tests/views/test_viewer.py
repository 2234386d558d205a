"""Meshcat views, in the process and in a browser."""

import html
import json
import os
import re
import subprocess
import sys
import tempfile
import webbrowser
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from shown_cycle import motion_of, shown_cycle
from stored_trajectories import REFINEMENT, STOP, stored_path

import tubeplanner
from cases import PROBLEMS, followed, slow_but
from tubeplanner import OptionError, OutputError, TrajectoryError, load_problem
from tubeplanner.collision.link_elements import read_geometry
from tubeplanner.commands.cli import main
from tubeplanner.files.export import trajectory_csv, trajectory_json, trajectory_ros
from tubeplanner.views.cycle_view import view_cycle
from tubeplanner.views.page_panel import panel_data
from tubeplanner.views.palette import (
    CARRIED_COLOR,
    EXECUTED_COLOR,
    SEGMENT_COLORS,
    WARNING_COLOR,
    rgb,
)
from tubeplanner.views.scene import Layer
from tubeplanner.views.viewer import recorded_commands, view

# The page: what is recorded for the viewer, what the panel says, where it is written.


MEGABYTE = 1e6
QUICK = ("two_link/around_a_post", "ur5/over_the_wall", "panda/between_shelves")


@pytest.fixture(scope="module")
def shown(stored):
    made = {}

    def of(name):
        if name not in made:
            problem, trajectory = stored(name)
            made[name] = view(problem, trajectory)
        return made[name]

    return of


def objects(commands):
    """Return the material of every object, by its path."""
    return {
        command["path"]: command["object"]["materials"][0]
        for command in commands
        if command["type"] == "set_object"
    }


@pytest.mark.parametrize("name", slow_but(QUICK, PROBLEMS))
def test_every_link_that_has_looks_has_a_mesh(name, shown):
    scene = shown(name).scene
    looks = {link.name for link in read_geometry(scene.problem.robot).links if link.visuals}
    drawn = {path for path in objects(recorded_commands(scene)) if "/arm/0/" in path}
    assert {path.split("/")[-2] for path in drawn} == looks
    assert scene.notes == ()


@pytest.mark.parametrize("name", slow_but(QUICK, PROBLEMS))
def test_a_page_can_be_mailed(name, shown):
    page = shown(name).html
    assert MEGABYTE < len(page.encode()) < 4 * MEGABYTE
    assert "{{" not in page[:20000]
    loads = re.findall(r"""<(?:script|link|img|iframe)[^>]*(?:src|href)=["']?[^>]*""", page[:20000])
    assert loads == []
    assert "MIT" in page or "SPDX" in page


def test_the_tube_has_one_colour_per_segment(shown):
    scene = shown("ur5/over_the_wall").scene
    materials = objects(recorded_commands(scene))
    colors = [materials[f"/meshcat/tube/0/body_0/segment_{k}"]["color"] for k in range(3)]
    assert colors == [int(color[1:], 16) for color in SEGMENT_COLORS[:3]]
    assert all(materials[f"/meshcat/tube/0/body_0/segment_{k}"]["transparent"] for k in range(3))


def test_obstacles_and_what_is_carried_are_there(shown):
    scene = shown("ur10/onto_a_conveyor").scene
    paths = objects(recorded_commands(scene))
    for obstacle in scene.problem.obstacles:
        assert f"/meshcat/obstacles/0/body_0/{obstacle.name}" in paths
    for solid in scene.problem.attached:
        assert f"/meshcat/carried/0/body_6/{solid.name}" in paths


@pytest.mark.parametrize("name", ["two_link/around_a_post", "panda/between_shelves"])
def test_the_animation_is_the_trajectory(name, shown, stored):
    problem, trajectory = stored(name)
    scene = shown(name).scene
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


def of_layer(scene, layer):
    return [item for item in scene.items if item.layer == layer]


def test_the_tool_is_where_the_path_is(shown):
    scene = shown("ur5/over_the_wall").scene
    trajectory = scene.trajectories[0]
    point = next(item for item in of_layer(scene, Layer.TOOL) if item.name == "point")
    for step in (0, 40, -1):
        placed = point.surface.moved(trajectory.placement(step, point.body)).vertices
        assert placed.mean(axis=0) == pytest.approx(trajectory.tool[step], abs=1e-3)


def test_the_speed_is_how_fast_the_tool_moves(shown):
    trajectory = shown("ur5/over_the_wall").scene.trajectories[0]
    moved = np.linalg.norm(np.diff(trajectory.tool, axis=0), axis=1) / np.diff(trajectory.time)
    between = (trajectory.speed[1:] + trajectory.speed[:-1]) / 2
    assert moved == pytest.approx(between, abs=0.03)


def test_the_links_stay_in_the_space_they_are_said_to_sweep(shown):
    scene = shown("panda/between_shelves").scene
    (swept,) = of_layer(scene, Layer.SWEPT)
    low, high = swept.surface.vertices.min(axis=0), swept.surface.vertices.max(axis=0)
    for item in of_layer(scene, Layer.ARM):
        if item.body == 0:
            continue
        for step in (0, 30, 60, -1):
            points = item.surface.moved(scene.trajectories[0].placement(step, item.body)).vertices
            assert (points > low - 0.02).all()
            assert (points < high + 0.02).all()


def test_the_panel_says_what_is_seen(shown):
    scene = shown("ur10/onto_a_conveyor").scene
    data = panel_data(scene)
    assert data["title"] == "ur10/onto_a_conveyor"
    (trajectory,) = data["trajectories"]
    assert trajectory["lasts"] == f"{1000 * scene.duration:.0f} ms"
    labels = {layer["name"]: layer for layer in data["layers"]}
    assert "carried_box" in labels["carried"]["label"]
    assert labels["tool"]["scale"]["ticks"][-1] == f"{scene.peak_speed:.2f} m/s"
    assert labels["tube"]["entries"][0]["text"] == "segment 0: radius 30 mm"
    assert not labels["swept"]["visible"]
    assert json.loads(json.dumps(data)) == data


def test_many_segments_are_named_by_the_first_few():
    problem = load_problem("example:two_link/around_a_post")
    points = np.column_stack([np.linspace(0.4, 0.5, 10), np.linspace(-0.3, 0.3, 10), np.zeros(10)])
    tube = tubeplanner.Tube(points, 0.05)
    longer = tubeplanner.PlanningProblem(problem.robot, tube, problem.start)
    entries = panel_data(view(longer).scene)["layers"][1]["entries"]
    assert len(entries) == 7
    assert "9 segments" in entries[-1]["text"]


def test_trajectories_stand_side_by_side(stored):
    problem, slow = stored("ur5/over_the_wall")
    _, fast = stored("ur5/over_the_wall", "refinement")
    shown = view(problem, fast, slow, names=["fast", "slow"])
    scene = shown.scene
    assert scene.duration == slow.duration
    commands = recorded_commands(scene)
    placed = {c["path"]: c["matrix"] for c in commands if c["type"] == "set_transform"}
    assert placed["/meshcat/arm/1"][12:15] == pytest.approx(scene.frame.offset)
    assert np.count_nonzero(scene.frame.offset) == 1
    assert [label["text"][:4] for label in panel_data(scene)["labels"]] == ["fast", "slow"]
    assert len(shown.html) < 4 * MEGABYTE


def test_without_a_trajectory_the_arm_is_at_its_start():
    problem = load_problem("example:ur5/over_the_wall")
    scene = view(problem).scene
    assert scene.duration == 0
    assert scene.trajectories[0].tool[0] == pytest.approx(
        problem.robot.tool_position(problem.start[None])[0]
    )
    commands = recorded_commands(scene)
    assert not [c for c in commands if c["type"] == "set_animation"]
    assert "at its start" in panel_data(scene)["hint"]


def test_a_seed_that_leads_nowhere_is_said():
    problem = load_problem("example:two_link/around_a_post")
    tube = tubeplanner.Tube([[2.0, 0, 0], [2.0, 0.3, 0]], 0.05)
    seed = tubeplanner.Seed(np.array([0.1, 0.2]))
    far = tubeplanner.PlanningProblem(problem.robot, tube, seed)
    scene = view(far).scene
    assert "drawn at the seed" in scene.notes[0]
    assert panel_data(scene)["notes"] == list(scene.notes)


def test_joints_are_known_by_name(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    turned = trajectory.reordered(problem.robot.joint_names[::-1])
    assert view(problem, turned).scene.trajectories[0].tool == pytest.approx(
        view(problem, trajectory).scene.trajectories[0].tool
    )


def test_a_trajectory_of_other_joints_is_refused_by_name(bundled, stored):
    problem = bundled("ur5/over_the_wall")
    _, other = stored("two_link/around_a_post")
    with pytest.raises(TrajectoryError, match=r"elbow\.json: the trajectory moves the joints"):
        view(problem, other, names=["elbow.json"])
    with pytest.raises(OptionError, match="one each, all different"):
        view(problem, other, names=["a", "b"])


def test_a_link_whose_mesh_is_missing_is_drawn_by_its_collision_geometry(tmp_path):
    urdf = tmp_path / "arm.urdf"
    source = Path(tubeplanner.__file__).parents[2] / "robots" / "two_link" / "two_link.urdf"
    text = source.read_text()
    looks = re.search(r"<visual>.*?</visual>", text, re.S).group(0)
    mesh = '<visual><geometry><mesh filename="gone.stl"/></geometry></visual>'
    urdf.write_text(text.replace(looks, mesh))
    robot = tubeplanner.load_robot(urdf, "hand")
    problem = load_problem("example:two_link/around_a_post")
    scene = view(tubeplanner.PlanningProblem(robot, problem.tube, problem.start)).scene
    assert "gone.stl" in scene.notes[0]
    urdf.write_text(re.sub(r"<visual>.*?</visual>", "", text, flags=re.S))
    robot = tubeplanner.load_robot(urdf, "hand")
    scene = view(tubeplanner.PlanningProblem(robot, problem.tube, problem.start)).scene
    assert "no visual geometry" in scene.notes[0]
    assert of_layer(scene, Layer.ARM)


def test_a_notebook_gets_the_whole_page(shown):
    page = shown("two_link/around_a_post")
    frame = page._repr_html_()
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', frame).group(1)) == page.html


def test_what_a_name_holds_does_not_break_the_page(stored):
    problem, trajectory = stored("two_link/around_a_post")
    named = tubeplanner.PlanningProblem(
        problem.robot, problem.tube, problem.start, name="</script><b>&"
    )
    page = view(named, trajectory, names=["</script>"]).html
    assert page.count("</script>") == 5
    data = re.search(r'id="data">(.*?)</script>', page, re.S).group(1)
    assert json.loads(data)["trajectories"][0]["name"] == "</script>"


def test_a_page_is_saved_whole_or_not_at_all(shown, tmp_path):
    page = shown("two_link/around_a_post")
    page.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text() == page.html
    with pytest.raises(OutputError, match="does not exist"):
        page.save(tmp_path / "nowhere" / "page.html")


@pytest.mark.slow
def test_the_page_is_the_same_in_another_process(tmp_path):
    """Whatever is a hash, a time or an address there."""
    problem, trajectory = "two_link/around_a_post", stored_path("two_link/around_a_post", STOP)
    pages = [tmp_path / name for name in ("here.html", "there.html")]
    here, there = (
        ["view", f"example:{problem}", str(trajectory), "--html", str(page)] for page in pages
    )
    assert main(here) == 0
    command = f"from tubeplanner.commands.cli import main; main({there})"
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    subprocess.run([sys.executable, "-c", command], env=environment, check=True)
    assert pages[0].read_bytes() == pages[1].read_bytes()


@pytest.mark.parametrize("found", [True, False])
def test_a_page_is_opened_in_a_browser(found, shown, monkeypatch):
    asked = []
    monkeypatch.setattr(webbrowser, "open", lambda url: asked.append(url) or found)
    path, opened = shown("two_link/around_a_post").open()
    assert opened is found
    assert asked == [path.as_uri()]
    assert path.read_text().startswith("<!DOCTYPE html>")


@pytest.mark.parametrize("refused", ["mkdtemp", "write_files"])
def test_a_page_that_there_is_no_room_for_leaves_no_folder(refused, shown, monkeypatch, tmp_path):
    def full(*_, **__):
        if refused == "mkdtemp":
            raise OSError(28, "No space left on device")
        raise OutputError("no room")

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    where = "tempfile" if refused == "mkdtemp" else "tubeplanner.views.viewer"
    monkeypatch.setattr(f"{where}.{refused}", full)
    message = "no room" if refused == "write_files" else "No space left on device; name a file for"
    with pytest.raises(OutputError, match=message):
        shown("two_link/around_a_post").open()
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def files(stored, tmp_path):
    problem, trajectory = stored("two_link/around_a_post")
    (tmp_path / "t.json").write_text(trajectory_json(trajectory))
    samples = trajectory.sample(500)
    (tmp_path / "t.csv").write_text(trajectory_csv(problem.robot.joint_names, samples))
    (tmp_path / "t.yaml").write_text(trajectory_ros(problem.robot.joint_names, samples))
    return tmp_path


def test_the_command_shows_files_of_every_kind(files, capsys):
    page = files / "page.html"
    names = [str(files / f"t.{kind}") for kind in ("json", "csv", "yaml")]
    assert main(["view", "example:two_link/around_a_post", *names, "--html", str(page)]) == 0
    out = capsys.readouterr().out
    assert out.endswith(f"view: {page}\n")
    assert [line for line in out.splitlines() if "passes every condition" in line] == [
        f"note: t.{kind}: passes every condition" for kind in ("json", "csv", "yaml")
    ]
    data = re.search(r'id="data">(.*?)</script>', page.read_text(), re.S).group(1)
    assert [m["name"] for m in json.loads(data)["trajectories"]] == ["t.json", "t.csv", "t.yaml"]


def test_the_command_says_where_the_page_is_if_no_browser_opens(monkeypatch, capsys):
    monkeypatch.setattr(webbrowser, "open", lambda url: False)
    assert main(["view", "example:two_link/around_a_post"]) == 0
    told = capsys.readouterr().out
    assert "no browser could be opened" in told
    assert Path(re.search(r"view: (\S+\.html)", told).group(1)).exists()
    assert main(["view", "example:two_link/around_a_post", "--json"]) == 0
    assert Path(json.loads(capsys.readouterr().out)["html"]).exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--html", "page.png"], "name a file that ends in .html"),
        (["--html", "nowhere/page.html"], "does not exist"),
        (["gone.json"], "gone.json"),
    ],
)
def test_bad_arguments_are_named(arguments, told, capsys):
    assert main(["view", "example:two_link/around_a_post", *arguments]) == 2
    assert told in capsys.readouterr().err


def test_a_file_for_another_robot_is_named(files, capsys):
    assert main(["view", "example:ur5/over_the_wall", str(files / "t.json")]) == 2
    assert "t.json: the trajectory moves the joints" in capsys.readouterr().err


def test_planning_writes_the_page_with_its_other_files(tmp_path, capsys):
    page, trajectory = tmp_path / "t.html", tmp_path / "t.json"
    asked = ["plan", "example:two_link/around_a_post", "-o", str(trajectory), "--html", str(page)]
    assert main(asked) == 0
    assert f"view: {page}" in capsys.readouterr().out
    assert "refinement" in page.read_text()
    trajectory.unlink()
    assert main([*asked[:-1], str(tmp_path / "t.txt")]) == 2
    assert not trajectory.exists()


def test_boxes_are_named_by_their_sides():
    problem = load_problem("example:two_link/around_a_post")
    points = np.column_stack([np.linspace(0.4, 0.5, 10), np.linspace(-0.3, 0.3, 10), np.zeros(10)])
    sections = [{"box": [0.2, 0.08], "up": [0, 0, 1]}] + [None] * 8
    tube = tubeplanner.Tube(points, 0.05, cross_section=sections)
    boxed = tubeplanner.PlanningProblem(problem.robot, tube, problem.start)
    entries = panel_data(view(boxed).scene)["layers"][1]["entries"]
    assert entries[0]["text"] == "segment 0: box 200 x 80 mm"
    assert entries[1]["text"] == "segment 1: radius 50 mm"
    assert entries[-1]["text"].endswith("40 to 50 mm (of boxes, half the smaller side)")


@pytest.fixture(scope="module")
def with_runs(stored):
    """Three arms that follow the plan over the wall; one stands 20 mm too far ahead."""
    problem, trajectory = stored("ur5/over_the_wall", REFINEMENT)
    execution = followed(problem, trajectory, [[0, 0, 0], [0, 0, 0.001], [0.02, 0, 0]])
    return view(problem, trajectory, names=["plan"], execution=execution)


def test_executed_paths_are_lines_that_change_colour_outside_the_tube(with_runs):
    scene = with_runs.scene
    found = {
        command["path"].rpartition("/")[2]: command["object"]
        for command in recorded_commands(scene)
        if command["type"] == "set_object" and "/executed/0/" in command["path"]
    }
    for name, color in (("inside", EXECUTED_COLOR), ("outside", WARNING_COLOR)):
        assert found[name]["materials"][0]["color"] == int(color[1:], 16)
        assert found[name]["object"]["type"] == "LineSegments"
    tube = scene.problem.tube
    assert len(scene.executed.outside) > 10
    ends = scene.executed.inside.reshape(-1, 3)
    assert (tube.margin(ends).max(axis=1) >= 0).all()


def test_the_panel_says_which_runs_are_seen(with_runs):
    layers = {layer["name"]: layer for layer in panel_data(with_runs.scene)["layers"]}
    executed = layers["executed"]
    assert executed["label"] == "Executed paths of the tool: 3 runs"
    assert [entry["color"] for entry in executed["entries"]] == [EXECUTED_COLOR, WARNING_COLOR]
    assert executed["visible"]
    assert MEGABYTE < len(with_runs.html) < 4 * MEGABYTE


def test_the_planned_path_is_thin_among_executed_ones(with_runs, stored):
    def thickness(scene):
        path = next(item for item in of_layer(scene, Layer.TOOL) if item.name == "path")
        ends = path.surface.vertices.reshape(-1, 11, 3)  # rings about the path
        return np.ptp(ends[len(ends) // 2], axis=0).max()

    usual = view(*stored("ur5/over_the_wall", REFINEMENT)).scene
    assert thickness(with_runs.scene) < 0.5 * thickness(usual)
    assert "executed" not in [layer["name"] for layer in panel_data(usual)["layers"]]


def test_runs_of_several_trajectories_are_refused(stored):
    problem, trajectory = stored("ur5/over_the_wall", REFINEMENT)
    execution = followed(problem, trajectory, [[0, 0, 0]])
    with pytest.raises(OptionError, match="execution goes with one trajectory, not 2"):
        view(problem, trajectory, trajectory, execution=execution)
    with pytest.raises(OptionError, match="not 0"):
        view(problem, execution=execution)


# The page in a real browser: pictures are not blank, and time moves the arm.


BROWSER_PROBLEMS = ("ur5/over_the_wall", "panda/between_shelves", "two_link/around_a_post")
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


@pytest.mark.parametrize("name", slow_but(("two_link/around_a_post",), BROWSER_PROBLEMS))
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
