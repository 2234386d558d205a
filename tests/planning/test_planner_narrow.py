"""Tubes of millimetres: planned as well as wide ones, and never slower than what else there is."""

from dataclasses import replace
from itertools import pairwise

import pytest

from cases import SHORTEST
from narrow_cases import drawn
from tubeplanner import compare, load_problem, parse_problem, plan
from tubeplanner.baselines.baselines import BASELINES
from tubeplanner.constraints.unused_speed import unused_speed

EACH = 1.01
# The shortest durations [s] over the processor types of `test_planner_best_known.py`, by radius
# [mm]. A few are quick to plan; the others are slow tests.
BEST = {
    ("ur5/over_the_wall", 1.0): 0.63905,
    ("xarm7/from_crate_to_crate", 2.0): 0.62525,
    ("ur5/over_the_wall", 0.5): 0.64746,
    ("panda/between_shelves", 1.0): 0.78570,
    ("ur10/onto_a_conveyor", 0.5): 1.04888,
    ("xarm7/from_crate_to_crate", 0.5): 0.66030,
}
QUICK = 1
CASES = [
    pytest.param(*case, marks=[] if number < QUICK else pytest.mark.slow)
    for number, case in enumerate(BEST)
]


def narrowed(name, millimetres):
    problem = load_problem(f"example:{name}")
    return replace(problem, tube=problem.tube.with_radius(millimetres / 1000))


def certified_baselines(problem):
    """Return the durations of the schemes that pass the certificate."""
    smoothed = [name for name in BASELINES if name.startswith("smoothed")]
    rows = compare(problem, methods=smoothed).rows
    return [row.duration for row in rows if row.certified]


@pytest.mark.parametrize(("name", "millimetres"), CASES)
def test_a_narrow_tube_takes_no_longer_than_the_best_known(name, millimetres):
    problem = narrowed(name, millimetres)
    result = plan(problem, SHORTEST)
    assert result.method == "refinement"
    assert result.duration <= EACH * BEST[name, millimetres]
    assert unused_speed(problem, result.trajectory) < 0.01
    assert result.duration < min(certified_baselines(problem))


@pytest.mark.slow
def test_a_bead_of_two_millimetres_is_faster_than_every_scheme():
    case = next(case for case in drawn() if case.name.startswith("bead"))
    problem = parse_problem(case.data)
    result = plan(problem, SHORTEST)
    assert result.method == "refinement"
    assert result.duration <= EACH * case.mark
    assert result.duration < min(certified_baselines(problem))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["ur5/over_the_wall", "panda/between_shelves", "two_link/around_a_post"]
)
def test_a_wider_tube_is_never_slower(name):
    durations = [
        plan(narrowed(name, radius), SHORTEST).duration for radius in (0.5, 2, 10, 30, 100)
    ]
    for narrow, wide in pairwise(durations):
        assert wide <= 1.01 * narrow
