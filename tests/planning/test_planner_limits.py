"""Plans under every kind of limit."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cases import INERTIA, SHORTEST, limited_tool, one_joint, slow_but, with_motors
from tubeplanner import (
    LimitOverrides,
    Objective,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    PointSpeed,
    Seed,
    Tube,
    load_robot,
    parse_problem,
    plan,
    verify,
)
from tubeplanner.baselines.baselines import BASELINES, judged_baseline
from tubeplanner.constraints.effort_costs import EffortCosts
from tubeplanner.constraints.motor_effort import motor_effort
from tubeplanner.resources import bundled_problems
from tubeplanner.robot.effort_range import EffortRange

# Plans with motors: a bar's against its least time, integrated by itself, and whole arms'.


TRAVEL, LEVER, GRAVITY = 1.3, 0.5, 9.81  # [rad, m, m/s^2]
FREE = {"velocity": 1e3}


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
            one_joint(folder, self.mass, **FREE),
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
LINE = {"stall": 6.0, "no_load": 4.0}
UNEVEN = {"positions": (0.0,), "backwards": (3.0,), "forwards": (7.0,)}
TABLE = {
    "positions": (-1.2, -0.3, 0.2, 0.9),
    "backwards": (3.0, 6.0, 5.0, 2.5),
    "forwards": (3.0, 6.0, 5.0, 2.5),
}
BARS = {
    "ideal": Bar(),
    "rotor": Bar(armature=0.6),
    "viscous friction": Bar(viscous=1.5),
    "Coulomb friction": Bar(back=2.0, forth=1.0),
    "torque-speed line": Bar(**LINE),
    "all of these": Bar(armature=0.2, **RUBBING, **LINE),
    "limits by direction": Bar(**UNEVEN),
    "limits by position": Bar(**TABLE),
    "everything and weight": Bar(mass=0.25, armature=0.1, **RUBBING, **LINE, **TABLE),
    # The motor of its third joint, and the limit that is given with it.
    "Puma 560": Bar(4.8, 0.577, 3.98, 5.6, 7.1, backwards=(89.4,), forwards=(89.4,)),
}


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("name", BARS)
def test_a_bar_takes_hardly_more_than_its_least_time_and_never_less(name, way, tmp_path):
    """What is more is the price of accelerations that do not jump."""
    least = BARS[name].least_time(way)
    result = plan(BARS[name].problem(tmp_path, way), SHORTEST)
    assert (result.succeeded, result.method) == (True, "refinement")
    assert least * (1 - 1e-6) < result.duration < 1.0015 * least


def test_friction_and_lines_take_longer_by_themselves():
    """So that the times above tell them apart."""
    times = {name: bar.least_time(1.0) for name, bar in BARS.items()}
    slower = ("rotor", "torque-speed line", "all of these", "everything and weight")
    assert all(times[name] > 1.03 * times["ideal"] for name in slower)
    assert BARS["Coulomb friction"].least_time(-1.0) > 1.01 * times["Coulomb friction"]


# --- whole arms ----------------------------------------------------------------------------------


def with_fields(name, **robot):
    """Return a bundled problem whose robot has other fields."""
    path = bundled_problems()[name]
    fields = yaml.safe_load(path.read_text())
    fields["robot"].update(robot)
    return parse_problem(fields, path.parent)


QUICK = ("branch-and-bound", "stop-at-corners")
LINES = {"saturation_effort": [120.0, 35.0], "no_load_velocity": [8.0, 12.0]}
MOTORS = {
    "ur10/onto_a_conveyor": {"preset": "ur10_friction"},
    "two_link/around_a_post": {"motors": LINES},
    "two_link/paper_1_30mm": {
        "motors": {
            "coulomb_friction": {"joint1": [4.0, 6.0], "joint2": [2.0, 1.0]},
            "viscous_friction": 1.0,
            "friction_uncertainty": 0.2,
        }
    },
}


def peak_jerk(robot, trajectory):
    return abs(trajectory.derivative_coefficients(3)).max()


def energy(robot, trajectory):
    return EffortCosts(robot, trajectory).energy(robot.limits.effort**-2)


COSTS = {"smoothness": peak_jerk, "energy": energy}


def require_used(result):
    """Raise unless all limits are kept and some motor gives what it can."""
    conditions = result.certificate.conditions
    assert result.certificate.passed
    used = [conditions[kind].margin for kind in ("effort", "motor_curve", "velocity")]
    assert min(margin for margin in used if margin is not None) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("name", MOTORS)
def test_plans_keep_what_motors_have_and_use_it(name):
    problem = with_fields(name, **MOTORS[name])
    result = plan(problem, SHORTEST)
    assert (result.succeeded, result.method) == (True, "refinement")
    require_used(result)
    ideal = with_fields(name)
    faster = plan(ideal, SHORTEST)
    assert faster.succeeded
    assert not verify(problem, faster.trajectory).passed
    kinds = {one.limit for one in result.sensitivities if one.elasticity < -0.05}
    assert ("motor_curve" in kinds) == ("saturation_effort" in MOTORS[name].get("motors", {}))


def test_efforts_along_a_plan_are_inside_the_line():
    """By the formula, at samples: tau <= S (1 - v / V) and -tau <= S (1 + v / V), both touched."""
    problem = with_fields("two_link/around_a_post", motors=LINES)
    trajectory = plan(problem, SHORTEST).trajectory
    samples = trajectory.at(np.linspace(0, trajectory.duration, 20_001))
    effort = motor_effort(problem.robot, trajectory, samples) / LINES["saturation_effort"]
    line = samples.velocity / LINES["no_load_velocity"]
    assert (effort + line).max() == pytest.approx(1.0, abs=1e-3)
    assert (-effort - line).max() == pytest.approx(1.0, abs=1e-3)
    assert max((effort + line).max(), (-effort - line).max()) <= 1 + 1e-9


@pytest.mark.parametrize("method", slow_but(QUICK, (*QUICK, "suh-bishop")))
def test_other_methods_keep_them(method):
    problem = with_fields("two_link/paper_1_30mm", **MOTORS["two_link/paper_1_30mm"])
    result = plan(problem, PlanOptions(method, slack=0.0))
    assert (result.succeeded, result.method) == (True, method)
    require_used(result)


@pytest.mark.parametrize("minimise", ["smoothness", "energy"])
def test_the_second_stage_finds_something_with_friction_too(minimise):
    """Kept exactly: what is slack is used up, and the note speaks of no failure."""
    name = "two_link/paper_1_30mm"
    problem = with_fields(name, **MOTORS[name])
    problem = replace(problem, objective=Objective(0.02, minimise))
    result = plan(problem)
    assert result.certificate.passed
    assert result.shortest_duration < result.duration <= 1.02 * result.shortest_duration * 1.000001
    assert not np.array_equal(result.trajectory.coefficients, result.shortest.coefficients)
    longer = result.shortest.scaled(result.duration / result.shortest.duration)
    saved = COSTS[minimise](problem.robot, result.trajectory)
    assert saved < 0.99 * COSTS[minimise](problem.robot, longer)


# Every method keeps the limits on how fast efforts change, and uses them.


SMOOTH = ("smoothed-bang-bang", "smoothed-arc-corners")
NAMES = ("joint1", "joint2")


def bent(gravity=(0, 0, 0), **rates):
    """A two-link arm with limited effort rates [N m/s] in a tube around a corner."""
    limits = LimitOverrides(velocity=dict.fromkeys(NAMES, np.inf), effort_rate=rates)
    robot = load_robot("example:two_link", "hand", gravity=gravity, limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


def effort_rate_require_used(certificate):
    condition = certificate.conditions["effort_rate"]
    assert -1e-6 <= condition.margin < 0.01
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("rates", [{"joint1": 300.0, "joint2": 200.0}, {"joint2": 60.0}])
@pytest.mark.parametrize("gravity", [(0, 0, 0), (0, -1.6, 0)])
def test_plans_keep_them_and_use_them(rates, gravity):
    result = plan(bent(gravity, **rates), SHORTEST)
    assert (result.succeeded, result.method) == (True, "refinement")
    effort_rate_require_used(result.certificate)
    assert plan(bent(gravity), SHORTEST).duration < 0.95 * result.duration
    dear = [one for one in result.sensitivities if one.limit == "effort_rate"]
    assert {one.joint for one in dear} == set(rates)
    assert min(one.elasticity for one in dear) < -0.05


def test_with_a_limit_on_every_joint_no_note_speaks_of_growing_jerk():
    both, one = plan(bent(joint1=300.0, joint2=200.0), SHORTEST), plan(bent(joint1=300.0), SHORTEST)
    assert not any("jerk" in note for note in both.notes)
    assert any("jerk" in note and "'joint2'" in note for note in one.notes)


@pytest.mark.parametrize("method", ["branch-and-bound", "stop-at-corners"])
def test_other_methods_keep_them_of_effort_rate(method):
    result = plan(bent(joint1=300.0), PlanOptions(method, slack=0.0))
    assert (result.succeeded, result.method) == (True, method)
    effort_rate_require_used(result.certificate)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_them_where_their_acceleration_is_continuous(name):
    """The others fail of what cannot be smooth in them, and of nothing else."""
    _, certificate = judged_baseline(bent(joint1=300.0), name)
    if name in SMOOTH:
        assert certificate.passed
        effort_rate_require_used(certificate)
    else:
        assert {"rest", "continuity"} <= set(certificate.failures())
        assert set(certificate.failures()) <= {"rest", "continuity", "effort_rate"}


@pytest.mark.slow
def test_a_panda_keeps_what_its_controller_is_asked_for(bundled):
    problem = bundled("panda/between_shelves")
    rates = dict.fromkeys(problem.robot.joint_names, 1000.0)
    robot = load_robot(
        "example:panda", problem.robot.tool_frame, limits=LimitOverrides(effort_rate=rates)
    )
    limited = PlanningProblem(
        robot,
        problem.tube,
        problem.start,
        problem.goal,
        obstacles=problem.obstacles,
        clearance=problem.clearance,
    )
    result = plan(limited, SHORTEST)
    assert result.succeeded
    effort_rate_require_used(result.certificate)
    assert result.duration < 1.15 * plan(problem, SHORTEST).duration


# Every method keeps velocity limits that fall towards the ends, also near and in the zones.


UPPER, DECELERATION = 2.0, 4.0
# Those of a Franka FR3, joint by joint.
FR3 = zip([6, 2.585, 3.5, 4, 17, 5.5, 17], [0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35], strict=True)
NEAR = {
    "joint1": {"deceleration": 4.0, "offset": 0.3, "lower": -0.5, "upper": 2.0},
    "joint2": {"deceleration": 5.0, "offset": 0.2, "lower": -2.0, "upper": 0.5},
}


def two_link(laws=NEAR):
    free = {"joint1": np.inf, "joint2": np.inf}
    limits = LimitOverrides(velocity=free, velocity_by_position=laws)
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


@pytest.fixture
def bar(tmp_path):
    """Return a function from start, goal and offset to the problem of a bar that turns."""

    def moved(start, goal, offset):
        law = {"deceleration": DECELERATION, "offset": offset, "lower": -UPPER, "upper": UPPER}
        robot = one_joint(tmp_path, velocity_by_position=law)
        tool = robot.tool_position(np.zeros((1, 1)))[0]
        tube = Tube([tool, tool + np.array([1.0, 0.0, 0.0])], 1000.0)
        return PlanningProblem(
            robot, tube, np.array([start]), np.array([goal]), self_collision=False
        )

    return moved


def require_kept(certificate, most=0.01):
    condition = certificate.conditions["velocity"]
    assert -1e-6 <= condition.margin < most
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("method", ["refinement", "stop-at-corners"])
def test_plans_keep_it_and_use_it(method):
    result = plan(two_link(), PlanOptions(method))
    assert result.succeeded
    require_kept(result.certificate)
    assert plan(two_link({}), PlanOptions(method)).duration < result.duration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_searches_keep_it(method, bundled):
    free = bundled("two_link/paper_1_30mm")
    q = plan(free).trajectory.position(np.linspace(0, 0.8, 200))
    laws = {
        name: {"deceleration": 4.0, "offset": 0.3, "lower": low - 0.5, "upper": high + 0.5}
        for name, low, high in zip(
            free.robot.joint_names, q.min(axis=0).tolist(), q.max(axis=0).tolist(), strict=True
        )
    }
    robot = load_robot("example:two_link", "hand", limits=LimitOverrides(velocity_by_position=laws))
    result = plan(replace(free, robot=robot), PlanOptions(method))
    assert result.succeeded
    assert result.method == method
    require_kept(result.certificate, most=0.2)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_it(name):
    _, certificate = judged_baseline(two_link(), name)
    require_kept(certificate, most=0.2)


@pytest.mark.parametrize("below", [0.1, 1e-3, 1e-6])
def test_a_goal_next_to_the_zone_is_come_to(bar, below):
    """It takes some 75 ms for each factor e of the distance: the velocity falls in proportion."""
    zone = 0.3**2 / (2 * DECELERATION)
    result = plan(bar(0.0, UPPER - zone - below, 0.3))
    assert result.succeeded
    require_kept(result.certificate)
    assert result.duration < 1.1 + 0.3 / DECELERATION * np.log(1.0 / below) + 0.2


def test_without_an_offset_the_end_itself_is_come_to(bar):
    """Sped up at 5 N m / 0.7 kg m^2, slowed down at the law's deceleration: a closed form."""
    result = plan(bar(0.0, UPPER, 0.0))
    assert result.succeeded
    require_kept(result.certificate)
    speeding_up = 5 / 0.7
    fastest = np.sqrt(2 * UPPER / (1 / speeding_up + 1 / DECELERATION))
    least = fastest / speeding_up + fastest / DECELERATION
    assert least < result.duration < 1.02 * least


@pytest.mark.parametrize(("start", "goal"), [(UPPER, 0.0), (UPPER, UPPER - 0.005), (-UPPER, 0.0)])
def test_it_leaves_a_zone_as_if_there_were_none(bar, start, goal):
    """From rest, where no velocity is allowed towards the end."""
    result = plan(bar(start, goal, 0.3))
    assert result.succeeded
    require_kept(result.certificate, most=1.0)
    elasticities = [p.elasticity for p in result.sensitivities if p.limit == "velocity_by_position"]
    assert elasticities == pytest.approx([0.0], abs=1e-6)


@pytest.mark.parametrize(("start", "goal"), [(0.0, UPPER - 0.005), (UPPER - 0.005, UPPER)])
def test_a_goal_in_a_zone_is_refused(bar, start, goal):
    result = plan(bar(start, goal, 0.3))
    assert result.status is PlanStatus.NO_TRAJECTORY
    assert result.place.joint == "turn"
    assert "limits.velocity_by_position allows it no velocity that way" in result.message


@pytest.mark.slow
@pytest.mark.parametrize("joint", range(7))
def test_a_motion_goes_round_a_zone_that_the_fastest_would_enter(bundled, joint):
    """Four tenths of what the free motion exceeds its ends by are left to it."""
    free = bundled("panda/between_shelves")
    motion = plan(free).trajectory
    q = motion.position(np.linspace(0, motion.duration, 2001))[:, joint]
    sign = 1.0 if q.max() - max(q[0], q[-1]) > min(q[0], q[-1]) - q.min() else -1.0
    top = max(sign * q[0], sign * q[-1])
    beyond = (sign * q).max() - top
    assert beyond > 0.02
    upper = top + 0.4 * beyond + 0.3**2 / (2 * DECELERATION)
    ends = sorted([sign * upper, -sign * 9.0])
    law = {"deceleration": DECELERATION, "offset": 0.3, "lower": ends[0], "upper": ends[1]}
    limits = LimitOverrides(velocity_by_position={free.robot.joint_names[joint]: law})
    robot = load_robot("example:panda", "panda_hand_tcp", limits=limits)
    goal = motion.position(np.array([motion.duration]))[0]
    result = plan(replace(free, robot=robot, goal=goal))
    assert result.succeeded
    assert result.method == "refinement"
    require_kept(result.certificate)
    assert result.duration < 1.7 * motion.duration


@pytest.mark.slow
def test_a_panda_keeps_the_law_of_an_fr3(bundled):
    """Which its fastest motion breaks by a tenth of the velocity; it costs next to nothing."""
    free = bundled("panda/between_shelves")
    names = free.robot.joint_names
    laws = {name: {"deceleration": d, "offset": o} for name, (d, o) in zip(names, FR3, strict=True)}
    limits = LimitOverrides(velocity_by_position=laws)
    robot = load_robot("example:panda", "panda_hand_tcp", limits=limits)
    result = plan(replace(free, robot=robot))
    assert result.succeeded
    require_kept(result.certificate)
    assert result.duration == pytest.approx(plan(free).duration, rel=0.01)


# Every method keeps the limits on the speeds of points, and uses them.


POINTS = [PointSpeed("hand", (0.0, 0.1, 0.0), 0.6), PointSpeed("link2", (0.0, 0.0, 0.0), 0.5)]


def problem(points=POINTS):
    """The two-link arm in a bent tube."""
    free = {"joint1": np.inf, "joint2": np.inf}
    limits = LimitOverrides(velocity=free, point_speed=points)
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0]]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


def point_speed_require_kept(certificate, most=0.01):
    condition = certificate.conditions["point_speed"]
    assert -1e-6 <= condition.margin < most
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("method", ["refinement", "stop-at-corners"])
def test_plans_keep_it_and_use_it_of_point_speed(method):
    result = plan(problem(), PlanOptions(method))
    assert result.succeeded
    point_speed_require_kept(result.certificate)
    assert plan(problem([]), PlanOptions(method)).duration < result.duration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_searches_keep_it_of_point_speed(method, bundled):
    free = bundled("two_link/paper_1_30mm")
    robot = load_robot("example:two_link", "hand", limits=LimitOverrides(point_speed=POINTS))
    result = plan(replace(free, robot=robot), PlanOptions(method))
    assert result.succeeded
    assert result.method == method
    point_speed_require_kept(result.certificate, most=0.2)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_it_of_point_speed(name):
    _, certificate = judged_baseline(problem(), name)
    point_speed_require_kept(certificate, most=0.2)


@pytest.mark.slow
def test_the_elbow_of_a_ur5_keeps_its_limit(bundled):
    """Over the wall, the elbow reaches 1.37 m/s if it may."""
    free = bundled("ur5/over_the_wall")
    elbow = [PointSpeed("forearm_link", (0.0, 0.0, 0.0), 0.8)]
    limits = LimitOverrides(point_speed=elbow)
    limited = replace(free, robot=load_robot("example:ur5", "tool0", limits=limits))
    result = plan(limited)
    assert result.succeeded
    point_speed_require_kept(result.certificate)
    assert plan(free).duration < result.duration < 1.5 * plan(free).duration
    (price,) = (one for one in result.sensitivities if one.limit == "point_speed")
    assert price.elasticity < -0.05


# Every method keeps the limits on the tool's speed, and uses them.


def tool_speed_require_kept(problem, certificate):
    condition = certificate.conditions["tool_speed"]
    assert -1e-6 <= condition.margin < 0.2
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("given", [([None, 0.5], None), (None, 0.6), ([0.4, 0.9], 0.8)])
@pytest.mark.parametrize("method", ["refinement", "stop-at-corners"])
def test_plans_keep_it_and_use_it_of_tool_speed(method, given):
    problem = limited_tool(*given, count=2)
    result = plan(problem, PlanOptions(method, slack=0.0))
    assert result.succeeded
    tool_speed_require_kept(problem, result.certificate)
    assert result.certificate.conditions["tool_speed"].margin < 0.01
    free = plan(limited_tool(count=2), PlanOptions(method, slack=0.0))
    assert free.duration < result.duration


@pytest.mark.slow
@pytest.mark.parametrize("method", ["branch-and-bound", "suh-bishop"])
def test_searches_keep_it_of_tool_speed(method, bundled):
    problem = bundled("two_link/paper_1_30mm")
    problem = problem.with_tube(replace(problem.tube, tool_speed=0.8))
    result = plan(problem, PlanOptions(method, slack=0.0))
    assert result.succeeded
    assert result.method == method
    tool_speed_require_kept(problem, result.certificate)


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_keep_it_of_tool_speed(name):
    problem = limited_tool([None, 0.5], 1.2, count=2)
    _, certificate = judged_baseline(problem, name)
    tool_speed_require_kept(problem, certificate)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [[None, 0.5, None], 0.5])
def test_a_ur5_is_slow_over_the_wall(bundled, speed):
    """At its limit in the middle for most of the time, and certified."""
    problem = bundled("ur5/over_the_wall")
    limited = problem.with_tube(replace(problem.tube, tool_speed=speed))
    result = plan(limited, SHORTEST)
    assert result.succeeded
    tool_speed_require_kept(limited, result.certificate)
    trajectory = result.trajectory
    at = trajectory.at(np.linspace(0, trajectory.duration, 2001))
    fast = np.linalg.norm(problem.robot.tool_velocity(at.position, at.velocity)[0], axis=1)
    assert (abs(fast - 0.5) < 0.005).mean() > 0.4
    assert (fast.max() > 0.6) == isinstance(speed, list)
    prices = {p.segment: p.elasticity for p in result.sensitivities if p.limit == "tool_speed"}
    assert min(prices, key=prices.get) == 1
    assert prices[1] < -0.4
    assert plan(problem, SHORTEST).duration < 0.8 * result.duration


@pytest.mark.slow
def test_many_points_keep_it():
    """Chains of segments, each with a limit of its own or none."""
    angles = np.linspace(-0.6, 0.9, 40)
    points = np.column_stack([0.45 * np.cos(angles), 0.45 * np.sin(angles), 0 * angles])
    speeds = [0.6 if 10 <= k < 20 else None for k in range(39)]
    tube = Tube(points, 0.02, joint_signs={"joint2": "-"}, tool_speed=speeds)
    problem = PlanningProblem(limited_tool().robot, tube, Seed(np.array([0.0, -1.0])))
    result = plan(problem, SHORTEST)
    assert result.succeeded
    tool_speed_require_kept(problem, result.certificate)
