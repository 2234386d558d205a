"""Any values that a caller or a file may give, and what must come of them.

`TUBEPLANNER_EXAMPLES=3000 pytest tests/package/test_any_document.py` tries so many, other ones
each time, where the tests otherwise try few, always the same ones.
"""

import math
import os
from datetime import timedelta
from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

from tubeplanner import LimitOverrides, TubePlannerError, load_robot

EXAMPLES = int(os.environ.get("TUBEPLANNER_EXAMPLES", 0))
LONGEST = timedelta(seconds=20)  # anything else is a hang
NUMBERS = st.sampled_from(
    [
        *(0, 1, -1, 2, 0.5, 1e-12, 1e9, 1e308, -1e308, 10**400, math.nan, math.inf, -math.inf),
        *(True, np.float32(0.5), np.float32("inf"), np.int64(1), np.float64(0.5), np.bool_(True)),
    ]
)
NAMES = st.sampled_from(
    ["", "a", "joint1", "hand", "\x1b[31m", "\u202e", "a\nb", "x" * 500, "+", "\ud800", "x0.5"]
)
PLAIN = st.none() | NUMBERS | NAMES | st.binary(max_size=3)
ARRAYS = st.sampled_from(
    [
        np.zeros(0),
        np.zeros(3),
        np.ones((2, 3)),
        np.eye(4),
        np.full((4, 4), np.nan),
        np.zeros((2, 0)),
        np.array([["a", "b"]]),
        np.array([None, 1], dtype=object),
        np.array(1.0),
        np.array([1 + 1j]),
        np.zeros((1, 2, 3, 1)),
        np.array([True, False]),
    ]
)
OBJECTS = st.sampled_from([object(), int, {1, 2}, range(3), Path("a"), np.float32(0.5), Exception])
VALUES = st.recursive(
    PLAIN | ARRAYS | OBJECTS,
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.tuples(inner, inner)
        | st.dictionaries(NAMES, inner, max_size=2)
    ),
    max_leaves=5,
)


def examples(count):
    """Return the settings of a test that tries so many examples, the same ones each time."""
    return settings(
        max_examples=EXAMPLES or count,
        deadline=LONGEST,
        derandomize=not EXAMPLES,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


def accepted(make, *arguments, **named):
    """Return what comes of a call, None if it is refused, as it must be: in one printable line."""
    try:
        return make(*arguments, **named)
    except TubePlannerError as error:
        assert str(error)
        assert str(error).isprintable(), repr(str(error))
        return None


LINE = [[0.3, -0.3, 0], [0.3, 0.3, 0]]


@cache
def arm(**changes):
    """Return the two-link arm, loaded once, with other arguments of `load_robot`."""
    given = {"gravity": (0, 0, 0), "limits": LimitOverrides(velocity=50.0)}
    return load_robot("example:two_link", "hand", **given, **changes)
