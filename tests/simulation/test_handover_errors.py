import json
from dataclasses import replace

import numpy as np
import pytest

from simulated_cycle import DURATION, DWELL, followed_cycle, motion_of, picking
from tubeplanner.simulation.handover_errors import handover_errors

TAKEN = DURATION + DWELL
LEFT = TAKEN + DWELL + DURATION + DWELL


@pytest.fixture
def motion(tmp_path):
    return motion_of(picking(tmp_path))


def test_tools_that_are_where_they_should_be_are_off_by_nothing(motion):
    found = list(handover_errors(motion, followed_cycle(motion, 2)))
    assert [(each.mark.kind, each.mark.name) for each in found] == [
        ("attach", "part"),
        ("detach", "part"),
    ]
    assert [each.mark.time for each in found] == pytest.approx([TAKEN, LEFT])
    for each in found:
        np.testing.assert_allclose([each.distance, each.angle, each.speed], 0.0, atol=1e-9)


def test_errors_of_base_and_tool_count(motion):
    execution = followed_cycle(motion, 2)
    bases = [np.array([3e-3, 4e-3, 0.0]), np.zeros(3)]
    tools = [np.zeros(3), np.array([0.0, 0.0, 2e-3])]
    plants = [
        replace(plant, base=base, tool=tool)
        for plant, base, tool in zip(execution.plants, bases, tools, strict=True)
    ]
    for each in handover_errors(motion, replace(execution, plants=plants)):
        np.testing.assert_allclose(each.distance, [5e-3, 2e-3], rtol=1e-6)


def test_a_joint_that_is_off_then_turns_the_tool(motion):
    execution = followed_cycle(motion, 3)
    at_attach = np.searchsorted(execution.time, TAKEN - 1e-9)
    execution.position[1, at_attach, 2] += 0.01
    execution.position[2, at_attach, 2] -= 3.0
    execution.velocity[1, at_attach, 1] = -0.02
    taken, left = handover_errors(motion, execution)
    np.testing.assert_allclose(taken.angle, [0.0, 0.01, 3.0], atol=1e-7)
    np.testing.assert_allclose(taken.speed, [0.0, 0.02, 0.0], atol=1e-9)
    np.testing.assert_allclose(taken.distance, 0.0, atol=1e-7)
    assert left.angle.max() < 1e-7


def test_the_arm_is_seen_before_it_goes_on(motion):
    """The last control period that is no later."""
    execution = followed_cycle(motion)
    execution.position[:, execution.time > LEFT + 1e-9] += 0.1
    assert all(each.distance.max() < 1e-9 for each in handover_errors(motion, execution))


def test_the_worst_and_the_median_are_told(motion):
    execution = followed_cycle(motion, 3)
    for run, off in enumerate((0.004, 0.001, 0.002)):
        execution.position[run, :, 1] += off
    fields = json.loads(json.dumps(next(handover_errors(motion, execution)).as_dict()))
    assert fields["attach"] == "part"
    assert fields["time"] == pytest.approx(TAKEN)
    assert fields["distance"]["worst"] == pytest.approx(0.004)
    assert fields["distance"]["run"] == 0
    assert fields["distance"]["median"] == pytest.approx(0.002)
