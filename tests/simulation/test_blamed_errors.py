"""Which error is to blame, where what each does is known."""

import numpy as np
import pytest

from tubeplanner import Robustness, Tube, load_problem
from tubeplanner.simulation import blamed_errors
from tubeplanner.simulation.blamed_errors import Blame, BlamedError
from tubeplanner.simulation.shortfall import Shortfall

TURNED = [[0, 0, 0, 1]] * 3
POINTS = [[0.3, -0.5, 0], [0.3, 0, 0], [0.0, 0.3, 0]]


@pytest.fixture
def problem():
    """Two segments of 40 and 20 mm, tools turned by at most 0.2 and 0.1 rad."""
    tube = Tube(POINTS, [0.04, 0.02], orientations=TURNED, rotation_tolerance=[0.2, 0.1])
    return load_problem("example:two_link/paper_1_30mm").with_tube(tube)


@pytest.fixture
def blame(monkeypatch, problem):
    """Return a function from what is short with some errors, by kind, to who is to blame."""

    def found(errors, **short):
        def shortfall(problem, present):
            least = {"rotation": -1e3, "clearance": -1e3, "self_collision": -1e3}
            value = {kind: -1e3 for kind in ("radius", "position")} | least
            value |= {kind: of(present) for kind, of in short.items()}
            arrays = {"radius": (2,), "rotation": (2,), "position": (2, 2)}
            return Shortfall(
                **{
                    kind: np.full(arrays[kind], much) if kind in arrays else much
                    for kind, much in value.items()
                }
            )

        monkeypatch.setattr(
            blamed_errors, "simulated_runs", lambda problem, motion, present, draw, check: present
        )
        monkeypatch.setattr(blamed_errors, "shown_shortfall", shortfall)
        return blamed_errors.blamed_errors(problem, None, errors, lambda: None)

    return found


def test_most_to_blame_is_what_leaves_the_least_short_if_it_is_left_out(blame):
    """4 mm by the masses, 2 mm by a delay, 0.5 mm by the tool; 3 mm are there to spare."""
    found = blame(
        Robustness.exact(mass=0.04, delay=0.002, tool=0.0005),
        radius=lambda present: 0.1 * present.mass + present.delay + present.tool - 0.003,
    )
    assert (found.kind, found.unit) == ("radius", "m")
    assert found.short == pytest.approx(0.0035)
    assert found.without_any == pytest.approx(-0.003)
    assert [(error.error, error.size) for error in found.errors] == [
        ("mass", 0.04),
        ("delay", 0.002),
        ("tool", 0.0005),
    ]
    assert [error.short for error in found.errors] == pytest.approx([-0.0005, 0.0015, 0.003])
    assert str(found) == (
        "3.5 mm of radius short; mass of 0.04 is to blame most: -0.5 mm without it"
    )


def test_a_kind_counts_in_shares_of_its_tolerance(blame):
    """Of 20 mm 1.4 mm are 0.07, of 0.1 rad 8 mrad are 0.08, of 0.1 rad of travel 9 mrad 0.09."""
    errors = Robustness.exact(mass=0.05)
    short = {"radius": lambda present: 1.4e-3, "rotation": lambda present: 8e-3}
    assert blame(errors, **short).kind == "rotation"
    assert blame(errors, **short).unit == "rad"
    short |= {"position": lambda present: 9e-3}
    assert blame(errors, **short).kind == "position"
    short |= {"clearance": lambda present: 1.9e-3}
    found = blame(errors, **short)
    assert (found.kind, found.unit) == ("clearance", "m")
    short |= {"self_collision": lambda present: 2.1e-3}
    assert blame(errors, **short).kind == "self_collision"


def test_what_is_short_without_any_error_is_the_controllers():
    blame = Blame("self_collision", "m", 0.004, 0.001, (BlamedError("mass", 0.05, 0.002),))
    assert str(blame) == (
        "4 mm of self collision short, and 1 mm without any error: the controller cannot follow"
    )
    assert blame.as_dict()["errors"][0]["size"] == 0.05


def test_other_fields_of_robustness_are_left_as_they_are(blame):
    met = []

    def short(present):
        met.append(present)
        return 0.0

    errors = Robustness.exact(lag=0.001, noise=1e-5, controller="pd", control_period=0.002)
    blame(errors, radius=short)
    assert {(one.controller, one.control_period) for one in met} == {("pd", 0.002)}
    assert [(one.lag, one.noise) for one in met] == [
        (0.001, 1e-5),
        (0.0, 1e-5),
        (0.001, 0.0),
        (0.0, 0.0),
    ]
