"""Collision elements of the links and their convex covers."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from tubeplanner import LimitOverrides, load_robot
from tubeplanner.collision import link_elements as module
from tubeplanner.collision.cover_cache import VARIABLE
from tubeplanner.collision.link_elements import link_elements
from tubeplanner.collision.link_geometry import link_shapes
from tubeplanner.collision.mesh_cover import cover_mesh
from tubeplanner.errors import RobotError
from tubeplanner.resources import find_mesh

# Collision elements as the URDF has them, read by its parser or from the cache.


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


# Convex covers of links: they hold the whole link, and little else.


INERTIAL = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)


@pytest.fixture
def tip_shapes(tmp_path):
    """Return the shapes of the last link of a one-joint arm, given its URDF elements."""

    def shapes(*collisions, flange=""):
        path = tmp_path / "arm.urdf"
        path.write_text(
            f"""<robot name="arm"><link name="base"/>
            <link name="tip">{INERTIAL}{"".join(collisions)}</link>
            <joint name="j" type="revolute"><parent link="base"/><child link="tip"/>
            <origin xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
            {flange}</robot>"""
        )
        return link_shapes(load_robot(path, "tip"))

    return shapes


def collision(geometry, origin=""):
    return f"<collision>{origin}<geometry>{geometry}</geometry></collision>"


def is_covered(points, shapes, slack=1e-9):
    """Whether points (N, 3) lie in at least one of some polytopes."""
    covered = np.zeros(len(points), dtype=bool)
    for shape in shapes:
        planes = ConvexHull(shape.vertices).equations
        covered |= (points @ planes[:, :3].T + planes[:, 3] <= slack).all(axis=1)
    return covered


def volume(shapes):
    return sum(ConvexHull(shape.vertices).volume for shape in shapes)


def collision_meshes(robot):
    """Yield every mesh of a robot, in the frame of its link, read without the package's reader."""
    for link in ElementTree.parse(robot.urdf.path).getroot().findall("link"):
        for element in link.iterfind("collision"):
            mesh = element.find("geometry/mesh")
            if mesh is None:
                continue
            path = find_mesh(mesh.get("filename"), Path(robot.urdf.path))
            loaded = trimesh.load(str(path), force="mesh")
            loaded.apply_scale([float(s) for s in mesh.get("scale", "1 1 1").split()])
            origin = element.find("origin")
            if origin is not None:
                xyz = [float(x) for x in origin.get("xyz", "0 0 0").split()]
                rpy = [float(x) for x in origin.get("rpy", "0 0 0").split()]
                placement = trimesh.transformations.euler_matrix(*rpy, axes="sxyz")
                placement[:3, 3] = xyz
                loaded.apply_transform(placement)
            yield link.get("name"), loaded


def test_every_point_of_every_link_mesh_is_covered(panda):
    shapes = link_shapes(panda)
    checked = 0
    for link, mesh in collision_meshes(panda):
        surface, _ = trimesh.sample.sample_surface(mesh, 500, seed=1)
        points = np.vstack([surface, mesh.vertices])
        placement = panda.link_placement[link]
        in_body = points @ placement[:3, :3].T + placement[:3, 3]
        assert is_covered(in_body, shapes[link]).all(), link
        checked += 1
    assert checked >= 7


def test_covers_are_hardly_larger_than_their_links_even_where_hulls_are(ur5):
    shapes = link_shapes(ur5)
    ratios = {
        link: (mesh.convex_hull.volume / mesh.volume, volume(shapes[link]) / mesh.volume)
        for link, mesh in collision_meshes(ur5)
    }
    assert all(1 < cover < 1.2 for _, cover in ratios.values()), ratios
    for link in ("upper_arm_link", "forearm_link"):
        hull, cover = ratios[link]
        assert hull > 1.4
        assert cover < 1.1


def bone():
    """A dumbbell of three overlapping boxes along x, with its true inside."""
    boxes = [([0.2, 0.3, 0.3], -0.4), ([0.8, 0.05, 0.05], 0.0), ([0.2, 0.3, 0.3], 0.4)]
    parts = [trimesh.creation.box(size) for size, _ in boxes]
    for part, (_, x) in zip(parts, boxes, strict=True):
        part.apply_translation([x, 0, 0])

    def inside(points):
        return np.any(
            [(abs(points - [x, 0, 0]) <= np.array(size) / 2).all(axis=1) for size, x in boxes],
            axis=0,
        )

    return trimesh.util.concatenate(parts), inside


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_inside_of_a_concave_solid_is_covered_along_any_axis(axis):
    mesh, inside = bone()
    mesh.vertices = np.roll(mesh.vertices, axis, axis=1)
    points = np.random.default_rng(3).uniform(-0.5, 0.5, (5000, 3))
    solid = points[inside(np.roll(points, -axis, axis=1))]
    cover = cover_mesh(mesh)
    assert len(solid) > 100
    assert is_covered(solid, cover).all()
    assert 1 < len(cover) <= 8
    assert volume(cover) < 0.6 * mesh.convex_hull.volume


def test_a_convex_mesh_stays_one_shape():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    (shape,) = cover_mesh(mesh)
    np.testing.assert_allclose(ConvexHull(shape.vertices).volume, mesh.volume, rtol=1e-9)


def test_primitives_are_placed_by_their_origin_in_the_body_frame(tip_shapes):
    shapes = tip_shapes(
        collision('<box size="2 4 6"/>', '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'),
        collision('<sphere radius="0.5"/>', '<origin xyz="0 1 0"/>'),
        collision('<cylinder radius="0.1" length="3"/>'),
    )["tip"]
    brick, ball, post = shapes
    np.testing.assert_allclose(brick.vertices.min(axis=0), [-1, -1, -3], atol=1e-12)
    np.testing.assert_allclose(brick.vertices.max(axis=0), [3, 1, 3], atol=1e-12)
    np.testing.assert_allclose(ball.vertices, [[0, 1, 0]])
    assert ball.radius == 0.5
    np.testing.assert_allclose(np.ptp(post.vertices[:, 2]), 3)


def test_a_link_welded_to_another_is_in_the_frame_of_the_body_that_moves_it(tip_shapes):
    ball = collision('<sphere radius="0.1"/>')
    flange = (
        f'<link name="flange">{ball}</link>'
        '<joint name="weld" type="fixed"><parent link="tip"/><child link="flange"/>'
        '<origin xyz="0 0 0.5"/></joint>'
    )
    shapes = tip_shapes(flange=flange)
    assert list(shapes) == ["flange"]
    np.testing.assert_allclose(shapes["flange"][0].vertices, [[0, 0, 0.5]])


@pytest.mark.parametrize(
    ("scale", "size"), [("", [0.2, 0.4, 0.6]), ('scale="2 1 0.5"', [0.4, 0.4, 0.3])]
)
def test_a_mesh_beside_the_urdf_is_read_and_scaled(tmp_path, tip_shapes, scale, size):
    trimesh.creation.box([0.2, 0.4, 0.6]).export(tmp_path / "brick.stl")
    (shape,) = tip_shapes(collision(f'<mesh filename="brick.stl" {scale}/>'))["tip"]
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), size, rtol=1e-6)


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ('<mesh filename="none.stl"/>', "none.stl, named in"),
        ('<mesh filename="package://nobody/a.stl"/>', "package://nobody/a.stl was not found"),
        ('<mesh filename="noise.stl"/>', "link 'tip': mesh"),
        (
            '<mesh filename="noise.xyzabc"/>',
            "noise.xyzabc is no readable XYZABC file; export it again",
        ),
        ('<mesh filename="empty.obj"/>', "empty.obj has no vertices"),
        (
            '<capsule radius="1" length="2"/>',
            "a <geometry> holds <capsule>; it must hold one of <box>, <sphere>",
        ),
        ('<box size="a b c"/>', '<box> size="a b c" must be 3 finite numbers'),
        ("", "a <geometry> holds nothing; it must hold one of"),
    ],
)
def test_mesh_that_cannot_be_used_is_named(tmp_path, tip_shapes, geometry, message):
    for name, content in (("noise.stl", "noise"), ("noise.xyzabc", "noise"), ("empty.obj", "")):
        (tmp_path / name).write_text(content)
    with pytest.raises(RobotError) as caught:
        tip_shapes(collision(geometry))
    assert message in str(caught.value)


def test_links_without_collision_geometry_have_no_shapes(tip_shapes):
    visual = "<visual><geometry><sphere radius='1'/></geometry></visual>"
    assert tip_shapes(visual) == {}


def test_a_prefix_that_is_not_declared_leaves_geometry_and_joints_as_they_are(tmp_path):
    """yourdfpy and Pinocchio get the text with the declaration."""
    path = tmp_path / "arm.urdf"
    path.write_text(
        f"""<robot name="arm"><link name="base"/><link name="tip"><drake:tip/>{INERTIAL}
        <collision><drake:soft/><geometry><box size="1 2 3"/></geometry></collision></link>
        <joint name="j" type="revolute"><drake:ball/><parent link="base"/><child link="tip"/>
        <limit drake:jerk="3" lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    robot = load_robot(path, "tip")
    (shape,) = link_shapes(robot)["tip"]
    assert np.ptp(shape.vertices, axis=0) == pytest.approx([1, 2, 3])
    assert robot.urdf.undeclared == {"drake": ("tip", "soft", "ball", "jerk")}
