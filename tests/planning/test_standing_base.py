"""Links that no joint moves against obstacles, in a cell where distances are known."""

import pytest

from gantry import FLOOR, POST, gantry
from tubeplanner import load_problem
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.standing_base import require_base_free

# The base is a cube of 0.1 m whose top is at -0.05: its bottom is at that of the floor's top.
ON_FLOOR = ("floor",)


def at(folder, x, y, **changes):
    """Return the gantry's problem with its base somewhere, beside a post from -0.4 to -0.2."""
    path = gantry(folder, [FLOOR, POST], **changes)
    tube = [[x, y, 0.0], [x + 0.25, y, 0.0], [x + 0.5, y, 0.0]]
    return load_problem(path, changes={"robot.base": {"position": [x, y, 0]}, "tube.points": tube})


def test_a_base_that_stands_in_an_obstacle_is_refused_by_name_and_depth(tmp_path):
    with pytest.raises(Infeasible) as refused:
        require_base_free(at(tmp_path, -0.17, 0.3), ON_FLOOR)
    assert str(refused.value) == "'base', which no joint moves, stands 20.0 mm in 'post'"
    assert refused.value.place.links == ("base",)
    assert refused.value.place.obstacle == "post"
    assert refused.value.status == "tube_blocked"


def test_a_base_beside_an_obstacle_stands_well(tmp_path):
    require_base_free(at(tmp_path, -0.14, 0.3), ON_FLOOR)
    require_base_free(at(tmp_path, -0.17, 0.3), ("floor", "post"))
    require_base_free(load_problem(gantry(tmp_path)))


def test_what_it_stands_on_counts_unless_it_is_named(tmp_path):
    problem = at(tmp_path, 0.3, 0.3, clearance=0.004)
    require_base_free(problem, ON_FLOOR)
    with pytest.raises(Infeasible, match=r"touches 'floor' .clearance 4 mm.$"):
        require_base_free(problem)


def test_touching_is_standing(tmp_path):
    require_base_free(at(tmp_path, 0.3, 0.3))


@pytest.mark.parametrize(
    ("clearance", "x", "is_free"),
    [
        (0.01, -0.141, False),
        (0.01, -0.139, True),
        ({"default": 0.01, "segments": [0.005, 0.02]}, -0.131, False),
        ({"default": 0.01, "segments": [0.005, 0.02]}, -0.129, True),
        ({"default": 0.01, "segments": [0.005, 0.005]}, -0.144, True),
    ],
)
def test_it_keeps_the_clearance_of_the_other_links(tmp_path, clearance, x, is_free):
    problem = at(tmp_path, x, 0.3, clearance=clearance)
    if is_free:
        require_base_free(problem, ON_FLOOR)
        return
    with pytest.raises(Infeasible, match=r"from 'post' .clearance"):
        require_base_free(problem, ON_FLOOR)


def test_ignored_pairs_and_moving_links_do_not_count(tmp_path):
    ignoring = at(tmp_path, -0.17, 0.3, collision={"ignore": [["base", "post"]]})
    require_base_free(ignoring, ON_FLOOR)
    roof = {"name": "roof", "box": [1, 1, 0.05], "position": [0, 0, 0.02]}
    hits = gantry(tmp_path, [roof], name="roof")
    require_base_free(load_problem(hits))
