"""Sensitivities of the duration, motors included, against planning again."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import TOOL_DOWN, begun, with_motors
from scipy.spatial.transform import Rotation

from tubeplanner import (
    LimitOverrides,
    PlanningProblem,
    PointSpeed,
    Seed,
    Tube,
    load_problem,
    load_robot,
)
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.path_samples import LimitKey
from tubeplanner.optimizer.descent import Descent, DescentState, SequentialProgram
from tubeplanner.optimizer.stages import Refinement, limit_sensitivities
from tubeplanner.optimizer.step_search import TrustRegion
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Cup, Holding

NAMES = ("joint1", "joint2")
# Both joints come so near to these ends that they count.
NEAR = {
    "joint1": {"deceleration": 4.0, "offset": 0.3, "lower": -0.5, "upper": 2.0},
    "joint2": {"deceleration": 5.0, "offset": 0.2, "lower": -2.0, "upper": 0.5},
}
SIDES = np.array([[0.1, 0.3], [0.3, 0.1]])  # the arm's plane cuts the first across, then upright
FRICTION = {
    "armature": 0.2,
    "viscous_friction": 1.5,
    "backwards_friction": [5.0, 1.5],
    "forwards_friction": [3.0, 2.0],
}
UNSURE = FRICTION | {"friction_uncertainty": 0.3}
LINE = {"saturation_effort": np.array([130.0, 40.0]), "no_load_velocity": np.array([8.0, 12.0])}
ROUNDED = 50.0  # knot intervals; so wide that the least duration has no kinks where steps end


def arm(gravity=(0, 0, 0), **limits):
    limits = LimitOverrides(**{"velocity": dict.fromkeys(NAMES, np.inf), **limits})
    return load_robot("example:two_link", "hand", gravity=gravity, limits=limits)


def problem_with(robot=None, radius=(0.05, 0.05), **tube):
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, radius, joint_signs={"joint2": "-"}, **tube)
    return PlanningProblem(robot or arm(), tube, Seed(np.array([0.0, -1.0])))


def scaled(values, which, factor):
    """Return two values, one of them times a factor."""
    return np.array(values) * np.where(np.arange(2) == which, factor, 1.0)


def by_joint(limit, *values, motors=None, **more):
    """Return a maker of problems with a limit of both joints, that of one of them changed."""

    def made(which=None, factor=1.0):
        own = dict(zip(NAMES, scaled(values, which, factor).tolist(), strict=True))
        return problem_with(with_motors(arm(**more, **{limit: own}), **motors or {}))

    return made


def by_law(which=None, factor=1.0):
    """Change the velocities that the law of one joint allows, everywhere."""
    laws = {name: dict(law) for name, law in NEAR.items()}
    if which is not None:
        laws[NAMES[which]]["deceleration"] *= factor**2
        laws[NAMES[which]]["offset"] *= factor
    return problem_with(arm(velocity_by_position=laws))


def by_line(which=None, factor=1.0):
    line = {name: scaled(both, which, factor) for name, both in LINE.items()}
    return problem_with(with_motors(arm(effort=EFFORTS), **line, **FRICTION))


def by_point_speed(which=None, factor=1.0):
    places = [("hand", (0.0, 0.05, 0.0)), ("link2", (0.0, 0.0, 0.0))]
    speeds = scaled([1.1, 0.5], which, factor)
    points = [PointSpeed(*place, v) for place, v in zip(places, speeds, strict=True)]
    return problem_with(arm(point_speed=points))


def by_side(column):
    def made(which=None, factor=1.0):
        sides = SIDES.copy()
        sides[:, column] = scaled(sides[:, column], which, factor)
        ups = ([0, 0, 1], [0.3, 1, 0])
        sections = [{"box": box, "up": up} for box, up in zip(sides.tolist(), ups, strict=True)]
        return problem_with(radius=None, cross_section=sections)

    return made


def by_cup(which=None, factor=1.0):
    """Change one number of a cup that pulls along the hand, or the mass of its part."""
    held = Holding(CUP, Payload(0.5, (0.02, 0.01, 0.0)))
    held = held if which is None else held.raised(which, factor - 1)
    return replace(problem_with(), holding=[held])


def by_tube(field, *values):
    return lambda which=None, factor=1.0: problem_with(**{field: scaled(values, which, factor)})


CUP = Cup(force=12.0, radius=0.03, friction=0.4, normal=(1.0, 0.0, 0.0))
EFFORTS = {"joint1": 95.0, "joint2": 27.0}
TURNED = {"gravity": (0, -9.81, 0), "effort": dict.fromkeys(NAMES, 200.0)}
# By kind: problems with that limit changed, and the power of the speed that it is of; None: with
# gravity, friction or tolerances, where the powers do not add up.
CASES = {
    "effort": (by_joint("effort", *EFFORTS.values()), 2),
    "velocity": (by_joint("velocity", 3.0, 2.5), 1),
    "acceleration": (by_joint("acceleration", 15.0, 30.0), 2),
    "jerk": (by_joint("jerk", 400.0, 600.0), 3),
    "effort_rate": (by_joint("effort_rate", 400.0, 100.0, **TURNED), None),
    "velocity_by_position": (by_law, 1),
    "tool_speed": (by_tube("tool_speed", 1.2, 0.6), 1),
    "tool_acceleration": (by_tube("tool_acceleration", 9.0, 4.0), 2),
    "point_speed": (by_point_speed, 1),
    "radius": (by_tube("radius", 0.05, 0.05), 0),
    "width": (by_side(0), 0),
    "height": (by_side(1), 0),
    "holding": (by_cup, None),
    "effort with friction": (by_joint("effort", *EFFORTS.values(), motors=UNSURE), None),
    "motor_curve with friction": (by_line, None),
}
POWERS = {kind: power for kind, (_, power) in CASES.items()} | {"effort_rate": 3}
COUNTS = {"holding": 4}  # else 2


def refined(problem):
    refinement = Refinement(problem, begun(problem, 8), (2,))
    refinement.run()
    return refinement


def polished(problem, spline):
    """Plan again from a spline near by, on the same knots, to a tight tolerance."""
    program = SequentialProgram(problem, spline.grid)
    program.constraints.blend(ROUNDED)
    begin, limits = program.iterate(spline), {"min_gain": 1e-8, "max_steps": 60}
    return program, Descent((program,)).improved(
        DescentState((begin,), TrustRegion(0.01)), **limits
    ).iterate


@pytest.mark.parametrize("name", CASES)
def test_prices_are_what_planning_again_finds(name):
    """Of each limit of a kind alone, changed by half a percent."""
    (made, power), kind = CASES[name], name.split()[0]
    program, best = polished(made(), refined(made()).spline)
    prices = program.elasticities(best)
    own = {key: price for key, price in prices.items() if key.kind == kind}
    names = {key: (key.joint, key.segment, key.point, key.parameter) for key in own}
    assert len(set(names.values())) == COUNTS.get(kind, 2)
    assert all(price <= 0 for key, price in prices.items() if key.parameter != "mass")
    if power is not None:  # twice the efforts, four times the speed... T falls in proportion
        total = sum(POWERS[key.kind] * price for key, price in prices.items())
        assert total == pytest.approx(-1.0, abs=1e-4)
    for key, price in own.items():
        (which,) = set(names[key]) - {None}
        changed = (made(which, factor) for factor in (1.005, 0.995))
        durations = [polished(problem, best.spline)[1].duration for problem in changed]
        quotient = np.log(durations[0] / durations[1]) / np.log(1.005 / 0.995)
        near = {"rel": 0.3, "abs": 4e-3} if "friction" in name else {"rel": 0.1, "abs": 1e-3}
        assert price == pytest.approx(quotient, **near), key
    assert min(own.values()) < -0.01


def test_prices_name_what_they_are_of_and_the_dearest_come_first():
    keys = {
        LimitKey("effort", 1): -0.1,
        LimitKey("radius", None, 0): -0.4,
        LimitKey("point_speed", link="hand", point=0): -0.3,
        LimitKey("tolerance"): -0.0,
    }
    refinement = SimpleNamespace(elasticities=lambda: keys)
    assert [str(one) for one in limit_sensitivities(problem_with(), refinement, 2.0)] == [
        "radius of segment 0: 80 ms",
        "point_speed of point 0, on hand: 60 ms",
        "effort of joint2: 20 ms",
        "tolerance of the goal: 0 ms",
    ]


def test_a_contact_has_prices_per_newton_and_per_kilogram():
    keys = {LimitKey("holding", contact=0, parameter=name): 0.3 for name in ("force", "mass")}
    refinement = SimpleNamespace(elasticities=lambda: keys)
    force, mass = limit_sensitivities(by_cup(), refinement, 2.0)
    assert (str(force), force.unit) == ("holding.cup.force: -60 ms", "N")
    assert force.saved_per_unit == pytest.approx(-0.3 * 2.0 / CUP.force)
    assert (mass.field, mass.unit, mass.saved_per_unit) == ("holding.part.mass", "kg", -1.2)


def test_cones_shrink_as_the_force_that_they_are_shares_of_grows():
    """Shares of a force larger by a fraction are smaller by it, but for the force itself, 1."""
    problem = by_cup()
    spline = begun(problem, 8)
    constraints = SequentialProgram(problem, spline.grid).constraints
    current = constraints.at(spline)
    key = LimitKey("holding", contact=0, parameter="force")
    _, changes = constraints.shared_rise(current)[constraints.keys.index(key)]
    own = [own is current.cones[0] for own in current.convex]
    vector, change = current.cones[0].vector, changes[own.index(True)]
    assert change == pytest.approx([0.0, 0.0, 0.0, 1.0] - vector, abs=1e-3 * abs(vector).max())
    assert not any(other.any() for other in changes if other.shape[1] == 3)


def test_a_number_at_its_largest_accepted_value_has_a_price():
    sticky = Holding(Cup(force=10.0, radius=0.02, friction=10.0), Payload(1.0))
    limit = HoldingLimit(replace(problem_with(), holding=[sticky]))
    (key,) = (key for key in limit.keys if key.parameter == "friction")
    assert limit.raised(key, 1e-3).keys == limit.keys


def test_only_refinement_has_sensitivities_and_the_dearest_come_first(planned):
    name = "two_link/paper_1_30mm"
    assert planned(name)[1].sensitivities == ()
    result = planned(name, "refinement")[1]
    assert {one.limit for one in result.sensitivities} == {"effort", "radius"}
    largest_saving = result.sensitivities[0]
    assert largest_saving.saved == max(one.saved for one in result.sensitivities)
    assert largest_saving.saved == pytest.approx(-0.1 * largest_saving.elasticity * result.duration)
    (radius,) = (one for one in result.sensitivities if one.limit == "radius")
    assert (radius.joint, radius.segment) == (None, 0)
    assert radius.elasticity < -0.01  # of one segment alone, without switching times


@pytest.mark.dear("refines the motion of six joints")
def test_a_start_on_bounds_of_its_rotation_has_sane_prices():
    """Where a path can hardly leave, steps hardly use the tolerance: multipliers said minutes."""
    problem, angle = load_problem("example:ur5/level_tray", changes=TOOL_DOWN), 0.0524
    turn = Rotation.from_matrix(problem.robot.tool_pose(problem.start)[0])
    first = (turn * Rotation.from_rotvec([-angle, 0, 0])).as_quat()
    count = problem.tube.segment_count
    turns = {"orientations": [first] * (count + 1)}
    turns["rotation_tolerance"] = [(angle, angle, np.inf)] * count
    problem = problem.with_tube(replace(problem.tube, **turns))
    refinement = refined(problem)
    duration = polished(problem, refinement.spline)[1].duration
    largest_saving, *others = limit_sensitivities(problem, refinement, duration)
    assert largest_saving.limit == "velocity"
    assert 0.02 < largest_saving.saved < 0.1
    turns = [one for one in others if (one.limit, one.segment) == ("rotation", 0)]
    assert sum(one.saved for one in turns) < 0.005
