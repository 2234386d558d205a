"""Which pairs of links and obstacles are checked: for what they are, not for their covers."""

import pickle
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from arms import OPENED, axle, joint, loaded, opened, solid_link
from cases import SHORTEST, refusal
from numpy.testing import assert_array_equal as same

from tubeplanner import (
    AttachedSolid,
    LimitOverrides,
    Obstacle,
    PlanningProblem,
    Tube,
    load_problem,
    load_robot,
    parse_problem,
    placement_of,
    plan,
)
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.collision_checker import CollisionChecker, CollisionScene, LeftOutPair
from tubeplanner.studies.tubes.clearance_bounds import PairClearance

CASES = Path(__file__).parents[1] / "data/cases"
BLOCK = Obstacle.box("block", [1, 1, 1], placement_of((0, 5, 0)))
MARBLE = Obstacle.sphere("marble", 0.1, placement_of((0, -5, 0)))


@pytest.fixture
def snake(tmp_path):
    """Load a chain of balls one metre apart: base, flange (fixed), a, b, c, tool (fixed to c)."""

    def load(radius=0.1, **options):
        names = ("base", "flange", "a", "b", "c", "tool")
        kinds = ("fixed", "revolute", "revolute", "revolute", "fixed")
        parts = [solid_link(name, f'<sphere radius="{radius}"/>') for name in names]
        for (parent, child), kind in zip(pairwise(names), kinds, strict=True):
            parts.append(joint(f"to_{child}", parent, child, kind, "1 0 0"))
        return loaded(tmp_path, *parts, tool="tool", **options)

    return load


def owners(checker, pairs):
    return {tuple(checker.shapes[index].owner for index in pair) for pair in pairs}


def products(first, second):
    return {(one, other) for one in first for other in second}


def test_links_are_checked_unless_they_are_neighbours_or_move_as_one(snake):
    """Obstacles are checked against every link that a joint moves."""
    checker = CollisionChecker(snake(), [BLOCK, MARBLE])
    links = products(("base", "flange"), ("b", "c", "tool")) | products("a", ("c", "tool"))
    assert owners(checker, checker.link_pairs) == links
    moving = products(("a", "b", "c", "tool"), ("block", "marble"))
    assert owners(checker, checker.obstacle_pairs) == moving
    same(checker.pairs, [*checker.obstacle_pairs, *checker.link_pairs])
    assert checker.owners(checker.link_pairs[0])[1] is None
    assert checker.owners(checker.obstacle_pairs[0]) == (("a",), "block")
    alone = CollisionChecker(snake(), [BLOCK], self_collision=False)
    assert (alone.link_pairs.shape, len(alone.obstacle_pairs)) == ((0, 2), 4)


def test_links_behind_a_locked_joint_belong_to_the_cell(snake):
    checker = CollisionChecker(snake(joints=["to_b", "to_c"]), [BLOCK])
    moving = products(("b", "c", "tool"), ["block"])
    assert owners(checker, checker.obstacle_pairs) == moving
    links = products(("base", "flange", "a"), ("c", "tool"))
    assert owners(checker, checker.link_pairs) == links


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


def test_pairs_are_found_by_the_names_of_their_solids(snake):
    checker = CollisionChecker(snake(), [BLOCK, MARBLE])
    for names in owners(checker, checker.pairs):
        result = checker.between(*names)
        same(result, checker.between(*names[::-1]))
        assert owners(checker, checker.pairs[result]) == {names}
        assert names not in owners(checker, checker.pairs[~result])
    assert not checker.between("a", "nothing").any()


@pytest.mark.parametrize("pair", [("b", "base"), ("marble", "tool")])
def test_ignored_pairs_are_left_out_in_either_order(snake, pair):
    plain = CollisionChecker(snake(), [BLOCK, MARBLE])
    checker = CollisionChecker(snake(), [BLOCK, MARBLE], ignore=[pair])
    (left_out,) = owners(plain, plain.pairs) - owners(checker, checker.pairs)
    assert set(left_out) == set(pair)


def test_link_pairs_that_always_touch_are_left_out(snake):
    """The centres of flange and b are 2 m apart when the arm is straight; flange and c 3 m."""
    for radius, left_out in ((0.9, False), (1.05, True)):
        checker = CollisionChecker(snake(radius))
        pairs = owners(checker, checker.link_pairs)
        assert (("flange", "b") not in pairs) == left_out
        assert ("flange", "c") in pairs


def test_pairs_are_not_lost_where_limits_exclude_zero_or_lie_a_turn_away(snake):
    """The same arc of the same joint, described one turn apart; bent little, a and c touch."""
    limits = LimitOverrides(position={"to_a": (4, 5), "to_b": (0.5, 1), "to_c": (3.5, 9)})
    assert len(CollisionChecker(snake(limits=limits)).link_pairs) == 8
    pairs = []
    for turn in (0.0, -2 * np.pi):
        limits = LimitOverrides(position={"to_b": (2.0 + turn, 4.0 + turn)})
        checker = CollisionChecker(snake(0.5, limits=limits))
        pairs.append(owners(checker, checker.link_pairs))
    assert pairs[0] == pairs[1]
    assert ("a", "c") in pairs[0]


def test_an_arm_without_geometry_is_known_and_clear_of_everything(snake):
    assert CollisionChecker(snake()).has_link_geometry
    robot = {"urdf": "example:asr_twodof", "tool_frame": "Tip"}
    ends = {"start": {"joints": [0.0, 0.9]}, "goal": {"joints": [1.0, 0.9]}}
    problem = parse_problem({"robot": robot, **ends}, reads_tube=False)
    assert not CollisionChecker(problem.robot, [BLOCK]).has_link_geometry
    least = PairClearance(problem, 0.01).least(np.zeros((3, 2)), near=1.0)
    assert (least.clearance == np.inf).all()


TOOL_BALL = AttachedSolid("ball", Obstacle.sphere("ball", 0.1, np.eye(4)).shapes)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"obstacles": [BLOCK, MARBLE, BLOCK]}, "obstacles: the name 'block' is given 2 times"),
        (
            {"obstacles": [Obstacle.sphere("tool", 0.1, np.eye(4))]},
            "obstacles: 'tool' is also the name of a link; choose another",
        ),
        (
            {"obstacles": [BLOCK], "ignore": [("tool", "blok")]},
            "collision.ignore: unknown link or obstacle 'blok' (did you mean 'block'?); there is: "
            "base, flange, a, b, c, tool, block",
        ),
        ({"attached": [replace(TOOL_BALL, name="tool")]}, "'tool' is also the name of a link"),
        ({"attached": [replace(TOOL_BALL, touch_links=("toll",))]}, "unknown link or obstacle 'to"),
    ],
)
def test_names_that_clash_or_do_not_exist_are_refused(snake, given, message):
    assert message in refusal(ProblemError, CollisionChecker, snake(), **given)


NEIGHBOURS = {
    LeftOutPair(("ring", "middle"), "neighbours"),
    LeftOutPair(("middle", "rod"), "neighbours"),
}


@pytest.mark.parametrize(
    ("radius", "ignore", "reason"),
    [(0.08, (), None), (0.08, [("rod", "ring")], "ignored"), (0.11, (), "always touching")],
)
def test_covers_that_always_overlap_are_no_reason_to_leave_a_pair_out(
    tmp_path, radius, ignore, reason
):
    robot = axle(tmp_path, radius, sections=24)
    checker = CollisionChecker(robot, ignore=ignore)
    if reason is not None:
        assert set(checker.left_out) == {*NEIGHBOURS, LeftOutPair(("ring", "rod"), reason)}
        assert len(checker.link_pairs) == 0
        return
    assert set(checker.left_out) == NEIGHBOURS
    assert owners(checker, checker.link_pairs) == {("ring", "rod")}
    rotation, position = robot.body_poses(np.zeros((1, 2)))
    distance = checker.distances(rotation[0], position[0], checker.link_pairs).min()
    assert 0.01 < distance < 0.0205


def block_and_rod(folder, mesh, length=0.1, z=0.0):
    """Return an arm whose last link, a rod, turns inside of its first, a mesh."""
    return loaded(
        folder,
        solid_link("block", f'<mesh filename="{mesh}"/>'),
        solid_link("middle", '<sphere radius="0.01"/>', '<origin xyz="0 0 9"/>'),
        solid_link("rod", f'<box size="0.05 0.05 {length}"/>', f'<origin xyz="0 0 {z}"/>'),
        joint("one", "block", "middle"),
        joint("two", "middle", "rod"),
        tool="rod",
    )


@pytest.mark.parametrize("kind", ["closed", *OPENED])
def test_a_pair_is_left_out_only_if_it_touches_for_certain(tmp_path, kind):
    """A rod inside of a block is in touch just if the block is closed; one in its wall always."""
    block = trimesh.creation.box([0.4, 0.4, 0.4])
    opened(block, kind, tmp_path / "block.stl")
    beside = block.copy().apply_translation([0, 0, -3])
    own = trimesh.load(tmp_path / "block.stl", process=False)
    trimesh.util.concatenate([own, beside]).export(tmp_path / "two.stl")
    is_closed = kind == "closed"
    for mesh, length, z, touching in [
        ("block.stl", 0.1, 0.0, is_closed),
        ("two.stl", 0.1, 0.0, is_closed),
        ("two.stl", 0.1, -3.0, True),  # in the shell that is closed
        ("block.stl", 0.1, 0.3, False),
        ("block.stl", 0.6, 0.0, True),
    ]:
        robot = block_and_rod(tmp_path, mesh, length, z)
        checker = CollisionChecker(robot)
        assert (LeftOutPair(("block", "rod"), "always touching") in checker.left_out) == touching
        assert (len(checker.link_pairs) == 0) == touching
        named = mesh in checker.open_meshes.get("block", {})
        assert named == (kind not in ("closed", "both sides"))
        if not touching and z == 0:
            poses = (each[0] for each in robot.body_poses(np.zeros((1, 2))))
            assert checker.distances(*poses, checker.link_pairs).min() < -0.1


def test_a_hollow_whose_shell_is_wound_the_wrong_way_or_open_is_no_inside(tmp_path):
    block, hollow = trimesh.creation.box([0.4, 0.4, 0.4]), trimesh.creation.box([0.2, 0.2, 0.2])
    lid = trimesh.Trimesh(hollow.vertices, hollow.faces[hollow.face_normals[:, 2] > 0.9])
    for inner in (hollow, lid):
        trimesh.util.concatenate([block, inner]).export(tmp_path / "block.stl")
        assert len(CollisionChecker(block_and_rod(tmp_path, "block.stl")).link_pairs) > 0


def test_a_refusal_names_the_mesh_that_is_not_closed(tmp_path):
    block = trimesh.creation.box([0.4, 0.4, 0.4])
    opened(block, "no top", tmp_path / "block.stl")
    solid = {"name": "block", "mesh": str(tmp_path / "block.stl")}
    fields = {
        "robot": {"urdf": "example:two_link", "tool_frame": "hand"},
        "start": {"joints": [0.0, 0.5]},
        "goal": {"joints": [0.4, 0.5]},
        "obstacles": [solid],
    }
    result = plan(parse_problem(fields, reads_tube=False), SHORTEST)
    assert (
        "the mesh block.stl of block is not closed (4 edges are open or wound both ways), its "
        "openings count as solid: export it closed" in result.message
    )


def test_links_of_one_body_are_not_listed(ur5):
    left_out = CollisionChecker(ur5).left_out
    assert LeftOutPair(("shoulder_link", "upper_arm_link"), "neighbours") in left_out
    assert not any(set(pair.links) == {"wrist_3_link", "ee_link"} for pair in left_out)


@pytest.mark.dear("covers the meshes of a robot with four legs where no cache has them")
def test_a_hollow_in_a_trunk_does_not_forbid_a_leg():
    problem = load_problem(CASES / "hyq_concave_trunk.yaml")
    result = plan(problem, SHORTEST)
    assert result.succeeded, result.message
    listed = result.certificate.as_dict()["left_out"]
    assert {"links": ["trunk", "lf_hipassembly"], "reason": "neighbours"} in listed


@pytest.fixture(scope="module")
def scene():
    robot = load_robot("example:two_link", "hand")
    return CollisionScene(robot, (MARBLE,), (), True, ())


def test_an_arm_with_other_limits_meets_the_same_scene(scene):
    limits = replace(scene.robot.limits, effort=0.9 * scene.robot.limits.effort)
    limited = scene.robot.with_limits(limits, scene.robot.motors)
    assert scene.is_as(replace(scene, robot=limited))


@pytest.mark.parametrize(
    "changes",
    [
        {"obstacles": ()},
        {"self_collision": False},
        {"ignore": (("hand", "marble"),)},
        {"robot": load_robot("example:two_link", "hand")},
    ],
    ids=["none", "links", "pairs", "arm"],
)
def test_with_anything_else_it_is_another_scene(scene, changes):
    assert not scene.is_as(replace(scene, **changes))


def ring_and_rod(folder):
    """Return an arm whose last link, a rod, slides and turns in its first, a ring, or far away."""
    trimesh.creation.annulus(0.1, 0.2, 0.05, sections=16).export(folder / "ring.stl")
    far = '<limit lower="-9" upper="9" effort="50" velocity="3"/>'
    return loaded(
        folder,
        solid_link("ring", '<mesh filename="ring.stl"/>'),
        solid_link("middle", '<sphere radius="0.01"/>', '<origin xyz="0 0 1"/>'),
        solid_link("rod", '<cylinder radius="0.02" length="0.3"/>'),
        joint("one", "ring", "middle", "prismatic", axis="1 0 0", limit=far),
        joint("two", "middle", "rod"),
        tool="rod",
    )


def test_an_end_where_covers_alone_overlap_is_free_by_closer_ones(tmp_path):
    robot, tube = ring_and_rod(tmp_path), Tube([[0, 0, 0], [0.05, 0, 0]], radius=0.02)
    assert not CollisionChecker(robot).closer_covers
    result = plan(PlanningProblem(robot, tube, [0.0, 0.0], [0.05, 1.0]), SHORTEST)
    assert result.succeeded, result.message
    assert result.certificate.conditions["self_collision"].margin > 0.02
    tube = Tube([[0, 0, 0], [0.1, 0, 0]], radius=0.02)
    result = plan(PlanningProblem(robot, tube, [0.0, 0.0], [0.1, 0.0]), SHORTEST)
    assert "ring and rod overlap by 20.0 mm in the goal configuration" in result.message


def test_a_scene_has_closer_covers_for_the_configurations_that_need_them(tmp_path):
    usual = CollisionScene(ring_and_rod(tmp_path), (), (), True, ())
    away, inside = [3.0, 0.0], [0.02, 0.5]
    assert usual.free_at([away]) is usual.free_at([]) is usual
    closer = usual.free_at([away, inside])
    assert set(closer.checker.closer_covers) == {"ring", "rod"}
    assert usual.free_at([inside]) is closer.free_at([inside]) is closer
    assert closer.free_at([away]) is usual
    sent = pickle.dumps(closer)
    for file in tmp_path.iterdir():
        file.unlink()
    there = pickle.loads(sent)
    assert there.free_at([inside]) is there
