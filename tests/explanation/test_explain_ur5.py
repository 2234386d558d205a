"""Explanations of what is wrong with a UR5 that lifts over a wall, where the remedy is known."""

import numpy as np
import pytest

from tubeplanner import explain, load_problem, plan
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.plan_options import PlanOptions

pytestmark = pytest.mark.slow
PROBLEM = "example:ur5/over_the_wall"
LIFT = "robot.limits.effort.shoulder_lift_joint"
ELBOW = "robot.limits.position.elbow_joint"
QUICK = PlanOptions(quality="fast", slack=0.0)


def explained(changes):
    return explain(PROBLEM, changes=changes, options=QUICK, time_limit=1000.0)


def require_planned(changes, remedy):
    result = plan(load_problem(PROBLEM, changes={**changes, **remedy.changes}), QUICK)
    assert result.succeeded
    assert result.duration == pytest.approx(remedy.duration, rel=1e-6)


def test_the_effort_that_holds_the_arm_at_its_start_is_found():
    changes = {LIFT: 25.0}
    problem = load_problem(PROBLEM)
    needed = abs(problem.robot.gravity_effort(np.array([problem.start]))[0, 1])
    found = explained(changes)
    assert (found.status, found.place.joint) == (
        PlanStatus.GRAVITY_EXCEEDS_EFFORT,
        "shoulder_lift_joint",
    )
    (remedy,) = found.remedies
    assert remedy.field == LIFT
    assert 25.0 < remedy.too_little < needed <= remedy.after <= 25 + 1.06 * (needed - 25)
    require_planned(changes, remedy)


def test_a_start_beyond_a_limit_is_mended_by_turning_it_or_by_the_limit():
    start = load_problem(PROBLEM).start
    changes = {ELBOW: [0.0, float(start[2]) - 0.03]}
    found = explained(changes)
    assert (found.status, found.result) == (PlanStatus.BAD_INPUT, None)
    assert {remedy.field for remedy in found.remedies} == {ELBOW, "start.joints", "start"}
    for remedy in found.remedies:
        if remedy.field == "start":
            continue
        size = np.abs(np.subtract(remedy.after, remedy.before)).max()
        assert 0.03 * (1 - 1e-5) <= size <= 1.05 * 0.03
        require_planned(changes, remedy)


def test_a_sign_that_keeps_the_arm_on_one_side_is_freed():
    kept = {"elbow_joint": "+", "shoulder_pan_joint": [-1.2, -0.2]}
    found = explained({"tube.joint_signs": kept})
    assert found.status is PlanStatus.UNREACHABLE
    first = found.remedies[0]
    assert first.field == "tube.joint_signs.shoulder_pan_joint"
    assert first.after == "0"
    require_planned({}, first)
