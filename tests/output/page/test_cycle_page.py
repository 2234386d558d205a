"""view_cycle: moved parts, scene, panel."""

import json
from dataclasses import replace

import numpy as np
import pytest
from shown_cycle import GRIP, RELEASE, at, data_of, materials_of, motion_of, shown_cycle

from tubeplanner import OptionError, ProblemError, Tube
from tubeplanner.geometry.solids import Obstacle
from tubeplanner.output.curves import Stop, Timeline, cycle_timeline
from tubeplanner.output.drawing import SEGMENT_COLORS
from tubeplanner.output.page.scene import moved_parts
from tubeplanner.output.page.viewer import recorded_commands, view_cycle
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.steps import Attach, Detach
from tubeplanner.trajectory.parts import Mark

TOLERANCE = 1e-12  # [m]


@pytest.fixture(scope="module")
def cycle(tmp_path_factory):
    return shown_cycle(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def motion(cycle):
    return motion_of(cycle)


@pytest.fixture(scope="module")
def page(cycle, motion):
    return view_cycle(cycle, [motion], ["motion.json"])


@pytest.fixture(scope="module")
def seen(cycle, motion):
    """Times, tool frames, which are the last body's, and the parts by name."""
    instants = {mark.time for mark in motion.marks}
    time = np.array(sorted({*np.linspace(0, motion.trajectory.duration, 100), *instants}))
    rotation, position = cycle.robot.body_poses(motion.trajectory.position(time))
    bodies = np.tile(np.eye(4), (len(time), 1, 1))
    bodies[:, :3, :3], bodies[:, :3, 3] = rotation[:, -1], position[:, -1]
    tool = bodies @ cycle.robot.link_placement["tip"]
    return time, tool, {part.name: part for part in moved_parts(cycle, motion.marks, time, tool)}


def test_a_part_stands_moves_with_the_tool_and_stands_where_the_next_cell_has_it(
    cycle, motion, seen
):
    time, tool, parts = seen
    part = parts["part"]
    (begin, _), end = motion.move_times["carry"], motion.marks[7].time
    assert (part.poses[time < begin] == np.eye(4)).all()
    assert abs(part.poses[time == begin] - np.eye(4)).max() < TOLERANCE
    np.testing.assert_array_equal(part.surface.vertices, cycle.obstacles[0].shapes[0].vertices)
    during = (time >= begin) & (time <= end)
    grips = np.linalg.inv(tool[during]) @ part.poses[during]
    assert abs(grips - grips[0]).max() < TOLERANCE
    (left,) = [each for each in cycle.cells(motion.junctions)[2].obstacles if each.name == "part"]
    after = np.flatnonzero(time >= end)
    for step in (after[0], after[-1]):
        placed = part.surface.moved(part.poses[step]).vertices
        np.testing.assert_allclose(placed, left.shapes[0].vertices, atol=TOLERANCE)


def test_what_comes_and_goes_is_there_only_while_it_is_carried(motion, seen):
    time, tool, parts = seen
    cap, begin, end = parts["cap"], motion.marks[3].time, motion.marks[8].time
    carried = (time >= begin) & (time < end)
    np.testing.assert_array_equal(cap.present, carried)
    assert abs(cap.poses[carried] - tool[carried]).max() < TOLERANCE
    assert [len(cap.seen_at(step)) for step in (0, carried.argmax())] == [0, 8]


def test_a_part_may_be_taken_again_and_stands_before_there_is_a_motion(cycle):
    part = Obstacle.box("part", (0.1, 0.1, 0.1), at(0.6, 0.4, 0.05))
    moves = [replace(leg.moves[0], passes_through=False) for leg in cycle.legs]
    steps = [Attach("part"), moves[0], Detach("part"), moves[1], Attach("part"), moves[2]]
    again = Cycle(cycle.start, steps, [part])
    time, tool = np.arange(4.0), np.array([at(x, 0, 0) for x in (0, 1, 3, 7)])
    marks = [Mark(t, "event", "any") for t in (0, 0, 1, 1, 2, 2)]
    (result,) = moved_parts(again, marks, time, tool)
    np.testing.assert_allclose(result.poses[:, 0, 3], [0, 1, 1, 5])
    (standing,) = moved_parts(cycle, (), np.zeros(1), np.eye(4)[None])
    assert (standing.name, standing.present.all()) == ("part", True)


@pytest.fixture(scope="module")
def commands(page):
    return recorded_commands(page.scene)


def track_of(commands, path, name):
    """Return times and values of a property in the animation of an object's parent."""
    (animation,) = (c for c in commands if c["type"] == "set_animation")
    above = path.rsplit("/", 2)[0]
    (clip,) = (each["clip"] for each in animation["animations"] if each["path"] == above)
    (keys,) = (each["keys"] for each in clip["tracks"] if each["name"].strip(".") == name)
    return [np.array([key[part] for key in keys]) for part in ("time", "value")]


@pytest.mark.dear("makes the page that others look at")
def test_every_move_has_a_tube_in_its_own_colour_and_a_part_moves_by_itself(commands):
    objects = materials_of(commands)
    tubes = [objects[f"/meshcat/tube/0/body_0/move_{k}"]["color"] for k in range(4)]
    assert tubes == [int(color[1:], 16) for color in SEGMENT_COLORS]
    (path,) = [path for path in objects if "/part/" in path]
    assert path.startswith("/meshcat/carried/0/body_")
    time, position = track_of(commands, path, "position")
    assert abs(position[time <= 1 + GRIP]).max() < 1e-12
    assert abs(position[-1]).max() > 0.1


def test_what_comes_and_goes_is_hidden_before_and_after(commands):
    (path,) = [path for path in materials_of(commands) if "/cap/" in path]
    time, seen = track_of(commands, path, "visible")
    np.testing.assert_array_equal(seen, (time >= 1 + GRIP) & (time < 2 + GRIP + RELEASE))
    at_first = [c for c in commands if c["type"] == "set_property"]
    shown = {c["path"]: c["value"] for c in at_first if c["property"] == "visible"}
    assert shown[path.rsplit("/", 2)[0]] is False


def test_frames_have_every_mark_among_them_and_speeds_equal_steps(cycle):
    motion, instant = motion_of(cycle, 0.9371), 1e-6
    page = view_cycle(cycle, [motion])
    time = page.scene.trajectories[0].time
    assert {mark.time for mark in motion.marks} <= set(time.tolist())
    assert (np.diff(time) > 0).all()
    assert (np.diff(time) < 1 / 199).all()
    (stated,) = page.panel["trajectories"]
    even = np.linspace(0, stated["duration"], len(stated["speed"]))[1:-1]
    before, after = (
        cycle.robot.tool_position(motion.trajectory.position(even + by))
        for by in (-instant, instant)
    )
    speed = np.linalg.norm(after - before, axis=1) / (2 * instant)
    np.testing.assert_allclose(stated["speed"][1:-1], speed, atol=1e-3)


def test_the_time_line_has_moves_and_what_happens_at_rest(motion):
    timeline = cycle_timeline(motion)
    assert [band.name for band in timeline.bands] == ["reach", "carry", "on", "back"]
    rest, second = 1 + GRIP, 2 + GRIP + RELEASE
    ends = [(band.begin, band.end) for band in timeline.bands]
    expected = [(0, 1), (rest, rest + 0.5), (rest + 0.5, rest + 1), (second, second + 1)]
    np.testing.assert_allclose(ends, expected)
    taken, left = timeline.stops
    assert (taken.begin, taken.end) == pytest.approx((1, rest))
    assert taken.text == "grip 'close' (0.1 s), attach part, attach cap"
    assert [time for time, _ in left.ticks] == pytest.approx([rest + 1, second, second])


def test_texts_of_rests_stand_beside_each_other_with_what_is_left_to_them():
    times = (0.5, 0.75, 5.0, 9.5)
    stops = tuple(Stop(time - 0.1, time + 0.1, ((time - 0.1, "dwell"),)) for time in times)
    slacks = [rest["room"] for rest in Timeline((), stops).as_dict(10.0)["rests"]]
    assert [(slack["begin"], slack["end"], slack["align"]) for slack in slacks] == [
        (0, 0.625, "left"),
        (0.625, 0.875, "center"),
        (2.875, 7.125, "center"),
        (7.25, 10, "right"),
    ]
    assert Timeline((), ()).as_dict(10.0)["rests"] == []


def test_the_panel_says_what_is_seen(page):
    panel = page.panel
    assert panel["about"].endswith("closed cycle of 4 moves")
    layers = {layer["name"]: layer for layer in panel["layers"]}
    assert layers["carried"]["label"] == "Carried: part, cap"
    assert layers["obstacles"]["label"] == "Obstacles: post"
    texts = [entry["text"] for entry in layers["tube"]["entries"]]
    assert len(texts) == 4
    assert [texts[0], texts[3]] == ["reach: 200 mm, 1.000 s", "back: 200 to 300 mm, 1.000 s"]
    assert data_of(page.html) == json.loads(json.dumps(panel))


def test_motions_stand_side_by_side_with_a_line_each(cycle, motion):
    both = view_cycle(cycle, [motion, motion_of(cycle, 2.0)], ["fast", "slow"])
    assert [t["name"] for t in both.panel["trajectories"]] == ["fast", "slow"]
    ends = [line["bands"][-1]["end"] for line in both.panel["timelines"]]
    assert ends == pytest.approx([3.3, 6.3])
    assert both.panel["layers"][2]["entries"][0]["text"] == "reach: 200 mm"


def test_without_a_motion_the_arm_is_at_its_start(cycle):
    page = view_cycle(cycle)
    assert page.scene.duration == 0
    assert page.panel["timelines"] == []
    assert "at its start" in page.panel["hint"]
    paths = " ".join(materials_of(recorded_commands(page.scene)))
    assert "/part/" in paths
    assert "/cap/" not in paths


def test_long_motions_do_not_make_more_frames_than_can_be_mailed(cycle):
    slow = view_cycle(cycle, [motion_of(cycle, 30.0)]).scene.trajectories[0]
    assert 1000 < len(slow.time) < 1300


def test_what_is_no_cycle_and_names_that_do_not_fit_are_refused(cycle, motion):
    with pytest.raises(ProblemError, match="give a Cycle"):
        view_cycle("cycle")
    with pytest.raises(OptionError, match="one each, all different"):
        view_cycle(cycle, [motion, motion], ["a", "a"])


def test_a_move_without_a_tube_is_drawn_without_one(cycle, motion):
    tube = cycle.steps[0].tube
    free = replace(cycle.steps[0], tube=Tube.anywhere(*tube.points[[0, -1]]))
    without = replace(cycle, steps=[free, *cycle.steps[1:]])
    page = view_cycle(without, [replace(motion, cycle=without)])
    drawn = materials_of(recorded_commands(page.scene))
    assert [path for path in drawn if "/tube/" in path and "/move_0" in path] == []
    assert abs(page.scene.frame.floor).max() < 10  # [m]
    (layer,) = [layer for layer in page.panel["layers"] if layer["name"] == "tube"]
    assert layer["entries"][0]["text"] == "reach: anywhere, 1.000 s"
