from tubeplanner.outcome import Place
from tubeplanner.simulation.executed_tube import Extreme
from tubeplanner.simulation.judged_runs import JudgedRun
from tubeplanner.simulation.run_summary import summaries


def run(tube, clearance):
    none = Extreme(0.0, Place())
    far = Extreme(tube, Place(segment=int(100 * tube)))
    return JudgedRun(far, None, None, none, none, 0.0, Extreme(clearance, Place()), None)


def test_the_worst_is_the_farthest_out_and_the_nearest():
    found = summaries([run(0.01, 0.05), run(0.04, 0.03), run(0.02, -0.01)])
    assert (found["tube"].worst.value, found["tube"].run, found["tube"].median) == (0.04, 1, 0.02)
    assert found["tube"].worst.place.segment == 4
    near = found["obstacles"]
    assert (near.worst.value, near.run, near.median) == (-0.01, 2, 0.03)
    assert found["rotation"] is None
    assert found["tube"].as_dict()["worst"]["place"]["segment"] == 4
