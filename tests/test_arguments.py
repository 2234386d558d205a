"""Arguments of public functions: what they may be, and what is said of others."""

from concurrent.futures import Executor
from pathlib import Path

import numpy as np
import pytest

from tubeplanner.arguments import (
    given_options,
    given_path,
    given_row,
    require_callback,
    require_executor,
)
from tubeplanner.errors import OptionError
from tubeplanner.planning.plan_options import PlanOptions


def test_options_are_those_of_the_class_unless_others_are_given():
    given = PlanOptions("suh-bishop")
    assert given_options(given, PlanOptions) is given
    assert given_options(None, PlanOptions) == PlanOptions()
    with pytest.raises(OptionError, match=r"^options are {}; give PlanOptions$"):
        given_options({}, PlanOptions)


@pytest.mark.parametrize("row", [[1, 2], (1, 2), range(1, 3), np.array([1, 2])])
def test_a_row_is_a_list_a_tuple_or_an_array(row):
    assert given_row("radii", row, "numbers") == [1, 2]


@pytest.mark.parametrize("other", ["12", {1: 2}, {1, 2}, 1.0, None, np.array(1.0), iter([1])])
def test_anything_else_is_no_row(other):
    with pytest.raises(OptionError, match=r"^radii is .*; give a list of numbers$"):
        given_row("radii", other, "numbers")


def test_whom_progress_is_told_to_can_be_called():
    require_callback(None)
    require_callback(print)
    with pytest.raises(OptionError, match=r"^progress is 5; give a function, which is called"):
        require_callback(5)


def test_an_executor_submits():
    require_executor(None)
    require_executor(Executor())
    with pytest.raises(OptionError, match=r"^executor is \[\]; give one of concurrent\.futures"):
        require_executor([])


def test_a_path_is_text_or_a_path():
    assert given_path("directory", "a") == given_path("directory", Path("a")) == Path("a")
    with pytest.raises(OptionError, match=r"^directory is b'a'; give a path$"):
        given_path("directory", b"a")
