from dataclasses import replace

import numpy as np
import pytest

from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import load_problem
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.execution import executed
from tubeplanner.simulation.judged_runs import judged_runs
from tubeplanner.simulation.plant import Draw, drawn_plants

NAME = "ur5/over_the_wall"


@pytest.fixture(scope="module")
def case():
    problem = load_problem(f"example:{NAME}")
    return problem, stored_trajectory(NAME, REFINEMENT).trajectory


@pytest.fixture(scope="module")
def exact(case):
    """One run of a perfect plant."""
    problem, motion = case
    plants = drawn_plants(problem.robot, Robustness.exact(), Draw(1))
    return executed(problem, motion, plants)


def test_a_perfect_plant_keeps_what_was_promised(case, exact):
    (run,) = judged_runs(*case, exact)
    assert run.survives
    assert run.broken == ()
    assert -2 < run.position.value < 0
    assert run.velocity.value < 1.001
    assert run.saturated == 0.0
    assert run.tracking.value < 5e-4
    assert run.tool_tracking.value < 5e-4
    assert run.obstacles.value >= 0.01
    assert run.rotation is None


def shifted(execution, **shifts):
    return replace(execution, plants=[replace(execution.plants[0], **shifts)])


def test_a_base_that_stands_elsewhere_takes_tool_and_links_along(case, exact):
    by = np.array([0.0, 0.0, 0.2])
    (run,) = judged_runs(*case, exact)
    (away,) = judged_runs(*case, shifted(exact, base=by))
    assert away.tool_tracking.value == pytest.approx(0.2, abs=1e-3)
    assert away.tracking == run.tracking
    assert "tube" in away.broken
    assert away.tube_by_segment.max() == away.tube.value
    assert away.tube_by_segment.argmax() == away.tube.place.segment
    assert away.tube.value > 0.05
    assert away.obstacles.value != pytest.approx(run.obstacles.value, abs=1e-3)
    assert away.self_collision == run.self_collision


def test_a_tool_that_is_longer_counts_along_its_own_axis(case, exact):
    problem, motion = case
    by = np.array([0.0, 0.0, 0.03])
    (run,) = judged_runs(problem, motion, shifted(exact, tool=by))
    assert run.tool_tracking.value == pytest.approx(0.03, abs=1e-3)


def test_a_robot_that_runs_into_a_wall_collides(case, exact):
    (run,) = judged_runs(*case, shifted(exact, base=np.array([0.0, 0.0, -0.1])))
    assert "obstacles" in run.broken
    assert run.obstacles.place.obstacle is not None


def test_with_errors_the_shortest_motion_leaves_its_tube_in_most_runs(case):
    """At full effort nothing is left for feedback; with a tenth of the errors, it goes out less."""
    problem, motion = case
    small = Robustness(
        mass=0.005, com=5e-4, unmodelled_friction=0.002, lag=1e-4, delay=2.5e-4, tool=0, base=0
    )
    worst = []
    for errors in (Robustness(), small):
        plants = drawn_plants(problem.robot, errors, Draw(6))
        runs = judged_runs(problem, motion, executed(problem, motion, plants))
        worst.append(np.median([run.tube.value for run in runs]))
        if errors is not small:
            assert sum(not run.survives for run in runs) >= 4
            assert all(0.05 < run.saturated < 0.9 for run in runs)
            assert all(run.tracking.place.joint in problem.robot.joint_names for run in runs)
    assert 1e-3 < worst[0] < 0.02
    assert worst[1] < worst[0] / 2
