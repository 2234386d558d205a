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
    source = np.asanyarray(values)
    if source.dtype.kind not in "iuf":
        numbers = source.dtype.kind == "O" and all(
            isinstance(value, Real) and not isinstance(value, bool | np.bool_)
            for value in source.flat
        )
        if not numbers:
            raise TypeError(f"real numbers are needed, not {source.dtype}")
    if isinstance(source, np.ma.MaskedArray):
        raise TypeError("a masked array has no value where it is masked; fill it")
    try:
        array = np.array(source, dtype=np.float64)
    except OverflowError:
        raise ValueError("a whole number is too large") from None
    array.setflags(write=False)
    return array
