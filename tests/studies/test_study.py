"""Studies: what they pose at each point, and paths that lead nowhere before anything is planned."""

import pytest

from studied import MASS, PROBLEM, RADIUS, between, small_study
from tubeplanner import ProblemError
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.studies.axes import Levels
from tubeplanner.studies.study import Study


def test_a_point_poses_its_problem_with_its_values():
    problems = {"arm": PosedProblem.read(PROBLEM), "post": PosedProblem.read(POST)}
    axes = [Levels("problem", ("arm", "post")), Levels(RADIUS, ("x2", 0.01)), Levels(MASS, (3,))]
    study = Study("two", problems, axes)
    posed = [study.posed(point) for point in study.points]
    assert [each.name for each in posed] == ["two_link/paper_1_30mm"] * 2 + [POST_NAME] * 2
    assert [each.document["tube"]["radius"] for each in posed][1::2] == [0.01, 0.01]
    assert posed[0].document["tube"]["radius"] == 0.06
    assert {each.document["robot"]["payload"]["mass"] for each in posed} == {3}
    assert problems["arm"].document["tube"]["radius"] == 0.03


POST, POST_NAME = "example:two_link/around_a_post", "two_link/around_a_post"


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ([], "nothing is varied; give at least one field or several problems"),
        ({RADIUS: [1], MASS: []}, "robot.payload.mass: give at least one value"),
        ({RADIUS: [1], "tube.raduis": [1]}, "tube.raduis: unknown key 'raduis'"),
        ({RADIUS: [0.1, "x2", None], MASS: [1, "x2"]}, "robot.payload.mass: nothing is given"),
        ([between(MASS, 0.5, 2, factor=True).levels(3)], f"{MASS}: nothing is given there: x0.5"),
        ({"include": ["a.yaml"]}, "include: values are changed after files are included"),
        ([between(RADIUS, 0, 1)], "tube.radius: count is required in a grid"),
    ],
)
def test_what_no_point_can_have_is_found_at_once(vary, message):
    with pytest.raises(ProblemError) as caught:
        small_study(vary)
    assert str(caught.value).startswith(message)


def test_of_several_problems_the_one_without_the_field_is_named():
    problems = {"arm": PosedProblem.read(PROBLEM), "post": PosedProblem.read(POST)}
    axes = [Levels("problem", ("arm", "post")), Levels("obstacles.post.position", ([0, 0, 0],))]
    with pytest.raises(ProblemError, match=r"^arm: obstacles\.post\.position: "):
        Study("two", problems, axes)


def test_values_that_a_later_one_builds_upon_are_set_in_their_order():
    study = small_study({"robot.payload": [{"mass": 2, "com": [0, 0, 0]}], MASS: ["x2"]})
    assert study.posed(study.points[0]).document["robot"]["payload"]["mass"] == 4
