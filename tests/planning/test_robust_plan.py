"""Plans that survive errors: what they keep back, what they cost, and what is said of them."""

import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tubeplanner import OptionError, PlanOptions, Robustness, Tube, load_problem, plan, verify
from tubeplanner.execution import error_contributions as blamed_errors
from tubeplanner.execution.plants import Draw
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning import robust_plan
from tubeplanner.planning import surviving_plans as tightening
from tubeplanner.planning.tightening import Tightening

NAME = "example:two_link/paper_2_10mm"
SHORTEST = PlanOptions(slack=0.0, quality="fast")
QUIET = Robustness.exact(noise=1e-6)  # errors that every plan survives


@pytest.fixture(autouse=True, scope="module")
def few_arms():
    """Fewer arms than a plan for a user is tried with."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (tightening, robust_plan):
            patch.setattr(module, "WORKING", Draw(3, 0))
        patch.setattr(tightening, "FEWER", Draw(2, 0))
        patch.setattr(tightening, "MANY", Draw(4, 0))
        patch.setattr(robust_plan, "_FRESH", (Draw(10, 1), Draw(10, 2)))
        patch.setattr(blamed_errors, "_DRAW", Draw(4, 0))
        yield


def problem_with(robustness, **changes):
    return replace(load_problem(NAME, changes=changes), robustness=robustness)


@pytest.fixture(scope="module")
def usual(few_arms):
    """The usual errors: the problem, its plan, and the one that knows nothing of them."""
    problem = problem_with(Robustness())
    return problem, plan(problem, SHORTEST), plan(replace(problem, robustness=None), SHORTEST)


@pytest.mark.dear("plans and simulates a dozen tightened problems")
def test_what_is_kept_back_makes_runs_survive_and_has_its_price(usual):
    problem, robust, default = usual
    certificate = verify(replace(problem, robustness=None), robust.trajectory)
    survival = robust.survival
    kept = survival.tightening
    assert robust.succeeded and certificate.passed
    assert 0.5 < kept.effort < 1
    assert certificate.conditions["effort"].margin == pytest.approx(1 - kept.effort, abs=1e-3)
    assert certificate.conditions["tube"].margin >= kept.radius.min() - 1e-6
    # Its runs survive where those of the default plan do not.
    assert survival.reached
    assert (survival.verdict.runs, survival.verdict.failed) == (10, 0)
    assert survival.verdict_without.failed > 5
    assert robust.message.endswith(f"; {survival.verdict.survived(problem.robustness)}")
    # What it costs is what its parts cost.
    assert survival.duration_without == default.duration
    assert survival.added == pytest.approx(robust.duration - default.duration)
    assert 0 < survival.added < 0.08 * default.duration
    assert list(survival.costs) == ["effort", "radius"]
    assert all(cost > 0 for cost in survival.costs.values())
    assert any("of the effort limits" in note for note in robust.notes)


def tried_with(problem, radius, *prices, **parts):
    """Return what stands for a plan with so much of a radius kept back, and its prices."""
    kept = replace(Tightening.nothing(problem), radius=np.array([radius]), **parts)
    return SimpleNamespace(tightening=kept, result=SimpleNamespace(sensitivities=prices))


def test_prices_are_those_of_whole_limits():
    """Of a radius of 10 mm, of which 6 mm were left; shares leave relative changes alone."""
    problem = problem_with(Robustness())
    radius = Sensitivity("radius", None, 0, -0.03, 0.0012)
    effort = Sensitivity("effort", "joint1", None, -0.4, 0.0015)
    tried = tried_with(problem, 0.004, radius, effort, effort=0.9)
    whole = robust_plan._of_whole_limits(problem, tried)
    assert [one.limit for one in whole] == ["radius", "effort"]
    assert whole[0].elasticity == pytest.approx(-0.05)
    assert whole[0].saved == pytest.approx(0.002)
    assert whole[1] == effort


def test_of_a_box_both_sides_are_smaller_by_twice_as_much():
    """60 by 100 mm, 5 mm taken off at every side."""
    problem = load_problem(NAME)
    points, box = problem.tube.points, {"box": [0.06, 0.1], "up": [0, 0, 1]}
    problem = problem.with_tube(Tube(points, None, cross_section=box))
    prices = [Sensitivity(side, None, 0, -0.01, 0.001) for side in ("width", "height")]
    whole = robust_plan._of_whole_limits(problem, tried_with(problem, 0.005, *prices))
    saved = {one.limit: one.saved for one in whole}
    assert saved == pytest.approx({"width": 0.001 * 60 / 50, "height": 0.001 * 100 / 90})


@pytest.mark.dear("simulates two dozen runs")
def test_a_plan_that_survives_by_itself_is_left_as_it_is():
    problem = problem_with(QUIET)
    fast = PlanOptions(quality="fast")
    robust, default = plan(problem, fast), plan(replace(problem, robustness=None), fast)
    assert np.array_equal(robust.trajectory.coefficients, default.trajectory.coefficients)
    survival = robust.survival
    assert survival.reached and survival.verdict.failed == 0
    assert (survival.costs, survival.verdict_without) == ({}, None)
    assert not any(survival.tightening.has(part) for part in ("effort", "radius", "clearance"))


@pytest.mark.slow  # plans and simulates many tightened problems
def test_smoothed_and_in_whole_periods_it_survives_as_well():
    problem = replace(problem_with(Robustness(), **{"objective.slack": 0.01}), period=0.004)
    robust = plan(problem)
    assert robust.survival.verdict.failed == 0
    assert robust.duration / 0.004 == pytest.approx(round(robust.duration / 0.004), abs=1e-6)
    assert robust.duration > robust.shortest_duration
    assert any(note.startswith("smoothed") for note in robust.notes)


@pytest.mark.slow  # plans and simulates many tightened problems
def test_where_none_survives_the_error_that_is_to_blame_is_named():
    problem = problem_with(Robustness.exact(tool=0.02, mass=0.001), **{"tube.radius": 0.004})
    robust = plan(problem, SHORTEST)
    survival = robust.survival
    assert (robust.status, robust.trajectory) == (PlanStatus.NO_TRAJECTORY, None)
    assert not survival.reached and survival.verdict.failed > 0
    assert [one.error for one in survival.contribution.errors] == ["tool", "mass"]
    assert survival.contribution.errors[0].short < 0 < survival.contribution.short
    assert f"no plan survives these errors; of the best one {survival.verdict}" in robust.message
    assert "tool of 0.02 is to blame most" in robust.message
    assert robust.location.segment == 0  # where it leaves the tube


@pytest.mark.slow  # plans and simulates many tightened problems
def test_a_controller_that_cannot_follow_is_to_blame():
    slow = Robustness.exact(control_period=0.05, mass=0.01, path_tolerance=1e-5)
    problem = problem_with(slow, **{"tube.radius": 0.001})
    survival = plan(problem, SHORTEST).survival
    assert not survival.reached
    assert survival.contribution.without_any > 0
    assert "without any error: the controller cannot follow" in str(survival.contribution)


@pytest.mark.parametrize(
    ("stage", "says"),
    [
        ("3 simulated runs", "whether it survives was not simulated"),
        ("10 fresh simulated runs", "its runs were not simulated to the end"),
    ],
)
def test_stopped_early_it_ends_with_what_is_certified(stage, says):
    problem = problem_with(QUIET)

    def stop(progress):
        if progress.stage == stage:
            raise KeyboardInterrupt

    found = plan(problem, SHORTEST, stop)
    assert (found.succeeded, found.stopped_by) == (True, "interrupt")
    assert found.message.endswith(says)
    assert verify(problem, found.trajectory).passed


@pytest.mark.dear("plans, simulates and tightens until runs survive")
def test_stopped_before_many_arms_have_run_it_ends_with_what_survived_few():
    problem = problem_with(Robustness.exact(mass=0.02))

    def stop(progress):
        if progress.stage == "4 simulated runs":
            raise KeyboardInterrupt

    found = plan(problem, PlanOptions(quality="fast"), stop)
    survival = found.survival
    assert found.stopped_by == "interrupt"
    assert (survival.reached, survival.verdict) == (True, None)
    assert survival.tightening.has("effort")
    assert verify(problem, found.trajectory).passed


def test_without_mujoco_the_field_is_refused_by_name(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    problem = problem_with(Robustness())
    with pytest.raises(OptionError, match=r"the field robustness takes MuJoCo 3.*pip install"):
        plan(problem)
    assert plan(problem, PlanOptions(robust=False)).survival is None


@pytest.mark.parametrize("method", ["branch-and-bound", "stop-at-corners", "suh-bishop"])
def test_other_methods_do_not_honour_it(method):
    with pytest.raises(OptionError, match=f"robustness, which method '{method}' does not support"):
        plan(problem_with(Robustness()), PlanOptions(method, slack=0.0))
