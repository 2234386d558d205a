"""Triangles of shapes, tubes, thick lines; viewpoints."""

import numpy as np
import pytest

from tubeplanner import GoalRegion, Obstacle, Tube, placement_of
from tubeplanner.output.drawing import (
    SEGMENT_COLORS,
    best_direction,
    coarse_hull_points,
    dashes,
    directions,
    floor_grid,
    goal_ball,
    joined,
    outline,
    pipe,
    shape_surface,
    tube_surfaces,
)
from tubeplanner.output.figures.space_panel import tube_solids
from tubeplanner.task.endpoints import endpoint_of

CORNERS = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.4, 0.0], [0.5, 0.4, 0.3]]


def volume(surface):
    """Return the enclosed volume; negative if the triangles face inwards."""
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return np.einsum("fi,fi->f", a, np.cross(b, c)).sum() / 6


def test_where_the_tool_may_be_anywhere_there_is_no_skin():
    tube = Tube.anywhere(*np.array(CORNERS[:2]))
    assert tube_surfaces(tube) == []
    assert tube_solids(tube, [SEGMENT_COLORS[0]]) == []


def test_the_skin_of_a_tube_is_closed_and_one_segment_is_a_capsule():
    tube = Tube(CORNERS[:3], 0.05)
    parts = tube_surfaces(tube)
    assert all(abs(tube.margin(part.vertices).max(axis=1)).max() < 0.0015 for part in parts)
    legs, elbow = 0.9 * np.pi * 0.05**2, 4 / 3 * np.pi * 0.05**3
    # At the corner the two cylinders share a wedge of 2/3 r^3 and have a quarter of a ball beside.
    expected = legs + elbow * 1.25 - 2 / 3 * 0.05**3
    assert volume(joined(parts)) == pytest.approx(expected, rel=0.02)
    (capsule,) = tube_surfaces(Tube(CORNERS[:2], 0.1))
    assert volume(capsule) == pytest.approx(np.pi * 0.1**2 * (0.5 + 4 / 3 * 0.1), rel=0.01)


def test_a_pipe_has_its_thickness_and_remembers_its_points():
    line = np.column_stack([np.linspace(0, 1, 11), np.zeros(11), np.zeros(11)])
    surface, owner = pipe(line, 0.01)
    assert volume(surface) == pytest.approx(np.pi * 0.01**2, rel=0.08)
    assert np.linalg.norm(surface.vertices - line[owner], axis=1).max() == pytest.approx(0.01)
    assert set(owner) == set(range(11))
    surface, owner = pipe(np.zeros((5, 3)), 0.01)  # of a tool that stands still
    assert len(surface.faces) == len(owner) == 0
    covered = volume(dashes(np.array(CORNERS), 0.002, 0.04))  # of dashes, about half of a line
    assert covered == pytest.approx(0.6 * 1.2 * np.pi * 0.002**2, rel=0.1)


@pytest.mark.parametrize(
    ("kind", "sizes", "exact"),
    [
        ("box", [[0.1, 0.2, 0.3]], 0.006),
        ("sphere", [0.1], 4 / 3 * np.pi * 1e-3),
        ("capsule", [0.1, 0.2], np.pi * 0.01 * (0.2 + 0.4 / 3)),
    ],
)
def test_shapes_face_outwards(kind, sizes, exact):
    obstacle = getattr(Obstacle, kind)("it", *sizes, placement_of([1, 2, 3]))
    assert volume(shape_surface(obstacle.shapes[0])) == pytest.approx(exact, rel=0.05)


def test_boxes_are_drawn_as_ones_and_their_parts_are_their_boundary():
    section = {"box": [0.2, 0.1], "up": [0, 0, 1]}
    tube = Tube([[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0]], None, cross_section=section)
    parts = tube_surfaces(tube)
    assert max(tube.margin(part.vertices).max() for part in parts) < 1e-3
    both = 2 * 0.2 * 0.1 * 0.6 - 0.15 * 0.15 * 0.1
    assert sum(map(volume, parts)) == pytest.approx(both, rel=0.02)


def test_the_ball_of_a_goal_is_as_large_as_its_tolerance_and_a_point_has_none():
    position = np.array([0.2, 0.01, 0.3])
    (ball,) = goal_ball(endpoint_of(GoalRegion(position, 0.02), position))
    away = np.linalg.norm(ball.vertices - position, axis=1)
    np.testing.assert_allclose(away, 0.02, rtol=1e-5)
    np.testing.assert_allclose(ball.vertices.mean(axis=0), position, atol=1e-3)
    for goal in (None, GoalRegion(position, 0.0)):
        assert goal_ball(endpoint_of(goal, position)) == []


def test_whoever_looks_is_not_behind_a_wall():
    path = np.array([[0, -0.3, 0.2], [0, -0.3, 0.5], [0, 0.3, 0.5], [0, 0.3, 0.2]])
    seen = {}
    for x in (-0.5, 0.5):
        wall = Obstacle.box("wall", [0.02, 4, 8], placement_of([x, 0, 0])).shapes
        seen[x] = best_direction(path, [], [wall])
        assert seen[x][2] > 0
    assert seen[-0.5][0] > 0 > seen[0.5][0]


def test_the_floor_is_a_grid_of_round_lengths_under_all():
    for size, expected in ((0.5, 0.1), (1.2, 0.5), (30.0, 5.0)):
        edges, step = floor_grid(np.array([[0.01, 0, 0], [size, size / 2, 1]]))
        assert step == expected
        assert np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) == pytest.approx(step)
        assert edges[..., 0].min() <= 0
        assert edges[..., 0].max() >= size
        assert (edges[..., 2] == 0).all()


def test_an_outline_holds_all_points():
    flat = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0.5, 0.5, 0]])
    assert (outline(flat).min(axis=0) == 0).all()
    assert (outline(flat).max(axis=0) == [1, 2, 0]).all()
    cloud = directions(500) * np.array([1, 2, 3])
    assert len(coarse_hull_points(cloud)) <= 48
    assert np.ptp(outline(cloud), axis=0) == pytest.approx(np.ptp(cloud, axis=0))
