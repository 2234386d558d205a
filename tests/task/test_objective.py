"""Objective, controller period and Robustness: demands on a motion beside its duration."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import Objective, PlanOptions, load_problem, plan
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.task.demands import CONTROLLERS, ERRORS, Robustness

NAME = "two_link/paper_1_30mm"
PERIOD = "give the controller's, 1e-05 to 1 s"
NO_NUMBERS = (np.inf, np.nan, "1", True)


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a problem file with fields."""

    def write(**fields):
        path = tmp_path / "problem.json"
        path.write_text(json.dumps({"include": f"example:{NAME}", **fields}))
        return path

    return write


@pytest.mark.parametrize("slack", [-0.001, 10.1, np.inf, np.nan, "0.005", True])
def test_slack_is_a_share_of_time_as_is_that_of_options(slack):
    with pytest.raises(ProblemError, match=r"objective\.slack is .*; give a fraction .* to 10$"):
        Objective(slack)
    with pytest.raises(OptionError, match=r"^slack is .*; give a fraction .* from 0 .* to 10$"):
        PlanOptions(slack=slack)
    for bound in (0, 10):
        assert Objective(bound).slack == PlanOptions(slack=bound).slack == bound


def test_the_shortest_is_asked_for_unless_a_slack_is_given():
    """The options for the shortest motion have a slack of 0 unless the user gives a slack."""
    assert PlanOptions().shortest.slack == 0.0
    assert PlanOptions(slack=0.02).shortest.slack == 0.02
    assert PlanOptions("refinement", "fast").shortest.quality == "fast"


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        *(
            ({"minimise": name}, "minimise: unknown objective .*smoothness")
            for name in ("power", 1)
        ),
        *(({"duration": x}, "duration is .* s; give how long") for x in (0, 2e4, *NO_NUMBERS)),
        ({"slack": 0.01, "duration": 2.0}, r"slack is 0\.01 and objective\.duration 2 s"),
        *(
            ({"minimise": "energy", "weights": {"j": x}}, "weights of 'j' is .*; give a finite")
            for x in (-1.0, *NO_NUMBERS)
        ),
        *(
            ({"minimise": name, "weights": {"j": 1.0}}, f"but '{name}' is minimised; leave them")
            for name in ("smoothness", "work")
        ),
    ],
)
def test_a_fault_of_an_objective_is_named(fields, message):
    with pytest.raises(ProblemError, match=rf"objective\..*{message}"):
        Objective(**fields)


@pytest.mark.parametrize("period", [0.0, 1e-6, 1.1, *NO_NUMBERS])
def test_a_period_is_a_controllers(period, bundled):
    problem = bundled(NAME)
    with pytest.raises(ProblemError, match=rf"period is .* s; {PERIOD}"):
        replace(problem, period=period)
    for bound in (1e-5, 1, None):
        assert replace(problem, period=bound).period == bound


def test_an_objective_is_an_objective_and_robustness_is_one(bundled):
    with pytest.raises(ProblemError, match=r"objective is 'smoothness'; give an Objective"):
        replace(bundled(NAME), objective="smoothness")
    with pytest.raises(ProblemError, match=r"robustness is 0\.05; give a Robustness"):
        replace(bundled(NAME), robustness=0.05)


def test_files_say_both(written):
    problem = load_problem(written(objective={"slack": 0.02}, period=0.004))
    assert (problem.objective, problem.period) == (Objective(0.02, "smoothness"), 0.004)
    plain = load_problem(written())
    assert (plain.objective, plain.period) == (None, None)
    assert Objective() == Objective(0.005, "smoothness")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"objective": {"slack": -0.1}}, "objective.slack is -0.1; give a fraction"),
        ({"objective": {"minimise": "power"}}, "objective.minimise"),
        ({"objective": {"weight": {}}}, "unknown key"),
        ({"period": 4}, f"period is 4 s; {PERIOD}"),
        ({"robustness": {"mass": 2}}, "robustness.mass is 2; give a number from 0 to 0.9"),
    ],
)
def test_a_wrong_value_of_a_file_is_named(fields, message, written, run):
    status, out, err = run("plan", written(**fields))
    assert (status, out) == (2, "")
    assert message in err


@pytest.mark.parametrize("method", ["branch-and-bound", "stop-at-corners", "suh-bishop"])
def test_methods_that_make_nothing_smoother_refuse_a_slack(method, bundled, run):
    problem = bundled(NAME)
    expected = (
        f"but method '{method}' makes nothing smoother and saves nothing; "
        "give slack 0, or method 'refinement'"
    )
    with pytest.raises(OptionError, match=expected):
        plan(problem, PlanOptions(method, slack=0.005))
    with pytest.raises(OptionError, match=f"objective.duration is 2 s, {expected}"):
        plan(replace(problem, objective=Objective(duration=2.0)), PlanOptions(method))
    status, _, err = run("plan", f"example:{NAME}", "--method", method, "--slack", "0.01")
    assert status == 2
    assert f"slack is 0.01, {expected}" in err


def test_they_ignore_the_default_and_a_slack_of_zero(bundled):
    problem, method = bundled(NAME), "stop-at-corners"
    shortest = plan(problem, PlanOptions(method))
    for changed, slack in ((problem, 0.0), (replace(problem, objective=Objective(0)), None)):
        result = plan(changed, PlanOptions(method, slack=slack))
        assert result.method == method
        assert result.shortest is None
        assert result.duration == shortest.duration


@pytest.mark.parametrize("duration", [0.804, 0.8])
def test_with_a_period_a_duration_is_a_multiple_of_it(duration, bundled):
    problem = replace(bundled(NAME), objective=Objective(duration=duration), period=0.004)
    assert (problem.objective.duration, problem.objective.slack) == (duration, None)
    message = r"is 0\.802 s, no multiple of the period, 0\.004 s; give 0\.8 or 0\.804, or leave"
    with pytest.raises(ProblemError, match=message):
        replace(problem, objective=Objective(duration=0.802))


def test_weights_are_those_of_the_limits_unless_given(bundled, written):
    robot = bundled(NAME).robot
    energy = Objective(minimise="energy", weights={"joint2": 3.0})
    weights = [robot.limits.effort[0] ** -2, 3.0]
    np.testing.assert_allclose(energy.energy_weights(robot), weights)
    fields = {"duration": 1.2, "minimise": "energy", "weights": {"joint1": 2.0}}
    objective = load_problem(written(objective=fields)).objective
    assert objective == Objective(None, "energy", 1.2, {"joint1": 2.0})


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ({"elbow": 1.0}, "objective.weights: unknown joint 'elbow'"),
        ({"joint1": 0.0, "joint2": 0.0}, "objective.weights are all zero"),
    ],
)
def test_weights_of_no_joint_and_of_nothing_are_refused(bundled, weights, message):
    with pytest.raises(ProblemError, match=message):
        replace(bundled(NAME), objective=Objective(minimise="energy", weights=weights))


def test_the_usual_errors_are_assumed_but_for_the_given_ones():
    usual = Robustness()
    assert (usual.mass, usual.com, usual.payload, usual.friction) == (0.05, 0.005, 0.1, 0.2)
    assert (usual.lag, usual.delay, usual.noise) == (1e-3, 1e-3, 1e-5)
    assert (usual.tool, usual.base, usual.control_period) == (5e-4, 5e-4, 1e-3)
    assert (usual.unmodelled_friction, usual.controller) == (0.02, CONTROLLERS[0])
    stops = (usual.velocity_tolerance, usual.path_tolerance, usual.tool_tolerance)
    assert (usual.bandwidth, *stops) == (30.0, None, 0.05, None)
    exact = Robustness.exact(com=0.02)
    assert {name: getattr(exact, name) for name in ERRORS if getattr(exact, name)} == {"com": 0.02}
    assert exact.control_period == 1e-3


def test_enlarged_all_errors_are_larger_and_control_and_its_stops_are_as_they_were():
    """Enlarged errors stay within their bounds: masses within 90 %."""
    control = {"controller": "pd", "control_period": 0.002, "bandwidth": 20.0}
    control |= {"velocity_tolerance": 0.1, "path_tolerance": 0.2, "tool_tolerance": 0.01}
    errors = Robustness(mass=0.7, **control)
    enlarged = errors.enlarged(1.5)
    assert enlarged.mass == 0.9
    for name in list(ERRORS)[1:]:
        assert getattr(enlarged, name) == pytest.approx(1.5 * getattr(errors, name)), name
    assert {name: getattr(enlarged, name) for name in control} == control


def test_errors_are_told_in_percent_and_in_thousandths_of_their_units():
    errors = Robustness.exact(mass=0.05, unmodelled_friction=0.025, lag=0.0015, noise=1e-5)
    words = "mass 5 %, unmodelled friction 2.5 %, lag 1.5 ms, noise 0.01 mrad or mm"
    assert errors.in_words == words
    assert Robustness.exact().in_words == "nothing"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mass": 1.0}, "robustness.mass is 1; give a number from 0 to 0.9"),
        ({"com": -0.1}, "robustness.com is -0.1 m; give a number from 0 to 1 m"),
        ({"lag": float("nan")}, "robustness.lag is nan s; give a number from 0 to 1 s"),
        ({"control_period": 0.0}, "control_period is 0 s; give a number from 0.0001 to 0.1 s"),
        ({"bandwidth": 81.0}, "robustness.bandwidth is 81 rad/s; give a number from 1 to 80"),
        ({"path_tolerance": -1.0}, "path_tolerance is -1 rad; give a number from 1e-06 to 10 rad"),
        ({"controller": "PD"}, "robustness.controller: unknown controller 'PD'; there is: compu"),
    ],
)
def test_values_out_of_their_bounds_are_refused(values, message):
    with pytest.raises(ProblemError, match=re.escape(message)):
        Robustness(**values)


def test_a_problem_file_has_the_usual_errors_where_it_says_nothing(written):
    assert load_problem(written()).robustness is None
    assert load_problem(written(robustness={})).robustness == Robustness()
    fields = {"mass": 0.1, "controller": "pd"}
    assert load_problem(written(robustness=fields)).robustness == Robustness(**fields)
