import re
from dataclasses import fields, replace

import pytest

from tubeplanner import ProblemError, load_problem
from tubeplanner.problem.robustness import CONTROLLERS, Robustness

NAME = "example:two_link/paper_1_30mm"


@pytest.fixture
def changed():
    """Return a function from changed fields to the problem with them."""
    return lambda changes: load_problem(NAME, changes=changes)


def test_without_anything_given_it_is_the_usual_errors():
    usual = Robustness()
    assert (usual.mass, usual.com, usual.payload, usual.friction) == (0.05, 0.005, 0.1, 0.2)
    assert (usual.lag, usual.delay, usual.noise) == (1e-3, 1e-3, 1e-5)
    assert (usual.tool, usual.base, usual.control_period) == (5e-4, 5e-4, 1e-3)
    assert (usual.unmodelled_friction, usual.controller) == (0.02, CONTROLLERS[0])


def test_exact_has_no_errors_but_those_given():
    exact = Robustness.exact(com=0.02)
    errors = [f.name for f in fields(exact) if f.name not in ("control_period", "controller")]
    assert {name: getattr(exact, name) for name in errors if getattr(exact, name)} == {"com": 0.02}
    assert exact.control_period == 1e-3


def test_enlarged_the_arms_build_is_off_by_more_and_its_control_is_as_it_was():
    """As far as errors may be: masses by no more than 90 %."""
    found = Robustness(mass=0.7, controller="pd", control_period=0.002).enlarged(1.5)
    expected = Robustness(
        mass=0.9,
        com=0.0075,
        payload=0.15,
        friction=0.3,
        tool=7.5e-4,
        base=7.5e-4,
        controller="pd",
        control_period=0.002,
    )
    assert {f.name: getattr(found, f.name) for f in fields(found)} == {
        f.name: pytest.approx(value) if isinstance(value, float) else value
        for f in fields(found)
        for value in [getattr(expected, f.name)]
    }


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"mass": 1.0}, "robustness.mass is 1; give a number from 0 to 0.9"),
        ({"com": -0.1}, "robustness.com is -0.1 m; give a number from 0 to 1 m"),
        ({"noise": "much"}, "robustness.noise is 'much' rad or m; give a number from 0 to 0.1"),
        ({"lag": float("nan")}, "robustness.lag is nan s; give a number from 0 to 1 s"),
        ({"control_period": 0.0}, "control_period is 0 s; give a number from 0.0001 to 0.1 s"),
        ({"controller": "PD"}, "robustness.controller: unknown controller 'PD'; there is: compu"),
    ],
)
def test_values_out_of_their_bounds_are_refused(given, message):
    with pytest.raises(ProblemError, match=re.escape(message)):
        Robustness(**given)


def test_a_problem_file_has_the_usual_errors_where_it_says_nothing(changed):
    assert changed({}).robustness is None
    assert changed({"robustness": {}}).robustness == Robustness()
    given = changed({"robustness.mass": 0.1, "robustness.controller": "pd"})
    assert given.robustness == Robustness(mass=0.1, controller="pd")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robustness.mass": 2}, r"robustness\.mass is 2; give a number from 0 to 0\.9"),
        ({"robustness.masses": 0.1}, r"unknown key 'masses' .did you mean 'mass'"),
        ({"robustness.controller": "lqr"}, r"robustness\.controller"),
    ],
)
def test_a_wrong_error_in_a_problem_file_is_named(changed, changes, message):
    with pytest.raises(ProblemError, match=message):
        changed(changes)


def test_robustness_of_a_problem_is_one(changed):
    with pytest.raises(ProblemError, match=r"robustness is 0\.05; give a Robustness"):
        replace(changed({}), robustness=0.05)
