"""Panel of a page: curves, time line, titles, layers, notes."""

import numpy as np
import pytest
from shown_cycle import motion_of, shown_cycle
from stored_trajectories import REFINEMENT

from tubeplanner import PlanningProblem, Tube
from tubeplanner.limits.binding_limits import POSITION, binding_rows
from tubeplanner.output.curves import LimitedSection, limited_sections
from tubeplanner.output.drawing import LINE_COLORS, SEGMENT_COLORS
from tubeplanner.output.page.panel import (
    binding_marks,
    page_curves,
    segment_bands,
)

STEPS = 240


@pytest.fixture(scope="module")
def section(stored):
    """A fast motion over a wall."""
    return LimitedSection(*stored("ur5/over_the_wall", REFINEMENT))


@pytest.fixture(scope="module")
def curves(section):
    """Times, and the curves of the page."""
    time = np.linspace(0, section.trajectory.duration, STEPS)
    return time, page_curves([section], time)


def test_a_line_is_the_largest_share_of_a_joints_limits(section, curves):
    time, curves = curves
    lines = {line["name"]: line for line in curves["limits"]["lines"]}
    assert [*lines] == [*section.problem.robot.joint_names, "tool"]
    own = section.uses.samples.time
    for j, name in enumerate(section.problem.robot.joint_names):
        fractions = {use.kind: use.fraction for use in section.uses.uses if use.joint == j}
        del fractions[POSITION]
        line = lines[name]
        assert line["color"] == LINE_COLORS[j]
        between = np.max(
            [np.interp(time, own, fraction) for fraction in fractions.values()], axis=0
        )
        assert (np.array(line["share"]) >= 100 * between - 0.51).all()
        assert max(line["share"]) == round(
            100 * max(fraction.max() for fraction in fractions.values())
        )
        kinds = [curves["limits"]["kinds"][k] for k in line["kind"]]
        k = int(np.argmax(line["share"]))
        assert fractions[kinds[k]].max() == pytest.approx(line["share"][k] / 100, abs=0.02)
        assert POSITION not in kinds


def test_the_closest_pairs_are_those_of_then(curves):
    time, curves = curves
    obstacles, links = curves["clearance"]
    assert [obstacles["name"], links["name"]] == ["to obstacles", "between links"]
    for k in (0, 100, -1):
        ends = np.reshape(obstacles["points"][k], (2, 3))
        length = 1000 * np.linalg.norm(ends[1] - ends[0])
        assert length == pytest.approx(obstacles["distance"][k], abs=0.3)
        assert obstacles["required"][k] == pytest.approx(10, abs=0.1)
        assert obstacles["pairs"][obstacles["pair"][k]][1] in ("wall", "table")
    assert links["required"][0] == 0
    assert len(obstacles["distance"]) == len(time)


def test_a_limit_on_the_tools_speed_is_that_of_the_segment(stored, curves):
    problem, trajectory = stored("ur5/over_the_wall")
    tube = problem.tube
    slow = Tube(tube.points, tube.radius, tool_speed=[None, 3.0, None])
    limited = PlanningProblem(problem.robot, slow, problem.start, self_collision=False)
    time = np.linspace(0, trajectory.duration, STEPS)
    limited_curves = page_curves([LimitedSection(limited, trajectory)], time)
    speeds = limited_curves["speedLimit"]
    assert [speeds[0], speeds[STEPS // 2], speeds[-1]] == [None, 3.0, None]
    assert "clearance" not in limited_curves
    assert "speedLimit" not in curves[1]


def test_between_the_legs_of_a_cycle_nothing_is_said_and_marks_have_its_time(tmp_path):
    cycle = shown_cycle(tmp_path)
    motion = motion_of(cycle, 0.2)  # fast: limits bind
    sections = limited_sections(motion)
    assert [section.begin for section in sections] == [begin for begin, _ in motion.leg_times]
    time = np.linspace(0, motion.trajectory.duration, STEPS)
    curves = page_curves(sections, time)
    rests = np.ones(STEPS, dtype=bool)
    for begin, end in motion.leg_times:
        rests &= (time < begin) | (time > end)
    assert 0 < rests.sum() < STEPS
    fractions = [line["share"] for line in curves["limits"]["lines"]]
    for values in (*fractions, curves["clearance"][0]["distance"]):
        np.testing.assert_array_equal([each is None for each in values], rests)
    lasts = [span["end"] for mark in binding_marks(sections) for span in mark["spans"]]
    assert max(lasts) > motion.leg_times[-1][0]


def test_segments_follow_each_other_in_their_colours(section):
    bands = segment_bands(section)
    assert [band["name"] for band in bands] == ["segment 0", "segment 1", "segment 2"]
    assert [band["color"] for band in bands] == list(SEGMENT_COLORS[:3])
    ends = [0, *(band["end"] for band in bands)]
    assert [*(band["begin"] for band in bands), section.trajectory.duration] == ends


def test_of_many_segments_groups_are_named(stored):
    problem, trajectory = stored("two_link/around_a_post", REFINEMENT)
    ends = problem.robot.tool_position(trajectory.position(np.array([0, trajectory.duration])))
    points = ends[0] + np.linspace(0, 1, 41)[:, None] * (ends[1] - ends[0])
    tube = Tube(points, 2.0)
    bands = segment_bands(
        LimitedSection(PlanningProblem(problem.robot, tube, problem.start), trajectory)
    )
    assert [band["name"] for band in bands][-1] == "segments 35 to 39"


def test_marks_are_where_a_limit_binds(section):
    marks = {mark["name"]: mark["spans"] for mark in binding_marks([section])}
    rows = binding_rows(section.problem.robot.joint_names, section.uses, section.closest)
    expected = {row.name: row.spans for row in rows if row.spans}
    assert list(marks) == list(expected)
    for name, spans in marks.items():
        assert [span["kind"] for span in spans] == [each.kind for each in expected[name]]
        begins = [each.begin for each in expected[name]]
        assert [span["begin"] for span in spans] == pytest.approx(begins, abs=1e-5)
