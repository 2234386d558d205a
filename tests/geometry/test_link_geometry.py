"""Collision elements of the links, their convex covers, and how far these stand off."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh
from arms import INERTIAL, LIMIT, joint, link, loaded, solid, solid_link
from cases import outside, refusal
from numpy.testing import assert_allclose as close
from scipy.spatial import ConvexHull

from tubeplanner import LimitOverrides
from tubeplanner.errors import RobotError
from tubeplanner.geometry.collision_checker import CollisionChecker, link_covers
from tubeplanner.geometry.link_geometry import link_elements, link_parts, link_shapes
from tubeplanner.geometry.meshes import cover_mesh
from tubeplanner.resources import CACHE_VARIABLE, find_mesh

ARM = solid('<box size="0.1 0.2 0.3"/>', '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>')
ARM += solid('<sphere radius="0.4"/>') + solid('<cylinder radius="0.5" length="0.6"/>')
ARM += solid('<capsule radius="0.7" length="0.8"/>')
ARM += solid('<mesh filename="a.stl" scale="1 -2 3"/>') + solid('<mesh filename="b.obj"/>')
CASES = Path(__file__).parents[1] / "data/cases"
EXPECTED = [
    ("box", (0.1, 0.2, 0.3), ""),
    ("sphere", (0.4,), ""),
    ("cylinder", (0.5, 0.6), ""),
    ("capsule", (0.7, 0.8), ""),
    ("mesh", (1.0, -2.0, 3.0), "a.stl"),
    ("mesh", (1.0, 1.0, 1.0), "b.obj"),
]


@pytest.fixture
def robot(tmp_path, monkeypatch):
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    limits = LimitOverrides(effort={"j": np.inf})
    parts = link("base", ""), link("arm", ARM), joint("j", "base", "arm")
    return loaded(tmp_path, *parts, tool="arm", limits=limits)


def described(elements):
    return [(element.kind, element.sizes, element.filename) for element in elements]


def test_elements_are_those_of_the_urdf(robot):
    result = link_elements(robot)
    assert list(result) == ["arm"]
    assert described(result["arm"]) == EXPECTED
    pose = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    close(result["arm"][0].placement, pose, atol=1e-15)
    np.testing.assert_array_equal(result["arm"][1].placement, np.eye(4))


@pytest.fixture
def tip_shapes(tmp_path):
    """Return the shapes of the last link of a one-joint arm, given its collision elements."""

    def shapes(*collisions, more=""):
        parts = link("base", ""), link("tip", INERTIAL + "".join(collisions))
        return link_shapes(loaded(tmp_path, *parts, joint("j", "base", "tip"), more))

    return shapes


def volume(shapes):
    return sum(ConvexHull(shape.vertices).volume for shape in shapes)


def collision_meshes(robot):
    """Yield every mesh of a robot, in the frame of its link, read without the package's reader."""
    for element in ElementTree.parse(robot.urdf.path).getroot().findall("link"):
        for part in element.iterfind("collision"):
            mesh, origin = part.find("geometry/mesh"), part.find("origin")
            if mesh is None:
                continue
            path = find_mesh(mesh.get("filename"), Path(robot.urdf.path))
            result = trimesh.load(str(path), force="mesh")
            result.apply_scale([float(s) for s in mesh.get("scale", "1 1 1").split()])
            if origin is not None:
                xyz, rpy = (origin.get(key, "0 0 0").split() for key in ("xyz", "rpy"))
                euler = [float(angle) for angle in rpy]
                placement = trimesh.transformations.euler_matrix(*euler, axes="sxyz")
                placement[:3, 3] = [float(x) for x in xyz]
                result.apply_transform(placement)
            yield element.get("name"), result


def test_every_point_of_every_link_mesh_is_covered(panda):
    shapes = link_shapes(panda)
    checked = 0
    for name, mesh in collision_meshes(panda):
        surface, _ = trimesh.sample.sample_surface(mesh, 500, seed=1)
        points = np.vstack([surface, mesh.vertices])
        placement = panda.link_placement[name]
        in_body = points @ placement[:3, :3].T + placement[:3, 3]
        assert outside(shapes[name], in_body).max() < 1e-9, name
        checked += 1
    assert checked >= 7


def test_covers_are_hardly_larger_than_their_links_even_where_hulls_are(ur5):
    shapes = link_shapes(ur5)
    ratios = {
        name: (mesh.convex_hull.volume / mesh.volume, volume(shapes[name]) / mesh.volume)
        for name, mesh in collision_meshes(ur5)
    }
    assert all(1 < cover < 1.2 for _, cover in ratios.values()), ratios
    for hull, cover in (ratios["upper_arm_link"], ratios["forearm_link"]):
        assert hull > 1.4
        assert cover < 1.1


def bone():
    """A dumbbell of three overlapping boxes along x, with its true inside."""
    boxes = [([0.2, 0.3, 0.3], -0.4), ([0.8, 0.05, 0.05], 0.0), ([0.2, 0.3, 0.3], 0.4)]
    parts = [trimesh.creation.box(size).apply_translation([x, 0, 0]) for size, x in boxes]

    def inside(points):
        each = [abs(points - [x, 0, 0]) <= np.array(size) / 2 for size, x in boxes]
        return np.any([within.all(axis=1) for within in each], axis=0)

    return trimesh.util.concatenate(parts), inside


def test_the_inside_of_a_concave_solid_is_covered_along_any_axis():
    mesh, inside = bone()
    mesh.vertices = np.roll(mesh.vertices, 2, axis=1)
    points = np.random.default_rng(3).uniform(-0.5, 0.5, (5000, 3))
    inner = points[inside(np.roll(points, -2, axis=1))]
    cover = cover_mesh(mesh)
    assert len(inner) > 100
    assert outside(cover, inner).max() < 1e-9
    assert 1 < len(cover) <= 8
    assert volume(cover) < 0.6 * mesh.convex_hull.volume


def test_primitives_are_placed_by_their_origin_in_the_body_frame(tip_shapes):
    shapes = tip_shapes(
        solid('<box size="2 4 6"/>', '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'),
        solid('<sphere radius="0.5"/>', '<origin xyz="0 1 0"/>'),
        solid('<cylinder radius="0.1" length="3"/>'),
    )["tip"]
    brick, ball, post = shapes
    close(brick.vertices.min(axis=0), [-1, -1, -3], atol=1e-12)
    close(brick.vertices.max(axis=0), [3, 1, 3], atol=1e-12)
    close(ball.vertices, [[0, 1, 0]])
    assert ball.radius == 0.5
    close(np.ptp(post.vertices[:, 2]), 3)


def test_a_link_welded_to_another_is_in_the_frame_of_the_body_that_moves_it(tip_shapes):
    flange = solid_link("flange", '<sphere radius="0.1"/>')
    shapes = tip_shapes(more=flange + joint("weld", "tip", "flange", "fixed", "0 0 0.5"))
    assert list(shapes) == ["flange"]
    close(shapes["flange"][0].vertices, [[0, 0, 0.5]])


@pytest.mark.parametrize(
    ("scale", "size"), [("", [0.2, 0.4, 0.6]), ('scale="2 1 0.5"', [0.4, 0.4, 0.3])]
)
def test_a_mesh_beside_the_urdf_is_read_and_scaled(tmp_path, tip_shapes, scale, size):
    trimesh.creation.box([0.2, 0.4, 0.6]).export(tmp_path / "brick.stl")
    (shape,) = tip_shapes(solid(f'<mesh filename="brick.stl" {scale}/>'))["tip"]
    close(np.ptp(shape.vertices, axis=0), size, rtol=1e-6)


@pytest.mark.parametrize(
    ("geometry", "message"),
    [
        ('<mesh filename="none.stl"/>', "none.stl, named in"),
        ('<mesh filename="package://nobody/a.stl"/>', "package://nobody/a.stl was not found"),
        ('<mesh filename="noise.stl"/>', "link 'tip': mesh"),
        ('<mesh filename="noise.xyzabc"/>', "noise.xyzabc is no readable XYZABC file; export it"),
    ],
)
def test_mesh_that_cannot_be_used_is_named(tmp_path, tip_shapes, geometry, message):
    for name in ("noise.stl", "noise.xyzabc"):
        (tmp_path / name).write_text("noise")
    assert message in refusal(RobotError, tip_shapes, solid(geometry))


def test_a_prefix_that_is_not_declared_leaves_geometry_and_joints_as_they_are(tmp_path):
    """Pinocchio gets the text with the declaration."""
    tip = "<drake:tip/>" + INERTIAL + solid('<box size="1 2 3"/>', "<drake:soft/>")
    limit = "<drake:ball/>" + LIMIT.replace("<limit", '<limit drake:jerk="3"')
    parts = link("base", ""), link("tip", tip), joint("j", "base", "tip", limit=limit)
    robot = loaded(tmp_path, *parts)
    (shape,) = link_shapes(robot)["tip"]
    assert np.ptp(shape.vertices, axis=0) == pytest.approx([1, 2, 3])
    assert robot.urdf.undeclared == {"drake": ("tip", "soft", "ball", "jerk")}


def arm_of(folder, base, tip):
    """Return an arm of two links, given their elements."""
    parts = solid_link("base", base), solid_link("tip", tip)
    return loaded(folder, *parts, joint("one", "base", "tip"))


@pytest.mark.parametrize(
    ("geometry", "error"),
    [
        ('<sphere radius="0.1"/>', 0.0),
        ('<cylinder radius="0.1" length="0.3"/>', 0.1 * (1 / np.cos(np.pi / 24) - 1)),
    ],
)
def test_primitives_stand_off_by_what_a_prism_adds(tmp_path, geometry, error):
    checker = CollisionChecker(arm_of(tmp_path, '<sphere radius="0.01"/>', geometry))
    base, tip = link_covers(checker)
    assert (base.link, base.shapes, base.closer_shapes, base.closer_error) == ("base", 1, 0, None)
    assert tip.outer_error == pytest.approx(error, abs=1e-4)


def test_meshes_stand_off_by_what_points_on_their_covers_show(tmp_path):
    meshes = (f'<mesh filename="{CASES / name}"/>' for name in ("mesh_ring.obj", "mesh_U.obj"))
    robot = arm_of(tmp_path, *meshes)
    checker = CollisionChecker(robot)
    covers = {each.link: each for each in link_covers(checker)}
    for name, parts in link_parts(robot).items():
        assert covers[name].shapes == sum(len(part.cover()) for part in parts)
        for part in parts:
            vertices = np.vstack([shape.vertices for shape in part.cover()])
            assert part.solid.distance(vertices).max() <= covers[name].outer_error + 2e-3
    assert {name for name, each in covers.items() if each.closer_shapes} == {*checker.closer_covers}
