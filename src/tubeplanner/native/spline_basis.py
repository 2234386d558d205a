"""Cubic splines over phases at samples, compiled: weights, values, changes by switching times.

Knots are given as samples are: by phase and share of it, the end included. Every function returns
None if the library is left out.
"""

from ctypes import c_int64
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function

Knots: TypeAlias = tuple[IntArray, FloatArray]
Places: TypeAlias = tuple[IntArray, FloatArray, IntArray]

_PLACES = (Doubles, c_int64, Integers, Doubles, c_int64, Integers, Doubles, Integers)
_weights = native_function("cubic_weights", *_PLACES, Doubles)
_by_switching = native_function(
    "cubic_by_switching", *_PLACES, c_int64, Doubles, c_int64, Doubles, Integers
)
_values = native_function(
    "cubic_values", c_int64, c_int64, c_int64, Doubles, Integers, Doubles, Doubles
)


def cubic_weights(switching_times: FloatArray, knots: Knots, samples: Places) -> FloatArray | None:
    """Return the weights of four control points in position and derivatives, shape (4, N, 4).

    Args:
        switching_times: Ends of the phases, shape (m+1,).
        knots: Phases and shares of the M+1 knots, the last one the end.
        samples: Phases, shares and knot intervals of N samples.
    """
    if _weights is None:
        return None
    count = len(samples[0])
    weights = np.empty((4, count, 4))
    _weights(switching_times, len(knots[0]) - 1, *knots, count, *samples, weights)
    return weights


def cubic_by_switching(
    switching_times: FloatArray, knots: Knots, samples: Places, control: FloatArray, switches: int
) -> tuple[FloatArray, IntArray] | None:
    """Return how positions and derivatives change with inner switching times.

    Args:
        switching_times: As for `cubic_weights`.
        knots: Likewise.
        samples: Likewise.
        control: Control points, shape (K, n).
        switches: Number G of the inner switching times.

    Returns:
        Shape (G, 4, N, n), and which switching times change each sample: the first and the one
        after the last, shape (N, 2).
    """
    if _by_switching is None:
        return None
    count, joints, control = len(samples[0]), control.shape[1], np.ascontiguousarray(control)
    changes = np.zeros((switches, 4, count, joints))
    moved = np.empty((count, 2), dtype=np.int64)
    places = (switching_times, len(knots[0]) - 1, *knots, count, *samples)
    _by_switching(*places, joints, control, switches, changes, moved)
    return changes, moved


def cubic_values(weights: FloatArray, first: IntArray, control: FloatArray) -> FloatArray | None:
    """Return the values that weights (orders, N, 4) give, shape (orders, N, n).

    Args:
        weights: Of four control points at each of N samples.
        first: The first of these, shape (N,).
        control: Control points, shape (K, n).
    """
    if _values is None:
        return None
    orders, count = weights.shape[:2]
    control = np.ascontiguousarray(control)
    values = np.empty((orders, count, control.shape[1]))
    own = (np.ascontiguousarray(weights), np.ascontiguousarray(first), control)
    _values(orders, count, control.shape[1], *own, values)
    return values
