"""Distances of the shapes of bodies: against Coal, a second library, and their derivatives."""

import coal
import numpy as np
import pytest
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same

from tubeplanner import AttachedSolid, Obstacle, placement_of
from tubeplanner.geometry.collision_checker import CollisionChecker

BALL = Obstacle.sphere("ball", 0.1, placement_of((0.6, 0.1, 0.9)))
TURNED = placement_of((0.03, 0.02, 0.1), rpy=(0.4, 0.7, 0.2))
CARRIED = [
    AttachedSolid("rod", Obstacle.capsule("rod", 0.01, 0.1, TURNED).shapes),
    AttachedSolid("bead", Obstacle.sphere("bead", 0.01, TURNED).shapes),
]
ARMS = pytest.mark.parametrize("robot", ["ur5", "slide"], indirect=True)


@pytest.fixture(scope="module")
def robot(request):
    return request.getfixturevalue(request.param)


def random_configurations(robot, count, seed):
    low = np.maximum(robot.limits.lower_position, -np.pi)
    high = np.minimum(robot.limits.upper_position, np.pi)
    return np.random.default_rng(seed).uniform(low, high, (count, robot.joint_count))


def all_distances(distance, robot, q):
    """Return `distance` of the poses of every configuration: shape (N, P)."""
    return np.array([distance(*poses) for poses in zip(*robot.body_poses(q), strict=True)])


# By hand. The first link's box: x in [-0.03, 0.33], y in [-0.025, 0.025], z in [-0.045, -0.005].


@pytest.mark.parametrize(
    ("obstacle", "distance"),
    [
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
    close(checker.distances(rotation[0], position[0], pair[None]), [distance], atol=1e-8)


def random_obstacles(rng):
    """Return one obstacle of each kind, and by name Coal's own solid and its placement.

    They stand half a metre from the base: both arms run into them.
    """
    size = rng.uniform(0.1, 0.5, 3)
    radius, length = rng.uniform([0.05, 0.2], [0.15, 0.8])
    kinds = {
        "box": ((size,), coal.Box(*size)),
        "sphere": ((radius,), coal.Sphere(radius)),
        "capsule": ((radius, length), coal.Capsule(radius, length)),
        "cylinder": ((radius, length), coal.Cylinder(radius, length)),
    }
    obstacles, solids = [], {}
    for kind, (sizes, solid) in kinds.items():
        direction = rng.normal(size=3)
        position = 0.5 * direction / np.linalg.norm(direction)
        placement = placement_of(position, quaternion=rng.normal(size=4))
        obstacles.append(getattr(Obstacle, kind)(kind, *sizes, placement))
        solids[kind] = solid, placement
    return obstacles, solids


def coal_hull(vertices):
    model = coal.BVHModelOBBRSS()
    model.beginModel(0, len(vertices))
    model.addVertices(np.asfortranarray(vertices))
    model.endModel()
    model.buildConvexHull(True, "Qt")
    return model.convex, np.eye(4)


def coal_distances(checker, solids, q, pairs):
    """Return signed distances of pairs at configurations, without any of our bounds."""
    request = coal.DistanceRequest()
    request.enable_signed_distance = True
    request.gjk_tolerance = request.epa_tolerance = 1e-9
    shapes = [
        (each.body, *(solids.get(each.owner) or coal_hull(each.shape.vertices)))
        for each in checker.shapes
    ]

    def distances(rotation, position):
        placed = []
        for body, solid, placement in shapes:
            turn, shift = rotation[body], position[body]
            pose = turn @ placement[:3, :3], turn @ placement[:3, 3] + shift
            placed.append((solid, coal.Transform3s(*pose)))
        return [
            coal.distance(*placed[i], *placed[j], request, coal.DistanceResult()) for i, j in pairs
        ]

    return all_distances(distances, checker.robot, q)


def our_distances(checker, q, pairs):
    return all_distances(lambda *poses: checker.distances(*poses, pairs), checker.robot, q)


# Configurations, and seeds of obstacles that the arm can run into.
CONFIGURATIONS = {"ur5": (150, 31), "slide": (600, 61)}


@pytest.fixture(scope="module", params=CONFIGURATIONS)
def compared(request):
    """Ours, the bounding spheres' and Coal's distances of links to obstacles of every kind.

    For Coal the cylinder is our prism here: its depth of overlap with round cylinders is unsound.
    """
    robot, (count, seed) = request.getfixturevalue(request.param), CONFIGURATIONS[request.param]
    obstacles, solids = random_obstacles(np.random.default_rng(seed))
    checker = CollisionChecker(robot, obstacles, self_collision=False)
    pairs = checker.obstacle_pairs
    kinds = np.array([checker.shapes[j].owner for _, j in pairs])
    del solids["cylinder"]
    q = random_configurations(robot, count, seed=32)
    spheres = checker.sphere_distances(*robot.body_poses(q), pairs)
    exact = coal_distances(checker, solids, q, pairs)
    return kinds, our_distances(checker, q, pairs), exact, spheres


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


@ARMS
def test_a_cylinder_is_never_farther_than_it_is_and_hardly_nearer(robot):
    obstacles, solids = random_obstacles(np.random.default_rng(33))
    checker = CollisionChecker(robot, obstacles[3:], self_collision=False)
    pairs, q = checker.obstacle_pairs, random_configurations(robot, 100, seed=34)
    ours, exact = our_distances(checker, q, pairs), coal_distances(checker, solids, q, pairs)
    apart = exact > 0
    assert apart.mean() > 0.5
    assert (ours[apart] <= exact[apart] + 1e-9).all()
    one_percent_of_the_radius = 0.0087 * solids["cylinder"][0].radius
    assert np.mean(exact[apart] - ours[apart] > one_percent_of_the_radius + 1e-6) < 1e-2


@ARMS
def test_link_to_link_distances_agree_with_coal(robot):
    checker = CollisionChecker(robot)
    pairs, q = checker.link_pairs, random_configurations(robot, 25, seed=13)
    ours, exact = our_distances(checker, q, pairs), coal_distances(checker, {}, q, pairs)
    assert (exact < 0).any()
    assert (ours <= exact + 1e-9).all()
    assert np.mean(exact - ours > 1e-6) < 0.01


@ARMS
def test_joint_moves_change_distances_by_no_more_than_the_motion_weights(robot):
    rng = np.random.default_rng(14)
    obstacles, solids = random_obstacles(rng)
    checker = CollisionChecker(robot, obstacles)
    weights = checker.motion_weights(checker.pairs)
    before = random_configurations(robot, 20, seed=15)
    move = rng.normal(size=before.shape) * rng.choice([0.01, 0.3], size=(20, 1))
    move[::2] *= np.eye(robot.joint_count)[rng.integers(robot.joint_count, size=10)]
    after = robot.limits.clip(before + move)
    first, second = (coal_distances(checker, solids, q, checker.pairs) for q in (before, after))
    change, bound = abs(second - first), abs(after - before) @ weights.T
    apart = (first > 0) & (second > 0)
    assert apart.mean() > 0.5
    assert (change <= bound + 1e-6)[apart].all()
    assert (weights == 0).any()
    assert (change[::2][bound[::2] == 0] < 1e-6).all()


@ARMS
def test_a_separating_direction_separates_neighbouring_configurations_too(robot):
    """Along the direction found at one configuration: exact there, a lower bound elsewhere."""
    brick = Obstacle.box("brick", [0.2, 0.1, 0.3], placement_of([0.6, 0.1, 0.3]))
    checker = CollisionChecker(robot, [brick, BALL], attached=CARRIED)
    pairs, rng = checker.pairs, np.random.default_rng(3)
    for _ in range(4):
        q = rng.uniform(-2, 2, (2, robot.joint_count))
        q[1] = q[0] + rng.uniform(-0.05, 0.05, robot.joint_count)
        rotation, position = robot.body_poses(q)
        there, direction = checker.separations(rotation[0], position[0], pairs)
        copies = [np.repeat(poses[:, None], len(pairs), axis=1) for poses in (rotation, position)]
        at_same, near = (
            checker.separations_along(copies[0][i], copies[1][i], pairs, direction) for i in (0, 1)
        )
        close(at_same, there, atol=1e-12)
        here = checker.distances(rotation[1], position[1], pairs)
        apart = here > 0
        assert (near[apart] <= here[apart] + 1e-5).all()
        assert np.median((here - near)[apart]) < 0.005


@ARMS
def test_the_distance_gradient_is_that_of_central_differences(robot):
    checker = CollisionChecker(robot, [BALL], attached=CARRIED)
    pairs = np.vstack([checker.obstacle_pairs[-4:], checker.link_pairs[:2]])
    q = np.array([0.3, -1.2, 1.5, 0.2, 0.7, 0.1] if robot.joint_count == 6 else [0.5, 0.3, 0.4])
    poses = [np.repeat(pose, len(pairs), axis=0) for pose in robot.body_poses(q[None])]
    closest = checker.closest_points(*poses, pairs)
    assert (closest.distance > 0.01).all()
    exact = checker.distance_gradient(*poses, pairs, closest)
    moves = 1e-5 * np.eye(len(q))
    ahead, behind = (our_distances(checker, q + sign * moves, pairs) for sign in (1, -1))
    close(exact.T, (ahead - behind) / 2e-5, atol=1e-3)
    assert abs(exact).max() > 0.1


MATTERS = 0.08  # [m]


@pytest.mark.parametrize("is_native", [True, False])
def test_distances_are_exact_where_they_matter_and_lower_bounds_elsewhere(bundled, is_native):
    problem = bundled("ur5/over_the_wall")
    checker = CollisionChecker(problem.robot, problem.obstacles)
    if not is_native:
        vars(checker)["_native"] = None
    fraction = np.linspace(0, 1, 25)[:, None]  # across the wall, through it
    start, end = [-1.2, -0.9, 1.5, -2.1, -1.5, 0], [1.2, -0.5, 1.4, -2.4, -1.5, 0]
    q = (1 - fraction) * start + fraction * end
    exact = our_distances(checker, q, checker.pairs)
    matters = np.full(exact.shape, MATTERS)
    result = checker.near_distances(q, checker.pairs, matters, np.full(exact.shape, -np.inf))
    near = exact < MATTERS - 1e-6
    assert (exact < 0).any()
    assert near.sum() > 20
    close(result[near], exact[near], rtol=0, atol=2e-5)
    assert (result <= exact + 2e-5).all()
    assert (result[~near] >= MATTERS - 2e-5).all()
    bounds = matters + 100.0  # what is known to be far enough stays as it is
    same(checker.near_distances(q, checker.pairs, matters, bounds), bounds)


def test_a_pose_that_is_not_finite_never_reaches_fcl(two_link):
    checker = CollisionChecker(two_link, [BALL])
    for wrong in ([np.nan] * 3, [0, np.inf, 0]):
        rotation, position = (array[0] for array in two_link.body_poses(np.zeros((1, 2))))
        position[2] = wrong
        with pytest.raises(ValueError, match="poses must be finite"):
            checker.distances(rotation, position, checker.pairs)
