"""Compiled largest speeds against those in numpy."""

import numpy as np
import pytest

from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.native import speed_roots
from tubeplanner.native.library import LIBRARY

pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")


@pytest.mark.parametrize("powers", [(1,), (3,), (0, 2), (0, 1, 2), (0, 1, 2, 3), (1, 3)])
@pytest.mark.parametrize("signs", [(1.0,), (1.0, -1.0)])
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
