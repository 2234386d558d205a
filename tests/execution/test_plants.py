"""Plants drawn at random about the model; stages with a carried load."""

from dataclasses import replace

import numpy as np
import pytest
from cases import one_joint, with_motors

from tubeplanner import OptionError, Payload, load_robot
from tubeplanner.execution.plants import Draw, drawn_plants, first_instant, last_instant
from tubeplanner.task.demands import Robustness

RUNS = 400
COM, INERTIA = (0.03, -0.02, 0.1), (0.05, 0.06, 0.07, 0.01, 0, 0)


@pytest.fixture(scope="module")
def robot():
    """A UR10 with a payload of 7.5 kg."""
    return loaded()


def loaded(fraction=1.0):
    """Return a UR10 with a payload, or a fraction of it."""
    weight = Payload(7.5 * fraction, COM, tuple(np.multiply(fraction, INERTIA)))
    return load_robot("example:ur10", "tool0", payload=weight)


def drawn(robot, **errors):
    """Arms of independent errors: the first two are corners."""
    return drawn_plants(robot, Robustness.exact(**errors), Draw(RUNS + 2, seed=3))[2:]


def test_the_first_arm_has_all_errors_at_their_bounds_the_second_none_the_others_less(robot):
    """Signs and directions of the first are drawn."""
    kinds = {"viscous_friction": 2.0, "backwards_friction": 3.0, "forwards_friction": 4.0}
    moved, errors = with_motors(robot, **kinds), Robustness(lag=2e-3, delay=3e-3, noise=4e-5)
    slope = moved.limits.effort / moved.limits.velocity
    sizes = []
    for plant in drawn_plants(moved, errors, Draw(9)):
        motors, bodies = (
            plant.motors,
            list(zip(plant.bodies[1:6], moved.inertias[1:6], strict=True)),
        )
        fractions = [(body.mass / own.mass - 1) / errors.mass for body, own in bodies]
        fractions += [np.linalg.norm(body.com - own.com) / errors.com for body, own in bodies]
        friction = [getattr(motors, kind) / kinds[kind] - 1 for kind in list(kinds)[1:]]
        fractions.extend(np.ravel(friction) / errors.friction)
        fractions += [
            getattr(plant, name) / getattr(errors, name) for name in ("lag", "delay", "noise")
        ]
        fractions += [
            np.linalg.norm(plant.tool) / errors.tool,
            np.linalg.norm(plant.base) / errors.base,
        ]
        more = motors.viscous_friction - 2.0
        sizes.append(np.abs(fractions))
        if len(sizes) == 1:
            unmodelled = errors.unmodelled_friction * slope
            np.testing.assert_allclose(abs(more - unmodelled), 2.0 * errors.friction)
        if len(sizes) == 2:
            np.testing.assert_array_equal(more, 0.0)
            assert plant.bodies[-1].mass == pytest.approx(moved.inertias[-1].mass)
    np.testing.assert_allclose(sizes[0], 1.0, rtol=1e-9)
    np.testing.assert_array_equal(sizes[1], 0.0)
    assert np.min(sizes[2:]) > 0
    assert np.max(sizes[2:]) < 1


def test_masses_are_uniform_and_inertias_with_them(robot):
    plants = drawn(robot, mass=0.05)
    fractions = np.array([[body.mass for body in plant.bodies[1:6]] for plant in plants])
    fractions /= [body.mass for body in robot.inertias[1:6]]
    assert abs(fractions - 1).max() <= 0.05
    # Of a uniform distribution: a quarter of its width about the mean on either side.
    quartiles = np.quantile(fractions, [0.25, 0.75], axis=0).mean(axis=1)
    np.testing.assert_allclose(quartiles, [0.975, 1.025], atol=0.003)
    assert abs(np.corrcoef(fractions.T) - np.eye(5)).max() < 0.15
    for body, fraction in enumerate(fractions[0], start=1):
        expected = fraction * robot.inertias[body].inertia
        np.testing.assert_allclose(plants[0].bodies[body].inertia, expected, atol=1e-12)


def test_the_payload_has_an_error_of_its_own(robot):
    masses = np.array([plant.bodies[-1].mass for plant in drawn(robot, payload=0.1)])
    away = masses - robot.inertias[-1].mass
    assert 0.7 < abs(away).max() <= 0.75
    own = np.array([plant.bodies[-1].mass for plant in drawn(robot, mass=0.1)])
    without = robot.inertias[-1].mass - 7.5
    assert abs(own - without - 7.5).max() <= 0.1 * without + 1e-9
    (plant,) = drawn_plants(robot, Robustness.exact(payload=0.5), Draw(1))
    fraction = 1 + (plant.bodies[-1].mass - robot.inertias[-1].mass) / 7.5
    expected = loaded(fraction).inertias[-1]
    np.testing.assert_allclose(plant.bodies[-1].com, expected.com, atol=1e-9)
    np.testing.assert_allclose(plant.bodies[-1].inertia, expected.inertia, atol=1e-9)


def test_centres_of_mass_tool_and_base_lie_in_balls(robot):
    plants = drawn(robot, com=0.005, tool=0.002, base=0.001)
    com = [plant.bodies[2].com - robot.inertias[2].com for plant in plants]
    tool, base = ([getattr(plant, part) for plant in plants] for part in ("tool", "base"))
    for shifts, radius in ((com, 0.005), (tool, 0.002), (base, 0.001)):
        distance = np.linalg.norm(shifts, axis=1)
        assert distance.max() <= radius
        # Half of a ball's volume is within 0.794 of its radius.
        assert np.median(distance) == pytest.approx(radius * 0.5 ** (1 / 3), rel=0.05)
        assert np.linalg.norm(np.mean(shifts, axis=0)) < 0.1 * radius


def test_frictions_err_by_themselves_and_unmodelled_friction_is_added(robot):
    kinds = {"viscous_friction": 2.0, "backwards_friction": 3.0, "forwards_friction": 4.0}
    moved = with_motors(robot, armature=0.5, **kinds)
    plants = drawn(moved, friction=0.2)
    fractions = np.array(
        [[getattr(p.motors, kind) / kinds[kind] for kind in kinds] for p in plants]
    )
    assert 0.19 < abs(fractions - 1).max() <= 0.2
    assert abs(np.corrcoef(fractions.reshape(RUNS, -1).T) - np.eye(18)).max() < 0.25
    assert all((plant.motors.armature == 0.5).all() for plant in plants)
    limits = moved.limits
    more = [p.motors.viscous_friction - 2.0 for p in drawn(moved, unmodelled_friction=0.02)]
    fraction = np.array(more) * limits.velocity / limits.effort
    assert 0 < fraction.min() < 0.001
    assert 0.019 < fraction.max() <= 0.02 + 1e-12
    assert np.median(fraction) == pytest.approx(0.01, rel=0.05)
    assert abs(np.corrcoef(fraction.T) - np.eye(6)).max() < 0.25


def test_a_joint_without_an_effort_limit_has_no_unmodelled_friction(tmp_path):
    robot = one_joint(tmp_path, effort=np.inf)
    (plant,) = drawn_plants(robot, Robustness.exact(unmodelled_friction=0.1), Draw(1))
    assert plant.motors.viscous_friction == 0.0


def test_a_run_is_the_same_however_many_there_are(robot):
    errors = Robustness(lag=2e-3, delay=3e-3, noise=4e-5)
    few, many = (drawn_plants(robot, errors, Draw(runs, seed=5)) for runs in (3, 5))
    other = drawn_plants(robot, errors, Draw(3, seed=6))
    for name in ("lag", "delay", "noise", "noise_seed"):
        assert getattr(few[2], name) == getattr(many[2], name)
        assert len({getattr(plant, name) for plant in [*many[2:], other[2]]}) == 4
    assert few[2].bodies[3].mass == many[2].bodies[3].mass
    assert len({plant.bodies[3].mass for plant in [*many[2:], other[2]]}) == 4
    assert len({plant.noise_seed for plant in [*many, *other]}) == 8


@pytest.mark.parametrize(("given", "name"), [({"runs": 0}, "runs"), ({"seed": -1}, "seed")])
def test_draws_out_of_bounds_are_refused(given, name):
    with pytest.raises(OptionError, match=f"{name} is "):
        Draw(**given)


def test_the_tool_is_shifted_in_its_own_frame_and_with_the_base(robot):
    (exact,) = drawn_plants(robot, Robustness.exact(), Draw(1))
    np.testing.assert_array_equal([exact.tool, exact.base], np.zeros((2, 3)))
    q = np.linspace(-1, 1, 3 * robot.joint_count).reshape(3, -1)
    rotation, position = robot.tool_pose(q)
    along, base = np.array([0.0, 0.0, 0.1]), np.array([0.2, 0.0, -0.3])
    turned, tool = replace(exact, tool=along, base=base).displaced(rotation, position)
    np.testing.assert_array_equal(turned, rotation)
    np.testing.assert_allclose(tool, position + base + 0.1 * rotation[:, :, 2], atol=1e-12)


TIME = np.arange(11) * 0.1  # 0.30000000000000004 among it


@pytest.mark.parametrize(
    ("when", "first", "last"),
    [
        *((0.0, 0, 0), (0.3, 3, 3), (0.35, 4, 3), (1.0, 10, 10), (np.inf, 11, 10)),
        *((0.3 - 1e-12, 3, 3), (0.3 + 1e-12, 3, 3)),  # rounding makes no other instant
    ],
)
def test_instants_beside_a_time(when, first, last):
    assert (first_instant(TIME, when), last_instant(TIME, when)) == (first, last)
