"""The last orientation against what the goal asks, beside what the tube asks on the way."""

import numpy as np
import pytest

from cases import changed
from tubeplanner import GoalRegion, Tube, verify

TRAY = "ur5/level_tray"


def ended(stored, bound, tolerance=None):
    """Return the condition of a tray's motion, its goal and perhaps its tube bounded otherwise."""
    problem, trajectory = stored(TRAY)
    tube = problem.tube
    if tolerance is not None:
        tube = Tube(
            tube.points,
            tube.radius,
            joint_signs=list(tube.joint_ranges),
            orientations=tube.orientations,
            rotation_tolerance=tolerance,
        )
    goal = GoalRegion(tube.points[-1], 0.0, bound)
    certificate = verify(changed(problem, tube=tube, goal=goal), trajectory)
    return certificate.conditions["rotation"], trajectory


def vector(stored):
    """Return the rotation vector from the last orientation to the end's."""
    problem, trajectory = stored(TRAY)
    rotation, tool = problem.robot.tool_pose(trajectory.position([trajectory.duration]))
    return problem.tube.rotation.error(rotation, tool, problem.tube.segment_count - 1)[0]


@pytest.mark.parametrize("components", [False, True])
def test_the_end_is_judged_against_the_last_orientation(components, stored):
    turned = abs(vector(stored))
    worst = int(turned.argmax())
    assert turned[worst] > 2e-3
    room = np.where(np.arange(3) == worst, 1e-3, 0.2)
    bound = tuple((turned + room).tolist()) if components else float(np.linalg.norm(turned)) + 1e-3
    condition, trajectory = ended(stored, bound, tolerance=np.inf)
    assert condition.margin == pytest.approx(1e-3, abs=1e-9)
    assert (condition.unit, condition.coverage) == ("rad", "at the goal")
    assert condition.where.time == trajectory.duration
    less = tuple(value - 2e-3 for value in bound) if components else bound - 2e-3
    assert ended(stored, less, tolerance=np.inf)[0].margin == pytest.approx(-1e-3, abs=1e-9)


def test_the_lesser_margin_counts(stored):
    alone, _ = ended(stored, None)
    assert alone.coverage == "for all t"
    wide, _ = ended(stored, 3.0)
    assert wide == alone
    tight = float(np.linalg.norm(vector(stored))) - 1e-3
    if tight > 0:
        assert ended(stored, tight)[0].coverage == "at the goal"


def test_a_goal_that_bounds_nothing_is_not_judged(stored):
    free, _ = ended(stored, (np.inf, np.inf, np.inf), tolerance=np.inf)
    assert free.margin is None
