"""Sensitivities of the duration, motors included."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from cases import SHORTEST, with_motors
from tubeplanner import (
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    PointSpeed,
    Seed,
    Tube,
    load_problem,
    load_robot,
    parse_problem,
    plan,
)
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.refinement.descent import FIRST_PENALTY
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.spline_start import starting_spline
from tubeplanner.refinement.trust_region import TrustRegion

# The sensitivities against planning again, and against what it must add up to.


ROBOTS = Path(__file__).resolve().parents[2] / "robots"
EVERY = {"joint1": np.inf, "joint2": np.inf}
# Both joints come so near to these ends that they count.
NEAR = {
    "joint1": {"deceleration": 4.0, "offset": 0.3, "lower": -0.5, "upper": 2.0},
    "joint2": {"deceleration": 5.0, "offset": 0.2, "lower": -2.0, "upper": 0.5},
}
LAW_AND_POINTS = ("velocity_by_position", "point_speed")


def arm(**limits):
    limits = {"velocity": EVERY, **limits}
    overrides = LimitOverrides(**limits)
    return load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=overrides)


def problem_with(robot=None, radius=(0.05, 0.05)):
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, np.array(radius), joint_signs={"joint2": "-"})
    return PlanningProblem(robot or arm(), tube, Seed(np.array([0.0, -1.0])))


@pytest.mark.parametrize(
    "limits",
    [
        {},
        {"velocity": {"joint1": 3.0, "joint2": 2.5}},
        {"acceleration": {"joint1": 15.0, "joint2": 30.0}},
        {"jerk": {"joint1": 400.0, "joint2": 600.0}},
        {"tool_speed": 0.9},
        {"effort_rate": {"joint1": 300.0, "joint2": 80.0}},
        {"point_speed": [PointSpeed("hand", (0.0, 0.1, 0.0), 0.9)]},
        {"velocity_by_position": NEAR},
    ],
    ids=[
        "effort",
        "velocity",
        "acceleration",
        "jerk",
        "tool_speed",
        "effort_rate",
        "point_speed",
        "velocity_by_position",
    ],
)
def test_without_gravity_all_limits_together_have_a_known_sensitivity(limits):
    """Twice the efforts and accelerations, four times the speed... T falls in proportion."""
    sensitivities = plan(problem_with(arm(**limits)), SHORTEST).sensitivities
    order = {"effort": 2, "acceleration": 2, "velocity": 1, "jerk": 3, "radius": 0}
    order |= dict.fromkeys(("tool_speed", "point_speed", "velocity_by_position"), 1)
    order["effort_rate"] = 3
    total = sum(order[sensitivity.limit] * sensitivity.elasticity for sensitivity in sensitivities)
    assert all(
        any(one.limit == kind and one.elasticity < -0.01 for one in sensitivities)
        for kind in limits
    )
    assert total == pytest.approx(-1.0, abs=1e-4)
    assert all(sensitivity.elasticity <= 0 for sensitivity in sensitivities)
    assert [sensitivity.saved for sensitivity in sensitivities] == sorted(
        (p.saved for p in sensitivities), reverse=True
    )


def polished(problem, spline):
    """Plan again from a spline near by, on the same knots, to a tight tolerance."""
    program = SequentialProgram(problem, spline.grid)
    program.constraints.look_for_links(spline)
    begin = program.iterate(spline)
    found = program.improved(begin, TrustRegion(0.01), FIRST_PENALTY, min_gain=1e-8, max_steps=60)
    return found.iterate.duration


def refined_to_the_end(problem):
    """Return a refinement, its spline, and the duration that a tight tolerance leaves of it."""
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    spline = refined._best.spline
    return refined, spline, polished(problem, spline)


def test_sensitivities_are_what_planning_again_finds():
    problem = problem_with()
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    spline = refined._best.spline
    duration = polished(problem, spline)
    sensitivities = refined.elasticities()
    step = 0.02
    limits = problem.robot.limits.effort
    for key, elasticity in sensitivities.items():
        limit, index = key.kind, key.segment if key.joint is None else key.joint
        found = []
        for factor in (1 + step, 1 - step):
            if limit == "radius":
                radius = np.array([0.05, 0.05])
                radius[index] *= factor
                changed = problem_with(radius=radius)
            else:
                name = problem.robot.joint_names[index]
                changed = problem_with(arm(effort={name: factor * limits[index]}))
            found.append(polished(changed, spline))
        change = (found[1] - found[0]) / (2 * step)
        assert -elasticity * duration == pytest.approx(change, rel=0.1, abs=1e-3), (limit, index)


def test_that_of_the_tools_speed_is_what_planning_again_finds():
    """Of each segment on its own, by changing its limit by 1 %."""
    limits = np.array([1.2, 0.6])

    def limited(speeds):
        problem = problem_with()
        return problem.with_tube(replace(problem.tube, tool_speed=speeds))

    problem = limited(limits)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    spline = refined._best.spline
    duration = polished(problem, spline)
    prices = {key: e for key, e in refined.elasticities().items() if key.kind == "tool_speed"}
    assert [(key.joint, key.segment) for key in prices] == [(None, 0), (None, 1)]
    for key, elasticity in prices.items():
        found = [
            polished(limited(limits * np.where(np.arange(2) == key.segment, factor, 1)), spline)
            for factor in (1.01, 0.99)
        ]
        change = (found[1] - found[0]) / 0.02
        assert -elasticity * duration == pytest.approx(change, rel=0.1, abs=2e-3)
    assert min(prices.values()) < -0.1


def test_those_of_effort_rates_are_what_planning_again_finds():
    """With gravity, whose share of the rate is another power of the speed than the rest."""
    limits, gravity = {"joint1": 400.0, "joint2": 100.0}, (0, -9.81, 0)
    effort = dict.fromkeys(limits, 200.0)

    def limited(rates):
        overrides = LimitOverrides(velocity=EVERY, effort=effort, effort_rate=rates)
        robot = load_robot("example:two_link", "hand", gravity=gravity, limits=overrides)
        return problem_with(robot)

    problem = limited(limits)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    spline = refined._best.spline
    prices = {key: e for key, e in refined.elasticities().items() if key.kind == "effort_rate"}
    assert [key.joint for key in prices] == [0, 1]
    for key, elasticity in prices.items():
        name = problem.robot.joint_names[key.joint]
        found = [polished(limited(limits | {name: f * limits[name]}), spline) for f in (1.01, 0.99)]
        quotient = np.log(found[0] / found[1]) / np.log(1.01 / 0.99)
        assert elasticity == pytest.approx(quotient, rel=0.1, abs=2e-3)
    assert min(prices.values()) < -0.1


def test_that_of_velocities_by_position_is_what_planning_again_finds():
    """The velocities that the law of one joint allows, changed by 1 % everywhere."""

    def limited(raised=None, factor=1.0):
        laws = {name: dict(law) for name, law in NEAR.items()}
        if raised is not None:
            laws[raised]["deceleration"] *= factor**2
            laws[raised]["offset"] *= factor
        return problem_with(arm(velocity_by_position=laws))

    refined, spline, duration = refined_to_the_end(limited())
    found = {key: e for key, e in refined.elasticities().items() if key.kind in LAW_AND_POINTS}
    assert [key.joint for key in found] == [0, 1]
    for key, elasticity in found.items():
        name = f"joint{key.joint + 1}"
        ends = [polished(limited(name, factor), spline) for factor in (1.01, 0.99)]
        change = (ends[1] - ends[0]) / 0.02
        assert -elasticity * duration == pytest.approx(change, rel=0.1, abs=2e-3)
    assert min(found.values()) < -0.1


def test_those_of_points_are_what_planning_again_finds():
    """Of each point on its own, by changing its limit by 1 %."""
    limits = np.array([1.1, 0.5])

    def limited(speeds):
        places = [("hand", (0.0, 0.05, 0.0)), ("link2", (0.0, 0.0, 0.0))]
        points = [PointSpeed(*place, v) for place, v in zip(places, speeds, strict=True)]
        return problem_with(arm(point_speed=points))

    refined, spline, duration = refined_to_the_end(limited(limits))
    found = {key: e for key, e in refined.elasticities().items() if key.kind in LAW_AND_POINTS}
    assert [(key.link, key.point) for key in found] == [("hand", 0), ("link2", 1)]
    for key, elasticity in found.items():
        ends = [
            polished(limited(limits * np.where(np.arange(2) == key.point, factor, 1)), spline)
            for factor in (1.01, 0.99)
        ]
        change = (ends[1] - ends[0]) / 0.02
        assert -elasticity * duration == pytest.approx(change, rel=0.1, abs=2e-3)
    assert min(found.values()) < -0.1


def test_a_points_price_names_its_link():
    points = [PointSpeed("hand", (0.0, 0.1, 0.0), 0.9)]
    result = plan(problem_with(arm(point_speed=points)))
    (price,) = (one for one in result.sensitivities if one.limit == "point_speed")
    assert (price.joint, price.segment, price.link, price.point) == (None, None, "hand", 0)
    assert str(price) == f"point_speed of point 0, on hand: {1000 * price.saved:.2g} ms"


@pytest.mark.slow
def test_those_of_a_ur5_are_what_planning_again_finds():
    """Six joints, obstacles, three segments: the two that cost most, by changing them by 1 %."""
    path = ROBOTS / "ur5" / "over_the_wall.yaml"
    fields = yaml.safe_load(path.read_text())
    answer = plan(parse_problem(fields, path.parent), SHORTEST)
    goal = answer.trajectory.position(answer.duration).tolist()
    fields["goal"] = {"joints": goal}
    problem = parse_problem(fields, path.parent)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    for key, elasticity in refined.elasticities().items():
        limit, joint = key.kind, key.joint
        if limit == "radius" or elasticity > -0.1:
            continue
        name = problem.robot.joint_names[joint]
        value = getattr(problem.robot.limits, limit)[joint]
        found = []
        for factor in (1.01, 0.99):
            limits = {limit: {name: float(factor * value)}}
            changed = fields | {"robot": fields["robot"] | {"limits": limits}}
            found.append(polished(parse_problem(changed, path.parent), refined._best.spline))
        quotient = np.log(found[0] / found[1]) / np.log(1.01 / 0.99)
        assert elasticity == pytest.approx(quotient, rel=0.1), (limit, name)


def test_only_refinement_has_sensitivities():
    problem = load_problem("example:two_link/paper_1_30mm")
    assert plan(problem, PlanOptions("stop-at-corners")).sensitivities == ()
    result = plan(problem, SHORTEST)
    assert {sensitivity.limit for sensitivity in result.sensitivities} == {"effort", "radius"}
    dearest = result.sensitivities[0]
    assert dearest.joint in ("joint1", "joint2")
    assert dearest.segment is None
    assert dearest.saved == pytest.approx(-0.1 * dearest.elasticity * result.duration)
    assert str(dearest) == f"effort of {dearest.joint}: {1000 * dearest.saved:.2g} ms"
    radius = next(
        sensitivity for sensitivity in result.sensitivities if sensitivity.limit == "radius"
    )
    assert (radius.joint, radius.segment) == (None, 0)
    assert radius.elasticity < -0.01  # of one segment alone, without switching times


def test_a_start_on_its_rotation_tolerance_costs_nothing(two_link):
    """No variable moves the start, and what is near it hardly: neither has a sensitivity."""
    start, goal = np.array([-0.9, 1.2]), np.array([0.1, 1.2])
    tool = two_link.tool_position(np.array([start, goal]))
    turned = Rotation.from_rotvec(np.outer([start.sum() + 0.1, goal.sum()], [0, 0, 1])).as_quat()
    tube = Tube(tool, 0.3, orientations=turned, rotation_tolerance=0.1)
    result = plan(PlanningProblem(two_link, tube, start, goal), SHORTEST)
    assert result.succeeded
    assert result.certificate.conditions["rotation"].margin == pytest.approx(0.0, abs=1e-6)
    (turn,) = (one.elasticity for one in result.sensitivities if one.limit == "rotation")
    assert -0.05 < turn <= 0.0
    effort = sum(one.elasticity for one in result.sensitivities if one.limit == "effort")
    assert effort < -0.3  # but other limits do cost something
    assert all(one.saved < 0.1 * result.duration for one in result.sensitivities)


SIDES = np.array([[0.1, 0.3], [0.3, 0.1]])  # the arm's plane cuts the first across, then upright


def problem_in_boxes(sides=SIDES, tool_radius=0.0):
    ups = ([0, 0, 1], [0.3, 1, 0])
    sections = [{"box": box, "up": up} for box, up in zip(sides.tolist(), ups, strict=True)]
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    signs = {"joint2": "-"}
    tube = Tube(points, None, cross_section=sections, joint_signs=signs, tool_radius=tool_radius)
    return PlanningProblem(arm(), tube, Seed(np.array([0.0, -1.0])))


def test_widths_and_heights_have_the_prices_that_planning_again_finds():
    problem = problem_in_boxes()
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    spline = refined._best.spline
    prices = {key: value for key, value in refined.elasticities().items() if key.joint is None}
    found, step = {}, 0.02
    for kind, column in (("width", 0), ("height", 1)):
        for segment in (0, 1):
            durations = []
            for factor in (1 + step, 1 - step):
                sides = SIDES.copy()
                sides[segment, column] *= factor
                durations.append(polished(problem_in_boxes(sides), spline))
            quotient = np.log(durations[0] / durations[1]) / np.log((1 + step) / (1 - step))
            found[kind, segment] = quotient
    for (kind, segment), quotient in found.items():
        own = sum(v for k, v in prices.items() if (k.kind, k.segment) == (kind, segment))
        assert own == pytest.approx(quotient, rel=0.1, abs=1e-3), (kind, segment)
    assert found["width", 0] < -0.01
    assert found["height", 1] < -0.01


@pytest.mark.parametrize(
    ("angle", "axis", "whole"), [(0.05236, 0, True), (0.0524, 1, False), (0.0524, 0, True)]
)
def test_a_start_on_its_rotation_tolerance_has_sane_prices(angle, axis, whole):
    """Where a path can hardly leave, steps hardly use the tolerance: multipliers said minutes."""
    problem = load_problem("example:ur5/level_tray")
    turn = problem.robot.tool_pose(problem.start)[0]
    off = Rotation.from_rotvec(-angle * np.eye(3)[axis])
    orientations = problem.tube.orientations.copy()
    orientations[slice(None) if whole else 0] = (Rotation.from_matrix(turn) * off).as_quat()
    tube = replace(
        problem.tube,
        orientations=orientations,
        rotation_tolerance=[(angle, angle, np.inf)] * problem.tube.segment_count,
    )
    result = plan(replace(problem, tube=tube), SHORTEST)
    assert result.succeeded
    assert 0.02 < result.sensitivities[0].saved < 0.1
    assert result.sensitivities[0].limit == "velocity"
    turns = [one for one in result.sensitivities if (one.limit, one.segment) == ("rotation", 0)]
    assert sum(one.saved for one in turns) < 0.005


# Prices of efforts and torque-speed lines with friction, against planning again.


ARMED = {"armature": 0.2, "viscous_friction": 1.5}
FRICTION = {"backwards_friction": [5.0, 1.5], "forwards_friction": [3.0, 2.0]}
LINE = {"saturation_effort": np.array([130.0, 40.0]), "no_load_velocity": np.array([8.0, 12.0])}
EFFORT = np.array([95.0, 27.0])
ROUNDED = 50.0  # knot intervals


def motors_problem_with(effort=EFFORT, **motors):
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
        return motors_problem_with(EFFORT * own, **motors)
    return motors_problem_with(**motors | {name: both * own for name, both in LINE.items()})


def motors_polished(problem, spline):
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
    problem = motors_problem_with(**motors)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    refined = Refinement(problem, starting_spline(problem, branch, 8), (3, 3))
    refined.run()
    program, best = motors_polished(problem, refined.spline)
    kinds = {"effort"} | ({"motor_curve"} if "line" in name else set())
    own = {key: e for key, e in program.elasticities(best).items() if key.kind in kinds}
    assert {key.kind for key in own} == kinds
    for key, elasticity in own.items():
        found = [
            motors_polished(changed(key.kind, key.joint, factor, motors), best.spline)[1].duration
            for factor in (1.005, 0.995)
        ]
        quotient = np.log(found[0] / found[1]) / np.log(1.005 / 0.995)
        near = 0.1 if "forwards_friction" not in motors else 0.3
        assert elasticity == pytest.approx(quotient, rel=near, abs=4e-3)
    assert min(own.values()) < -0.1
