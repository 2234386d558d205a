"""SpeedPolynomial: a limited quantity over path speed; the largest speed, native or NumPy."""

from collections.abc import Mapping
from ctypes import c_int64
from dataclasses import dataclass
from functools import reduce

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.native.library import Doubles, native_function

_POWERS = range(4)
_speeds = native_function(
    "largest_speeds", c_int64, *(Doubles for _ in _POWERS), c_int64, Doubles, Doubles
)


def largest_speeds(terms: Mapping[int, FloatArray], signs: tuple[float, ...]) -> FloatArray | None:
    """Return the largest speeds s with sign * (sum of terms[k] s^k) <= 1 for all signs, compiled.

    Args:
        terms: By the power k, from 0 to 3, all of one shape; some power above 0 is there.
        signs: Of the sides.

    Returns:
        Of that shape; 0 where no speed is slow enough, inf where any is. None without the native
        library.
    """
    if _speeds is None:
        return None
    speed = np.empty(next(iter(terms.values())).shape)
    arrays = {k: np.ascontiguousarray(term) for k, term in terms.items()}
    _speeds(speed.size, *(arrays.get(k) for k in _POWERS), len(signs), np.array(signs), speed)
    return speed


# ---- A limited quantity as a polynomial in the speed at which a path is run.
#
# A path q(x) run at the speed s = dx/dt has s times the velocity dq/dx, s^2 times the acceleration,
# and s^3 times the jerk (Hollerbach, "Dynamic scaling of manipulator trajectories", 1984; Suh &
# Bishop 1988, property 2). A limited quantity is a sum of such terms: gravity and Coulomb friction
# with s^0, velocity, viscous friction and tool speed with s, inertia with s^2, jerk with s^3.

_DEGREE = 3
_MAX_STEPS = 60  # halving alone leads to rounding in 53
_ROUNDING = 2e-15  # of the sum of the terms' magnitudes


@dataclass(frozen=True, eq=False)
class SpeedPolynomial:
    """I quantities of N samples at any speed s: the sum of terms[k] s^k."""

    terms: Mapping[int, FloatArray]  # by the power k, from 0 to 3, each (N, I)
    # the limits as fractions of nominal limits, (N, I), where they are less; terms[0] contains
    # their shortfall. None: the nominal limits.
    allowed: FloatArray | None = None

    @property
    def degree(self) -> int:
        """The highest power."""
        return max(self.terms)

    @property
    def shape(self) -> tuple[int, ...]:
        """N and I."""
        return next(iter(self.terms.values())).shape

    def at(self, speed: float) -> FloatArray:
        """Return the quantities at a speed, shape (N, I)."""
        return self.weighted({k: speed**k for k in self.terms})

    def weighted(self, weights: Mapping[int, float]) -> FloatArray:
        """Return the sum of the terms times weights of their powers, shape (N, I)."""
        value: FloatArray = reduce(np.add, (c * weights[k] for k, c in self.terms.items()))
        return value

    def largest_speed(self, signs: tuple[float, ...]) -> FloatArray:
        """Return the largest speed with sign * quantity <= 1 for all signs, shape (N, I)."""
        speed = largest_speeds(self.terms, signs)
        if speed is not None:
            return speed
        return np.minimum.reduce([self._one_sided(sign) for sign in signs])

    def _one_sided(self, sign: float) -> FloatArray:
        powers = [k for k in self.terms if k > 0]
        static = sign * self.terms[0] if 0 in self.terms else np.zeros(())
        if len(powers) == 1:
            return _root(powers[0], 1 - static, sign * self.terms[powers[0]])
        c = np.zeros((_DEGREE + 1, *self.terms[powers[0]].shape))
        for k, term in self.terms.items():
            c[k] = sign * term
        c[0] -= 1
        return largest_speed(c)


def _root(power: int, available: FloatArray, use: FloatArray) -> FloatArray:
    """Return the largest s with use * s^power <= available, 0 where nothing is available."""
    available = np.broadcast_to(available, use.shape)
    root = np.full(use.shape, np.inf)
    np.divide(available, use, out=root, where=(use > 0) & (available > 0))
    root[(available < 0) | ((available == 0) & (use > 0))] = 0.0
    return root if power == 1 else np.power(root, 1 / power)


def largest_speed(c: FloatArray) -> FloatArray:
    """Return the largest s >= 0 up to which cubics c0 + c1 s + c2 s^2 + c3 s^3 are at most zero.

    That is their first crossing: no smaller s is above. A closed form gives the root (Press et al.,
    "Numerical Recipes", 2007, section 5.6); safeguarded steps by Newton's method restore the digits
    lost by rounding.

    Args:
        c: Coefficients, shape (4, ...).

    Returns:
        Shape (...); 0 where c0 > 0 or the cubic rises above zero at once, inf where it never does.
    """
    shape, c = c.shape[1:], c.reshape(_DEGREE + 1, -1)
    with np.errstate(all="ignore"):
        scale = _scale(c)
        c = c * scale ** np.arange(_DEGREE + 1)[:, None]
        c = c / np.maximum(abs(c).max(axis=0), np.finfo(float).tiny)
        low, high, crosses = _bracket(c)
        result = np.full(len(crosses), np.inf)
        # Where nothing crosses zero, Newton's method would look for it in vain.
        rising, low, high = c[:, crosses], low[crosses], high[crosses]
        roots = (np.clip(np.nan_to_num(root), low, high) for root in _closed_form(rising))
        inside = np.array([low, high, *roots])
        misses = np.array([abs(_value(rising, position)) for position in inside])
        nearest = np.take_along_axis(inside, misses.argmin(axis=0)[None], axis=0)[0]
        result[crosses] = _polished(rising, nearest, low, high) * scale[crosses]
    result[c[0] > 0] = 0.0
    return result.reshape(shape)


def _scale(c: FloatArray) -> FloatArray:
    """Return the largest size that roots can have, within a factor of two; 1 if there are none.

    (Fujiwara's bound, "Ueber die obere Schranke des absoluten Betrages der Wurzeln", 1916.)
    """
    size, degree = abs(c), _degree(c)
    lead = np.take_along_axis(size, degree[None], axis=0)[0]
    bound = np.zeros_like(lead)
    for k in range(_DEGREE):
        fraction = (size[k] / lead) ** (1 / np.maximum(degree - k, 1))
        bound = np.where(k < degree, np.maximum(bound, fraction), bound)
    return np.where(bound > 0, bound, 1.0)


def _degree(c: FloatArray) -> IntArray:
    """Return the power of the last coefficient that is not zero."""
    degree: IntArray = _DEGREE - (c[::-1] != 0).argmax(axis=0)
    return degree


def _bracket(c: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return intervals of first crossings, monotone inside, and True where a crossing exists."""
    turns = _quadratic(c[1], 2 * c[2], 3 * c[3])  # one of them infinite where c3 is zero
    early, late = (np.where((e > 0) & (e < np.inf), e, np.nan) for e in turns)
    first, last = np.fmin(early, late), np.fmax(early, late)
    above_first, above_last = _value(c, first) > 0, _value(c, last) > 0
    lead = np.take_along_axis(c, _degree(c)[None], axis=0)[0]
    before_end = np.where(np.isnan(last), 0.0, last)
    far = np.maximum(2.5, before_end)  # roots are at most twice the scale
    low = np.where(above_first, 0.0, np.where(above_last, first, before_end))
    high = np.where(above_first, first, np.where(above_last, last, far))
    return low, high, above_first | above_last | (lead > 0)


def _polished(c: FloatArray, root: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return roots to rounding, each in an interval in which its cubic rises through zero.

    By Newton's steps, by halves where these leave the interval. A single step suffices except for
    roots that nearly coincide.
    """
    root, low, high = root.copy(), low.copy(), high.copy()
    active = np.arange(len(root))
    for _ in range(_MAX_STEPS):
        value = _value(c[:, active], root[active])
        rough = abs(value) > _ROUNDING * _value(abs(c[:, active]), root[active])
        active, value = active[rough], value[rough]
        if len(active) == 0:
            break
        above = value > 0
        high[active[above]], low[active[~above]] = root[active[above]], root[active[~above]]
        a, s = c[:, active], root[active]
        step = s - value / ((3 * a[3] * s + 2 * a[2]) * s + a[1])
        begin, end = low[active], high[active]
        root[active] = np.where((step > begin) & (step < end), step, (begin + end) / 2)
    return root


def _closed_form(c: FloatArray) -> tuple[FloatArray, ...]:
    """Return all roots of the cubics and of the quadratics that they may be."""
    quadratic = _quadratic(c[0], c[1], c[2])
    if not c[3].any():
        return quadratic
    a, b, d = c[2] / c[3], c[1] / c[3], c[0] / c[3]
    q, r = (a**2 - 3 * b) / 9, (2 * a**3 - 9 * a * b + 27 * d) / 54
    angle = np.arccos(np.clip(r / np.sqrt(q**3), -1.0, 1.0))
    three = [
        -2 * np.sqrt(q) * np.cos((angle + turn) / 3) - a / 3
        for turn in (0.0, 2 * np.pi, -2 * np.pi)
    ]
    first = -np.sign(r) * np.cbrt(abs(r) + np.sqrt(r**2 - q**3))
    single = first + np.where(first == 0, 0.0, q / first) - a / 3
    return (*three, single, *quadratic)


def _quadratic(c0: FloatArray, c1: FloatArray, c2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the roots of quadratics, or of lines without a square term; nan where none is real.

    (Press et al., section 5.6, without cancellation.)
    """
    half = -(c1 + np.where(c1 < 0, -1.0, 1.0) * np.sqrt(c1**2 - 4 * c2 * c0)) / 2
    return half / c2, c0 / half


def _value(c: FloatArray, s: FloatArray) -> FloatArray:
    value: FloatArray = ((c[3] * s + c[2]) * s + c[1]) * s + c[0]
    return value
