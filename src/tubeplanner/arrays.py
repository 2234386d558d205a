"""Array types; arrays handed out read-only."""

from numbers import Real
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]


def read_only(values: object) -> FloatArray:
    """Return a float64 copy that cannot be written to.

    Raises:
        TypeError: The values are not real numbers: complex, truth values, text, or masked.
        ValueError: They have no shape, or are too large.
    """
    given = np.asanyarray(values)
    if given.dtype.kind not in "iuf":
        numbers = given.dtype.kind == "O" and all(_is_number(value) for value in given.flat)
        if not numbers:
            raise TypeError(f"real numbers are needed, not {given.dtype}")
    if isinstance(given, np.ma.MaskedArray):
        raise TypeError("a masked array has no value where it is masked; fill it")
    try:
        array = np.array(given, dtype=np.float64)
    except OverflowError:
        raise ValueError("a whole number is too large") from None
    array.setflags(write=False)
    return array


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)
