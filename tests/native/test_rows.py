"""Compiled rows against those in numpy."""

from itertools import product

import numpy as np
import pytest

from tubeplanner.native.library import LIBRARY
from tubeplanner.optimizer import phased_spline
from tubeplanner.optimizer import rows as optimizer_rows
from tubeplanner.optimizer.phased_spline import PhasedSpline, VelocityHull, sampled
from tubeplanner.optimizer.rows import Rows, StepSize, plane_rows, sided_rows
from tubeplanner.optimizer.starts import knot_grid

pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")

TIMES = np.array([0.0, 0.2, 0.3, 0.5, 0.6, 0.9, 1.0])
GRID = knot_grid(TIMES, 25)
SIZES = [None, StepSize(0.01, np.full(5, 0.002)), StepSize(0.2, np.full(5, 0.03))]
IN_UNITS = {
    joints: StepSize(0.05, np.full(5, 0.01), np.arange(1.0, joints + 1)) for joints in (2, 7)
}


def pure(monkeypatch):
    monkeypatch.setattr(phased_spline, "_chained", None)
    for name in ("_near", "_reach", "_used"):
        monkeypatch.setattr(optimizer_rows, name, None)


def at(joints, hull=False):
    control = np.random.default_rng(joints).normal(size=(GRID.control_point_count, joints))
    points = VelocityHull(GRID.control_point_count) if hull else GRID.samples(np.arange(2) / 2)
    return sampled(PhasedSpline(GRID, TIMES, control), points)


def alike(rows: Rows, others: Rows):
    for name in Rows.__dataclass_fields__:
        ours, theirs = getattr(rows, name), getattr(others, name)
        assert ours.shape == theirs.shape
        np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)


def rows_of(spline, size) -> list[Rows]:
    rng, (count, joints) = np.random.default_rng(1), spline.by_x.shape[1:]
    orders = range(1, 2) if len(spline.basis) == 2 else (0, 1, 3)
    by_path = {order: 0.01 * 0.1**order * rng.normal(size=(count, 3, joints)) for order in orders}
    used, limit = rng.uniform(-1, 1, (count, 3)), rng.integers(0, 9, (count, 3))
    change = (rng.normal(size=used.shape), 0.5)
    sided = sided_rows(spline, by_path, used, change, limit, (1.0, -1.0), size)
    slack = rng.uniform(-0.1, 0.4, (count, 2))
    slack[::3] = np.inf
    by_joint = rng.normal(size=(count, 2, joints))
    return [sided, plane_rows(spline, by_joint, slack, limit[:, 0], size)]


@pytest.mark.parametrize(("joints", "size"), [*product((2, 7, 11), SIZES), *IN_UNITS.items()])
@pytest.mark.parametrize("hull", [False, True])
def test_rows_agree_to_rounding(joints, size, hull, monkeypatch):
    spline = at(joints, hull)
    compiled = rows_of(spline, size)
    step = (np.ones((GRID.control_point_count, joints)), np.arange(5.0), 0.3)
    products = [rows.used_by_step(*step) for rows in compiled]
    other = size or SIZES[1]
    reaches = [rows.reach(other) for rows in compiled]
    pure(monkeypatch)
    for rows, others in zip(compiled, rows_of(spline, size), strict=True):
        alike(rows, others)
    for rows, used, reach in zip(compiled, products, reaches, strict=True):
        np.testing.assert_allclose(used, rows.used_by_step(*step), rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(reach, rows.reach(other), rtol=1e-10)
