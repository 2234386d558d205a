"""SpeedPolynomial: a limited quantity over path speed; the largest speed, native or NumPy."""

import numpy as np
import pytest

from tubeplanner.limits import speed_polynomial as speed_roots
from tubeplanner.limits.speed_polynomial import SpeedPolynomial, largest_speed
from tubeplanner.native.library import LIBRARY

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")


@NEEDS_LIBRARY
@pytest.mark.parametrize(
    ("powers", "signs"),
    [
        ((3,), (1.0, -1.0)),
        ((0, 2), (1.0, -1.0)),
        ((0, 1, 2), (1.0,)),
        ((0, 1, 2, 3), (1.0, -1.0)),
        ((1, 3), (1.0,)),
    ],
)
def test_largest_speeds_agree_to_rounding(powers, signs, monkeypatch):
    rng = np.random.default_rng(5)
    # Of many sizes; zeros here and there; what is held is too much, or all there is, in places.
    terms = {k: rng.normal(size=(400, 3)) * 10.0 ** rng.integers(-6, 6, (400, 3)) for k in powers}
    for k, term in terms.items():
        term[rng.uniform(size=term.shape) < 0.2] = 0.0
        if k == 0:
            term[:] = np.clip(term, -1.2, 1.2)
            term[::7] = 1.0
    used = SpeedPolynomial(terms)
    compiled = used.largest_speed(signs)
    monkeypatch.setattr(speed_roots, "_speeds", None)
    pure = used.largest_speed(signs)
    np.testing.assert_allclose(compiled, pure, rtol=1e-9)
    assert np.isinf(pure).any() or len(signs) > 1


COUNT = 20_000


def value(c, s):
    return ((c[3] * s + c[2]) * s + c[1]) * s + c[0]


def size(c, s):
    return value(abs(c), s)


def plain(rng):
    return rng.normal(size=(4, COUNT))


def of_any_size(rng):
    return plain(rng) * 10.0 ** rng.uniform(-6, 6, (4, COUNT))


def with_zeros(rng):
    return rng.integers(-2, 3, size=(4, COUNT)).astype(float)


def with_near_roots(rng):
    """Two roots, or all three, nearly coincide."""
    first, other = rng.uniform(0, 2, (2, COUNT))
    a, b = first, first * (1 + 10.0 ** rng.uniform(-16, -3, COUNT))
    c = np.where(rng.uniform(size=COUNT) < 0.5, other, first * (1 + 1e-9))
    rows = np.array([-a * b * c, a * b + a * c + b * c, -(a + b + c), np.ones(COUNT)])
    return rows * rng.choice([-1.0, 1.0], COUNT)


@pytest.mark.parametrize("cubics", [plain, of_any_size, with_zeros, with_near_roots])
def test_it_is_the_first_crossing(cubics):
    c = cubics(np.random.default_rng(1))
    s = largest_speed(c)
    assert not np.isnan(s).any()
    assert (s[c[0] > 0] == 0).all()
    crossing = np.isfinite(s) & (s > 0)
    at = np.where(crossing, s, 0.0)
    assert (abs(value(c, at)) <= 1e-12 * size(c, at))[crossing].all()
    free = np.where(np.isfinite(s), s, 1e3)
    for fraction in np.linspace(0, 1, 41)[:-1]:
        slower = fraction * free
        assert (value(c, slower) <= 1e-12 * size(c, slower))[s > 0].all()


def test_beyond_it_the_cubic_is_above_zero():
    c = plain(np.random.default_rng(2))
    s = largest_speed(c)
    crossing = np.isfinite(s) & (s > 0)
    a_little = 1e-6 * np.maximum(s, 1.0)
    above = value(c, s + a_little)[crossing] > 0
    # But for a crossing that turns back within that little.
    assert above.mean() > 0.9999


INF, BOTH = np.inf, (1.0, -1.0)


@pytest.mark.parametrize(
    ("terms", "signs", "speeds"),
    [
        *[({k: [0.5, -2.0, 0]}, BOTH, [2 ** (1 / k), 0.5 ** (1 / k), INF]) for k in (1, 2, 3)],
        *[({k: [0.5, -2.0, 0]}, (1.0,), [2 ** (1 / k), INF, INF]) for k in (1, 2, 3)],
        # Held, against friction, to accelerate: all of the motor at s = 1.
        ({0: [0.2], 1: [0.3], 2: [0.5]}, BOTH, [1.0]),
        # What is used up allows rest alone.
        ({0: [1.0, 1.0], 1: [0.1, 0.0]}, (1.0,), [0.0, INF]),
        # Held to one side, driven to the other: 0.25 s + 0.5 s^2 reach 1.5.
        ({0: [0.5, -0.5], 1: [-0.25, 0.25], 2: [-0.5, 0.5]}, BOTH, [1.5, 1.5]),
        ({0: [0.5], 1: [-0.25], 2: [-0.5]}, (1.0,), [INF]),
        ({0: [-0.5], 1: [0.25], 2: [0.5]}, (-1.0,), [INF]),
        # Gravity beyond the motor stops it in either direction.
        ({0: [1.2, 0.8], 2: [-0.4, -0.4]}, BOTH, [0.0, np.sqrt(1.8 / 0.4)]),
        ({0: [-1.2, -0.8], 2: [0.4, 0.4]}, BOTH, [0.0, np.sqrt(1.8 / 0.4)]),
        # -1 times a jerk of 0 is -0: the turning point at infinity has either sign.
        ({0: [0.0], 1: [0.0], 2: [-4.0], 3: [0.0]}, BOTH, [0.5]),
    ],
)
def test_the_largest_speed_is_the_root_of_either_side(terms, signs, speeds):
    used = SpeedPolynomial({k: np.array([term], dtype=float) for k, term in terms.items()})
    np.testing.assert_allclose(used.largest_speed(signs), [speeds], rtol=1e-14)


def test_a_polynomial_is_the_sum_of_its_terms():
    speed = 0.5
    terms = {0: np.array([[0.2, -1.0]]), 1: np.array([[0.3, 0.0]]), 3: np.array([[0.5, 2.0]])}
    at = SpeedPolynomial(terms).at(speed)
    np.testing.assert_allclose(at, terms[0] + terms[1] * speed + terms[3] * speed**3)
    assert SpeedPolynomial(terms).degree == 3
