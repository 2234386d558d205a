"""Point clouds: formats, cells, merged boxes."""

import numpy as np
import pytest
import trimesh
from cases import refusal

from tubeplanner import parse_problem
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.point_clouds import MAX_BOXES, read_point_cloud
from tubeplanner.output.files.fingerprint import problem_hash

# Centres of cells of 0.1 m: a plate of 3 x 2 with a post of 2 on a corner, and one beyond zero.
CELLS = [(i, j, 0) for i in range(3) for j in range(2)] + [(0, 0, 1), (0, 0, 2), (-1, 5, 0)]
POINTS = 0.1 * (np.array(CELLS) + 0.5)
NAN = np.full(3, np.nan)
HEADER = "# .PCD v0.7\nVERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {type}\nCOUNT {count}\n"
HEADER += "WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {data}\n"


def pcd(data, content):
    n = len(POINTS) + 1
    # A field of padding before the coordinates, as PCL writes it.
    fields = {"fields": "_ x y z i", "size": "1 8 8 8 2", "type": "U F F F I"}
    return (HEADER.format(n=n, data=data, count="2 1 1 1 1", **fields)).encode() + content


def rows(points):
    return [(0, 1, *point, 7) for point in points]


def text(points, end="\n"):
    return end.join(" ".join(f"{x:.17g}" for x in row) for row in points).encode()


def binary(points):
    kind = [("_", "u1", 2), ("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("i", "<i2")]
    return np.array([((0, 1), *point, 7) for point in points], dtype=kind).tobytes()


WITH_NAN = [*POINTS, NAN]
FILES = {
    "binary.ply": trimesh.PointCloud(POINTS).export(file_type="ply"),
    "text.ply": trimesh.PointCloud(POINTS).export(file_type="ply", encoding="ascii"),
    "binary.pcd": pcd("binary", binary(WITH_NAN)),
    "text.pcd": pcd("ascii", text(rows(WITH_NAN), "\r\n")),
    "plain.xyz": b"# x y z\r\n" + text(POINTS, "\r\n"),
    "colours.xyz": text([[*point, 1, 2, 3] for point in POINTS]).replace(b" ", b","),
}


@pytest.mark.parametrize("name", FILES)
def test_every_format_has_the_same_points(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    points = read_point_cloud(tmp_path / name).points
    np.testing.assert_allclose(points, POINTS, atol=1e-6)


def test_boxes_are_the_cells_that_hold_points_and_no_more(tmp_path):
    rng = np.random.default_rng(0)
    cells = np.unique(rng.integers(-4, 4, (300, 3)), axis=0)
    points = 0.1 * (cells + rng.uniform(0.1, 0.9, cells.shape))
    (tmp_path / "a.xyz").write_bytes(text(points))
    boxes = read_point_cloud(tmp_path / "a.xyz").boxes(0.1)
    assert len(boxes) < len(cells)
    corners = [(shape.vertices.min(axis=0), shape.vertices.max(axis=0)) for shape in boxes]
    covered = [
        tuple(cell)
        for low, high in np.round(np.array(corners) / 0.1).astype(int)
        for cell in low + np.stack(np.indices(high - low), axis=-1).reshape(-1, 3)
    ]
    assert sorted(covered) == sorted(map(tuple, cells))  # each cell in one box


def test_points_are_an_obstacle_in_a_pose(tmp_path):
    (tmp_path / "scan.xyz").write_bytes(text(POINTS))
    scan = {"name": "scan", "points": "scan.xyz", "size": 0.1, "position": [2, 0, 0]}
    fields = {
        "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
        "tube": {"points": [[0.6, 0, 0], [0.4, 0.4, 0]], "radius": 0.1},
        "start": {"seed": [0, 1]},
    }
    problem = parse_problem(fields | {"obstacles": [scan]}, tmp_path)
    (obstacle,) = problem.obstacles
    sizes = sorted(np.ptp(shape.vertices, axis=0).round(9).tolist() for shape in obstacle.shapes)
    assert sizes == [[0.1, 0.1, 0.1], [0.1, 0.1, 0.2], [0.3, 0.2, 0.1]]
    assert min(shape.vertices[:, 0].min() for shape in obstacle.shapes) == pytest.approx(1.9)
    for change in ({"size": 0.2}, {"position": [2, 0, 1]}):
        other = parse_problem(fields | {"obstacles": [scan | change]}, tmp_path)
        assert problem_hash(other) != problem_hash(problem)
    for change, message in (
        ({"size": None}, "obstacles: 'scan': size, the side of the boxes [m], is required"),
        ({"size": 0}, "points has size 0 m"),
        ({"points": "none.xyz"}, "none.xyz cannot be read"),
    ):
        solids = {"obstacles": [scan | change]}
        assert message in refusal(ProblemError, parse_problem, fields | solids, tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.pts", b"", "unknown ending '.pts'"),
        ("a.xyz", b"1 2\n", "is no readable XYZ file"),
        ("a.xyz", b"", "has no finite points"),
        ("a.xyz", b"nan 0 0\n", "has no finite points"),
        ("a.xyz", b"20000 0 0\n", "reaches 2e+04 m"),
        ("a.ply", b"solid", "is no readable PLY file"),
        ("a.pcd", b"VERSION 0.7", "its header has no line DATA"),
        ("a.pcd", pcd("binary_compressed", b""), "save it as ascii or binary"),
        ("a.pcd", pcd("ascii", text(rows(POINTS))), "has 9 points where its header says 10"),
        ("a.pcd", pcd("binary", binary(POINTS)), "is no readable PCD file"),
    ],
)
def test_what_is_no_point_cloud_is_refused_by_name(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    assert message in refusal(ProblemError, read_point_cloud, tmp_path / name)


def test_too_many_boxes_are_refused_with_a_size_that_serves(tmp_path):
    points = np.random.default_rng(0).uniform(0, 1, (3 * MAX_BOXES, 3))
    (tmp_path / "a.xyz").write_bytes(text(points))
    cloud = read_point_cloud(tmp_path / "a.xyz")
    message = refusal(ProblemError, cloud.boxes, 0.02)
    assert "at most 2000 are accepted; a size of 0.08 m makes" in message
    assert len(cloud.boxes(0.08)) <= MAX_BOXES
