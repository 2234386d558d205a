"""Rows of a limit with every power of the speed: held, rubbing, accelerated and jerked."""

from types import SimpleNamespace

import numpy as np
import pytest

from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.refinement.sampled_spline import sampled
from tubeplanner.refinement.speed_limit_rows import EvaluatedSpeedLimit

NUMBERS = np.array([7, 4])  # of the limit's two keys


class EveryPower:
    """A `SpeedLimit`: two quantities, of the first joint and of the sum of all, with all powers."""

    kind = "every power"
    keys = (None, None)

    def __init__(self, signs):
        self.signs = signs

    def used(self, at):
        q, v, a, j = (self._two(values) for values in at.by_path)
        return SpeedPolynomial({0: 0.01 * q**2, 1: 0.05 * v * q, 2: 0.01 * a, 3: 0.002 * j})

    def by_path(self, at, speed):
        q, v, _, _ = (self._two(values) for values in at.by_path)
        weights = np.stack([np.eye(at.position.shape[1])[0], np.ones(at.position.shape[1])])
        factors = {
            0: 0.02 * q + 0.05 * v * speed,
            1: 0.05 * q * speed,
            2: np.full_like(q, 0.01 * speed**2),
            3: np.full_like(q, 0.002 * speed**3),
        }
        return {order: factor[:, :, None] * weights for order, factor in factors.items()}

    def key_of(self, at):
        return np.array([[1, 0]])

    @staticmethod
    def _two(values):
        return np.stack([values[:, 0], values.sum(axis=1)], axis=1)


@pytest.fixture(params=[(1.0,), (1.0, -1.0)], ids=["one side", "both sides"])
def evaluate(request, case):
    """Return a function from a spline to the limit at its samples."""
    problem, _, samples = case

    def at(spline):
        known = sampled(spline, samples)
        path = PathSamples(problem, known.by_x, lambda: samples.phase)
        return EvaluatedSpeedLimit(EveryPower(request.param), known, path, NUMBERS)

    return SimpleNamespace(at=at, spline=case[1])


@pytest.mark.parametrize("longer", [0.7, 1.0, 1.3])
def test_slack_in_another_duration_is_that_of_its_own_rows(evaluate, longer):
    """Multiplied by the highest power of the ratio of the durations, by which rows are told."""
    limit, duration = evaluate.at(evaluate.spline), 0.8
    there = limit.rows(longer * duration, None)
    slack = limit.slack(duration, longer**2)
    np.testing.assert_allclose(slack[there.index], longer**3 * there.slack, rtol=1e-12, atol=1e-12)


def test_the_least_duration_just_keeps_every_side(evaluate):
    limit = evaluate.at(evaluate.spline)
    bounded = np.flatnonzero(limit.squared_durations > 0)  # no speed is too fast elsewhere
    assert len(bounded) > 0
    for i in bounded:
        used = limit.limit.used(limit.path).at(limit.squared_durations[i] ** -0.5)[i]
        sides = np.concatenate([sign * used for sign in limit.limit.signs])
        assert sides.max() == pytest.approx(1.0, abs=1e-9)
