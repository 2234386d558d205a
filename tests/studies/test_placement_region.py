"""Regions for a robot's base: what they hold, and the stands spread over them."""

import numpy as np
import pytest

from tubeplanner import OptionError, Stand
from tubeplanner.studies.placement_region import Region


def test_a_grid_stands_in_the_middles_of_cells_and_turns_all_the_way():
    grid = Region.of([0.0, 1.0, -1.0, 1.0], 0.25).grid(8 * 8, 0.5)
    stands = np.array(grid.stands)
    assert grid.spacing == (0.5, 0.5, 0.0, np.pi / 4)
    assert len(stands) == len(set(grid.stands)) == 64
    np.testing.assert_allclose(np.unique(stands[:, 0]), [0.25, 0.75])
    np.testing.assert_allclose(np.unique(stands[:, 1]), [-0.75, -0.25, 0.25, 0.75])
    assert set(stands[:, 2]) == {0.25}
    turns = np.sort((stands[:8, 3] - 0.5) % (2 * np.pi) / (np.pi / 4))
    np.testing.assert_allclose(turns, np.arange(8), atol=1e-5)
    assert 0.5 in stands[:, 3]
    assert (abs(stands[:, 3]) <= np.pi).all()


@pytest.mark.parametrize(
    ("bounds", "count", "columns"),
    [
        ([0, 0, 0, 2], 80, (1, 10, 1, 8)),
        ([0, 2, 1, 1], 80, (10, 1, 1, 8)),
        ([1, 1, 1, 1], 80, (1, 1, 1, 8)),
        ([1, 1, 1, 1], 3, (1, 1, 1, 3)),
        ([0, 1, 0, 1, 0, 1], 9 * 24, (3, 3, 3, 8)),
        ([0, 1, 0, 1, 0, 1], 8, (1, 1, 1, 8)),
        ([0, 9, 0, 1], 72, (9, 1, 1, 8)),
        ([0, 900, 0, 1], 72, (9, 1, 1, 8)),
    ],
)
def test_a_grid_has_about_as_many_stands_as_asked_in_cells_as_square_as_can_be(
    bounds, count, columns
):
    region = Region.of(bounds, 0.0)
    stands = region.grid(count, 0.0).stands
    assert tuple(len(set(values)) for values in zip(*stands, strict=True)) == columns
    assert len(stands) == np.prod(columns)
    assert all(region.holds(stand) for stand in stands)


def test_the_nearest_stand_is_in_the_region_and_rounded():
    region = Region.of([0.0, 1 / 3, -1.0, 1.0], 0.1)
    assert region.nearest(Stand(2, -2, 0.3, 4.0)) == Stand(
        1 / 3, -1.0, 0.1, round(4 - 2 * np.pi, 6)
    )
    assert region.nearest(Stand(0.12345649, 0.0, 0.1, 1.0)) == Stand(0.123456, 0.0, 0.1, 1.0)
    assert region.holds(region.nearest(Stand(9, 9, 9, 9)))
    assert not region.holds(Stand(0.1, 0.0, 0.11, 0.0))


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ([0, 1, 0], "give X0, X1, Y0, Y1"),
        ([0, 1, 0, 1, 2], "give X0, X1, Y0, Y1"),
        ([0, 1, 0, float("nan")], "give X0, X1, Y0, Y1"),
        ([0, 1, 0, True], "give X0, X1, Y0, Y1"),
        ([0, 1, 0.5, 0.2], "y goes from 0.5 to 0.2 m"),
    ],
)
def test_what_is_no_region_is_refused(bounds, message):
    with pytest.raises(OptionError, match=message):
        Region.of(bounds, 0.0)
