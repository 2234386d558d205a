import numpy as np
import pytest

from cases import followed, quintic
from tubeplanner.views.executed_paths import executed_paths
from tubeplanner.views.execution_curves import tool_runs


def paths_of(problem, bases, steps):
    motion = quintic(0.6, joint="slide")
    return executed_paths(tool_runs(problem, motion, followed(problem, motion, bases)), steps)


def test_lines_join_to_whole_paths(slider):
    found = paths_of(slider, np.zeros((1, 3)), 50)
    assert len(found.outside) == 0
    assert 50 <= len(found.inside) <= 101
    np.testing.assert_array_equal(found.inside[1:, 0], found.inside[:-1, 1])
    assert found.inside[0, 0, 0] == 0
    assert found.inside[-1, 1, 0] == pytest.approx(0.6)


def test_lines_outside_the_tube_are_told_apart(slider):
    """A base that stands 0.15 m ahead takes the tool 0.05 m out of the tube's round end."""
    found = paths_of(slider, [[0.15, 0, 0]], 1000)
    assert found.inside[:, :, 0].max() == pytest.approx(0.7, abs=0.01)
    assert found.outside[:, :, 0].min() == pytest.approx(0.7, abs=0.01)
    assert found.outside[:, :, 0].max() == pytest.approx(0.75)


def test_of_very_many_runs_those_farthest_out_are_shown(slider):
    aside = np.zeros((230, 3))
    aside[:, 1] = np.linspace(0, 0.2, 230)
    found = paths_of(slider, aside, 10)
    assert (found.shown, found.total) == (200, 230)
    shown = np.unique(np.concatenate([found.inside, found.outside])[:, 0, 1])
    np.testing.assert_allclose(shown, aside[30:, 1])
