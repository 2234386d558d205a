"""Prices of efforts and torque-speed lines with friction, against planning again."""

import numpy as np
import pytest

from cases import with_motors
from tubeplanner import LimitOverrides, PlanningProblem, Seed, Tube, load_robot
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.refinement.descent import FIRST_PENALTY
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.spline_start import starting_spline
from tubeplanner.refinement.trust_region import TrustRegion

ARMED = {"armature": 0.2, "viscous_friction": 1.5}
FRICTION = {"backwards_friction": [5.0, 1.5], "forwards_friction": [3.0, 2.0]}
LINE = {"saturation_effort": np.array([130.0, 40.0]), "no_load_velocity": np.array([8.0, 12.0])}
EFFORT = np.array([95.0, 27.0])
ROUNDED = 50.0  # knot intervals


def problem_with(effort=EFFORT, **motors):
    limits = LimitOverrides(
        velocity=dict.fromkeys(("joint1", "joint2"), np.inf),
        effort={"joint1": effort[0], "joint2": effort[1]},
    )
    plain = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"})
    return PlanningProblem(with_motors(plain, **motors), tube, Seed(np.array([0.0, -1.0])))


def changed(kind, joint, factor, motors):
    """Return the problem with the limit of one joint changed."""
    own = np.where(np.arange(2) == joint, factor, 1.0)
    if kind == "effort":
        return problem_with(EFFORT * own, **motors)
    return problem_with(**motors | {name: both * own for name, both in LINE.items()})


def polished(problem, spline):
    """Plan again from a spline near by, on the same knots, to a tight tolerance.

    Friction is blended so widely that the least duration has no kinks between which steps end.
    """
    program = SequentialProgram(problem, spline.grid)
    program.constraints.blend(ROUNDED)
    begin = program.iterate(spline)
    found = program.improved(begin, TrustRegion(0.01), FIRST_PENALTY, min_gain=1e-8, max_steps=60)
    return program, found.iterate


CASES = {
    "viscous": ARMED,
    "Coulomb": ARMED | FRICTION,
    "uncertain": ARMED | FRICTION | {"friction_uncertainty": 0.3},
    "line": LINE,
    "line and friction": LINE | ARMED | FRICTION,
}


@pytest.mark.parametrize("name", CASES)
def test_they_are_what_planning_again_finds(name):
    """Of efforts and lines of each joint alone, changed by half a percent."""
    motors = CASES[name]
    problem = problem_with(**motors)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    program, best = polished(problem, refined.spline)
    kinds = {"effort"} | ({"motor_curve"} if "line" in name else set())
    own = {key: e for key, e in program.elasticities(best).items() if key.kind in kinds}
    assert {key.kind for key in own} == kinds
    for key, elasticity in own.items():
        found = [
            polished(changed(key.kind, key.joint, factor, motors), best.spline)[1].duration
            for factor in (1.005, 0.995)
        ]
        quotient = np.log(found[0] / found[1]) / np.log(1.005 / 0.995)
        near = 0.1 if "forwards_friction" not in motors else 0.3
        assert elasticity == pytest.approx(quotient, rel=near, abs=4e-3)
    assert min(own.values()) < -0.1
