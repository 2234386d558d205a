"""The map of a cell: which colour or hatching each place of the robot has."""

from dataclasses import replace

import numpy as np
import pytest
from gantry import FLOOR, POST, gantry
from matplotlib.collections import PatchCollection
from matplotlib.patches import Rectangle

from tubeplanner import BasePlacement, load_problem, plot_placement
from tubeplanner.outcome import Location
from tubeplanner.studies.base_regions import Region
from tubeplanner.studies.placement import GivenPlacement, Placement, PlacementRow

GRID = Region.of([-1.0, 1.0, -1.0, 1.0], 0.0).grid(32, 0.0)  # two columns of two, eight angles
CORNERS = [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)]


@pytest.fixture(scope="module")
def placement(tmp_path_factory):
    """A placement of which every cell has something else to say."""
    folder = tmp_path_factory.mktemp("gantry")
    problem = load_problem(gantry(folder, [FLOOR, POST]))
    statuses = dict.fromkeys(GRID.base_placements, ("base_in_obstacle", None))
    first, second, third, _ = ([s for s in GRID.base_placements if s[:2] == at] for at in CORNERS)
    for base_placement, duration in zip(first, (0.9, 0.7, 0.8), strict=False):
        statuses[base_placement] = ("success", duration)
    statuses |= {second[3]: ("unreachable", None), second[5]: ("tube_blocked", None)}
    statuses[third[0]] = ("unreachable", None)
    rows = [PlacementRow(s, status, "", Location(), d) for s, (status, d) in statuses.items()]
    rows.append(PlacementRow(BasePlacement(-0.4, 0.25, 0.0, 0.5), "success", "", Location(), 0.65))
    given = GivenPlacement(BasePlacement(0.0, 0.0, 0.0, 0.0), None, "unreachable")
    region = Region.of([-1.0, 1.0, -1.0, 1.0], 0.0)
    return Placement(problem, region, ("floor",), GRID, tuple(rows), given, rows[-1], None, {})


@pytest.fixture(scope="module")
def axes(placement):
    return plot_placement(placement).axes[0]


def hatched(axes):
    """Return the middles of hatched cells by hatching."""
    cells = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    return {tuple(np.round(cell.get_center(), 9)): cell.get_hatch() for cell in cells}


def test_a_cell_has_the_shortest_duration_of_its_angles(axes):
    (cells,) = [each for each in axes.collections if isinstance(each, PatchCollection)]
    np.testing.assert_array_equal(cells.get_array(), [0.7])
    corners = cells.get_paths()[0].vertices
    np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], [[-1, -1], [0, 0]])


def test_a_cell_without_a_motion_has_the_reason_of_the_angle_that_came_farthest(axes):
    hatches = hatched(axes)
    assert set(hatches) == set(CORNERS[1:])
    assert len(set(hatches.values())) == 3
    words = [text.get_text() for text in axes.figure.legends[0].get_texts()]
    for reason in ("tube blocked", "unreachable", "base in obstacle"):
        assert f"no motion: {reason} (1)" in words


def test_the_cell_is_seen_from_above_in_equal_scale(axes, placement):
    assert axes.get_aspect() == 1
    lines = {line.get_label(): line for line in axes.lines}
    outline = lines["obstacle"].get_xydata()
    ends = outline.min(axis=0), outline.max(axis=0)
    np.testing.assert_allclose(ends, [[-0.4, 0.2], [-0.2, 0.4]])
    path = lines["reference path of the tool"].get_xydata()
    np.testing.assert_allclose(path, placement.problem.tube.points[:, :2])
    assert {"floor", "post"} <= {text.get_text() for text in axes.texts}


def test_stands_have_arrows_along_their_yaw_and_the_search_has_dots(axes):
    arrows = [np.subtract(t.xy, t.get_position()) for t in axes.texts if t.get_text() == ""]
    angles = [np.arctan2(y, x) for x, y in arrows]
    np.testing.assert_allclose(angles, [0.0, 0.5], atol=1e-9)
    lines = {line.get_label(): line.get_xydata().tolist() for line in axes.lines}
    assert lines["pattern search"] == [[-0.4, 0.25]]
    assert lines["as given"] == [[0.0, 0.0]]
    assert lines["best"] == [[-0.4, 0.25]]


def test_a_map_without_any_motion_and_of_one_place_is_drawn(placement, tmp_path, undrawn):
    none = [replace(row, status="unreachable", duration=None) for row in placement.rows[:32]]
    figure = plot_placement(replace(placement, rows=tuple(none), best=None))
    assert len(figure.axes) == 1
    assert len(hatched(figure.axes[0])) == 4
    region = Region.of([0.2, 0.2, 0.3, 0.3], 0.0)
    one = replace(placement, region=region, grid=region.grid(8, 0.0), rows=(), best=None)
    plot_placement(one, tmp_path / "one.png")
    assert (tmp_path / "one.png").read_bytes() == undrawn
