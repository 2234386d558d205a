from dataclasses import replace

import pytest

from cases import rest_to_rest
from tubeplanner import Robustness, load_problem
from tubeplanner.simulation.plant import Draw
from tubeplanner.simulation.simulated_runs import simulated_runs


@pytest.fixture(scope="module")
def case():
    """A quick motion of the two-link arm."""
    problem = load_problem("example:two_link/paper_1_30mm")
    return problem, rest_to_rest(["joint1", "joint2"], [0.2, -0.5], [0.5, -0.9], 0.3)


def worst(case, errors, draw=None):
    """Return how far the tools of some arms come from the plan [m]."""
    runs = simulated_runs(*case, errors, draw or Draw(1, 0))
    return [run.tool_tracking.value for run in runs]


def test_arms_are_those_of_the_draw(case):
    errors = Robustness.exact(tool=0.01, control_period=0.01)
    few, more, others = (worst(case, errors, Draw(*d)) for d in ((2, 3), (3, 3), (2, 4)))
    assert (len(few), len(more)) == (2, 3)
    assert few == pytest.approx(more[:2])
    assert few[0] != pytest.approx(few[1], rel=1e-3)
    assert few != pytest.approx(others, rel=1e-3)


def test_errors_controller_and_its_period_count(case):
    exact = Robustness.exact(control_period=0.002)
    (least,) = worst(case, exact)
    assert least < 1e-3
    assert worst(case, replace(exact, controller="pd"))[0] > 3 * least
    assert worst(case, replace(exact, control_period=0.02))[0] > 1.5 * least
    assert worst(case, replace(exact, mass=0.5))[0] > 1.5 * least


def test_it_may_be_ended_on_the_way(case):
    calls = []

    def checkpoint():
        calls.append(None)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulated_runs(*case, Robustness.exact(control_period=0.01), Draw(1, 0), checkpoint)
