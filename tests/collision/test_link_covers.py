"""How far covers stand off is stated, and true."""

import numpy as np
import pytest

from tubeplanner import load_robot
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.link_covers import link_covers
from tubeplanner.collision.link_geometry import link_parts

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


def test_meshes_stand_off_by_what_points_on_their_covers_show():
    robot = load_robot("example:finger_edu", "finger_tip_link")
    checker = CollisionChecker(robot)
    covers = {each.link: each for each in link_covers(checker)}
    for link, parts in link_parts(robot).items():
        assert covers[link].shapes == sum(len(part.cover()) for part in parts)
        for part in parts:
            vertices = np.vstack([shape.vertices for shape in part.cover()])
            assert part.solid.distance(vertices).max() <= covers[link].outer_error + 2e-3
    assert {link for link, each in covers.items() if each.closer_shapes} == {*checker.closer_covers}
