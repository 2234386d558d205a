"""What is asked about: fields, points from wherever they are, and what is refused."""

import numpy as np
import pytest

from asked_problems import PLANAR, POINTS, asked
from small_cycle import SMALL
from tubeplanner import PosedProblem
from tubeplanner.documents import parse_yaml
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.explanation.question import Question


def test_points_are_those_of_the_problem_or_of_its_file(tmp_path):
    rows = [",".join(map(str, [*point, 0.04])) for point in POINTS]
    (tmp_path / "path.csv").write_text("x,y,z,radius\n" + "\n".join(rows))
    tube = {"points": "path.csv"}
    from_file = Question.of(PosedProblem({**PLANAR, "tube": tube}, tmp_path, "asked"))
    for question in (asked(), from_file):
        np.testing.assert_array_equal(question.points, POINTS)
        assert question.segment_count == 3
    assert from_file.given_tube["radius"] == [0.04, 0.04, 0.04]


def test_what_is_given_once_is_for_every_segment():
    assert asked().per_segment(0.1) == [0.1, 0.1, 0.1]
    assert asked().per_segment([1, None, 2]) == [1, None, 2]


def test_a_question_may_be_about_what_cannot_be_posed():
    question = asked({"tube.radius": [0.03, 0.05]})
    with pytest.raises(ProblemError, match=r"tube\.radius has 2 values for 3 segments"):
        question.load()
    assert question.load({"tube.radius": 0.05}).tube.radius.tolist() == [0.05, 0.05, 0.05]
    assert repr(question) == "<Question about asked>"


@pytest.mark.parametrize(
    ("document", "error", "message"),
    [
        (parse_yaml(SMALL), ProblemError, "this is a cycle, where one problem is needed"),
        ({"study": {}}, ProblemError, "this is a study, where one problem is needed"),
        ({**PLANAR, "tube": None}, ProblemError, "tube is required; `tubeplanner route` finds"),
        ({**PLANAR, "radus": 1}, ProblemError, "unknown key 'radus'"),
        (
            {**PLANAR, "robot": {"urdf": "example:two_link", "tool_frame": "hnd"}},
            RobotError,
            "did you mean 'hand'",
        ),
    ],
)
def test_what_is_no_problem_is_refused(tmp_path, document, error, message):
    with pytest.raises(error, match=message):
        Question.of(PosedProblem(document, tmp_path, "asked"))


@pytest.mark.parametrize(
    ("position", "segment"), [([0.5, -0.3, 0], 0), ([0.3, 0.12, 0], 1), ([0.2, 0.9, 0.1], 2)]
)
def test_the_segment_near_a_point_is_found(position, segment):
    assert asked().segment_near(np.array(position)) == segment
