"""Joints that mimic planned ones, against the same arm with all joints planned."""

import numpy as np
import pytest

from follower_arm import JOINTS, LINKS, RULES, follower_arm
from tubeplanner import (
    LimitOverrides,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    RobotError,
    Tube,
    load_robot,
    plan,
)
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.obstacle import placement_of
from tubeplanner.robot.followers import followers_of, leader_of


def load(folder, rules, own=None, **options):
    path = folder / "arm.urdf"
    path.write_text(follower_arm(rules, own))
    return load_robot(path, "tip", **options)


PLANNED = ("lift", "first", "wrist", "side_joint")
ALL = tuple(JOINTS)


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """The arm with followers, and the same with every joint planned."""
    folder = tmp_path_factory.mktemp("followers")
    return (
        load(folder, RULES, joints=["wrist", "first", "side_joint", "lift"]),
        load(folder, {}, joints=list(ALL)),
    )


def map_of(robot):
    """Return the matrix and the offsets by which all joints follow the planned ones."""
    rules = {"second": ("first", -2.0, 0.3), "slide": ("lift", 0.5, 0.1)}
    rules["tip_joint"] = ("first", -1.0, 0.35)  # 0.5 (-2 q + 0.3) + 0.2
    matrix, offset = np.zeros((len(ALL), robot.joint_count)), np.zeros(len(ALL))
    for row, name in enumerate(ALL):
        master, multiplier, offset[row] = rules.get(name, (name, 1.0, 0.0))
        matrix[row, robot.joint_names.index(master)] = multiplier
    return matrix, offset


@pytest.fixture(scope="module")
def states(arms):
    robot, _ = arms
    q, v, a = np.random.default_rng(1).uniform(-1, 1, (3, 20, robot.joint_count))
    matrix, offset = map_of(robot)
    return (q, v, a), (q @ matrix.T + offset, v @ matrix.T, a @ matrix.T), matrix


def test_rules_are_followed_to_the_end(arms):
    description = arms[0].urdf
    rule = leader_of(description, "tip_joint")
    assert (rule.master, rule.multiplier) == ("first", -1.0)
    assert rule.offset == pytest.approx(0.35)
    assert set(followers_of(description, PLANNED)) == set(RULES)
    assert set(followers_of(description, ["first"])) == {"second", "tip_joint"}


def test_tool_and_bodies_are_where_they_are_with_every_joint_planned(arms, states):
    (robot, plain), (mine, full, matrix) = arms, states
    for one, other in zip(robot.tool_pose(mine[0]), plain.tool_pose(full[0]), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
    rotation, position = robot.body_poses(mine[0])
    other_rotation, other_position = plain.body_poses(full[0])
    for link in LINKS:
        body, other = robot.link_body[link], plain.link_body[link]
        np.testing.assert_allclose(rotation[:, body], other_rotation[:, other], atol=1e-12)
        np.testing.assert_allclose(position[:, body], other_position[:, other], atol=1e-12)
    jacobian = robot.tool_jacobian(mine[0])[1]
    np.testing.assert_allclose(jacobian, plain.tool_jacobian(full[0])[1] @ matrix, atol=1e-12)


def test_efforts_of_followers_go_to_their_masters(arms, states):
    (robot, plain), (mine, full, matrix) = arms, states
    expected = plain.inverse_dynamics(*full) @ matrix
    np.testing.assert_allclose(robot.inverse_dynamics(*mine), expected, atol=1e-10)
    gravity = plain.gravity_effort(full[0]) @ matrix
    np.testing.assert_allclose(robot.gravity_effort(mine[0]), gravity, atol=1e-10)


def test_efforts_do_the_work_that_kinetic_and_potential_energy_gain(arms):
    """Power at the masters is the change of energy: one scalar law for all joints together."""
    robot, plain = arms
    matrix, offset = map_of(robot)
    rng = np.random.default_rng(2)
    q, v, a = rng.uniform(-1, 1, (3, 1, robot.joint_count))

    def energy(time):
        at = (q + v * time + a * time**2 / 2) @ matrix.T + offset
        speed = (v + a * time) @ matrix.T
        kinetic = plain.inverse_dynamics(at, 0 * at, speed) - plain.gravity_effort(at)
        return float((kinetic * speed).sum() / 2) + potential(at)

    def potential(at):
        rotation, position = plain.body_poses(at)
        height = 0.0
        for link in LINKS[1:]:
            body, placement = plain.link_body[link], plain.link_placement[link]
            com = placement[:3, :3] @ [0.1, 0.02, 0] + placement[:3, 3]
            height += (rotation[0, body] @ com + position[0, body])[2]
        return 2 * 9.81 * height

    power = (robot.inverse_dynamics(q, v, a) * v).sum()
    assert power == pytest.approx((energy(1e-5) - energy(-1e-5)) / 2e-5, rel=1e-6)


def test_derivatives_are_those_of_differences(arms, states):
    robot, (mine, _, _) = arms[0], states
    step = 1e-6
    for which, derivative in enumerate(robot.inverse_dynamics_derivatives(*mine)):
        for joint in range(robot.joint_count):
            moved = []
            for sign in (1, -1):
                state = [array.copy() for array in mine]
                state[which][:, joint] += sign * step
                moved.append(robot.inverse_dynamics(*state))
            numeric = (moved[0] - moved[1]) / (2 * step)
            np.testing.assert_allclose(derivative[:, :, joint], numeric, atol=2e-6)


def test_points_move_as_their_jacobian_says(arms, states):
    robot, (mine, _, _) = arms[0], states
    q, step = mine[0], 1e-6
    body = np.arange(len(q)) % robot.body_count
    local = np.random.default_rng(3).normal(scale=0.2, size=(len(q), 3))

    def points(at):
        rotation, position = robot.body_poses(at)
        rows = np.arange(len(at))
        return np.einsum("nij,nj->ni", rotation[rows, body], local) + position[rows, body]

    jacobian = robot.point_jacobian(*robot.body_poses(q), body, points(q))
    for joint in range(robot.joint_count):
        ahead = step * np.eye(robot.joint_count)[joint]
        numeric = (points(q + ahead) - points(q - ahead)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, joint], numeric, atol=1e-8)


def test_distances_change_by_no_more_than_the_motion_weights(arms):
    """Between links that share a master too: one moves by it once, the other twice."""
    robot = arms[0]
    checker = CollisionChecker(robot, [Obstacle.box("b", [0.2] * 3, placement_of([0.8, 0, 0.3]))])
    owners = {
        frozenset(n for i in pair for n in (checker.shapes[i].owner,)) for pair in checker.pairs
    }
    assert frozenset(("upper", "tip")) in owners
    rng = np.random.default_rng(4)
    before = rng.uniform(-1, 1, (60, robot.joint_count))
    after = before + rng.normal(scale=0.02, size=before.shape)
    weights = checker.motion_weights(checker.pairs)
    for one, other in zip(before, after, strict=True):
        found = [
            checker.distances(rotation[0], position[0], checker.pairs)
            for rotation, position in (robot.body_poses(one[None]), robot.body_poses(other[None]))
        ]
        apart = (found[0] > 0) & (found[1] > 0)
        bound = weights @ abs(other - one)
        assert (abs(found[0] - found[1]) <= bound + 1e-9)[apart].all()


def test_links_with_a_follower_between_them_are_not_neighbours(arms):
    """A master and a follower of it lie between: `column` and `fore` may meet."""
    checker = CollisionChecker(arms[0])
    names = {frozenset(checker.owners(pair)[0]) for pair in checker.link_pairs}
    assert frozenset(("column", "fore")) in names
    assert frozenset(("upper", "fore")) not in names


def test_what_is_certified_holds_for_the_arm_with_every_joint_planned(tmp_path, arms):
    strong = LimitOverrides(effort={"lift": 500, "first": 300, "wrist": 100, "side_joint": 50})
    robot, plain = load(tmp_path, RULES, joints=PLANNED, limits=strong), arms[1]
    start = np.array([0.2, 0.1, 0.3, 0.0])
    tube = Tube(robot.tool_position(start + np.array([[0.0], [0.4]])), 0.05)
    # The branch that goes on from the start does not end at start + 0.4.
    there = plan(PlanningProblem(robot, tube, start), PlanOptions("stop-at-corners")).trajectory
    problem = PlanningProblem(robot, tube, start, there.position(there.duration))
    result = plan(problem, PlanOptions("stop-at-corners"))
    assert result.certificate.passed
    samples = result.trajectory.per_piece(200)
    matrix, offset = map_of(robot)
    full = (
        samples.position @ matrix.T + offset,
        *(rate @ matrix.T for rate in (samples.velocity, samples.acceleration)),
    )
    assert (abs(plain.inverse_dynamics(*full) @ matrix) <= robot.limits.effort * (1 + 1e-6)).all()
    assert (tube.margin(plain.tool_position(full[0])).max(axis=1) >= -1e-6).all()


def test_limits_of_followers_bound_their_master(tmp_path):
    limits = {
        "second": '<limit lower="-1" upper="1.5" effort="1" velocity="4"/>',
        "slide": '<limit lower="0" upper="0.5" effort="1" velocity="0"/>',
    }
    names = ["lift", "first", "wrist"]
    limited = load(tmp_path, RULES, limits, joints=names).limits
    # second = 0.3 - 2 first in [-1, 1.5]; slide = 0.1 + 0.5 lift in [0, 0.5]
    np.testing.assert_allclose(limited.lower_position, [-0.2, -0.6, -2])
    np.testing.assert_allclose(limited.upper_position, [0.8, 0.65, 2])
    np.testing.assert_allclose(limited.velocity, [3, 2, 3])
    np.testing.assert_allclose(limited.effort, 50)
    given = LimitOverrides(
        position={"second": (-9, 9)}, velocity={"second": 8}, acceleration={"tip_joint": 7}
    )
    limited = load(tmp_path, RULES, limits, joints=names, limits=given).limits
    np.testing.assert_allclose(limited.velocity, [3, 3, 3])
    np.testing.assert_allclose(limited.lower_position, [-0.2, -2, -2])
    np.testing.assert_allclose(limited.acceleration, [np.inf, 7, np.inf])


REFUSED = {
    "no range": (
        {"limits": {"second": '<limit lower="7" upper="8" effort="1" velocity="4"/>'}},
        r"joint 'second', which follows 'first', has position limits \[7, 8\]; they leave",
    ),
    "an effort of a follower": (
        {"options": {"limits": LimitOverrides(effort={"second": 5})}},
        "robot.limits.effort: unknown joint 'second'; there is: lift, first, wrist",
    ),
    "a follower that is locked": (
        {"options": {"locked_joints": {"second": 0.3}}},
        "robot.locked_joints: 'second' follows 'first', which is planned; remove it",
    ),
}


@pytest.mark.parametrize(("changes", "message"), REFUSED.values(), ids=REFUSED)
def test_what_contradicts_a_follower_is_named(tmp_path, changes, message):
    options = changes.get("options", {})
    with pytest.raises(RobotError, match=message):
        load(tmp_path, RULES, changes.get("limits"), **options)


def test_a_follower_of_multiplier_zero_stands_still(tmp_path):
    robot = load(tmp_path, {"second": ("first", 0.0, 0.3)})
    assert "second" not in robot.joint_names
    assert robot.body_count == robot.joint_count + 1
    plain = load(tmp_path, {})
    full = np.insert(np.zeros((1, robot.joint_count)), 2, 0.3, axis=1)
    np.testing.assert_allclose(
        robot.tool_position(np.zeros((1, robot.joint_count))), plain.tool_position(full), atol=1e-12
    )


def test_a_mimic_joint_on_the_tools_chain_is_planned_by_its_master(tmp_path):
    robot = load(tmp_path, {"wrist": ("side_joint", 1.0, 0.0)})
    assert robot.joint_names == ("lift", "first", "second", "slide", "side_joint", "tip_joint")


@pytest.mark.parametrize(
    ("tool", "last"),
    [
        ("arm_left_tool_link", "arm_left_7_joint"),
        ("gripper_left_outer_finger_left_link", "gripper_left_finger_joint"),
        ("gripper_left_fingertip_left_link", "gripper_left_finger_joint"),
    ],
)
def test_tiago_pro_loads_with_its_gripper(tool, last):
    robot = load_robot("example:tiago_pro", tool)
    assert robot.joint_names[-1] == last
    q = np.clip(np.full((1, robot.joint_count), 0.3), robot.limits.lower_position, None)
    assert np.isfinite(robot.inverse_dynamics(q, q, q)).all()
