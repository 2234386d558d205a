"""What is said of plans that are to survive errors."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tubeplanner.problem.tightening import Tightening
from tubeplanner.simulation.blamed_errors import Blame, BlamedError
from tubeplanner.simulation.run_verdict import RunVerdict
from tubeplanner.simulation.survival import Survival

NONE_FAILED, MANY_FAILED = RunVerdict(200, 0, {"tube": 0}), RunVerdict(200, 150, {"tube": 150})
KEPT = Tightening(
    effort=0.93,
    velocity=0.97,
    radius=np.array([0.0012, 0.0034]),
    rotation=np.array([0.012, 0.0]),
    clearance=0.0021,
    position=np.array([[0.0, 0.05], [0.0, 0.0]]),
)
COSTS = {
    "effort": 0.012,
    "velocity": 0.003,
    "radius": 0.0015,
    "rotation": 0.0011,
    "clearance": 0.0003,
    "position": 0.0001,
}
BLAME = Blame(
    "radius", "m", 0.004, -0.009, (BlamedError("mass", 0.05, -0.001), BlamedError("lag", 0.1, 0.0))
)


@pytest.fixture
def survival():
    return Survival(NONE_FAILED, True, KEPT, 0.9, MANY_FAILED, COSTS)


def test_what_was_seen_is_the_verdict_of_fresh_runs(survival):
    assert survival.seen == f"seen in simulation: {NONE_FAILED}"
    stopped = replace(survival, verdict=None)
    assert stopped.seen == "its runs were not simulated to the end"


def test_costs_sum_up(survival):
    assert survival.added == pytest.approx(0.018)
    assert replace(survival, costs={}).added == 0


def test_a_note_tells_what_every_part_costs(survival):
    (note,) = survival.notes
    assert note == (
        "surviving takes 18.0 ms more, 2 %: 93 % of the effort limits (12.0 ms); 97 % of the "
        "velocity limits (3.0 ms); up to 3.4 mm less radius (1.5 ms); up to 12 mrad less rotation "
        "(1.1 ms); 2.1 mm more clearance (0.3 ms); up to 50 mrad or mm less joint range (0.1 ms); "
        f"without robustness the plan takes 0.9000 s, and {MANY_FAILED}"
    )


def test_it_tells_nothing_of_what_was_not_seen(survival):
    (note,) = replace(survival, verdict_without=None, costs={"effort": 0.009}).notes
    assert note == (
        "surviving takes 9.0 ms more, 1 %: 93 % of the effort limits (9.0 ms); without robustness "
        "the plan takes 0.9000 s"
    )
    assert replace(survival, costs={}).notes == ()


def test_blame_is_of_the_plan_whose_runs_it_is_about(survival):
    (note,) = replace(survival, costs={}, blame=BLAME).notes
    assert note == f"the plan without robustness: {BLAME}"
    (note,) = replace(survival, reached=False, costs={}, blame=BLAME).notes
    assert note == f"no plan was found of which all runs survive, their errors enlarged: {BLAME}"
    assert len(replace(survival, blame=BLAME).notes) == 2


def test_as_json_it_has_all_of_it(survival):
    found = json.loads(json.dumps(replace(survival, blame=BLAME).as_dict()))
    assert found["reached"] is True
    assert found["verdict"]["failed"] == 0
    assert found["verdict_without"]["failed"] == 150
    assert found["duration_without"] == 0.9
    assert found["costs"] == COSTS
    assert found["kept_back"]["radius"] == [0.0012, 0.0034]
    assert found["kept_back"]["position"] == [[0.0, 0.05], [0.0, 0.0]]
    assert found["blame"]["errors"][0] == {"error": "mass", "size": 0.05, "short": -0.001}
    stopped = replace(survival, verdict=None, verdict_without=None).as_dict()
    assert (stopped["verdict"], stopped["verdict_without"], stopped["blame"]) == (None, None, None)
