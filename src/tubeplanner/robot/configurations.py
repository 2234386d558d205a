"""Configurations, one or many: methods that take (N, n) and, without the leading axis, (n,)."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError

_Method = TypeVar("_Method", bound=Callable[..., Any])


def one_or_many(axis: int = 0) -> Callable[[_Method], _Method]:
    """Return a decorator of a method of an arm that takes configurations (N, n), and their rates.

    With (n,) the method then returns its arrays without the axis of the samples. What has another
    shape raises RobotError.

    Args:
        axis: Which axis of the arrays that the method returns is that of the samples.
    """

    def decorated(method: _Method) -> _Method:
        signature = inspect.signature(method)

        @wraps(method)
        def taking(self: Any, *given: FloatArray, **named: FloatArray) -> Any:
            if named:
                given = signature.bind(self, *given, **named).args[1:]
            # Inner loops call this with arrays of many samples: they cost no more than this test.
            if _are_many(given, self.joint_count):
                return method(self, *given)
            arrays = [np.asarray(values, dtype=np.float64) for values in given]
            names = list(signature.parameters)[1:]
            _require_shapes(names, arrays, self.joint_count)
            if arrays[0].ndim == 2:
                return method(self, *arrays)
            return _first(method(self, *(values[None] for values in arrays)), axis)

        return cast(_Method, taking)

    return decorated


def _are_many(given: tuple[FloatArray, ...], joint_count: int) -> bool:
    """Return whether all are arrays of one shape (N, n)."""
    if not given or type(given[0]) is not np.ndarray:
        return False
    shape = given[0].shape
    return (
        len(shape) == 2
        and shape[1] == joint_count
        and all(type(values) is np.ndarray and values.shape == shape for values in given[1:])
    )


def _require_shapes(names: list[str], arrays: list[FloatArray], joint_count: int) -> None:
    """Raise RobotError unless arrays have one shape, (n,) or (N, n)."""
    shape = arrays[0].shape if arrays else ()
    if shape != (joint_count,) and (len(shape) != 2 or shape[1] != joint_count):
        raise RobotError(
            f"{names[0]} has shape {shape}; the arm has {joint_count} joints: give "
            f"({joint_count},), or (N, {joint_count}) for N configurations"
        )
    for name, values in zip(names, arrays, strict=True):
        if values.shape != shape:
            raise RobotError(
                f"{name} has shape {values.shape}, and {names[0]} {shape}; give one shape"
            )


def _first(result: FloatArray | tuple[FloatArray, ...], axis: int) -> Any:
    """Return an array or several without an axis of length 1."""
    if isinstance(result, tuple):
        return tuple(values.squeeze(axis) for values in result)
    return result.squeeze(axis)
