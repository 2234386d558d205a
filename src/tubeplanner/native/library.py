"""The native library, if it was built, and the argument types of its functions.

TUBEPLANNER_PURE=1 leaves it out; TUBEPLANNER_BASELINE=1 takes the code for any processor of the
kind, as an older one would.
"""

import ctypes
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.native.build import library_path, source_key


@dataclass(frozen=True)
class NativeLibrary:
    """The library or the reason for its absence."""

    functions: ctypes.CDLL | None  # the library; None: it is left out
    build: str  # compiler and level of processors, or the reason for leaving it out

    @classmethod
    def load(cls) -> "NativeLibrary":
        """Load the library of the newest level that the processor runs."""
        if os.environ.get("TUBEPLANNER_PURE", "") not in ("", "0"):
            return cls(None, "pure Python (TUBEPLANNER_PURE is set)")
        if not library_path("baseline").exists():
            return cls(None, "pure Python (no native library was compiled at the installation)")
        try:
            library = ctypes.CDLL(str(library_path("baseline")))
            is_newer = library.tubeplanner_runs_v3() and not os.environ.get("TUBEPLANNER_BASELINE")
            if is_newer and library_path("x86-64-v3").exists():
                library = ctypes.CDLL(str(library_path("x86-64-v3")))
            is_current = _text(library, "tubeplanner_sources") == source_key()
        except (OSError, AttributeError) as error:
            return cls(None, f"pure Python (the library does not load: {error})")
        if not is_current:
            message = (
                "pure Python (native sources have changed: python -m tubeplanner.native.build)"
            )
            return cls(None, message)
        compiler, level = (_text(library, f"tubeplanner_{name}") for name in ("compiler", "level"))
        return cls(library, f"native ({compiler}, {level})")


_Location = ctypes.c_char * 0


class Doubles:
    """The type of arguments that are contiguous arrays of doubles."""

    dtype: np.dtype[Any] = np.dtype(np.float64)

    @classmethod
    def from_param(cls, array: Any) -> Any:
        """Return an object that passes the address of an array; None for None.

        Raises:
            TypeError: The array is of another type, or not contiguous.
        """
        if array is None:
            return None
        if array.dtype is not cls.dtype and array.dtype != cls.dtype:
            raise cls._refused(array)
        try:
            return _Location.from_buffer(array)  # as `ctypes.data`, in a third of its time
        except ValueError as error:
            raise cls._refused(array) from error
        except TypeError as error:  # a read-only array
            if not array.flags.c_contiguous:
                raise cls._refused(array) from error
            return ctypes.c_void_p(array.ctypes.data)

    @classmethod
    def _refused(cls, array: Any) -> TypeError:
        return TypeError(f"an array of {array.dtype} is not a contiguous one of {cls.dtype}")


class Integers(Doubles):
    """The type of arguments that are contiguous arrays of 64-bit integers."""

    dtype = np.dtype(np.int64)


class Bytes(Doubles):
    """The type of arguments that are contiguous arrays of truth values."""

    dtype = np.dtype(np.bool_)


def native_function(name: str, *arguments: Any, returns: Any = None) -> Callable[..., Any] | None:
    """Return a function of the library; None without the library.

    Args:
        name: Name of the function.
        arguments: Types of its arguments: `Doubles`, `Integers`, `Bytes`, ctypes' numbers.
        returns: Type of its result.
    """
    if LIBRARY.functions is None:
        return None
    function: Any = getattr(LIBRARY.functions, name)
    function.argtypes, function.restype = arguments, returns
    result: Callable[..., Any] = function
    return result


def _text(library: ctypes.CDLL, name: str) -> str:
    function = getattr(library, name)
    function.restype = ctypes.c_char_p
    return str(function().decode())


LIBRARY = NativeLibrary.load()
