"""Leans at which held parts stay at rest, and branches whose tool keeps them there."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.first_guess.branches import KnownBranches, redundancy_rules
from tubeplanner.first_guess.upright import holds, kept_upright, upright_cone
from tubeplanner.outcome import PlanningClock
from tubeplanner.planning.free_plans import goal_configurations
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Cup, Holding, Liquid, Tray, margins_against, rest_margins


def free(problem, holding=()):
    tube = replace(problem.tube, orientations=None, rotation_tolerance=None)
    return replace(problem, tube=tube, holding=holding)


def upright(problem):
    """Return what is upright in the tool frame at the start, (3,)."""
    return problem.robot.tool_pose(problem.start[None])[0][0][2]


def on_a_tray(problem, normal, com=(0.0, 0.0)):
    part = Payload(1.0, tuple(0.05 * normal + np.array([*com, 0.0])))
    return Holding(Tray(0.3, 0.04, safety=1.0, normal=tuple(normal.tolist())), part)


@pytest.mark.parametrize(("contact", "lean"), [(Liquid, 0.26), (Tray, np.arctan(0.3)), (Cup, None)])
def test_the_cone_is_that_of_the_contact(contact, lean, bundled):
    """A liquid's tilt, a tray's angle of friction; a strong cup holds in every direction."""
    problem = bundled("ur5/level_tray")
    normal = upright(problem) + np.array([0.02, -0.05, 0.0])
    normal /= np.linalg.norm(normal)
    made = {
        Liquid: lambda: Holding(Liquid(0.26, normal=tuple(normal))),
        Tray: lambda: on_a_tray(problem, normal),
        Cup: lambda: Holding(Cup(100.0, 0.03, 0.5), Payload(0.2)),
    }[contact]()
    cone = upright_cone(replace(problem, holding=(made,)), problem.start[None])
    if lean is None:
        assert cone is None
        return
    np.testing.assert_allclose(cone.axis, normal, atol=1e-9)
    assert cone.angle == pytest.approx(lean, abs=6e-3)


def test_a_part_beside_the_middle_of_its_foot_has_another_axis(bundled):
    """It tips over the near edge first: leaning to the other side, it may lean by more."""
    problem = bundled("ur5/level_tray")
    holding = on_a_tray(problem, upright(problem), com=(0.035, 0.0))
    problem = replace(problem, holding=(holding,))
    cone = upright_cone(problem, problem.start[None])
    assert abs(cone.axis[0]) > 0.05
    assert 0.02 < cone.angle < np.arctan(0.3)
    random = np.random.default_rng(0).normal(size=(500, 3))
    sideways = random - (random @ cone.axis)[:, None] * cone.axis
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    up = np.cos(0.98 * cone.angle) * cone.axis + np.sin(0.98 * cone.angle) * sideways
    assert margins_against(problem.holding, 9.81 * up).min() > 0


@pytest.mark.parametrize(
    "name", ["ur5/over_the_wall", "ur5/level_tray", "xarm7/from_crate_to_crate"]
)
def test_branches_hold_at_rest_where_orientations_are_free(name, bundled):
    """Without the holding, they lean by 30 degrees; the tool's normal is no axis of its frame."""
    own = free(bundled(name)).joined
    problem = replace(own, holding=(on_a_tray(own, upright(own)),))
    clock = PlanningClock(None, None)
    branches, others = KnownBranches(problem, clock), KnownBranches(own, clock)
    for known, is_held in ((branches, True), (others, False)):
        every = [known.by_rule(rule) for rule in redundancy_rules(problem)]
        for branch in (*every, known.joint_lines()):
            assert all(holds(problem, q) for q in branch.segments) == is_held
    np.testing.assert_array_equal(branches.joint_lines().start, own.start)


def test_a_rotation_tolerance_is_narrowed_to_what_holds_the_part(bundled):
    problem = bundled("ur5/level_tray").joined
    tube = replace(problem.tube, rotation_tolerance=((0.5, 0.5, np.inf),) * 3)
    problem = replace(problem, tube=tube, holding=(on_a_tray(problem, upright(problem)),))
    inner = kept_upright(problem, problem.start)
    bounds = np.array(inner.tube.rotation_tolerance)
    assert (np.hypot(*bounds[:, :2].T) < np.arctan(0.3)).all()
    assert (bounds[:, :2] > 0.1).all()
    assert np.isinf(bounds[:, 2]).all()
    wide = replace(problem, holding=(Holding(Liquid(1.2, normal=tuple(upright(problem)))),))
    assert kept_upright(wide, wide.start) is None


def test_goal_configurations_of_a_position_hold_the_part(bundled):
    own = free(bundled("ur5/over_the_wall"))
    ends = np.array([own.robot.tool_position(own.start[None])[0], own.tube.points[-1]])
    held = replace(own, tube=Tube.anywhere(*ends), holding=(on_a_tray(own, upright(own)),))
    goals = goal_configurations(held, held.start, 1)
    assert len(goals) > 1
    assert rest_margins(held.robot, held.holding, goals).min() > 0
