"""The cones of held parts as a limit on the speed, against wrenches of mass points."""

from dataclasses import replace

import numpy as np
import pytest

import tubeplanner as t
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.outcome import Infeasible
from tubeplanner.robot.pinocchio_model import Payload, ToolOffset
from tubeplanner.task.holding import Cup, Gripper, Holding, Liquid, Tray

STEP = 1e-3
UP = (0.1, 0.05, 1.0)  # nearly: the level tray's tool points up
CONTACTS = {
    "cup": Cup(42.4, 0.015, 0.5, position=(0, 0.01, -0.02), normal=(0.2, 0, -1)),
    "tray": Tray(0.5, (0.06, 0.04), safety=1.0, position=(0, 0, 0.01), normal=UP),
    "disc": Tray(0.5, 0.03, safety=1.0, normal=UP),
    "gripper": Gripper(60.0, 0.5, (0.02, 0.03)),
    "liquid": Liquid(0.4, normal=UP),
}
PART = Payload(0.8, (0.004, -0.002, 0.03), (0.004, 0.005, 0.006, 3e-4, 2e-4, 1e-4))


@pytest.fixture(scope="module")
def level():
    offset = {"position": [0.02, 0.01, 0.1], "rpy": [0.3, -0.2, 0.5]}
    robot = t.load_problem("example:ur5/level_tray").robot
    held = t.load_robot("example:ur5", "tool0", tool_offset=ToolOffset(**offset))
    assert held.joint_names == robot.joint_names
    start = np.array(t.load_problem("example:ur5/level_tray").start)
    return t.PlanningProblem(
        held, t.Tube.anywhere(*held.tool_position(np.stack([start, start]))), start
    )


def held(problem, name):
    contact = CONTACTS[name]
    part = Payload(PART.mass, tuple(np.array(PART.com) * (1, 1, -1)), PART.inertia)
    return replace(problem, holding=(Holding(contact, part if name == "cup" else PART),))


def motions(problem, count=30):
    """Return q, q' and q'' near the start, where most parts hold at rest."""
    q, v, a = np.random.default_rng(3).normal(size=(3, count, 6))
    return np.stack([problem.start + 0.03 * q, v, 3 * a])


def wrench_of_points(problem, state, speed):
    """Return the wrench (N, 6) by the forces on mass points that move with the tool frame."""
    (holding,), robot = problem.holding, problem.robot
    part = holding.mass_properties
    spread, axes = np.linalg.eigh(part.inertia_matrix())
    along = np.sqrt(np.maximum(spread.sum() / 2 - spread, 0) / part.mass * 3)
    offsets = np.vstack([axes.T * along[:, None], -axes.T * along[:, None]])
    points, mass = np.array(part.com) + offsets, part.mass / 6
    body = robot.link_body[robot.tool_frame]
    placement = robot.link_placement[robot.tool_frame]

    def located(time):
        q = state[0] + speed * time * state[1] + (speed * time) ** 2 / 2 * state[2]
        rotation, position = (pose[:, body] for pose in robot.body_poses(q))
        turned = rotation @ placement[:3, :3]
        origin = np.einsum("nij,j->ni", rotation, placement[:3, 3]) + position
        return turned, origin[:, None] + np.einsum("nij,pj->npi", turned, points), origin

    (_, before, _), (turned, now, origin), (_, after, _) = map(located, (-STEP, 0.0, STEP))
    force = mass * ((before - 2 * now + after) / STEP**2 - robot.gravity)
    middle = origin + np.einsum("nij,j->ni", turned, np.array(holding.contact.position))
    moment = np.cross(now - middle[:, None], force).sum(axis=1)
    frame = turned @ holding.axes
    parts = [np.einsum("nij,ni->nj", frame, each) for each in (force.sum(axis=1), moment)]
    return np.hstack(parts)


@pytest.mark.parametrize("name", CONTACTS)
def test_cones_are_those_of_the_wrench_of_mass_points(level, name):
    problem = held(level, name)
    state, speed = motions(problem), 0.7
    wrench = wrench_of_points(problem, state, speed)
    parts = HoldingLimit(problem).parts(PathSamples(problem, state))
    x, bound = parts.x0 + speed**2 * parts.x2, parts.t0 + speed**2 * parts.t2
    expected = np.array([cone.margin(wrench) for cone in problem.holding[0].cones]).T
    np.testing.assert_allclose(bound - np.linalg.norm(x, axis=2), expected, atol=2e-5)


@pytest.mark.parametrize("name", CONTACTS)
def test_the_largest_speed_is_where_a_sample_leaves_its_cone(level, name):
    problem = held(level, name)
    limit, at = HoldingLimit(problem), PathSamples(problem, motions(problem))
    parts, speed = limit.parts(at), limit.used(at).largest_speed(limit.signs)

    def margin(square):
        x = parts.x0 + square[..., None] * parts.x2
        return parts.t0 + square * parts.t2 - np.linalg.norm(x, axis=2)

    rests, leaves = margin(np.zeros_like(speed)) >= 0, (speed > 0) & (speed < np.inf)
    assert (rests == (speed > 0)).all()
    assert leaves.sum() > 5
    np.testing.assert_allclose(margin(np.where(leaves, speed, 0.0) ** 2)[leaves], 0.0, atol=1e-9)
    for share in (0.3, 0.9, 0.999):
        slower = np.where(leaves, share * speed, 50.0 * (speed > 0))
        assert (margin(slower**2)[rests] > -1e-9).all()


@pytest.mark.parametrize("name", ["cup", "tray"])
def test_derivatives_by_the_path_agree_with_differences(level, name, monkeypatch):
    problem = held(level, name)
    state, limit, speed, step = motions(problem), HoldingLimit(problem), 1.3, 1e-6
    tangents = limit._tangents(PathSamples(problem, state))
    monkeypatch.setattr(limit, "_tangents", lambda at: tangents)

    def used(k, j, change):
        other = state.copy()
        other[k, :, j] += change
        return limit.used(PathSamples(problem, other)).at(speed)

    exact = limit.by_path(PathSamples(problem, state), speed)
    for k in range(3):
        columns = [(used(k, j, step) - used(k, j, -step)) / (2 * step) for j in range(6)]
        np.testing.assert_allclose(exact[k], np.stack(columns, axis=-1), atol=1e-6)


def test_a_part_lost_at_rest_is_refused_by_lean_and_excess(level):
    problem = held(level, "liquid")
    q = problem.start + np.array([[0, 0, 0, 0.0, 0, 0], [0, 0, 0, 0.6, 0, 0]])
    at = PathSamples(problem, np.stack([q, 0 * q, 0 * q]))
    limit = HoldingLimit(problem)
    assert limit.used(at).largest_speed(limit.signs)[:, 0].tolist() == [np.inf, 0.0]
    refusal = limit.refusal(at)
    assert isinstance(refusal, Infeasible)
    assert "32.0 degrees from upright" in str(refusal) and "40.4 %" in str(refusal)
    assert refusal.configuration.tolist() == q[1].tolist()
