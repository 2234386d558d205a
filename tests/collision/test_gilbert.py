"""Separating directions of random hulls against a quadratic program's distances."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from tubeplanner.collision.gilbert import separating_directions


def shortest(first, second):
    """Return the distance of two hulls, by weights on their points."""
    count = len(first)

    def squared(weights):
        gap = weights[count:] @ second - weights[:count] @ first
        return gap @ gap, np.concatenate([-2 * first @ gap, 2 * second @ gap])

    sums = [
        {"type": "eq", "fun": lambda w, part=part: w[part].sum() - 1}
        for part in (slice(count), slice(count, None))
    ]
    begin = np.full(count + len(second), 1 / count)
    bounds = [(0, 1)] * len(begin)
    found = minimize(
        squared, begin, jac=True, method="SLSQP", bounds=bounds, constraints=sums,
        options={"ftol": 1e-14, "maxiter": 500},
    )  # fmt: skip
    return np.sqrt(found.fun)


@pytest.fixture(scope="module")
def hulls():
    rng = np.random.default_rng(8)
    first, second = rng.uniform(-0.2, 0.2, (2, 8, 3))
    turned = Rotation.random(30, random_state=9).as_matrix()
    moved = rng.normal(size=(30, 3))
    moved *= rng.uniform(0.5, 1.0, (30, 1)) / np.linalg.norm(moved, axis=1, keepdims=True)
    return first, second, turned, moved


def test_distances_are_those_of_a_quadratic_program(hulls):
    first, second, turned, moved = hulls
    placed = np.einsum("nij,vj->nvi", turned, first) + moved[:, None]
    gap = second[0] - placed[:, 0]
    distance, direction = separating_directions(
        first, second, turned, moved, gap, max_steps=3000, loose=1e-5
    )
    exact = np.array([shortest(points, second) for points in placed])
    assert (exact > 0.01).sum() > 20
    apart = exact > 0.01
    assert distance[apart] == pytest.approx(exact[apart], abs=2e-5)
    along = np.einsum("vi,ni->nv", second, direction).min(axis=1)
    along -= np.einsum("nvi,ni->nv", placed, direction).max(axis=1)
    np.testing.assert_allclose(along[apart], distance[apart], atol=1e-12)


def test_what_has_enough_is_no_longer_looked_at(hulls):
    first, second, turned, moved = hulls
    gap = second[0] - np.einsum("nij,j->ni", turned, first[0]) - moved
    arguments = (first, second, turned, moved, gap)
    once, _ = separating_directions(*arguments, max_steps=1)
    again, _ = separating_directions(*arguments, max_steps=50, enough=0.0)
    assert (once >= 0).any()
    assert (again[once >= 0] == once[once >= 0]).all()
    assert (again >= once).all()
