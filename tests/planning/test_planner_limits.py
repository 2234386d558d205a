"""Plans under every kind of limit."""

from dataclasses import asdict, dataclass, replace
from functools import cache

import numpy as np
import pytest
from cases import BRIEF, INERTIA, SHORTEST, one_joint, with_motors
from gantry import gantry
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tubeplanner import (
    LimitOverrides,
    Objective,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    PointSpeed,
    ProblemError,
    Seed,
    Tube,
    load_problem,
    load_robot,
    plan,
    verify,
)
from tubeplanner.first_guess.baselines import judged_baseline
from tubeplanner.limits.peaks import motor_effort
from tubeplanner.robot.joint_limits import EffortRange

# Plans with motors: a bar's against its least time, integrated by itself, and whole arms'.

TRAVEL, LEVER, GRAVITY = 1.3, 0.5, 9.81  # [rad, m, m/s^2]


@dataclass
class Bar:
    """A bar's motor and weight, and what it needs: by themselves."""

    mass: float = 0.0
    armature: float = 0.0
    viscous: float = 0.0
    back: float = 0.0
    forth: float = 0.0
    stall: float = np.inf
    no_load: float = np.inf
    positions: tuple = (0.0,)
    backwards: tuple = (5.0,)
    forwards: tuple = (5.0,)

    def problem(self, folder, way):
        """Return a problem in which it turns one way, and nothing else is asked."""
        table = [np.array(row) for row in (self.positions, self.backwards, self.forwards)]
        robot = with_motors(
            one_joint(folder, self.mass, velocity=1e3),
            [EffortRange(0, *table)],
            armature=self.armature,
            viscous_friction=self.viscous,
            backwards_friction=self.back,
            forwards_friction=self.forth,
            saturation_effort=self.stall,
            no_load_velocity=self.no_load,
        )
        tube = Tube([[0.0, 0, 0], [1.0, 0, 0]], 1000.0)
        ends = np.zeros(1), np.array([way * TRAVEL])
        return PlanningProblem(robot, tube, *ends, self_collision=False)

    def acceleration(self, q, v, push, moves):
        """Return the acceleration at the most effort forwards (push 1) or backwards (-1)."""
        if push > 0:
            most = np.interp(q, self.positions, self.forwards)
            effort = min(most, self.stall * (1 - v / self.no_load))
        else:
            most = np.interp(q, self.positions, self.backwards)
            effort = -min(most, self.stall * (1 + v / self.no_load))
        dry = self.forth if moves > 0 else -self.back
        load = self.viscous * v + dry + self.mass * GRAVITY * LEVER * np.cos(q)
        return (effort - load) / (INERTIA + self.mass * LEVER**2 + self.armature)

    def least_time(self, way):
        """Return the time of pushing as hard as can be, then braking so: from rest to rest [s]."""

        def moved(push, begin, until):
            def rate(_, state):
                return [state[1], self.acceleration(*state, push, way)]

            def stops(_, state):
                return way * state[1]

            stops.terminal, stops.direction = True, -1
            events = stops if push != way else None
            found = solve_ivp(rate, (0, until), begin, events=events, rtol=1e-10, atol=1e-12)
            return found.t[-1], found.y[:, -1]

        def run(switch):
            _, state = moved(way, [0.0, 0.0], switch)
            braking, (q, v) = moved(-way, state, 20.0)
            assert abs(v) < 1e-9
            return switch + braking, way * q

        switch = brentq(lambda time: run(time)[1] - TRAVEL, 0.05, 1.5, xtol=1e-11)
        return run(switch)[0]


RUBBING = {"viscous": 0.5, "back": 0.9, "forth": 0.4}
TABLE = {
    "positions": (-1.2, -0.3, 0.2, 0.9),
    "backwards": (3.0, 6.0, 5.0, 2.5),
    "forwards": (3.0, 6.0, 5.0, 2.5),
}
WHOLE = Bar(0.25, 0.1, **RUBBING, stall=6.0, no_load=4.0, **TABLE)  # everything and weight
UNEVEN = Bar(positions=(0.0,), backwards=(3.0,), forwards=(7.0,))
# The motor of a Puma 560's third joint, and the limit that is given with it.
PUMA = Bar(4.8, 0.577, 3.98, 5.6, 7.1, backwards=(89.4,), forwards=(89.4,))


@pytest.mark.parametrize(
    ("bar", "way"), [(WHOLE, 1.0), (WHOLE, -1.0), (UNEVEN, 1.0), (UNEVEN, -1.0), (PUMA, 1.0)]
)
def test_a_bar_takes_hardly_more_than_its_least_time_and_never_less(bar, way, tmp_path):
    """What is more is the price of accelerations that do not jump."""
    least = bar.least_time(way)
    result = plan(bar.problem(tmp_path, way), SHORTEST)
    assert (result.succeeded, result.method) == (True, "refinement")
    assert least * (1 - 1e-6) < result.duration < 1.0015 * least


def with_fields(name, **robot):
    """Return a bundled problem whose robot has other fields."""
    changes = {f"robot.{field}": value for field, value in robot.items()}
    return load_problem(f"example:{name}", changes=changes)


LINE = "two_link/paper_1_30mm"
LINES = {"saturation_effort": [120.0, 35.0], "no_load_velocity": [8.0, 12.0]}
MOTORS = {
    "two_link/around_a_post": {"motors": LINES},
    LINE: {
        "motors": {
            "coulomb_friction": {"joint1": [4.0, 6.0], "joint2": [2.0, 1.0]},
            "viscous_friction": 1.0,
            "friction_uncertainty": 0.2,
        }
    },
}


def require_used(result):
    """Raise unless all limits are kept and some motor gives what it can."""
    conditions = result.certificate.conditions
    assert result.certificate.passed
    used = [conditions[kind].margin for kind in ("effort", "motor_curve", "velocity")]
    assert min(margin for margin in used if margin is not None) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("name", MOTORS)
def test_plans_keep_what_motors_have_and_use_it(name, planned):
    problem = with_fields(name, **MOTORS[name])
    result = plan(problem, SHORTEST)
    assert (result.succeeded, result.method) == (True, "refinement")
    require_used(result)
    _, faster = planned(name, "refinement")
    assert not verify(problem, faster.trajectory).passed
    kinds = {one.limit for one in result.sensitivities if one.elasticity < -0.05}
    has_lines = LINES in MOTORS[name].values()
    assert ("motor_curve" in kinds) == has_lines
    if has_lines:  # at samples: tau <= S (1 - v / V) and -tau <= S (1 + v / V), both touched
        samples = result.trajectory.at(np.linspace(0, result.duration, 20_001))
        effort = motor_effort(problem.robot, result.trajectory, samples)
        used = effort / LINES["saturation_effort"] + samples.velocity / LINES["no_load_velocity"]
        for most in (used.max(), -used.min()):
            assert 1 - 1e-3 <= most <= 1 + 1e-9


def test_the_second_stage_finds_something_with_friction_too():
    """Kept exactly: what is slack is used up."""
    problem = replace(with_fields(LINE, **MOTORS[LINE]), objective=Objective(0.02))
    result = plan(problem)
    assert result.certificate.passed
    assert result.shortest_duration < result.duration <= 1.02 * result.shortest_duration * 1.000001
    longer = result.shortest.scaled(result.duration / result.shortest.duration)
    jerks = [abs(motion.derivative_coefficients(3)).max() for motion in (result.trajectory, longer)]
    assert jerks[0] < 0.99 * jerks[1]


# Every method keeps every limit and uses it.

NAMES = ("joint1", "joint2")
STOP, SEARCH, PAPER = "stop-at-corners", "branch-and-bound", "suh-bishop"
UPPER, DECELERATION = 2.0, 4.0
NEAR = {
    "joint1": {"deceleration": 4.0, "offset": 0.3, "lower": -0.5, "upper": 2.0},
    "joint2": {"deceleration": 5.0, "offset": 0.2, "lower": -2.0, "upper": 0.5},
}
# Of a Franka FR3, joint by joint.
OFFSETS = (0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35)
FR3 = [
    {"deceleration": deceleration, "offset": offset}
    for deceleration, offset in zip((6, 2.585, 3.5, 4, 17, 5.5, 17), OFFSETS, strict=True)
]
SHELVES, WALL = "panda/between_shelves", "ur5/over_the_wall"
POINTS = [PointSpeed("hand", (0.0, 0.1, 0.0), 0.6), PointSpeed("link2", (0.0, 0.0, 0.0), 0.5)]


def bent(tube=None, **limits):
    """A two-link arm with limits in a tube around a corner, of which some fields are different."""
    limits = LimitOverrides(velocity=dict.fromkeys(NAMES, np.inf), **limits)
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"}, **tube or {})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


# By name: the condition of the certificate, and the arm's and the tube's fields.
LIMITED = {
    "accelerations": ("acceleration", {"acceleration": {"joint1": 8.0, "joint2": 15.0}}),
    "jerks": ("jerk", {"jerk": {"joint1": 300.0, "joint2": 600.0}}),
    "effort rates": ("effort_rate", {"effort_rate": {"joint1": 300.0, "joint2": 200.0}}),
    "velocity by position": ("velocity", {"velocity_by_position": NEAR}),
    "speeds of points": ("point_speed", {"point_speed": POINTS}),
    "speed in a segment": ("tool_speed", {"tube": {"tool_speed": [None, 0.5]}}),
    "speeds of tube and arm": (
        "tool_speed",
        {"tube": {"tool_speed": [0.4, 0.9]}, "tool_speed": 0.8},
    ),
    "acceleration of the tool": ("tool_acceleration", {"tool_acceleration": 6.0}),
    "acceleration in a segment": ("tool_acceleration", {"tube": {"tool_acceleration": [4, None]}}),
}


def require_kept(certificate, condition, most=0.01):
    """Raise unless a limit is proved and no more than such a fraction of it is left."""
    judged = certificate.conditions[condition]
    assert -1e-6 <= judged.margin < most
    assert judged.coverage == "for all t"


@cache
def free_duration(method):
    return plan(bent(), PlanOptions(method, quality="fast", slack=0.0)).duration


@pytest.mark.parametrize(
    ("name", "method"),
    [(name, "refinement") for name in LIMITED]
    + [(name, STOP) for name in ("velocity by position", "speeds of points", "speed in a segment")]
    + [("acceleration of the tool", STOP)],
)
def test_plans_keep_a_limit_and_use_it(name, method):
    condition, fields = LIMITED[name]
    result = plan(bent(**fields), PlanOptions(method, quality="fast", slack=0.0))
    assert (result.succeeded, result.method) == (True, method)
    require_kept(result.certificate, condition)
    assert free_duration(method) < 0.99 * result.duration
    if (condition, method) == ("effort_rate", "refinement"):
        dear = [one for one in result.sensitivities if one.limit == "effort_rate"]
        assert {one.joint for one in dear} == set(fields["effort_rate"])
        assert min(one.elasticity for one in dear) < -0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {"robot.limits": {"tool_acceleration": 20.0}},
        {"tube.tool_acceleration": [12.0, None, 30.0]},
    ],
    ids=["everywhere", "in segments"],
)
def test_a_tool_that_accelerates_gently_needs_longer_over_the_wall(changes, planned):
    def duration(factor=1.0):
        """Return that with the limits so many times as high, and the plan."""
        (path, given), *_ = changes.items()
        if isinstance(given, dict):
            given = {name: factor * value for name, value in given.items()}
        else:
            given = [value and factor * value for value in given]
        problem = load_problem(f"example:{WALL}", changes={path: given})
        result = plan(problem, PlanOptions("refinement", quality="fast", slack=0.0))
        assert result.succeeded
        require_kept(result.certificate, "tool_acceleration")
        return result.duration, result

    needed, result = duration()
    assert needed > 1.05 * planned(WALL, "refinement")[1].duration
    prices = [one for one in result.sensitivities if one.limit == "tool_acceleration"]
    ends = [np.log(duration(factor)[0]) for factor in (0.95, 1.05)]
    slope = (ends[1] - ends[0]) / np.log(1.05 / 0.95)
    assert sum(one.elasticity for one in prices) == pytest.approx(slope, abs=0.02)


def test_a_gantry_is_as_slow_as_its_tool_may_accelerate(tmp_path):
    limits = {"tool_acceleration": 4.0, "velocity": 100.0, "effort": 1e4}
    problem = load_problem(gantry(tmp_path), changes={"robot.limits": limits})
    problem = replace(problem, goal=np.array([0.5, 0.0]), self_collision=False)
    result, least = plan(problem, PlanOptions(slack=0.0)), 2 * np.sqrt(0.5 / 4.0)
    require_kept(result.certificate, "tool_acceleration")
    assert least <= result.duration < 1.01 * least


def test_a_margin_ends_ranges_earlier():
    problem = bent(position_margin={"joint2": np.pi - 1.8})
    result = plan(problem, PlanOptions("refinement", quality="fast", slack=0.0))
    require_kept(result.certificate, "position")
    assert result.trajectory.position(result.duration)[1] == pytest.approx(-1.8, abs=1e-5)
    with pytest.raises(
        ProblemError, match=r"joint2' at -1 is outside its position limits \[-0.5, "
    ):
        bent(position_margin={"joint2": np.pi - 0.5})


@pytest.mark.parametrize(
    ("condition", "limits"),
    [
        ("effort_rate", {"effort_rate": {"joint1": 300.0}}),
        ("velocity", {"velocity_by_position": NEAR}),
        ("point_speed", {"point_speed": POINTS}),
    ],
)
def test_searches_keep_it(condition, limits):
    problem = bent(**limits)
    if condition.endswith("speed"):  # along a line it is faster than stopping at its ends
        line = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 0.03, joint_signs={"joint2": "-"})
        problem = problem.with_tube(line)
    result = plan(problem, PlanOptions(SEARCH, candidate_points=15, slack=0.0))
    assert (result.succeeded, result.method) == (True, SEARCH)
    require_kept(result.certificate, condition, most=0.2)


@pytest.mark.parametrize("method", [SEARCH, STOP, PAPER])
def test_other_methods_keep_what_motors_have(method):
    problem = with_fields(LINE, **MOTORS[LINE])
    options = PlanOptions(method, candidate_points=15, slack=0.0, suh_bishop=BRIEF)
    result = plan(problem, options)
    assert (result.succeeded, result.method) == (True, method)
    require_used(result)


def test_the_papers_method_keeps_limits():
    limits = {"point_speed": [asdict(point) for point in POINTS], "tool_speed": 0.8}
    limits["velocity_by_position"] = {"joint1": NEAR["joint1"]}
    problem = with_fields(LINE, limits=limits)
    result = plan(problem, PlanOptions(PAPER, slack=0.0, candidate_points=15, suh_bishop=BRIEF))
    assert (result.succeeded, result.method) == (True, PAPER)
    assert result.certificate.passed


@pytest.mark.parametrize(
    ("name", "baseline"),
    [
        pytest.param("effort rates", "smoothed-arc-corners", marks=pytest.mark.dear("many pieces")),
        ("effort rates", "bang-bang"),
        ("velocity by position", "arc-corners"),
        ("speed in a segment", "bounded-deviation"),
    ],
)
def test_baselines_keep_it_where_their_acceleration_is_continuous(name, baseline):
    """As to effort rates: the others fail of what cannot be smooth in them, and of nothing else."""
    condition, fields = LIMITED[name]
    _, certificate = judged_baseline(bent(**fields), baseline)
    if baseline == "bang-bang":
        assert {"rest", "continuity"} <= set(certificate.failures())
        assert set(certificate.failures()) <= {"rest", "continuity", "effort_rate"}
    else:
        require_kept(certificate, condition, most=0.2)


# Velocity limits that fall towards the ends of a joint, near and in the zones there.


@pytest.fixture
def bar(tmp_path):
    """Return a function from start, goal and offset to the problem of a bar that turns."""

    def moved(start, goal, offset):
        law = {"deceleration": DECELERATION, "offset": offset, "lower": -UPPER, "upper": UPPER}
        robot = one_joint(tmp_path, velocity_by_position=law)
        tool = robot.tool_position(np.zeros((1, 1)))[0]
        tube = Tube([tool, tool + np.array([1.0, 0.0, 0.0])], 1000.0)
        ends = np.array([start]), np.array([goal])
        return PlanningProblem(robot, tube, *ends, self_collision=False)

    return moved


@pytest.mark.parametrize("below", [0.1, 1e-6])
def test_a_goal_next_to_the_zone_is_come_to(bar, below):
    """It takes some 75 ms for each factor e of the distance: the velocity falls in proportion."""
    zone = 0.3**2 / (2 * DECELERATION)
    result = plan(bar(0.0, UPPER - zone - below, 0.3))
    require_kept(result.certificate, "velocity")
    assert result.duration < 1.1 + 0.3 / DECELERATION * np.log(1.0 / below) + 0.2


def test_without_an_offset_the_end_itself_is_come_to(bar):
    """Sped up at 5 N m / 0.7 kg m^2, slowed down at the law's deceleration: a closed form."""
    result = plan(bar(0.0, UPPER, 0.0))
    require_kept(result.certificate, "velocity")
    speeding_up = 5 / 0.7
    fastest = np.sqrt(2 * UPPER / (1 / speeding_up + 1 / DECELERATION))
    least = fastest / speeding_up + fastest / DECELERATION
    assert least < result.duration < 1.02 * least


@pytest.mark.parametrize(("start", "goal"), [(UPPER, UPPER - 0.005), (-UPPER, 0.0)])
def test_it_leaves_a_zone_as_if_there_were_none(bar, start, goal):
    """From rest, where no velocity is allowed towards the end."""
    result = plan(bar(start, goal, 0.3))
    require_kept(result.certificate, "velocity", most=1.0)
    elasticities = [p.elasticity for p in result.sensitivities if p.limit == "velocity_by_position"]
    assert elasticities == pytest.approx([0.0], abs=1e-6)


@pytest.mark.parametrize(("start", "goal"), [(0.0, UPPER - 0.005), (UPPER - 0.005, UPPER)])
def test_a_goal_in_a_zone_is_refused(bar, start, goal):
    result = plan(bar(start, goal, 0.3))
    assert (result.status, result.location.joint) == (PlanStatus.NO_TRAJECTORY, "turn")
    assert "limits.velocity_by_position allows it no velocity that way" in result.message


# Whole arms, as their makers limit them.


def by_joint(value):
    return {f"panda_joint{k + 1}": one for k, one in enumerate(value)}


@pytest.mark.slow  # arms of six and seven joints, of seconds each
@pytest.mark.parametrize(
    ("name", "limits", "condition", "most"),
    [
        # Its fastest motion breaks the law by a tenth of the velocity; it costs next to nothing.
        (SHELVES, {"velocity_by_position": by_joint(FR3)}, "velocity", 1.01),
        (SHELVES, {"effort_rate": by_joint([1000.0] * 7)}, "effort_rate", 1.15),
        # Over the wall, the elbow reaches 1.37 m/s if it may.
        (WALL, {"point_speed": [PointSpeed("forearm_link", (0, 0, 0), 0.8)]}, "point_speed", 1.5),
    ],
)
def test_an_arm_keeps_what_its_maker_limits(name, limits, condition, most, planned):
    free, fastest = planned(name, "refinement")
    overrides = LimitOverrides(**limits)
    robot = load_robot(f"example:{name.split('/')[0]}", free.robot.tool_frame, limits=overrides)
    result = plan(replace(free, robot=robot), SHORTEST)
    require_kept(result.certificate, condition)
    assert 0.99 * fastest.duration < result.duration < most * fastest.duration
    if condition == "point_speed":
        (price,) = (one for one in result.sensitivities if one.limit == "point_speed")
        assert price.elasticity < -0.05
