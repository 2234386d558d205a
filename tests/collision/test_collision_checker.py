"""CollisionChecker: pairs of links and obstacles, distances, cover errors of links."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import coal
import numpy as np
import pytest
from cases import SHORTEST
from scipy.spatial.transform import Rotation

from tubeplanner import (
    AttachedSolid,
    LimitOverrides,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    Tube,
    load_robot,
    parse_problem,
    placement_of,
    plan,
)
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.collision_scene import CollisionScene
from tubeplanner.collision.link_covers import link_covers
from tubeplanner.collision.link_geometry import link_parts
from tubeplanner.errors import ProblemError

# Distances against coal, a second collision library; and which pairs are checked at all.


CASES = Path(__file__).parents[1] / "data/cases"
CONFIGURATIONS = {"ur5": 150, "slide": 600}
SEEDS = {"ur5": 31, "slide": 61}  # of obstacles that the arm can run into


def random_placement(rng):
    """Return a placement half a metre from the base: both arms run into what stands there."""
    direction = rng.normal(size=3)
    position = 0.5 * direction / np.linalg.norm(direction)
    return placement_of(position, quaternion=rng.normal(size=4))


def random_obstacles(rng):
    """Return one obstacle of each kind, and by name coal's own solid and its placement."""
    size = rng.uniform(0.1, 0.5, 3)
    radius, length = rng.uniform([0.05, 0.2], [0.15, 0.8])
    placements = [random_placement(rng) for _ in range(4)]
    made = {
        "box": (Obstacle.box("box", size, placements[0]), coal.Box(*size)),
        "sphere": (Obstacle.sphere("sphere", radius, placements[1]), coal.Sphere(radius)),
        "capsule": (
            Obstacle.capsule("capsule", radius, length, placements[2]),
            coal.Capsule(radius, length),
        ),
        "cylinder": (
            Obstacle.cylinder("cylinder", radius, length, placements[3]),
            coal.Cylinder(radius, length),
        ),
    }
    obstacles = [obstacle for obstacle, _ in made.values()]
    solids = {
        name: (solid, placement)
        for (name, (_, solid)), placement in zip(made.items(), placements, strict=True)
    }
    return obstacles, solids


def coal_hull(vertices):
    model = coal.BVHModelOBBRSS()
    model.beginModel(0, len(vertices))
    model.addVertices(np.asfortranarray(vertices))
    model.endModel()
    model.buildConvexHull(True, "Qt")
    return model.convex


def coal_solids(checker, solids):
    """Return coal's solid of every shape and its placement in the body's frame."""
    return [
        solids[shape.owner]
        if shape.owner in solids
        else (coal_hull(shape.shape.vertices), np.eye(4))
        for shape in checker.shapes
    ]


def coal_distances(checker, solids, rotation, position, pairs):
    """Return signed distances of pairs at one configuration, without any of our bounds."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance = request.epa_tolerance = 1e-9

    def placed(index):
        solid, placement = solids[index]
        turn, shift = rotation[checker.shapes[index].body], position[checker.shapes[index].body]
        return solid, coal.Transform3s(turn @ placement[:3, :3], turn @ placement[:3, 3] + shift)

    return np.array(
        [coal.distance(*placed(i), *placed(j), request, coal.DistanceResult()) for i, j in pairs]
    )


def random_configurations(robot, count, seed):
    low = np.maximum(robot.limits.lower_position, -np.pi)
    high = np.minimum(robot.limits.upper_position, np.pi)
    return np.random.default_rng(seed).uniform(low, high, (count, robot.joint_count))


def all_distances(distance, robot, q):
    """Return what `distance` makes of the poses of every configuration: shape (N, P)."""
    return np.array([distance(*poses) for poses in zip(*robot.body_poses(q), strict=True)])


@pytest.mark.parametrize(
    ("obstacle", "distance"),
    [
        # The first link's box: x in [-0.03, 0.33], y in [-0.025, 0.025], z in [-0.045, -0.005].
        (Obstacle.sphere("o", 0.05, placement_of((0.0, -0.2, -0.025))), 0.2 - 0.025 - 0.05),
        (Obstacle.box("o", [1, 1, 0.2], placement_of((0, 0, 0.5))), 0.5 - 0.1 + 0.005),
        (Obstacle.capsule("o", 0.1, 1.0, placement_of((0.1, 0.5, 0))), 0.5 - 0.1 - 0.025),
        (Obstacle.sphere("o", 0.05, placement_of((0.15, 0, 0))), -0.05 + 0.005),
    ],
    ids=["sphere beside", "box above", "capsule beside", "sphere inside"],
)
def test_distances_to_the_two_link_arm_are_those_of_a_drawing(two_link, obstacle, distance):
    checker = CollisionChecker(two_link, [obstacle], self_collision=False)
    rotation, position = two_link.body_poses(np.array([[0.0, 1.0]]))
    (pair,) = [p for p in checker.obstacle_pairs if checker.shapes[p[0]].owner == "link1"]
    found = checker.distances(rotation[0], position[0], pair[None])
    np.testing.assert_allclose(found, [distance], atol=1e-8)


# --- which pairs are checked -------------------------------------------------------------------

INERTIAL = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
BALL = '<collision><geometry><sphere radius="RADIUS"/></geometry></collision>'
LIMIT = '<limit lower="-3" upper="3" effort="10" velocity="3"/>'


@pytest.fixture
def snake(tmp_path):
    """Load a chain of balls one metre apart: base, flange (fixed), a, b, c, tool (fixed to c)."""

    def load(radius=0.1, **options):
        names = ("base", "flange", "a", "b", "c", "tool")
        kinds = ("fixed", "revolute", "revolute", "revolute", "fixed")
        links = [
            f'<link name="{name}">{INERTIAL}{BALL.replace("RADIUS", str(radius))}</link>'
            for name in names
        ]
        joints = [
            f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>{LIMIT}</joint>'
            for (parent, child), kind in zip(pairwise(names), kinds, strict=True)
        ]
        path = tmp_path / "snake.urdf"
        path.write_text(f'<robot name="snake">{"".join(links + joints)}</robot>')
        return load_robot(path, "tool", **options)

    return load


BLOCK = Obstacle.box("block", [1, 1, 1], placement_of((0, 5, 0)))
TURNED = placement_of((0.03, 0.02, 0.1), rpy=(0.4, 0.7, 0.2))
CARRIED = [
    AttachedSolid("rod", Obstacle.capsule("rod", 0.01, 0.1, TURNED).shapes),
    AttachedSolid("bead", Obstacle.sphere("bead", 0.01, TURNED).shapes),
]
SPHERE = Obstacle.sphere("marble", 0.1, placement_of((0, -5, 0)))


def owners(checker, pairs):
    return {tuple(checker.shapes[index].owner for index in pair) for pair in pairs}


def test_links_are_checked_unless_they_are_neighbours_or_move_as_one(snake):
    checker = CollisionChecker(snake())
    assert owners(checker, checker.link_pairs) == {
        ("base", "b"), ("base", "c"), ("base", "tool"),
        ("flange", "b"), ("flange", "c"), ("flange", "tool"),
        ("a", "c"), ("a", "tool"),
    }  # fmt: skip


def test_obstacles_are_checked_against_every_link_that_a_joint_moves(snake):
    checker = CollisionChecker(snake(), [BLOCK, SPHERE])
    moving = ("a", "b", "c", "tool")
    expected = {(link, obstacle) for link in moving for obstacle in ("block", "marble")}
    assert owners(checker, checker.obstacle_pairs) == expected


def test_links_behind_a_locked_joint_belong_to_the_cell(snake):
    robot = snake(joints=["to_b", "to_c"])
    checker = CollisionChecker(robot, [BLOCK])
    assert owners(checker, checker.obstacle_pairs) == {(x, "block") for x in ("b", "c", "tool")}
    pairs = owners(checker, checker.link_pairs)
    assert pairs == {(x, y) for x in ("base", "flange", "a") for y in ("c", "tool")}


def test_motion_weights_are_the_farthest_a_joint_can_move_a_point(snake):
    """Balls of 0.1 m, a metre from joint to joint; what moves both of a pair does not count."""
    checker = CollisionChecker(snake(), [BLOCK])
    expected = {
        ("a", "block"): [0.1, 0, 0],
        ("b", "block"): [1.1, 0.1, 0],
        ("c", "block"): [2.1, 1.1, 0.1],
        ("tool", "block"): [3.1, 2.1, 1.1],
        ("base", "b"): [1.1, 0.1, 0],
        ("a", "c"): [0, 1.1, 0.1],
        ("a", "tool"): [0, 2.1, 1.1],
    }
    for pair, weights in zip(checker.pairs, checker.motion_weights(checker.pairs), strict=True):
        names = tuple(checker.shapes[index].owner for index in pair)
        if names in expected:
            np.testing.assert_allclose(weights, expected.pop(names), atol=1e-12)
    assert not expected


def test_all_pairs_are_those_with_obstacles_and_then_links(snake):
    checker = CollisionChecker(snake(), [BLOCK, SPHERE])
    count = len(checker.obstacle_pairs)
    np.testing.assert_array_equal(checker.pairs[:count], checker.obstacle_pairs)
    np.testing.assert_array_equal(checker.pairs[count:], checker.link_pairs)


def test_pairs_are_found_by_the_names_of_their_solids(snake):
    checker = CollisionChecker(snake(), [BLOCK, SPHERE])
    for names in {tuple(names) for names in owners(checker, checker.pairs)}:
        found = checker.between(*names)
        np.testing.assert_array_equal(found, checker.between(*names[::-1]))
        assert {frozenset(pair) for pair in owners(checker, checker.pairs[found])} == {
            frozenset(names)
        }
        others = owners(checker, checker.pairs[~found])
        assert frozenset(names) not in {frozenset(pair) for pair in others}
    assert not checker.between("a", "nothing").any()


def test_self_collision_can_be_left_out(snake):
    checker = CollisionChecker(snake(), [BLOCK], self_collision=False)
    assert checker.link_pairs.shape == (0, 2)
    assert len(checker.obstacle_pairs) == 4


@pytest.mark.parametrize("pair", [("b", "base"), ("base", "b"), ("marble", "tool")])
def test_ignored_pairs_are_left_out_in_either_order(snake, pair):
    robot = snake()
    plain = CollisionChecker(robot, [BLOCK, SPHERE])
    checker = CollisionChecker(robot, [BLOCK, SPHERE], ignore=[pair])
    before = owners(plain, plain.link_pairs) | owners(plain, plain.obstacle_pairs)
    after = owners(checker, checker.link_pairs) | owners(checker, checker.obstacle_pairs)
    assert {frozenset(left_out) for left_out in before - after} == {frozenset(pair)}


def test_link_pairs_that_always_touch_are_left_out(snake):
    # The centres of flange and b are 2 m apart when the arm is straight, those of flange and c 3 m.
    sometimes = CollisionChecker(snake(radius=0.9))
    assert ("flange", "b") in owners(sometimes, sometimes.link_pairs)
    always = CollisionChecker(snake(radius=1.05))
    assert ("flange", "b") not in owners(always, always.link_pairs)
    assert ("flange", "c") in owners(always, always.link_pairs)


def test_joints_whose_limits_exclude_zero_are_sampled_within_them(snake):
    limits = LimitOverrides(position={"to_a": (4, 5), "to_b": (0.5, 1), "to_c": (3.5, 9)})
    checker = CollisionChecker(snake(limits=limits))
    assert len(checker.link_pairs) == 8


def test_the_owners_of_a_pair_are_told_apart(snake):
    checker = CollisionChecker(snake(), [BLOCK])
    assert checker.owners(checker.link_pairs[0])[1] is None
    assert checker.owners(checker.obstacle_pairs[0]) == (("a",), "block")


def test_whether_a_robot_has_geometry_is_known(snake, two_link):
    assert CollisionChecker(snake()).has_link_geometry
    bare = load_robot("example:asr_twodof", "Tip")
    assert not CollisionChecker(bare, [BLOCK]).has_link_geometry


@pytest.mark.parametrize(
    ("obstacles", "ignore", "message"),
    [
        ([BLOCK, SPHERE, BLOCK], [], "obstacles: the name 'block' is given 2 times"),
        (
            [Obstacle.sphere("tool", 0.1, np.eye(4))],
            [],
            "obstacles: 'tool' is also the name of a link; choose another",
        ),
        (
            [BLOCK],
            [("tool", "blok")],
            "collision.ignore: unknown link or obstacle 'blok' (did you mean 'block'?); there is: "
            "base, flange, a, b, c, tool, block",
        ),
        ([], [("too", "a")], "unknown link or obstacle 'too' (did you mean 'tool'?)"),
    ],
)
def test_names_that_clash_or_do_not_exist_are_refused(snake, obstacles, ignore, message):
    with pytest.raises(ProblemError) as caught:
        CollisionChecker(snake(), obstacles, ignore=ignore)
    assert message in str(caught.value)


# --- obstacles ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "sizes", "size"),
    [
        ("box", ([1, -2, 1],), "-2"),
        ("box", ([1, 1, np.nan],), "nan"),
        ("sphere", (0.0,), "0"),
        ("sphere", (np.inf,), "inf"),
        ("cylinder", (0.1, 0.0), "0"),
        ("capsule", (-0.1, 1.0), "-0.1"),
    ],
)
def test_an_obstacle_without_a_size_is_refused(kind, sizes, size):
    with pytest.raises(ProblemError) as caught:
        getattr(Obstacle, kind)("part", *sizes, np.eye(4))
    assert str(caught.value) == (
        f"obstacle 'part': {kind} has size {size} m; 1e-06 to 10000 m are accepted"
    )


def test_a_placement_turns_by_urdf_angles_about_fixed_axes():
    roll, pitch, yaw = 0.3, -0.4, 0.5
    placement = placement_of((1, 2, 3), rpy=(roll, pitch, yaw))
    turns = [Rotation.from_rotvec(v).as_matrix() for v in np.diag([roll, pitch, yaw])]
    np.testing.assert_allclose(placement[:3, :3], turns[2] @ turns[1] @ turns[0], atol=1e-15)
    np.testing.assert_array_equal(placement[:, 3], [1, 2, 3, 1])


def test_a_quaternion_ends_with_its_real_part_and_may_have_any_length():
    placement = placement_of(quaternion=(0, 0, 3, 3))
    np.testing.assert_allclose(placement[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


def test_a_placement_without_rotation_is_upright():
    np.testing.assert_array_equal(placement_of(), np.eye(4))


@pytest.mark.parametrize("position", [(np.nan, 0, 0), (0, -np.inf, 0), (0, 0, 2e4)])
def test_a_placement_out_of_this_world_is_refused(position):
    with pytest.raises(ProblemError, match="must be three finite numbers within 10000 m"):
        placement_of(position)


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        ({"rpy": (0, 0, 0), "quaternion": (0, 0, 0, 1)}, "takes rpy or quaternion, not both"),
        ({"quaternion": (0, 0, 0, 0)}, "quaternion [0, 0, 0, 0] has no direction"),
    ],
)
def test_a_senseless_rotation_is_refused(rotation, message):
    with pytest.raises(ProblemError) as caught:
        placement_of((0, 0, 0), **rotation)
    assert message in str(caught.value)


def test_a_pose_that_is_not_finite_never_reaches_fcl(snake):
    """FCL would end the process without a word."""
    robot = snake()
    checker = CollisionChecker(robot)
    for wrong in ([np.nan] * 3, [0, np.inf, 0]):
        rotation, position = (array[0] for array in robot.body_poses(np.zeros((1, 3))))
        position[2] = wrong
        with pytest.raises(ValueError, match="poses must be finite"):
            checker.distances(rotation, position, checker.link_pairs)


def test_pairs_are_not_lost_where_limits_lie_a_turn_away(snake):
    """The same arc of the same joint, described one turn apart; bent little, a and c touch."""
    pairs = []
    for turn in (0.0, -2 * np.pi):
        limits = LimitOverrides(position={"to_b": (2.0 + turn, 4.0 + turn)})
        checker = CollisionChecker(snake(radius=0.5, limits=limits))
        pairs.append(owners(checker, checker.link_pairs))
    assert pairs[0] == pairs[1]
    assert ("a", "c") in pairs[0]


@pytest.mark.parametrize("name", ["ur5", "slide"])
def test_a_separating_direction_separates_neighbouring_configurations_too(request, name):
    """Along the direction found at one configuration: exact there, a lower bound elsewhere."""
    robot = request.getfixturevalue(name)
    boxes = [
        Obstacle.box(f"box{i}", [0.2, 0.1, 0.3], placement_of(center))
        for i, center in enumerate(([0.6, 0.1, 0.3], [-0.4, 0.5, 0.4], [0.1, -0.6, 0.8]))
    ]
    boxes.append(Obstacle.sphere("ball", 0.1, placement_of([0.5, 0.5, 0.5])))
    checker = CollisionChecker(robot, boxes, attached=CARRIED)
    pairs = np.concatenate([checker.obstacle_pairs, checker.link_pairs])
    rng = np.random.default_rng(3)
    for _ in range(4):
        q = rng.uniform(-2, 2, (2, robot.joint_count))
        q[1] = q[0] + rng.uniform(-0.05, 0.05, robot.joint_count)
        rotation, position = robot.body_poses(q)
        there, direction = checker.separations(rotation[0], position[0], pairs)
        copies = [np.repeat(poses[:, None], len(pairs), axis=1) for poses in (rotation, position)]
        same, near = (
            checker.separations_along(copies[0][i], copies[1][i], pairs, direction) for i in (0, 1)
        )
        np.testing.assert_allclose(same, there, atol=1e-12)
        here = checker.distances(rotation[1], position[1], pairs)
        apart = here > 0
        assert (near[apart] <= here[apart] + 1e-5).all()
        assert np.median((here - near)[apart]) < 0.005


@pytest.mark.parametrize("name", ["ur5", "slide"])
def test_the_distance_gradient_is_that_of_central_differences(request, name):
    robot = request.getfixturevalue(name)
    ball = Obstacle.sphere("ball", 0.1, placement_of((0.6, 0.1, 0.9)))
    checker = CollisionChecker(robot, [ball], attached=CARRIED)
    pairs = np.vstack([checker.obstacle_pairs[-4:], checker.link_pairs[:2]])
    q = np.array([0.3, -1.2, 1.5, 0.2, 0.7, 0.1])
    q = q if name == "ur5" else np.array([0.5, 0.3, 0.4])

    def distances(q):
        rotation, position = robot.body_poses(q[None])
        return checker.distances(rotation[0], position[0], pairs)

    poses = [np.repeat(pose, len(pairs), axis=0) for pose in robot.body_poses(q[None])]
    closest = checker.closest_points(*poses, pairs)
    assert (closest.distance > 0.01).all()
    exact = checker.distance_gradient(*poses, pairs, closest)
    step = 1e-5
    difference = [distances(q + move) - distances(q - move) for move in step * np.eye(len(q))]
    np.testing.assert_allclose(exact.T, np.array(difference) / (2 * step), atol=1e-3)
    assert abs(exact).max() > 0.1


# --- against coal, in many configurations -------------------------------------------------------


@pytest.mark.parametrize("name", ["ur5", "slide"])
def test_joint_moves_change_distances_by_no_more_than_the_motion_weights(request, name):
    robot = request.getfixturevalue(name)
    rng = np.random.default_rng(14)
    obstacles, solids = random_obstacles(rng)
    checker = CollisionChecker(robot, obstacles)
    placed = coal_solids(checker, solids)
    pairs = np.vstack([checker.obstacle_pairs, checker.link_pairs])
    weights = checker.motion_weights(pairs)
    before = random_configurations(robot, 20, seed=15)
    move = rng.normal(size=before.shape) * rng.choice([0.01, 0.3], size=(20, 1))
    move[::2] *= np.eye(robot.joint_count)[rng.integers(robot.joint_count, size=10)]
    after = robot.limits.clip(before + move)
    distances = [
        all_distances(lambda r, p: coal_distances(checker, placed, r, p, pairs), robot, q)
        for q in (before, after)
    ]
    change = abs(distances[1] - distances[0])
    bound = abs(after - before) @ weights.T
    apart = (distances[0] > 0) & (distances[1] > 0)
    assert apart.mean() > 0.5
    assert (change <= bound + 1e-6)[apart].all()
    still = weights == 0
    assert still.any()
    assert (change[::2][bound[::2] == 0] < 1e-6).all()


@pytest.fixture(scope="module", params=["ur5", "slide"])
def compared(request):
    """Ours, the bounding spheres' and coal's distances of links to obstacles of every kind.

    For coal the cylinder is our prism here: its depth of overlap with round cylinders is unsound.
    """
    robot = request.getfixturevalue(request.param)
    obstacles, solids = random_obstacles(np.random.default_rng(SEEDS[request.param]))
    checker = CollisionChecker(robot, obstacles, self_collision=False)
    pairs = checker.obstacle_pairs
    kinds = np.array([checker.shapes[j].owner for _, j in pairs])
    del solids["cylinder"]
    placed = coal_solids(checker, solids)
    q = random_configurations(robot, CONFIGURATIONS[request.param], seed=32)
    ours = all_distances(lambda r, p: checker.distances(r, p, pairs), robot, q)
    exact = all_distances(lambda r, p: coal_distances(checker, placed, r, p, pairs), robot, q)
    return kinds, ours, exact, checker.sphere_distances(*robot.body_poses(q), pairs)


@pytest.mark.parametrize("kind", ["box", "sphere", "capsule", "cylinder"])
def test_distances_are_never_above_those_of_coal_and_nearly_always_equal(compared, kind):
    kinds, ours, exact, _ = compared
    ours, exact = ours[:, kinds == kind], exact[:, kinds == kind]
    assert (exact < 0).any()
    assert (exact > 0).any()
    assert (ours - exact).max() < 1e-9
    assert np.mean(exact - ours > 1e-6) < 0.01
    assert (exact - ours).max() < 2e-3


def test_sphere_distances_are_never_above_the_distances(compared):
    _, ours, exact, spheres = compared
    assert (spheres <= exact + 1e-9).all()
    assert (spheres <= ours + 1e-9).all()
    assert spheres.max() > 0.3


@pytest.mark.parametrize("name", ["ur5", "slide"])
def test_a_cylinder_is_never_farther_than_it_is_and_hardly_nearer(request, name):
    robot = request.getfixturevalue(name)
    obstacles, solids = random_obstacles(np.random.default_rng(33))
    (cylinder,) = (obstacle for obstacle in obstacles if obstacle.name == "cylinder")
    checker = CollisionChecker(robot, [cylinder], self_collision=False)
    placed, pairs = coal_solids(checker, solids), checker.obstacle_pairs
    q = random_configurations(robot, 100, seed=34)
    ours = all_distances(lambda r, p: checker.distances(r, p, pairs), robot, q)
    exact = all_distances(lambda r, p: coal_distances(checker, placed, r, p, pairs), robot, q)
    apart = exact > 0
    assert apart.mean() > 0.5
    assert (ours[apart] <= exact[apart] + 1e-9).all()
    one_percent_of_the_radius = 0.0087 * solids["cylinder"][0].radius
    assert np.mean(exact[apart] - ours[apart] > one_percent_of_the_radius + 1e-6) < 1e-2


@pytest.mark.parametrize("name", ["ur5", "slide"])
def test_link_to_link_distances_agree_with_coal(request, name):
    robot = request.getfixturevalue(name)
    checker = CollisionChecker(robot)
    placed = coal_solids(checker, {})
    q, pairs = random_configurations(robot, 25, seed=13), checker.link_pairs
    ours = all_distances(lambda r, p: checker.distances(r, p, pairs), robot, q)
    exact = all_distances(lambda r, p: coal_distances(checker, placed, r, p, pairs), robot, q)
    assert (exact < 0).any()
    assert (ours <= exact + 1e-9).all()
    assert np.mean(exact - ours > 1e-6) < 0.01


# Solids that the tool carries count as links.


# A bar that the tool holds across its way, 0.3 m long.
BAR = Obstacle.box("bar", [0.02, 0.3, 0.02], placement_of([0, 0, 0.02])).shapes
STOPPING = PlanOptions("stop-at-corners")  # what is refused is refused sooner
POST = Obstacle.cylinder("post", 0.02, 0.3, placement_of([0.42, 0.05, 0]))


def problem(two_link, attached=(), points=((0.3, -0.3, 0), (0.3, 0.3, 0)), **more):
    tube = Tube(points, 0.03, joint_signs={"joint2": "-"})
    return PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])), attached=attached, **more)


def test_what_is_carried_must_clear_the_obstacles(two_link):
    carried = AttachedSolid("bar", BAR)
    result = plan(problem(two_link, [carried], obstacles=[POST]), STOPPING)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert result.place.links == ("bar",)
    assert result.place.obstacle == "post"
    allowed = problem(two_link, [carried], obstacles=[POST], ignore_collisions=[("bar", "post")])
    assert plan(allowed, SHORTEST).succeeded


def test_what_is_carried_must_clear_the_links_but_not_its_carrier(two_link):
    """A wide tail behind the elbow; it may touch what it is said to touch."""
    tail = Obstacle.box("tail", [0.1, 0.4, 0.02], placement_of([-0.39, 0, -0.02])).shapes
    points = ((0.45, -0.2, 0), (0.45, 0.2, 0))
    result = plan(problem(two_link, [AttachedSolid("tail", tail)], points), SHORTEST)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert set(result.place.links) == {"link1", "tail"}
    touching = AttachedSolid("tail", tail, touch_links=("link1", "base"))
    assert plan(problem(two_link, [touching], points), SHORTEST).succeeded


def test_it_is_placed_in_the_tool_frame(panda):
    ball = AttachedSolid("ball", Obstacle.sphere("b", 0.01, placement_of([0, 0, 0.3])).shapes)
    q = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    rotation, tool = panda.tool_pose(q[None])
    center = tool[0] + rotation[0] @ [0, 0, 0.3]
    target = Obstacle.sphere("target", 0.02, placement_of(center + np.array([0.1, 0, 0])))
    tube = Tube(tool[0] + np.array([[0, 0, 0], [0.02, 0, 0]]), 0.05)
    checker = PlanningProblem(panda, tube, q, obstacles=[target], attached=[ball]).collision
    poses = [pose[0] for pose in panda.body_poses(q[None])]
    pair = [p for p in checker.obstacle_pairs if checker.owners(p)[0] == ("ball",)]
    np.testing.assert_allclose(checker.distances(*poses, np.array(pair)), [0.07], atol=1e-6)


def test_the_file_says_the_same():
    fields = {
        "robot": {
            "urdf": "example:two_link",
            "tool_frame": "hand",
            "gravity": [0, 0, 0],
            "attached": [
                {"name": "bar", "box": [0.02, 0.3, 0.02], "position": [0, 0, 0.02]},
                {"name": "tail", "sphere": 0.01, "touch_links": ["link1"]},
            ],
        },
        "tube": {"points": [[0.3, -0.3, 0], [0.3, 0.3, 0]], "radius": 0.03},
        "start": {"seed": [0, -1]},
    }
    bar, tail = parse_problem(fields).attached
    assert (bar.name, bar.touch_links, tail.touch_links) == ("bar", (), ("link1",))
    np.testing.assert_allclose(bar.shapes[0].vertices, BAR[0].vertices)


@pytest.mark.parametrize(
    ("solid", "message"),
    [
        (AttachedSolid("link1", BAR), "'link1' is also the name of a link"),
        (AttachedSolid("post", BAR), "the name 'post' is given 2 times"),
        (AttachedSolid("bar", BAR, ("lnk1",)), "unknown link or obstacle 'lnk1'"),
    ],
)
def test_names_must_be_unique_and_known(two_link, solid, message):
    with pytest.raises(ProblemError, match=message):
        _ = problem(two_link, [solid], obstacles=[POST]).collision


def test_what_is_carried_is_never_excused_by_touching_always(two_link):
    """A ball so large that it is inside the first link in every configuration."""
    solid = AttachedSolid("ball", Obstacle.sphere("b", 0.7, placement_of()).shapes)
    checker = CollisionChecker(two_link, attached=[solid])
    pairs = [checker.owners(pair)[0] for pair in checker.link_pairs]
    assert {"link1", "ball"} in [set(pair) for pair in pairs]


def ball():
    return Obstacle.sphere("ball", 0.1, placement_of([0.0, 0.5, 0.5]))


@pytest.fixture(scope="module")
def scene():
    robot = load_robot("example:two_link", "hand")
    return CollisionScene(robot, (ball(),), (), True, ())


def test_an_arm_with_other_limits_meets_the_same_scene(scene):
    robot = scene.robot
    limits = replace(robot.limits, effort=0.9 * robot.limits.effort)
    assert scene.is_as(replace(scene, robot=robot.with_limits(limits, robot.motors)))


@pytest.mark.parametrize(
    "changes",
    [
        {"obstacles": ()},
        {"obstacles": (ball(),)},
        {"self_collision": False},
        {"ignore": (("hand", "ball"),)},
        {"robot": load_robot("example:two_link", "hand")},
    ],
    ids=["none", "another", "links", "pairs", "arm"],
)
def test_with_anything_else_it_is_another(scene, changes):
    assert not scene.is_as(replace(scene, **changes))


# How far covers stand off is stated, and true.


LINK = """<link name="{name}"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry>{geometry}</geometry></collision></link>"""
JOINT = """<joint name="one" type="revolute"><parent link="base"/><child link="tip"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="100" velocity="2"/></joint>"""


@pytest.mark.parametrize(
    ("geometry", "error"),
    [
        ('<box size="0.1 0.2 0.3"/>', 0.0),
        ('<sphere radius="0.1"/>', 0.0),
        ('<cylinder radius="0.1" length="0.3"/>', 0.1 * (1 / np.cos(np.pi / 24) - 1)),
    ],
)
def test_primitives_stand_off_by_what_a_prism_adds(tmp_path, geometry, error):
    links = LINK.format(name="base", geometry='<sphere radius="0.01"/>')
    links += LINK.format(name="tip", geometry=geometry)
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{JOINT}</robot>')
    checker = CollisionChecker(load_robot(tmp_path / "arm.urdf", "tip"))
    base, tip = link_covers(checker)
    assert (base.link, base.shapes, base.closer_shapes, base.closer_error) == ("base", 1, 0, None)
    assert tip.outer_error == pytest.approx(error, abs=1e-4)


def test_meshes_stand_off_by_what_points_on_their_covers_show(tmp_path):
    links = LINK.format(name="base", geometry=f'<mesh filename="{CASES / "mesh_ring.obj"}"/>')
    links += LINK.format(name="tip", geometry=f'<mesh filename="{CASES / "mesh_U.obj"}"/>')
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{JOINT}</robot>')
    robot = load_robot(tmp_path / "arm.urdf", "tip")
    checker = CollisionChecker(robot)
    covers = {each.link: each for each in link_covers(checker)}
    for link, parts in link_parts(robot).items():
        assert covers[link].shapes == sum(len(part.cover()) for part in parts)
        for part in parts:
            vertices = np.vstack([shape.vertices for shape in part.cover()])
            assert part.solid.distance(vertices).max() <= covers[link].outer_error + 2e-3
    assert {link for link, each in covers.items() if each.closer_shapes} == {*checker.closer_covers}
