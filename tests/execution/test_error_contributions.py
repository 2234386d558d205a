"""Contribution of each model error to failed runs; missing tolerance."""

from dataclasses import replace

import numpy as np
import pytest
from cases import judged_run, rest_to_rest

from tubeplanner import Robustness, Tube, load_problem
from tubeplanner.execution import error_contributions as blamed_errors
from tubeplanner.execution.error_contributions import (
    BlamedError,
    ErrorContribution,
    Shortfall,
    shown_shortfall,
    simulated_runs,
)
from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.plants import Draw
from tubeplanner.outcome import Location


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
    few, more, others = (worst(case, errors, Draw(*d)) for d in ((3, 3), (4, 3), (3, 4)))
    assert (len(few), len(more)) == (3, 4)
    assert few == pytest.approx(more[:3])
    assert few[0] != pytest.approx(few[2], rel=1e-3)
    assert few[2] != pytest.approx(others[2], rel=1e-3)


def test_errors_controller_its_period_and_bandwidth_count(case):
    exact = Robustness.exact(control_period=0.002)
    (least,) = worst(case, exact)
    assert least < 1e-3
    assert worst(case, replace(exact, controller="pd"))[0] > 1.2 * least
    assert worst(case, replace(exact, control_period=0.02))[0] > 1.5 * least
    heavy = replace(exact, mass=0.5)
    assert worst(case, heavy)[0] > 1.5 * least
    assert worst(case, replace(heavy, bandwidth=10.0))[0] > 3 * worst(case, heavy)[0]


def test_it_may_be_ended_on_the_way(case):
    calls = []

    def checkpoint():
        calls.append(None)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulated_runs(*case, Robustness.exact(control_period=0.01), Draw(1, 0), checkpoint)


POINTS = [[0.3, -0.5, 0], [0.3, 0, 0], [0.0, 0.3, 0], [0.3, 0.3, 0]]


@pytest.fixture(scope="module")
def problem():
    """Three segments."""
    tube = Tube(POINTS, 0.03, numbers=[0, 2, 5, 6], pass_through_points="all")
    return load_problem("example:two_link/paper_1_30mm").with_tube(tube)


def run(tube=(-0.01, -0.01, -0.01), near=None, **given):
    usual = {
        "clearance": 0.02,
        "tube_by_segment": np.array(tube),
        "rotation_by_segment": np.array([-1e3] * 3),
        "position_by_joint": -np.ones((2, 2)),
        "velocity_by_joint": np.array([0.84, 1.26]),
        "tracking_by_joint": np.array([0.3, 1.1]),
    }
    near = None if near is None else Extreme(near, Location())
    return judged_run(**(usual | {"obstacles": near} | given))


def test_the_same_in_every_run_is_what_is_short(problem):
    found = shown_shortfall(problem, [run((0.004, -0.002, 0.0), near=0.017)] * 3)
    assert found.radius == pytest.approx([0.004, -0.002, 0.0])
    assert found.clearance == pytest.approx(0.003)
    assert found.position == pytest.approx(-np.ones((2, 2)))
    assert found.most("radius") == pytest.approx(0.004)
    # Of velocities 1.05 of their limits are allowed.
    assert found.velocity == pytest.approx([-0.2, 0.2])
    assert found.tracking == pytest.approx([-0.7, 0.1])
    found = shown_shortfall(problem, [run(), run()])  # what nothing asks is never short
    assert found.clearance == -1e3
    assert found.self_collision == -1e3
    assert (found.rotation == -1e3).all()
    assert found.tool_tracking == -1
    far = run(
        tool_tracking=Extreme(0.003, Location()), stops={"velocity": 1.05, "tool_tracking": 2e-3}
    )
    assert shown_shortfall(problem, [far]).tool_tracking == pytest.approx(0.5)


def test_what_a_contact_lacks_is_a_share_of_what_it_carries(problem):
    for used, short in ((0.9, -0.1), (1.2, 0.2), (50.0, 0.5)):  # of a lost part no share is known
        held = run(holding=Extreme(used, Location()))
        assert shown_shortfall(problem, [held] * 2).holding == pytest.approx(short)
    assert shown_shortfall(problem, [run()]).holding == -1e3


def test_more_is_expected_of_others_than_was_seen(problem):
    """Of 95 from a normal distribution, the mean and 2.5 deviations; of more, the largest."""
    drawn = np.random.default_rng(0).normal(0.0, 0.001, 96)
    runs = [run((value, -1.0, -1.0)) for value in drawn]
    assert shown_shortfall(problem, runs).radius[0] == drawn.max()
    expected = drawn[:95].mean() + 2.5 * drawn[:95].std()
    assert expected > drawn.max()
    assert shown_shortfall(problem, runs[:95]).radius[0] == pytest.approx(expected)
    few = shown_shortfall(problem, [run((value, -1.0, -1.0)) for value in (0.0, 0.001)])
    assert few.radius[0] == pytest.approx(0.0005 + 2.5 * 0.0005)
    lost = [run((0.0, -1.0, -1.0))] * 49 + [run((1.0, -1.0, -1.0))]
    assert shown_shortfall(problem, lost).radius[0] == 1.0


def test_a_compulsory_point_that_is_missed_asks_of_both_segments_beside_it(problem):
    """Point 5 is the third, between the second and the third segment."""
    missed = Extreme(0.006, Location(point=5))
    found = shown_shortfall(problem, [run((0.001, 0.002, 0.02), points=missed)] * 2)
    assert found.radius == pytest.approx([0.001, 0.006, 0.02])
    # Point 2 by 4 mm, point 5 by 6 mm: 5 mm and 2.5 deviations of 1 mm.
    both = [Extreme(0.004, Location(point=2)), missed]
    found = shown_shortfall(problem, [run((-1.0, -1.0, -1.0), points=one) for one in both])
    assert found.radius == pytest.approx([-1.0, 0.0075, 0.0075])


def test_links_that_meet_are_short_of_room(problem):
    met = Extreme(-0.002, Location())
    assert shown_shortfall(problem, [run(), run(self_collision=met)]).self_collision == 0.002
    turned = replace(run(), rotation_by_segment=np.array([0.01, -0.2, -0.2]))
    assert shown_shortfall(problem, [turned]).rotation == pytest.approx([0.01, -0.2, -0.2])


@pytest.fixture
def two_segments():
    """Segments of 40 and 20 mm, tools turned by at most 0.2 and 0.1 rad."""
    turns = {"orientations": [[0, 0, 0, 1]] * 3, "rotation_tolerance": [0.2, 0.1]}
    tube = Tube(POINTS[:3], [0.04, 0.02], **turns)
    return load_problem("example:two_link/paper_1_30mm").with_tube(tube)


@pytest.fixture
def contribution(monkeypatch, two_segments):
    """Return a function from what is short with some errors, by kind, to who is to blame."""

    shapes = {"radius": 2, "rotation": 2, "position": (2, 2), "velocity": 2, "tracking": 2}

    def found(errors, **short):
        def shortfall(problem, present):
            kinds = (*shapes, "clearance", "self_collision", "tool_tracking")
            value = dict.fromkeys(kinds, -1e3)
            value |= {kind: of(present) for kind, of in short.items()}
            return Shortfall(
                **value | {kind: np.full(shapes[kind], value[kind]) for kind in shapes}
            )

        monkeypatch.setattr(
            blamed_errors, "simulated_runs", lambda problem, motion, present, draw, check: present
        )
        monkeypatch.setattr(blamed_errors, "shown_shortfall", shortfall)
        return blamed_errors.blamed_errors(two_segments, None, errors, lambda: None)

    return found


def test_most_to_blame_is_what_leaves_the_least_short_if_it_is_left_out(contribution):
    """4 mm by the masses, 2 mm by a delay, 0.5 mm by the tool; 3 mm are there to spare."""
    found = contribution(
        Robustness.exact(mass=0.04, delay=0.002, tool=0.0005),
        radius=lambda present: 0.1 * present.mass + present.delay + present.tool - 0.003,
    )
    assert (found.kind, found.unit) == ("radius", "m")
    assert found.short == pytest.approx(0.0035)
    assert found.without_any == pytest.approx(-0.003)
    sizes = {error.error: error.size for error in found.errors}
    assert sizes == {"mass": 0.04, "delay": 0.002, "tool": 0.0005}
    assert [error.short for error in found.errors] == pytest.approx([-0.0005, 0.0015, 0.003])
    assert str(found) == (
        "3.5 mm of radius short; mass of 0.04 is to blame most: -0.5 mm without it"
    )


def test_a_kind_counts_in_shares_of_its_tolerance(contribution):
    """Of 20 mm 1.4 mm are 0.07, of 0.1 rad 8 mrad are 0.08, of 0.1 rad of travel 9 mrad 0.09."""
    short = {"radius": lambda _: 1.4e-3}
    for kind, much, unit in (
        ("rotation", 8e-3, "rad"),
        ("position", 9e-3, None),
        ("clearance", 1.9e-3, "m"),
        ("self_collision", 2.1e-3, "m"),
        ("velocity", 0.11, ""),
        ("tracking", 0.12, ""),
        ("tool_tracking", 0.13, ""),
    ):
        short[kind] = lambda _, much=much: much
        found = contribution(Robustness.exact(mass=0.05), **short)
        assert found.kind == kind
        assert unit in (None, found.unit)


def test_what_is_short_without_any_error_is_the_controllers():
    contribution = ErrorContribution(
        "self_collision", "m", 0.004, 0.001, (BlamedError("mass", 0.05, 0.002),)
    )
    assert str(contribution) == (
        "4 mm of self collision short, and 1 mm without any error: the controller cannot follow"
    )
    assert contribution.as_dict()["errors"][0]["size"] == 0.05
    fast = replace(contribution, kind="velocity", unit="", short=0.034, without_any=-0.05)
    assert str(fast) == "3.4 % of velocity short; mass of 0.05 is to blame most: 0.2 % without it"


def test_other_fields_of_robustness_are_left_as_they_are(contribution):
    met = []

    def short(present):
        met.append(present)
        return 0.0

    errors = Robustness.exact(lag=0.001, noise=1e-5, controller="pd", control_period=0.002)
    contribution(errors, radius=short)
    assert {(one.controller, one.control_period) for one in met} == {("pd", 0.002)}
    errors = [(one.lag, one.noise) for one in met]
    assert errors == [(0.001, 1e-5), (0.0, 1e-5), (0.001, 0.0), (0.0, 0.0)]
