"""Plans with motors: a bar's against its least time, integrated by itself, and whole arms'."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import yaml
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cases import INERTIA, SHORTEST, one_joint, slow_but, with_motors
from tubeplanner import Objective, PlanningProblem, PlanOptions, Tube, parse_problem, plan, verify
from tubeplanner.constraints.effort_costs import EffortCosts
from tubeplanner.constraints.motor_effort import motor_effort
from tubeplanner.resources import bundled_problems
from tubeplanner.robot.effort_range import EffortRange

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
