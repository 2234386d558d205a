"""Files that are problems or cycles."""

import pytest

from small_cycle import SMALL
from tubeplanner import Cycle, PlanningProblem, ProblemError
from tubeplanner.cycle.problem_or_cycle import is_cycle_file, load_problem_or_cycle

PROBLEM = "example:two_link/around_a_post"


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(SMALL)
    return path


def test_each_file_becomes_what_it_is(path):
    cycle = load_problem_or_cycle(path.name, path.parent)
    assert isinstance(cycle, Cycle)
    assert isinstance(load_problem_or_cycle(PROBLEM), PlanningProblem)
    assert is_cycle_file(path)
    assert not is_cycle_file(PROBLEM)


def test_fields_are_changed_in_both(path):
    cycle = load_problem_or_cycle(path, changes={"moves.back.tube.radius": 0.2})
    assert cycle.legs[-1].joined.tube.radius.tolist() == [0.2]
    problem = load_problem_or_cycle(PROBLEM, changes={"clearance": 0.01})
    assert problem.clearance == 0.01


def test_moves_without_the_format_are_told_what_is_missing(path):
    path.write_text(SMALL.replace("format: tubeplanner/cycle\n", ""))
    with pytest.raises(ProblemError, match="format is required"):
        load_problem_or_cycle(path)


def test_a_file_that_is_not_there_is_bad_input():
    with pytest.raises(ProblemError, match="does not exist"):
        load_problem_or_cycle("nowhere.yaml")
