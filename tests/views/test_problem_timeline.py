"""The time line of a problem's motion: segments in turn, and what binds when."""

from itertools import pairwise

import numpy as np
import pytest

from shown_cycle import motion_of, shown_cycle
from stored_trajectories import REFINEMENT
from tubeplanner import PlanningProblem, Tube
from tubeplanner.constraints.binding_limits import binding_rows
from tubeplanner.views.cycle_curves import cycle_stretches
from tubeplanner.views.palette import SEGMENT_COLORS
from tubeplanner.views.problem_timeline import binding_marks, problem_timeline, segment_bands
from tubeplanner.views.stretch import Stretch


@pytest.fixture(scope="module")
def stretch(stored):
    return Stretch(*stored("ur5/over_the_wall", REFINEMENT))


def test_segments_follow_each_other_in_their_colours(stretch):
    bands = problem_timeline(stretch)["bands"]
    assert [band["name"] for band in bands] == ["segment 0", "segment 1", "segment 2"]
    assert [band["color"] for band in bands] == list(SEGMENT_COLORS[:3])
    assert bands[0]["begin"] == 0
    assert bands[-1]["end"] == stretch.trajectory.duration
    for before, after in pairwise(bands):
        assert before["end"] == after["begin"]


def test_of_many_segments_groups_are_named(stored):
    problem, trajectory = stored("two_link/around_a_post", REFINEMENT)
    ends = problem.robot.tool_position(trajectory.position(np.array([0, trajectory.duration])))
    points = ends[0] + np.linspace(0, 1, 41)[:, None] * (ends[1] - ends[0])
    tube = Tube(points, 2.0)
    bands = segment_bands(Stretch(PlanningProblem(problem.robot, tube, problem.start), trajectory))
    assert [band["name"] for band in bands][-1] == "segments 35 to 39"
    assert {band["name"] for band in bands} <= {
        f"segments {first} to {first + 4}" for first in range(0, 40, 5)
    }


def test_marks_are_where_a_limit_binds(stretch):
    marks = {mark["name"]: mark["spans"] for mark in binding_marks([stretch])}
    rows = binding_rows(stretch.problem.robot.joint_names, stretch.uses, stretch.closest)
    expected = {row.name: row.spans for row in rows if row.spans}
    assert list(marks) == list(expected)
    for name, spans in marks.items():
        assert [span["kind"] for span in spans] == [each.kind for each in expected[name]]
        assert [span["begin"] for span in spans] == pytest.approx(
            [each.begin for each in expected[name]], abs=1e-5
        )


def test_marks_of_a_cycle_have_its_time(tmp_path):
    cycle = shown_cycle(tmp_path)
    motion = motion_of(cycle, 0.2)  # fast: limits bind
    spans = [s for mark in binding_marks(cycle_stretches(cycle, motion)) for s in mark["spans"]]
    inside = [
        any(begin - 1e-4 <= s["begin"] <= s["end"] <= end + 1e-4 for begin, end in motion.leg_times)
        for s in spans
    ]
    assert len(spans) > 1
    assert all(inside)
    assert max(s["end"] for s in spans) > motion.leg_times[-1][0]
