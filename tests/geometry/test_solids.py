"""Obstacle and AttachedSolid: placement, contents, what a tool carries, hand-over."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cases import SHORTEST, outside, refusal
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same
from scipy.spatial.transform import Rotation

from tubeplanner import (
    AttachedSolid,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    ProblemError,
    Seed,
    Tube,
    placement_of,
    plan,
)
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.solids import left, taken
from tubeplanner.resources import bundled_folder

PART = bundled_folder() / "ur5" / "part.stl"
MESH = Path(__file__).parents[1] / "data/cases" / "mesh_U.obj"


def corners(solid):
    return np.concatenate([shape.vertices for shape in solid.shapes])


@pytest.mark.parametrize(
    ("kind", "sizes", "size"),
    [
        ("box", ([1, -2, 1],), "-2"),
        ("sphere", (np.inf,), "inf"),
        ("cylinder", (0.1, 0.0), "0"),
        ("capsule", (-0.1, 1.0), "-0.1"),
    ],
)
def test_an_obstacle_without_a_size_is_refused(kind, sizes, size):
    assert refusal(ProblemError, getattr(Obstacle, kind), "part", *sizes, np.eye(4)) == (
        f"obstacle 'part': {kind} has size {size} m; 1e-06 to 10000 m are accepted"
    )


@pytest.mark.parametrize("size", ["ab", 1.0, [1, 1, True], [1, 1, np.nan]])
def test_a_size_is_of_numbers(size):
    message = refusal(ProblemError, Obstacle.box, "part", size, placement_of())
    assert message.startswith("obstacle 'part': box ")


@pytest.mark.parametrize("name", [5, "", "a\nFAKE: passes", "x" * 300])
def test_a_solid_needs_a_name_that_can_be_shown(name):
    for make in (lambda: Obstacle.box(name, [1, 1, 1], np.eye(4)), lambda: AttachedSolid(name, ())):
        assert refusal(ProblemError, make).startswith("the name of an obstacle is")


def test_a_placement_turns_by_urdf_angles_about_fixed_axes_or_by_a_quaternion_of_any_length():
    """A quaternion ends with its real part."""
    angles = roll, pitch, yaw = 0.3, -0.4, 0.5
    placement = placement_of((1, 2, 3), rpy=angles)
    turns = [Rotation.from_rotvec(v).as_matrix() for v in np.diag([roll, pitch, yaw])]
    close(placement[:3, :3], turns[2] @ turns[1] @ turns[0], atol=1e-15)
    same(placement[:, 3], [1, 2, 3, 1])
    quarter = placement_of(quaternion=(0, 0, 3, 3))
    close(quarter[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    same(placement_of(), np.eye(4))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": (np.nan, 0, 0)}, "must be three finite numbers within 10000 m"),
        ({"position": (0, 0, 2e4)}, "must be three finite numbers within 10000 m"),
        ({"rpy": (0, 0, 0), "quaternion": (0, 0, 0, 1)}, "takes rpy or quaternion, not both"),
        ({"quaternion": (0, 0, 0, 0)}, "quaternion [0, 0, 0, 0] has no direction"),
    ],
)
def test_a_placement_out_of_this_world_is_refused(arguments, message):
    assert message in refusal(ProblemError, placement_of, **arguments)


@pytest.mark.parametrize(
    ("placement", "message"),
    [
        (np.diag([1.0, 1.0, -1.0, 1.0]), "is no rotation and translation"),
        (np.eye(4) + np.diag([1.0], -3), "is no rotation and translation"),
        (np.eye(3), "must be finite numbers of shape"),
        (np.full((4, 4), np.nan), "must be finite numbers of shape"),
        ("a", "must be finite numbers of shape"),
        (np.eye(4) + np.diag([1e9], 3), "position .* must be within 10000 m"),
    ],
)
def test_a_placement_is_a_rotation_and_a_translation(placement, message):
    with pytest.raises(ProblemError, match=f"obstacle 'part': .*{message}"):
        Obstacle.sphere("part", 0.1, placement)


def test_a_mesh_is_covered_scaled_and_placed():
    placement = placement_of([0.1, 0.2, 0.3], rpy=[0.4, 0.5, 0.6])
    obstacle = Obstacle.mesh("part", PART, placement, scale=2.0)
    mesh = trimesh.load(str(PART), force="mesh")
    mesh.apply_scale(2.0)
    mesh.apply_transform(placement)
    surface, _ = trimesh.sample.sample_surface(mesh, 500, seed=1)
    assert outside(obstacle.shapes, np.array(surface)).max() < 1e-9
    close(corners(obstacle).min(axis=0), mesh.bounds[0], atol=1e-9)
    close(corners(obstacle).max(axis=0), mesh.bounds[1], atol=1e-9)


def test_the_unit_of_a_collada_file_counts(tmp_path):
    """The same box, once in metres and once in millimetres."""
    path = tmp_path / "box.dae"
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box((1.0, 2.0, 3.0)))
    text = text.decode() if isinstance(text, bytes) else text
    assert "<unit" not in text
    for meter in ("1.0", "0.001"):
        path.write_text(text.replace("</asset>", f'<unit name="u" meter="{meter}"/></asset>'))
        size = np.ptp(corners(Obstacle.mesh("b", path, np.eye(4))), axis=0)
        close(size, float(meter) * np.array([1, 2, 3]))


# A bar that the tool holds across its way, 0.3 m long.
BAR = Obstacle.box("bar", [0.02, 0.3, 0.02], placement_of([0, 0, 0.02])).shapes
POST = Obstacle.cylinder("post", 0.02, 0.3, placement_of([0.42, 0.05, 0]))


def test_what_is_carried_must_clear_the_obstacles(two_link):
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 0.03, joint_signs={"joint2": "-"})
    solids = {"obstacles": [POST], "attached": [AttachedSolid("bar", BAR)]}
    problem = PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])), **solids)
    # What is refused is refused sooner by this method.
    result = plan(problem, PlanOptions("stop-at-corners"))
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert (result.location.links, result.location.obstacle) == (("bar",), "post")
    assert plan(replace(problem, ignore_collisions=[("bar", "post")]), SHORTEST).succeeded


@pytest.mark.parametrize(("touch_links", "is_checked"), [((), True), (("link1",), False)])
def test_what_is_carried_must_clear_the_links_but_those_that_it_may_touch(
    two_link, touch_links, is_checked
):
    """Also what touches always: a ball so large that it is inside the first link everywhere."""
    shapes = Obstacle.sphere("b", 0.7, placement_of()).shapes
    checker = CollisionChecker(two_link, attached=[AttachedSolid("ball", shapes, touch_links)])
    pairs = [set(checker.owners(pair)[0]) for pair in checker.link_pairs]
    assert ({"link1", "ball"} in pairs) == is_checked


def test_what_is_carried_is_placed_in_the_tool_frame(panda):
    ball = AttachedSolid("ball", Obstacle.sphere("b", 0.01, placement_of([0, 0, 0.3])).shapes)
    q = np.array([[0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5]])
    rotation, tool = panda.tool_pose(q)
    center = tool[0] + rotation[0] @ [0, 0, 0.3] + [0.1, 0, 0]
    target = Obstacle.sphere("target", 0.02, placement_of(center))
    checker = CollisionChecker(panda, [target], attached=[ball])
    poses = [pose[0] for pose in panda.body_poses(q)]
    pair = [p for p in checker.obstacle_pairs if checker.owners(p)[0] == ("ball",)]
    close(checker.distances(*poses, np.array(pair)), [0.07], atol=1e-6)


QUARTER = placement_of([1.0, 2.0, 3.0], rpy=[0, 0, np.pi / 2])
TILTED = placement_of([0.3, -0.2, 0.5], rpy=[0.3, -0.8, 2.0])
AHEAD = placement_of([1.0, 2.5, 3.0])
KINDS = {
    "box": Obstacle.box("part", [0.2, 0.1, 0.4], AHEAD),
    "sphere": Obstacle.sphere("part", 0.1, AHEAD),
    "cylinder": Obstacle.cylinder("part", 0.1, 0.4, AHEAD),
    "mesh": Obstacle.mesh("part", MESH, AHEAD, 0.01),
}


def test_a_box_ahead_of_a_turned_tool_is_ahead_of_it_in_its_frame():
    """The tool looks along y, so 0.5 m along y is 0.5 m along its x; its sides turn likewise."""
    part = taken(KINDS["box"], QUARTER)
    assert (part.name, part.touch_links) == ("part", ())
    half = abs(corners(part) - [0.5, 0, 0]).max(axis=0)
    close(half, [0.05, 0.1, 0.2], atol=1e-12)


def test_what_is_let_go_elsewhere_stands_where_the_tool_is_then():
    """Taken half a metre ahead of the tool along y, let go half a metre ahead of it along z."""
    up = placement_of([0.0, 0.0, 1.0], rpy=[0, -np.pi / 2, 0])  # its x is up, its z along -x
    base_placements = corners(left(taken(KINDS["box"], QUARTER), up))
    close(
        (base_placements.min(axis=0) + base_placements.max(axis=0)) / 2, [0.0, 0.0, 1.5], atol=1e-12
    )
    close(np.ptp(base_placements, axis=0), [0.4, 0.2, 0.1], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_let_go_where_it_was_taken_stands_as_before_and_pictures_show_it_there(kind):
    solid = KINDS[kind]
    carried, before = taken(solid, TILTED), solid.contents
    close(carried.contents.placement, np.linalg.inv(TILTED) @ before.placement, atol=1e-12)
    assert (carried.contents.kind, carried.contents.sizes) == (before.kind, before.sizes)
    back = left(carried, TILTED)
    close(corners(back), corners(solid), atol=1e-12)
    close(back.contents.placement, before.placement, atol=1e-12)
