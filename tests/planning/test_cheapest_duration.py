"""How much time is of use: against the closed form of the energy of a shape."""

from dataclasses import replace

import numpy as np
import pytest

from cases import ANGLE, anywhere, one_joint, quintic
from tubeplanner import Objective
from tubeplanner.constraints.effort_costs import EffortCosts
from tubeplanner.planning.cheapest_duration import cheapest_duration

LONGEST = 6.0


def asked(robot, minimise):
    return replace(anywhere(robot), objective=Objective(1.0, minimise))


def cheapest_shape(robot, shape):
    """Return the duration at which d/dT (E4/T^3 + E2/T + E0 T) vanishes, by quadrature."""
    x = (np.arange(20_000) + 0.5)[:, None] / 20_000
    state = (shape.position(x)[:, 0], 0 * x, shape.acceleration(x)[:, 0])
    held = robot.gravity_effort(state[0])
    moved = robot.inverse_dynamics(*state) - held
    e4, e2, e0 = (moved**2).mean(), 2 * (moved * held).mean(), (held**2).mean()
    roots = np.roots([e0, 0.0, -e2, 0.0, -3 * e4])
    return roots[(abs(roots.imag) < 1e-9) & (roots.real > 0)].real.max()


def test_energy_has_a_cheapest_duration_where_gravity_is_to_be_held(tmp_path):
    robot = one_joint(tmp_path, mass=0.5)
    expected = cheapest_shape(robot, quintic(ANGLE))
    assert 1.0 < expected < LONGEST
    found = cheapest_duration(asked(robot, "energy"), quintic(ANGLE), LONGEST)
    assert found == pytest.approx(expected, abs=(LONGEST - 1.0) / 49)


@pytest.mark.parametrize("minimise", ["smoothness", "energy", "work"])
def test_without_gravity_all_time_is_of_use(minimise, tmp_path):
    problem = asked(one_joint(tmp_path), minimise)
    assert cheapest_duration(problem, quintic(ANGLE), LONGEST) == LONGEST


def test_smoothness_uses_all_of_it_with_gravity_too(tmp_path):
    problem = asked(one_joint(tmp_path, mass=0.5), "smoothness")
    assert cheapest_duration(problem, quintic(ANGLE), LONGEST) == LONGEST


def test_work_is_least_where_a_bar_swings_by_itself(tmp_path):
    """Down and up again: slower, nothing lifts it; faster, it is to be driven.

    Hardly anything is left of what lifting it takes, as speed carries it up.
    """
    robot, swing = one_joint(tmp_path, mass=0.5), quintic(-np.pi, 0.5)
    problem, tried = asked(robot, "work"), np.linspace(0.5, LONGEST, 50)
    found = cheapest_duration(problem, swing, LONGEST)
    costs = EffortCosts(robot, swing)
    lifting = 0.5 * 9.81 * 0.5
    assert costs.work(LONGEST) > 0.8 * lifting
    assert costs.work(found) == min(map(costs.work, tried)) < 0.5 * lifting
    assert 1.0 < found < 3.0
