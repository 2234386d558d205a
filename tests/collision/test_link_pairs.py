"""Pairs are left out for what the links are, not for what their covers are."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from cases import SHORTEST

from tubeplanner import Obstacle, load_problem, load_robot, placement_of, plan, verify
from tubeplanner.collision.collision_checker import CollisionChecker, LeftOutPair
from tubeplanner.trajectory.trajectory_file import read_trajectory

CASES = Path(__file__).parents[1] / "data/cases"
# A ring on the base, a rod through it that never touches it, and a plate that cuts the rod.
LINK = """<link name="{name}"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision>{origin}<geometry>{geometry}</geometry></collision></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
  <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="100" velocity="2"/></joint>"""


@pytest.fixture
def axle(tmp_path):
    """A rod that turns inside of a ring, two joints away from it."""

    def build(radius):
        trimesh.creation.annulus(0.1, 0.2, 0.05, sections=24).export(tmp_path / "ring.stl")
        rod = f'<cylinder radius="{radius}" length="0.3"/>'
        far = '<origin xyz="0 0 1"/>'
        text = "".join(
            [
                LINK.format(name="ring", origin="", geometry='<mesh filename="ring.stl"/>'),
                LINK.format(name="middle", origin=far, geometry='<sphere radius="0.01"/>'),
                LINK.format(name="rod", origin="", geometry=rod),
                JOINT.format(name="one", parent="ring", child="middle"),
                JOINT.format(name="two", parent="middle", child="rod"),
            ]
        )
        (tmp_path / "axle.urdf").write_text(f'<robot name="axle">{text}</robot>')
        return load_robot(tmp_path / "axle.urdf", "rod")

    return build


NEIGHBOURS = {
    LeftOutPair(("ring", "middle"), "neighbours"),
    LeftOutPair(("middle", "rod"), "neighbours"),
}


def test_covers_that_always_overlap_are_no_reason_to_leave_a_pair_out(axle):
    checker = CollisionChecker(axle(0.08))
    assert set(checker.left_out) == NEIGHBOURS
    pairs = checker.link_pairs
    assert {checker.owners(pair)[0] for pair in pairs} == {("ring", "rod")}
    rotation, position = axle(0.08).body_poses(np.zeros((1, 2)))
    distance = checker.distances(rotation[0], position[0], pairs).min()
    assert 0.01 < distance < 0.0205


def test_links_that_always_touch_are_left_out_and_named(axle):
    checker = CollisionChecker(axle(0.11))
    touching = LeftOutPair(("ring", "rod"), "always touching")
    assert set(checker.left_out) == {*NEIGHBOURS, touching}
    assert len(checker.link_pairs) == 0


def test_what_is_ignored_is_named(axle):
    checker = CollisionChecker(axle(0.08), ignore=[("rod", "ring")])
    assert LeftOutPair(("ring", "rod"), "ignored") in checker.left_out
    assert len(checker.link_pairs) == 0


def test_links_of_one_body_are_not_listed(ur5):
    left_out = CollisionChecker(ur5).left_out
    assert LeftOutPair(("shoulder_link", "upper_arm_link"), "neighbours") in left_out
    assert not any(set(pair.links) == {"wrist_3_link", "ee_link"} for pair in left_out)


@pytest.mark.slow
def test_links_that_pass_through_each_other_are_seen():
    """Their covers touch in every configuration; the answer was certified once."""
    problem = load_problem(CASES / "hextilt_1.yaml")
    certificate = verify(problem, read_trajectory(CASES / "hextilt_1.answer.json"))
    assert certificate.failures() == ["self_collision"]
    assert set(certificate.conditions["self_collision"].where.links) == {
        "flying_arm_5__link_2",
        "flying_arm_5__link_4",
    }


@pytest.mark.slow
def test_a_hollow_in_a_trunk_does_not_forbid_a_leg():
    problem = load_problem(CASES / "hyq_concave_trunk.yaml")
    result = plan(problem, SHORTEST)
    assert result.succeeded, result.message
    listed = result.certificate.as_dict()["left_out"]
    assert {"links": ["trunk", "lf_hipassembly"], "reason": "neighbours"} in listed


def test_a_tool_may_go_between_the_legs_of_a_u(two_link):
    """The U lies around the second link; with a plain hull it would be full."""
    placement = placement_of([0.75, -0.15, -0.05], rpy=[0, 0, np.pi / 2])
    fixture = Obstacle.mesh("U", CASES / "mesh_U.obj", placement)
    checker = CollisionChecker(two_link, [fixture])
    assert len(fixture.shapes) == 3
    for q1, expected in ((0.0, 0.08), (0.25, -0.01)):
        rotation, position = two_link.body_poses(np.array([[q1, 0.0]]))
        distance = checker.distances(rotation[0], position[0], checker.obstacle_pairs).min()
        assert distance < 0 if expected < 0 else distance == pytest.approx(expected)
