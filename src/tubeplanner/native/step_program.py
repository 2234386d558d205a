"""The native program of one step: quadratic, sparse, banded but for a few variables."""

from ctypes import c_double, c_int, c_int64, c_void_p
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function

_new = native_function(
    "step_program_new", c_int64, c_int64, Doubles, Doubles, Doubles, Doubles, returns=c_void_p
)
_delete = native_function("step_program_delete", c_void_p)
_add_quadratic = native_function(
    "step_program_add_quadratic", c_void_p, c_int64, Integers, Integers, Doubles
)
_add_rows = native_function(
    "step_program_add_rows", c_void_p, c_int64, Integers, Integers, Doubles, Doubles
)
_set_slack = native_function("step_program_set_slack", c_void_p, Doubles)
_solve = native_function("step_program_solve", c_void_p, c_double, c_int64, returns=c_int)
_read = native_function("step_program_read", c_void_p, Doubles, Doubles, returns=c_int64)
_MOST_ITERATIONS = 100


class NativeProgram:
    """It minimises x . Q x / 2 + c . x under A x <= b and bounds on x.

    Rows may be added after it was solved: the next solution goes on from the last.
    """

    def __init__(
        self,
        first: FloatArray,
        linear: FloatArray,
        lower: FloatArray,
        upper: FloatArray,
        band: int,
    ) -> None:
        """Set it up without any row.

        Args:
            first: Where x begins, shape (V,).
            linear: c, shape (V,).
            lower: Of x, shape (V,).
            upper: Likewise; may be infinite.
            band: How many of the first variables only rows and Q's entries of neighbours couple.
        """
        self._handle: Any = None
        self._size, self.row_count, self.iterations = len(linear), 0, 0
        self._handle = _call(_new)(len(linear), band, first, linear, lower, upper)

    def __del__(self) -> None:
        if self._handle is not None:
            _call(_delete)(self._handle)

    def add_quadratic(self, row: IntArray, column: IntArray, value: FloatArray) -> None:
        """Add entries (E,) of Q: those above the diagonal and on it are taken."""
        own = (np.ascontiguousarray(part, dtype=np.int64) for part in (row, column))
        _call(_add_quadratic)(self._handle, len(value), *own, np.ascontiguousarray(value))

    def add_rows(
        self, count: IntArray, column: IntArray, value: FloatArray, slack: FloatArray
    ) -> None:
        """Add R rows.

        Args:
            count: How many entries each has, shape (R,).
            column: Where they are, row after row, shape (entries,); they may repeat.
            value: Theirs, shape (entries,).
            slack: b, shape (R,).

        Raises:
            ValueError: They do not fit together, or the program has no such variable.
        """
        fits = len(count) == len(slack) and len(column) == len(value) == count.sum()
        if not fits or column.max(initial=0) >= self._size:
            raise ValueError("rows and slack do not fit the program")
        own = (np.ascontiguousarray(part, dtype=np.int64) for part in (count, column))
        _call(_add_rows)(self._handle, len(slack), *own, np.ascontiguousarray(value), slack)
        self.row_count += len(slack)

    def set_slack(self, slack: FloatArray) -> None:
        """Give all rows other slack (R,); the next solution begins anew."""
        _call(_set_slack)(self._handle, slack)

    def solve(self, tolerance: float) -> tuple[FloatArray, FloatArray] | None:
        """Return x (V,) and the rows' multipliers (R,), or None if it does not get there.

        Args:
            tolerance: Of the gradient, the rows and the cost, absolute.
        """
        is_solved = _call(_solve)(self._handle, tolerance, _MOST_ITERATIONS)
        x, multipliers = np.empty(self._size), np.empty(self.row_count)
        self.iterations = _call(_read)(self._handle, x, multipliers)
        return (x, multipliers) if is_solved else None


def _call(function: Any) -> Any:
    """Return a function of the library."""
    if function is None:
        raise RuntimeError("the native library is left out")
    return function
