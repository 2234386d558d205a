"""view_cycle: moved parts, scene, panel."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from shown_cycle import GRIP, RELEASE, at, motion_of, shown_cycle

from tubeplanner import OptionError, ProblemError
from tubeplanner.collision.obstacle import Obstacle
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Attach, Detach
from tubeplanner.trajectory.marks import Mark
from tubeplanner.views.cycle_timeline import Stop, Timeline, cycle_timeline
from tubeplanner.views.cycle_view import view_cycle
from tubeplanner.views.moved_parts import moved_parts
from tubeplanner.views.palette import SEGMENT_COLORS
from tubeplanner.views.viewer import recorded_commands

# Parts stand, move with the tool, and stand where the cell of the next move has them.


TOLERANCE = 1e-12  # [m]


@pytest.fixture
def cycle(tmp_path):
    return shown_cycle(tmp_path)


def times_of(motion):
    instants = {mark.time for mark in motion.marks}
    return np.array(sorted({*np.linspace(0, motion.trajectory.duration, 100), *instants}))


def tool_frame(cycle, q):
    """Return poses of the tool frame, which is the last body's."""
    rotation, position = cycle.robot.body_poses(q)
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = rotation[:, -1], position[:, -1]
    return poses @ cycle.robot.link_placement["tip"]


@pytest.fixture
def seen(cycle):
    """Motion, times, tool frames, and the parts by name."""
    motion = motion_of(cycle)
    time = times_of(motion)
    tool = tool_frame(cycle, motion.trajectory.position(time))
    parts = moved_parts(cycle, motion.marks, time, tool)
    return motion, time, tool, {part.name: part for part in parts}


def test_a_part_stands_where_it_is_until_it_is_taken(cycle, seen):
    motion, time, _, parts = seen
    taken = motion.move_times["carry"][0]
    assert (parts["part"].poses[time < taken] == np.eye(4)).all()
    assert abs(parts["part"].poses[time == taken] - np.eye(4)).max() < TOLERANCE
    np.testing.assert_array_equal(
        parts["part"].surface.vertices, cycle.obstacles[0].shapes[0].vertices
    )


def test_it_keeps_its_place_in_the_tool_while_it_is_carried(seen):
    motion, time, tool, parts = seen
    begin, end = motion.move_times["carry"][0], motion.marks[7].time
    during = (time >= begin) & (time <= end)
    grips = np.linalg.inv(tool[during]) @ parts["part"].poses[during]
    assert abs(grips - grips[0]).max() < TOLERANCE
    assert np.ptp(parts["part"].poses[during], axis=0).max() > 0.3


def test_it_stands_in_the_end_where_the_next_cell_has_it(cycle, seen):
    motion, time, _, parts = seen
    (left,) = [each for each in cycle.cells(motion.seams)[2].obstacles if each.name == "part"]
    after = np.flatnonzero(time >= motion.marks[7].time)
    for step in (after[0], after[-1]):
        placed = parts["part"].surface.moved(parts["part"].poses[step]).vertices
        np.testing.assert_allclose(placed, left.shapes[0].vertices, atol=TOLERANCE)
    assert parts["part"].present.all()


def test_what_comes_and_goes_is_there_only_while_it_is_carried(seen):
    motion, time, tool, parts = seen
    begin, end = motion.marks[3].time, motion.marks[8].time
    carried = (time >= begin) & (time < end)
    np.testing.assert_array_equal(parts["cap"].present, carried)
    assert abs(parts["cap"].poses[carried] - tool[carried]).max() < TOLERANCE
    assert len(parts["cap"].seen_at(0)) == 0
    assert len(parts["cap"].seen_at(np.flatnonzero(carried)[0])) == 8


def test_a_part_may_be_taken_again(cycle):
    part = Obstacle.box("part", (0.1, 0.1, 0.1), at(0.6, 0.4, 0.05))
    moves = [replace(leg.moves[0], passes_through=False) for leg in cycle.legs]
    steps = [Attach("part"), moves[0], Detach("part"), moves[1], Attach("part"), moves[2]]
    again = Cycle(cycle.start, steps, [part])
    time, tool = np.arange(4.0), np.array([at(x, 0, 0) for x in (0, 1, 3, 7)])
    marks = [Mark(t, "event", "any") for t in (0, 0, 1, 1, 2, 2)]
    (found,) = moved_parts(again, marks, time, tool)
    np.testing.assert_allclose(found.poses[:, 0, 3], [0, 1, 1, 5])


def test_nothing_is_handed_over_before_there_is_a_motion(cycle):
    (part,) = moved_parts(cycle, (), np.zeros(1), np.eye(4)[None])
    assert part.name == "part"
    assert part.present.all()


# The page of a cycle: what is recorded for the viewer, what panel and time line say.


MOVES = ["reach", "carry", "on", "back"]


@pytest.fixture(scope="module")
def view_cycle_(tmp_path_factory):
    return shown_cycle(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def motion(view_cycle_):
    return motion_of(view_cycle_)


@pytest.fixture(scope="module")
def page(view_cycle_, motion):
    return view_cycle(view_cycle_, [motion], ["motion.json"])


def tracks_of(scene):
    """Return the tracks of the animation by path: times and values by property."""
    (animation,) = (c for c in recorded_commands(scene) if c["type"] == "set_animation")
    return {
        each["path"]: {
            track["name"].strip("."): (
                np.array([key["time"] for key in track["keys"]]),
                np.array([key["value"] for key in track["keys"]]),
            )
            for track in each["clip"]["tracks"]
        }
        for each in animation["animations"]
    }


def objects_of(scene):
    return [c["path"] for c in recorded_commands(scene) if c["type"] == "set_object"]


def test_every_move_has_a_tube_in_its_own_colour(page):
    materials = {
        command["path"]: command["object"]["materials"][0]
        for command in recorded_commands(page.scene)
        if command["type"] == "set_object" and "/tube/" in command["path"]
    }
    assert [materials[f"/meshcat/tube/0/body_0/move_{k}"]["color"] for k in range(4)] == [
        int(color[1:], 16) for color in SEGMENT_COLORS
    ]


def test_a_part_moves_by_itself_and_what_stands_does_not(page):
    paths = objects_of(page.scene)
    assert "/meshcat/obstacles/0/body_0/post" in paths
    assert not [path for path in paths if path.startswith("/meshcat/obstacles") and "part" in path]
    (path,) = [path for path in paths if "/part/" in path]
    assert path.startswith("/meshcat/carried/0/body_")
    time, position = tracks_of(page.scene)[path.rsplit("/", 2)[0]]["position"]
    assert abs(position[time <= 1 + GRIP]).max() < 1e-12
    assert np.ptp(position[time >= 2 + GRIP + RELEASE], axis=0).max() == 0
    assert abs(position[-1]).max() > 0.1


def test_what_comes_and_goes_is_hidden_before_and_after(page):
    (path,) = [path for path in objects_of(page.scene) if "/cap/" in path]
    tracks = tracks_of(page.scene)[path.rsplit("/", 2)[0]]
    time, seen = tracks["visible"]
    np.testing.assert_array_equal(seen, (time >= 1 + GRIP) & (time < 2 + GRIP + RELEASE))
    at_first = [c for c in recorded_commands(page.scene) if c["type"] == "set_property"]
    shown = {c["path"]: c["value"] for c in at_first if c["property"] == "visible"}
    assert shown[path.rsplit("/", 2)[0]] is False


def test_frames_have_every_mark_among_them(view_cycle_):
    motion = motion_of(view_cycle_, 0.9371)
    time = view_cycle(view_cycle_, [motion]).scene.trajectories[0].time
    assert {mark.time for mark in motion.marks} <= set(time.tolist())
    assert (np.diff(time) > 0).all()
    assert (np.diff(time) < 1 / 199).all()


def test_many_moves_do_not_make_more_frames_than_can_be_mailed(view_cycle_):
    slow = view_cycle(view_cycle_, [motion_of(view_cycle_, 30.0)]).scene.trajectories[0]
    assert 1000 < len(slow.time) < 1300


def test_the_time_line_has_moves_and_what_happens_at_rest(motion):
    timeline = cycle_timeline(motion)
    assert [band.name for band in timeline.bands] == MOVES
    ends = [(band.begin, band.end) for band in timeline.bands]
    rest, second = 1 + GRIP, 2 + GRIP + RELEASE
    middle = rest + 0.5
    expected = [(0, 1), (rest, middle), (middle, rest + 1), (second, second + 1)]
    np.testing.assert_allclose(ends, expected)
    taken, left = timeline.stops
    assert (taken.begin, taken.end) == pytest.approx((1, rest))
    assert taken.text == "grip 'close' (0.1 s), attach part, attach cap"
    assert [time for time, _ in left.ticks] == pytest.approx([rest + 1, second, second])


def line_with_rests_at(times, duration):
    """Return the rests of a time line as the page gets them."""
    stops = tuple(Stop(time - 0.1, time + 0.1, ((time - 0.1, "dwell"),)) for time in times)
    return Timeline((), stops).as_dict(duration)["rests"]


@pytest.mark.parametrize("times", [(0.6, 1.0, 2.5, 9.3, 9.4), (0.5, 9.5), (0.4,), (9.7,), (6.0,)])
def test_texts_of_rests_are_beside_each_other(times):
    rooms = [rest["room"] for rest in line_with_rests_at(times, 10.0)]
    ends = [0.0, *(end for room in rooms for end in (room["begin"], room["end"])), 10.0]
    assert ends == sorted(ends)
    for time, room in zip(times, rooms, strict=True):
        before, after = time - room["begin"], room["end"] - time
        assert min(before, after) > 0
        assert before == pytest.approx(after) or room["align"] != "center"


def test_texts_at_the_ends_of_a_line_have_what_is_left_to_them():
    first, second, middle, last = (
        (room["begin"], room["end"], room["align"])
        for room in (rest["room"] for rest in line_with_rests_at((0.5, 0.75, 5.0, 9.5), 10.0))
    )
    assert first == (0, 0.625, "left")
    assert second == (0.625, 0.875, "center")
    assert middle == (2.875, 7.125, "center")
    assert last == (7.25, 10, "right")
    late = [rest["room"]["align"] for rest in line_with_rests_at((5.0, 9.25, 9.5), 10.0)]
    assert late == ["center", "center", "right"]


def test_the_panel_says_what_is_seen(page):
    panel = page.panel
    assert panel["about"].endswith("closed cycle of 4 moves")
    layers = {layer["name"]: layer for layer in panel["layers"]}
    assert layers["carried"]["label"] == "Carried: part, cap"
    assert layers["obstacles"]["label"] == "Obstacles: post"
    texts = [entry["text"] for entry in layers["tube"]["entries"]]
    assert texts == [
        "reach: 200 mm, 1000 ms",
        "carry: 250 mm, 500 ms",
        "on: 300 mm, 500 ms",
        "back: 200 to 300 mm, 1000 ms",
    ]
    (line,) = panel["timelines"]
    assert [move["color"] for move in line["bands"]] == list(SEGMENT_COLORS)
    assert json.loads(json.dumps(panel)) == json.loads(
        re.search(r'id="data">(.*?)</script>', page.html, re.S).group(1)
    )


def test_motions_stand_side_by_side_with_a_line_each(view_cycle_, motion):
    both = view_cycle(view_cycle_, [motion, motion_of(view_cycle_, 2.0)], ["fast", "slow"])
    assert [t["name"] for t in both.panel["trajectories"]] == ["fast", "slow"]
    # Both lines are as wide as the longer motion lasts.
    last = both.panel["timelines"][0]["rests"][-1]
    assert last["room"]["align"] == "center"
    assert [line["bands"][-1]["end"] for line in both.panel["timelines"]] == pytest.approx(
        [3.3, 6.3]
    )
    assert both.panel["layers"][2]["entries"][0]["text"] == "reach: 200 mm"


def test_a_speed_is_told_at_equal_steps_of_time(view_cycle_):
    motion, instant = motion_of(view_cycle_, 0.9371), 1e-6
    (told,) = view_cycle(view_cycle_, [motion]).panel["trajectories"]
    even = np.linspace(0, told["duration"], len(told["speed"]))[1:-1]
    before, after = (
        view_cycle_.robot.tool_position(motion.trajectory.position(even + by))
        for by in (-instant, instant)
    )
    speed = np.linalg.norm(after - before, axis=1) / (2 * instant)
    np.testing.assert_allclose(told["speed"][1:-1], speed, atol=1e-3)


def test_without_a_motion_the_arm_is_at_its_start(view_cycle_):
    page = view_cycle(view_cycle_)
    assert page.scene.duration == 0
    assert page.panel["timelines"] == []
    assert "at its start" in page.panel["hint"]
    assert [path for path in objects_of(page.scene) if "/part/" in path]
    assert not [path for path in objects_of(page.scene) if "/cap/" in path]


def test_what_is_no_cycle_and_names_that_do_not_fit_are_refused(view_cycle_, motion):
    with pytest.raises(ProblemError, match="give a Cycle"):
        view_cycle("cycle")
    with pytest.raises(OptionError, match="one each, all different"):
        view_cycle(view_cycle_, [motion, motion], ["a", "a"])
