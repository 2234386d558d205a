"""The bundled cycles: cells that could be built, and moves that go easier on what is carried."""

from collections.abc import Iterator

import numpy as np
import pytest
from ruamel.yaml import YAML

from tubeplanner.cycle.cycle_reader import load_cycle
from tubeplanner.cycle.steps import Attach
from tubeplanner.resources import bundled_cycles

CYCLES = sorted(bundled_cycles())
TOUCHING = 1e-6  # [m]


def boxes_around(obstacles: list[dict]) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield every obstacle's name and the corners of the box around it [m]."""
    for each in obstacles:
        assert not {"rpy", "quaternion"} & set(each), "only upright solids are compared"
        if "box" in each:
            half = np.array(each["box"]) / 2
        else:
            radius, length = each["cylinder"]
            half = np.array([radius, radius, length / 2])
        centre = np.array(each["position"])
        yield each["name"], centre - half, centre + half


def standing(obstacles: list[dict]) -> set[str]:
    """Return the names of what stands on the floor, or on or at something that does."""
    boxes = {name: (low, high) for name, low, high in boxes_around(obstacles)}
    found, fresh = set(), {"floor"}
    while fresh:
        found |= fresh
        fresh = {
            name
            for name, (low, high) in boxes.items()
            for other in fresh
            if (low - boxes[other][1] <= TOUCHING).all()
            and (boxes[other][0] - high <= TOUCHING).all()
        } - found
    return found


@pytest.mark.parametrize("name", CYCLES)
def test_nothing_in_a_cell_floats(name):
    obstacles = YAML(typ="safe", pure=True).load(bundled_cycles()[name].read_text())["obstacles"]
    assert standing(obstacles) == {each["name"] for each in obstacles}


def test_what_floats_is_found():
    floor = {"name": "floor", "box": [1, 1, 0.1], "position": [0, 0, 0]}
    part = {"name": "part", "cylinder": [0.1, 0.1], "position": [0, 0, 0.101]}
    assert standing([floor, part]) == {"floor"}


@pytest.mark.parametrize("name", CYCLES)
def test_a_cycle_ends_as_it_began(name):
    cycle = load_cycle(f"example:{name}")
    assert cycle.closed
    assert cycle.name == name
    taken = {step.name for step in cycle.steps if isinstance(step, Attach)}
    assert taken <= {obstacle.name for obstacle in cycle.obstacles}


@pytest.mark.parametrize("name", CYCLES)
def test_the_arm_is_slower_with_what_it_carries(name):
    legs = load_cycle(f"example:{name}").legs
    masses = [leg.robot.payload.mass if leg.robot.payload else 0.0 for leg in legs]
    peaks = [leg.robot.limits.acceleration.max() for leg in legs]
    loaded = [peak for peak, mass in zip(peaks, masses, strict=True) if mass > min(masses)]
    empty = [peak for peak, mass in zip(peaks, masses, strict=True) if mass == min(masses)]
    assert max(loaded) < min(empty)
