from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

from judged_run import judged_run
from tubeplanner.outcome import Place
from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.simulation.run_summary import summaries
from tubeplanner.simulation.run_verdict import run_verdict


def run(tube, distance, clearance=0.0, **others):
    given = {
        "tube": Extreme(tube, Place(segment=int(100 * tube))),
        "obstacles": Extreme(distance, Place()),
        "clearance": clearance,
        "tube_by_segment": np.array([tube]),
    }
    return judged_run(**(given | others))


def of_all(names, value):
    return {name: Extreme(value, Place()) for name in names}


def test_the_worst_is_the_farthest_out_and_the_nearest():
    found = summaries([run(0.01, 0.05), run(0.04, 0.03), run(0.02, -0.01)])
    assert (found["tube"].worst.value, found["tube"].run, found["tube"].median) == (0.04, 1, 0.02)
    assert found["tube"].worst.place.segment == 4
    near = found["obstacles"]
    assert (near.worst.value, near.run, near.median) == (-0.01, 2, 0.03)
    assert found["rotation"] is None
    assert found["tube"].as_dict()["worst"]["place"]["segment"] == 4


def test_and_of_every_quantity_in_its_own_direction():
    values = (-0.3, -0.1, -0.2)
    far = ("tube", "rotation", "points", "tracking", "tool_tracking", "position", "velocity")
    near = ("obstacles", "self_collision")
    runs = [replace(run(0.0, 0.0), **of_all(far + near, value)) for value in values]
    found = summaries(runs)
    assert set(found) == {*far, *near}
    assert {found[name].worst.value for name in far} == {-0.1}
    assert {found[name].run for name in far} == {1}
    assert {found[name].worst.value for name in near} == {-0.3}
    assert {found[name].run for name in near} == {0}
    assert {summary.median for summary in found.values()} == {-0.2}


def test_a_run_survives_at_its_bounds():
    assert run(0.0, 0.01, 0.01).survives
    assert run(1e-9, 0.01, 0.01).broken == ("tube",)
    assert run(0.0, 0.0099, 0.01).broken == ("obstacles",)
    assert run(1e-9, -0.1).broken == ("tube", "obstacles")
    # Links keep no clearance from each other.
    assert run(0.0, 0.01, 0.01, **of_all(["self_collision"], 0.001)).survives
    assert run(0.0, 0.01, 0.01, **of_all(["self_collision"], -0.001)).broken == ("self_collision",)
    others = ("rotation", "points", "position")
    assert run(0.0, 0.01, 0.01, **of_all(others, 1e-9)).broken == others


def test_a_verdict_counts_every_run_once():
    verdict = run_verdict([run(0.1, 0.0), run(0.1, -0.1), run(-0.1, 0.0), run(-0.1, -0.1)])
    assert (verdict.runs, verdict.failed) == (4, 3)
    assert verdict.broken == {
        "tube": 2,
        "rotation": 0,
        "points": 0,
        "position": 0,
        "obstacles": 2,
        "self_collision": 0,
    }
    assert "3 of 4 runs failed: 2 left the tube; 2 came too near to an obstacle" in str(verdict)


@pytest.mark.parametrize(("failed", "runs"), [(0, 200), (1, 200), (199, 200), (200, 200), (1, 1)])
def test_the_share_of_all_arms_is_that_of_scipy(failed, runs):
    judged = [run(0.1 if k < failed else -0.1, 0.0) for k in range(runs)]
    expected = binomtest(failed, runs).proportion_ci(0.95, method="exact")
    assert run_verdict(judged).share == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_none_of_200_means_at_most_1_8_percent():
    verdict = run_verdict([run(-0.1, 0.0)] * 200)
    assert str(verdict) == "0 of 200 runs failed (at most 1.8 % of all, with 95 % confidence)"
    verdict = run_verdict([run(0.1, 0.0), *[run(-0.1, 0.0)] * 199])
    assert "between 0.0 and 2.8 % of all" in str(verdict)
