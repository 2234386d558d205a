"""Collision elements as the URDF has them, read by its parser or from the cache."""

import numpy as np
import pytest

from tubeplanner import LimitOverrides, load_robot
from tubeplanner.collision import link_elements as module
from tubeplanner.collision.cover_cache import VARIABLE
from tubeplanner.collision.link_elements import link_elements

URDF = """<robot name="r">
  <link name="base"/>
  <link name="arm">
    <collision>
      <origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>
      <geometry><box size="0.1 0.2 0.3"/></geometry>
    </collision>
    <collision><geometry><sphere radius="0.4"/></geometry></collision>
    <collision><geometry><cylinder radius="0.5" length="0.6"/></geometry></collision>
    <collision><geometry><mesh filename="a.stl" scale="1 -2 3"/></geometry></collision>
    <collision><geometry><mesh filename="b.obj"/></geometry></collision>
  </link>
  <joint name="j" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/>
  </joint>
</robot>"""
EXPECTED = [
    ("box", (0.1, 0.2, 0.3), ""),
    ("sphere", (0.4,), ""),
    ("cylinder", (0.5, 0.6), ""),
    ("mesh", (1.0, -2.0, 3.0), "a.stl"),
    ("mesh", (1.0, 1.0, 1.0), "b.obj"),
]


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    path = tmp_path / "r.urdf"
    path.write_text(URDF)
    return load_robot(path, "arm", limits=LimitOverrides(effort={"j": np.inf}))


def described(elements):
    return [(element.kind, element.sizes, element.filename) for element in elements]


def test_elements_are_those_of_the_urdf(robot):
    found = link_elements(robot)
    assert list(found) == ["arm"]
    assert described(found["arm"]) == EXPECTED
    turned = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    np.testing.assert_allclose(found["arm"][0].placement, turned, atol=1e-15)
    np.testing.assert_array_equal(found["arm"][1].placement, np.eye(4))


def test_elements_from_the_cache_are_the_same_and_nothing_is_parsed(robot, monkeypatch):
    cold = link_elements(robot)["arm"]
    monkeypatch.setattr(module, "read_geometry", None)
    warm = link_elements(robot)["arm"]
    assert described(warm) == described(cold) == EXPECTED
    for one, other in zip(warm, cold, strict=True):
        np.testing.assert_array_equal(one.placement, other.placement)
