import numpy as np
import pytest

from tubeplanner.simulation.stage import first_instant, last_instant

TIME = np.arange(11) * 0.1  # 0.30000000000000004 among it


@pytest.mark.parametrize(
    ("when", "first", "last"),
    [(0.0, 0, 0), (0.3, 3, 3), (0.35, 4, 3), (1.0, 10, 10), (np.inf, 11, 10)],
)
def test_instants_beside_a_time(when, first, last):
    assert (first_instant(TIME, when), last_instant(TIME, when)) == (first, last)


def test_rounding_makes_no_other_instant():
    for when in (0.3 - 1e-12, 0.3 + 1e-12):
        assert first_instant(TIME, when) == last_instant(TIME, when) == 3
