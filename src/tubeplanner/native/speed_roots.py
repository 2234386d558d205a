"""Up to which speeds polynomials stay within bounds, compiled."""

from collections.abc import Mapping
from ctypes import c_int64

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.native.library import Doubles, native_function

_POWERS = range(4)
_speeds = native_function(
    "largest_speeds", c_int64, *(Doubles for _ in _POWERS), c_int64, Doubles, Doubles
)


def largest_speeds(terms: Mapping[int, FloatArray], signs: tuple[float, ...]) -> FloatArray | None:
    """Return up to which speeds sign * (sum of terms[k] s^k) <= 1 for all signs.

    Args:
        terms: By the power k, from 0 to 3, all of one shape; some power above 0 is there.
        signs: Of the sides.

    Returns:
        Of that shape; 0 where no speed is slow enough, inf where any is. None if the library is
        left out.
    """
    if _speeds is None:
        return None
    found = np.empty(next(iter(terms.values())).shape)
    given = {k: np.ascontiguousarray(term) for k, term in terms.items()}
    _speeds(found.size, *(given.get(k) for k in _POWERS), len(signs), np.array(signs), found)
    return found
