"""The bundled cycles, planned whole; `test_shared_plan_closed.py` is the quick test beside it."""

import pytest

from tubeplanner.cycle.cycle_reader import load_cycle
from tubeplanner.cycle_planning.cycle_planner import plan_cycle
from tubeplanner.resources import bundled_cycles

# The share of the moves planned alone that the whole takes at most: where ends are chosen
# together and the arm has several configurations to choose from, less.
SHARES = {
    "panda/tray_to_the_next_shelf": 0.95,
    "ur10/boxes_onto_a_pallet": 0.95,
    "ur5/through_the_door": 1.0,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(bundled_cycles()))
def test_bundled_cycles_are_planned_and_certified(name):
    cycle = load_cycle(f"example:{name}")
    result = plan_cycle(cycle)
    assert result.succeeded, result.message
    assert result.certificate.passed
    assert len(result.motion.marks) == len(cycle.steps)
    assert result.shortest_duration <= SHARES[name] * result.greedy_duration
