"""Change of one quantity by any size; the explained problem; order of likely remedies."""

import numpy as np
import pytest
from asked_problems import PLANAR, POINTS, asked, simple_change

from tubeplanner import ProblemSpec
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Location, PlanStatus
from tubeplanner.studies.changes import Question, exact, figures, from_to, in_order, rounded


def test_sizes_have_three_figures_and_what_adding_leaves_behind_is_dropped():
    for value in ((0.123456, 0.123), (12.3456, 12.3), (0.00099951, 0.001), (1e-9, 1e-9), (0, 0)):
        assert rounded(value[0]) == value[1]
    assert (exact(0.1 + 0.2), exact(-1.294184)) == (0.3, -1.294184)


@pytest.mark.parametrize(
    ("values", "unit", "text"),
    [
        ([-0.0305], "m", "-30.5 mm"),
        ([0.1], "s", "100 ms"),
        ([0.0305], "rad", "0.0305 rad"),
        ([1.5], "", "1.5"),
        ([0.03, 0.042], "m", "30 -> 42 mm"),
        ([0.95, -1.05], "m", "0.95 -> -1.05 m"),
        ([25.0, 25.533], "N m", "25 -> 25.533 N m"),
    ],
)
def test_numbers_have_one_unit_and_all_their_figures(values, unit, text):
    assert (figures if len(values) == 1 else from_to)(*values, unit) == text


def test_points_are_those_of_the_problem_or_of_its_file(tmp_path):
    rows = [",".join(map(str, [*point, 0.04])) for point in POINTS]
    (tmp_path / "path.csv").write_text("x,y,z,radius\n" + "\n".join(rows))
    tube = {"points": "path.csv"}
    from_file = Question.of(ProblemSpec({**PLANAR, "tube": tube}, tmp_path, "asked"))
    for question in (asked(), from_file):
        np.testing.assert_array_equal(question.points, POINTS)
        assert question.segment_count == 3
    assert from_file.tube_fields["radius"] == [0.04, 0.04, 0.04]


def test_a_question_may_be_about_what_cannot_be_posed():
    question = asked({"tube.radius": [0.03, 0.05]})
    with pytest.raises(ProblemError, match=r"tube\.radius has 2 values for 3 segments"):
        question.load()
    assert question.load({"tube.radius": 0.05}).tube.radius.tolist() == [0.05, 0.05, 0.05]
    assert question.per_segment(0.1) == [0.1, 0.1, 0.1]
    assert question.per_segment([1, None, 2]) == [1, None, 2]


def test_a_study_is_refused(tmp_path):
    with pytest.raises(ProblemError, match="this is a study, where one problem is needed"):
        Question.of(ProblemSpec({"study": {}}, tmp_path, "asked"))


def test_the_segment_near_a_point_is_found():
    points = [[0.5, -0.3, 0], [0.3, 0.12, 0], [0.2, 0.9, 0.1]]
    assert [asked().segment_near(np.array(point)) for point in points] == [0, 1, 2]


def change(field, kind, *about):
    return simple_change(field, kind=kind, about=frozenset(about))


def fields_of(changes, status, location):
    """Return the fields of the two groups about the place, of those elsewhere and of all else."""
    tiers = in_order(changes, status, location)
    assert [len(tier) for tier in tiers] == [2, 1, 1]
    return [[each.field for each in group] for tier in tiers for group in tier]


def test_what_holds_a_part_comes_first_where_it_is_lost():
    changes = [change("a", "effort"), change("b", "radius"), change("c", "holding")]
    lost = Location(contact="cup slides, at rest")
    first, second, _, unlikely = fields_of(changes, PlanStatus.NO_TRAJECTORY, lost)
    assert (first, second, unlikely) == (["c"], ["b"], ["a"])


def test_the_likeliest_kinds_about_the_place_come_first():
    changes = [
        change("point 3", "point", "point 3", "segment 2"),
        change("effort", "effort", "joint1"),
        change("radius 2", "radius", "segment 2"),
        change("radius 0", "radius", "segment 0"),
        change("wall", "obstacle", "obstacle wall"),
        change("table", "obstacle", "obstacle table"),
        change("clearance", "clearance"),
        change("sign", "sign", "joint1"),
        change("radii", "radii"),
    ]
    location = Location(segment=2, obstacle="wall", links=("hand",))
    assert fields_of(changes, PlanStatus.TUBE_BLOCKED, location) == [
        ["clearance", "wall", "radii", "sign"],
        ["radius 2", "point 3"],
        ["table", "radius 0"],
        ["effort"],
    ]


def test_what_nobody_can_change_is_tried_last():
    changes = [change(kind, kind) for kind in ("attached", "points", "ends", "point")]
    for status in (PlanStatus.TUBE_BLOCKED, PlanStatus.NO_TRAJECTORY):
        *likely, unlikely = fields_of(changes, status, Location(links=("hand",)))
        assert unlikely == ["attached", "points", "ends"]
        assert [each for group in likely for each in group] == ["point"]


def test_a_joint_that_is_too_weak_comes_before_the_others():
    changes = [
        change("radius", "radius", "segment 0"),
        change("payload", "payload"),
        change("joint1", "effort", "joint1"),
        change("joint2", "effort", "joint2"),
    ]
    location = Location(joint="joint2", segment=0)
    assert fields_of(changes, PlanStatus.GRAVITY_EXCEEDS_EFFORT, location) == [
        ["joint2", "payload"],
        [],
        ["joint1"],
        ["radius"],
    ]


def test_a_point_is_about_its_two_segments_too():
    changes = [change(f"radius {k}", "radius", f"segment {k}") for k in range(4)]
    changes += [change(f"point {k}", "point", f"point {k}") for k in range(4)]
    assert fields_of(changes, PlanStatus.UNREACHABLE, Location(point=2)) == [
        ["radius 1", "radius 2"],
        ["point 2"],
        ["radius 0", "radius 3", "point 0", "point 1", "point 3"],
        [],
    ]


def test_what_links_are_near_is_about_the_place():
    changes = [
        change("other pair", "clearance", "link arm", "obstacle wall"),
        change("pair", "clearance", "link hand", "obstacle post"),
    ]
    location = Location(links=("hand", "elbow"))
    assert fields_of(changes, PlanStatus.TUBE_BLOCKED, location) == [
        ["pair"],
        [],
        ["other pair"],
        [],
    ]
    # Where nothing is likelier all kinds may help.
    changes = [change("effort", "effort", "joint1"), change("radius", "radius", "segment 1")]
    found = fields_of(changes, PlanStatus.NO_TRAJECTORY, Location(segment=1))
    assert found == [["radius"], [], ["effort"], []]
