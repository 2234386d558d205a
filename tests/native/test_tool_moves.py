"""Configurations moved natively to where tools are wanted, against numpy."""

import numpy as np
import pytest

from tubeplanner import load_problem
from tubeplanner.measurement import tool_moves
from tubeplanner.measurement.tool_moves import WantedTools, moved_tools
from tubeplanner.native.library import LIBRARY, NativeLibrary
from tubeplanner.tube.rotations import rotation_matrix

pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the native library is left out")
COUNT = 200


@pytest.mark.parametrize("close", [(0.0, 0.0), (0.02, 0.05)])
@pytest.mark.parametrize(
    "components", [None, (True, True, True), (True, False, True)], ids=["any", "all", "two"]
)
@pytest.mark.parametrize("name", ["ur5/over_the_wall", "panda/between_shelves"])
def test_moves_are_those_of_numpy(name, components, close, monkeypatch):
    problem, rng = load_problem(f"example:{name}"), np.random.default_rng(3)
    robot, start = problem.robot, problem.start
    bounds = start - 0.5, start + 0.4
    q = rng.uniform(*bounds, (COUNT, len(start)))
    q[: COUNT // 4] = np.round(q[: COUNT // 4] - start) * 0.5 + start  # some at their bounds
    q = np.clip(q, *bounds)
    rotation, tool = robot.tool_pose(start[None])
    wanted = WantedTools(tool + rng.normal(scale=0.1, size=(COUNT, 3)))
    if components is not None:
        reference = rotation @ rotation_matrix(rng.normal(scale=0.2, size=(COUNT, 3)))
        turned = rng.normal(scale=0.2, size=(COUNT, 3))
        wanted = WantedTools(wanted.position, reference, turned, np.array(components))
    found = moved_tools(robot, q, bounds, wanted, np.array(close))
    monkeypatch.setattr(tool_moves, "LIBRARY", NativeLibrary(None, ""))
    expected = moved_tools(robot, q, bounds, wanted, np.array(close))
    apart = abs(found - expected).max(axis=1)
    assert (abs(expected - q).max(axis=1) > 0.05).mean() > 0.5
    # A bound that is just met or not lets a few paths part.
    assert (apart < 1e-7).mean() > 0.97


def test_tools_get_where_they_are_wanted():
    problem, rng = load_problem("example:panda/between_shelves"), np.random.default_rng(4)
    robot, start = problem.robot, problem.start
    rotation, tool = robot.tool_pose(start + rng.uniform(-0.1, 0.1, (COUNT, 7)))
    vector = rng.uniform(-0.1, 0.1, (COUNT, 3))
    reference = rotation @ rotation_matrix(vector).transpose(0, 2, 1)
    wanted = WantedTools(tool, reference, vector, np.ones(3, dtype=bool))
    bounds, q = (start - 1, start + 1), np.tile(start, (COUNT, 1))
    turned, placed = robot.tool_pose(moved_tools(robot, q, bounds, wanted, np.full(2, 1e-6)))
    assert abs(placed - tool).max() < 2e-6
    assert abs(turned - rotation).max() < 2e-6
