"""The method as published, as a whole: certified, budgeted, repeatable, interruptible."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import (
    OptionError,
    Payload,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    Tube,
    load_robot,
    plan,
    verify,
)
from tubeplanner.errors import TrajectoryError
from tubeplanner.first_guess.knot_modification import ModificationOptions
from tubeplanner.first_guess.suh_bishop import SuhBishopOptions
from tubeplanner.first_guess.waypoints import sequential_quartics
from tubeplanner.planning.waypoint_plans import _require_held

METHOD = "suh-bishop"
# Coarse, so that tests are quick: few directions, few numbers of knots.
QUICK = SuhBishopOptions(ModificationOptions(halvings=1), 0, 1, 1, max_knots=11, node_budget=800)
OPTIONS = PlanOptions(METHOD, suh_bishop=QUICK)


@pytest.fixture(scope="module")
def example(bundled, shared):
    problem = bundled("two_link/paper_3_50mm")
    return problem, shared("suh-bishop.paper_3_50mm", lambda: plan(problem, OPTIONS))


def test_example_three_is_certified_and_as_fast_as_printed(example):
    """Table II: 0.95 s after phase 1, 0.80 s after phase 2."""
    problem, result = example
    assert (result.succeeded, result.method) == (True, METHOD)
    assert verify(problem, result.trajectory).passed
    assert result.phase1_duration == pytest.approx(0.95, rel=0.05)
    assert result.duration < 1.1 * 0.80
    # Knots pass at equal times, pieces are quartics.
    np.testing.assert_allclose(np.diff(result.trajectory.widths), 0, atol=1e-12)
    assert len(result.trajectory.coefficients) == 5


def test_no_step_makes_it_slower_and_the_best_is_kept(example):
    _, result = example
    steps = result.phase_two.steps
    assert [step.process for step in steps][:2] == ["MP", "other knots"]
    assert steps[-1].process == "DP"
    assert steps[0].begin == result.phase1_duration
    assert all(step.duration <= step.begin for step in steps)
    assert result.duration == min(step.duration for step in steps)
    best = min(steps, key=lambda step: step.duration)
    assert result.phase_two.knots == best.knots == len(result.trajectory.breakpoints)


def test_what_it_did_is_in_the_json_and_in_words(example):
    _, result = example
    fields = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert fields["phase1_duration"] == result.phase1_duration
    phase_two = fields["phase_two"]
    assert phase_two["steps"][0]["knots"] == 6
    assert list(phase_two) == ["steps", "knots", "nodes", "directions", "proved", "budget_reached"]
    assert "with 6 knots" in str(result.phase_two)
    assert f"{result.phase_two.nodes} nodes for" in str(result.phase_two)


def test_six_joints_within_a_small_budget(bundled):
    problem = bundled("ur5/over_the_wall")
    few = replace(QUICK, node_budget=400)
    result = plan(problem, PlanOptions(METHOD, candidate_points=12, suh_bishop=few))
    assert result.succeeded
    assert verify(problem, result.trajectory).passed
    assert result.duration < result.phase1_duration
    assert result.phase_two.budget_reached
    assert result.message.endswith("; searches of phase 2 ended at their shares of the node budget")
    assert "some ended at their fraction of the node budget" in str(result.phase_two)


def test_where_phase_one_finds_nothing_no_other_method_answers(bundled):
    """Too few points for two corners at 1 cm; stopping at them would be possible."""
    problem = bundled("two_link/paper_5_10mm")
    result = plan(problem, PlanOptions(METHOD, candidate_points=8))
    assert (result.status, result.method) == (PlanStatus.NO_TRAJECTORY, METHOD)
    assert result.phase_two is None
    assert result.message.startswith(
        "phase 1 found no certified trajectory through 8 points of the reference path ("
    )
    assert result.search.cuts["tube"] > 0


def test_gravity_that_no_motor_holds_is_the_reason():
    payload, gravity = Payload(60.0), (0, -9.81, 0)
    robot = load_robot("example:two_link", "hand", payload=payload, gravity=gravity)
    tube = Tube([[0.45, -0.3, 0], [0.45, 0.2, 0]], 0.05, joint_signs={"joint2": "-"})
    problem = PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))
    assert plan(problem, OPTIONS).status is PlanStatus.GRAVITY_EXCEEDS_EFFORT


def interrupting(stage, times):
    """Return a progress callback that presses Ctrl-C the so-manieth time at a stage."""
    left = [times]

    def progress(now):
        left[0] -= now.stage == stage
        if left[0] == 0:
            raise KeyboardInterrupt

    return progress


def test_ctrl_c_during_phase_two_ends_with_the_best_so_far(example):
    problem, whole = example
    result = plan(problem, OPTIONS, interrupting("moving knots", 4))
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    assert result.phase_two.directions == 3
    assert whole.duration < result.duration < result.phase1_duration


def test_ctrl_c_during_phase_one_ends_without_phase_two(example):
    problem, _ = example
    result = plan(problem, OPTIONS, interrupting("branch and bound", 40))
    assert result.stopped_by == "interrupt"
    assert result.duration == result.phase1_duration
    assert result.phase_two.steps == ()


def test_ctrl_c_before_anything_is_certified_is_passed_on(example):
    problem, _ = example
    with pytest.raises(KeyboardInterrupt):
        plan(problem, OPTIONS, interrupting("candidate points on the reference path", 1))


def test_a_time_limit_that_leaves_no_time_is_the_reason(example):
    problem, _ = example
    result = plan(problem, replace(OPTIONS, time_limit=1e-6))
    assert (result.status, result.stopped_by) == (PlanStatus.TIME_LIMIT, "time_limit")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"fewer_knots": -1}, "fewer_knots is -1; it must be >= 0"),
        ({"doubled": 0}, "doubled is 0; it must be >= 1"),
        ({"max_knots": 1}, "max_knots is 1; it must be >= 2"),
        ({"node_budget": 0}, "node_budget is 0; it must be >= 1"),
        ({"min_gain": 1}, "min_gain is 1; it must be > 0 and < 1"),
    ],
)
def test_options_are_checked(wrong, message):
    with pytest.raises(OptionError, match=message):
        SuhBishopOptions(**wrong)


def test_without_an_answer_gravity_is_judged_however_far_quartics_would_swing(bundled):
    """Quartics through 30 points of a zigzag swing by more than any number means."""
    problem = bundled("two_link/around_a_post")
    zigzag = np.column_stack([np.linspace(0, 1, 30), 1.5 * (-1.0) ** np.arange(30)])
    with pytest.raises(TrajectoryError, match="nothing can be computed"):
        sequential_quartics(problem.robot.joint_names, zigzag)
    _require_held(problem, zigzag)
