"""Verdict over n runs: kept promises, worst and usual values, confidence bound."""

from dataclasses import replace

import numpy as np
import pytest
from cases import anywhere, judged_run, rest_to_rest
from scipy.stats import binomtest
from stored_trajectories import REFINEMENT

from tubeplanner import LimitOverrides, PlanningProblem, Seed, Tube, load_robot
from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.run_verdict import judged_runs, run_verdict, summaries
from tubeplanner.execution.simulation import Execution, executed
from tubeplanner.outcome import Place
from tubeplanner.task.demands import Robustness


@pytest.fixture(scope="module")
def case(stored):
    return stored("ur5/over_the_wall", REFINEMENT)


@pytest.fixture(scope="module")
def exact(case):
    """One run of a perfect plant."""
    problem, motion = case
    return executed(problem, motion, drawn_plants(problem.robot, Robustness.exact(), Draw(1)))


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
    (longer,) = judged_runs(*case, shifted(exact, tool=np.array([0.0, 0.0, 0.03])))
    assert longer.tool_tracking.value == pytest.approx(0.03, abs=1e-3)
    (low,) = judged_runs(*case, shifted(exact, base=np.array([0.0, 0.0, -0.1])))
    assert "obstacles" in low.broken
    assert low.obstacles.place.obstacle is not None


TIME = np.array([0.0, 0.1, 0.2, 0.3])


@pytest.fixture
def flat():
    """A problem of the two-link arm that asks nothing but limits, and a motion."""
    limits = LimitOverrides(velocity={"joint1": 2.0, "joint2": 4.0})
    robot = load_robot("example:two_link", "hand", limits=limits)
    return anywhere(robot), rest_to_rest(["joint1", "joint2"], [0.2, -0.5], [0.9, -1.5], 0.3)


def by_hand(flat, moved, **others):
    """Runs that follow the motion but for what is added to joints, shape (R, 4, 2)."""
    problem, motion = flat
    moved = np.array(moved)
    plants = drawn_plants(problem.robot, Robustness.exact(), Draw(len(moved)))
    still = np.zeros(moved.shape)
    given = {"plants": plants, "velocity": still, "is_saturated": still > 0} | others
    position = motion.position(TIME) + moved
    return Execution(time=TIME, position=position, effort=still, **given)


def test_tools_err_in_their_own_frame_and_bases_in_the_cells(flat):
    """By as much along the tool's x, and along the cell's y backwards: seen from where it is."""
    plants = drawn_plants(flat[0].robot, Robustness.exact(), Draw(2))
    along, aside = np.array([0.03, 0.0, 0.0]), np.array([0.0, -0.03, 0.0])
    plants = [plants[0], replace(plants[1], tool=along, base=aside)]
    first, second = judged_runs(*flat, by_hand(flat, np.zeros((2, 4, 2)), plants=plants))
    assert first.tool_tracking.value == pytest.approx(0.0, abs=1e-12)
    turned = flat[1].position(TIME).sum(axis=1)
    away = 0.03 * np.hypot(np.cos(turned), np.sin(turned) - 1)
    assert second.tool_tracking.value == pytest.approx(away.max())
    assert second.tool_tracking.place.time == TIME[away.argmax()]


def test_what_joints_do_is_compared_with_plan_and_limits_on_either_side(flat):
    planned = flat[1].position(TIME)
    moved = np.zeros((2, 4, 2))
    moved[0, 2, 1], moved[0, 1, 0] = -0.1, 0.05
    # Joint 1 may turn by 2 pi, joint 2 by pi.
    moved[1, 1] = [7.0, -3.5] - planned[1]
    velocity, is_cut = np.zeros((2, 4, 2)), np.zeros((2, 4, 2), dtype=bool)
    velocity[0, 1], velocity[1, 2] = [-3.0, 5.0], [0.0, 1.0]
    is_cut[0, 0, 0] = is_cut[0, 2, 0] = is_cut[0, 2, 1] = True
    first, second = judged_runs(*flat, by_hand(flat, moved, velocity=velocity, is_saturated=is_cut))
    assert first.tracking == Extreme(pytest.approx(0.1), Place(time=0.2, joint="joint2"))
    assert first.velocity == Extreme(pytest.approx(1.5), Place(time=0.1, joint="joint1"))
    assert second.velocity == Extreme(pytest.approx(0.25), Place(time=0.2, joint="joint2"))
    assert (first.saturated, second.saturated) == (0.5, 0.0)
    beyond = [[-2 * np.pi - 0.2, 3.5 - np.pi], [7.0 - 2 * np.pi, -0.5 - np.pi]]
    np.testing.assert_allclose(second.position_by_joint, beyond)
    assert second.position == Extreme(
        pytest.approx(7.0 - 2 * np.pi), Place(time=0.1, joint="joint1")
    )
    assert first.position.value == pytest.approx(planned[3, 1] * -1 - np.pi)
    assert "position" not in first.broken
    assert "position" in second.broken


def test_plans_may_have_their_joints_in_another_order(flat):
    problem, motion = flat
    turned = motion.reordered(["joint2", "joint1"])
    (run,) = judged_runs(problem, turned, by_hand(flat, np.zeros((1, 4, 2))))
    assert run.tracking.value == 0.0


def test_rotation_points_and_clearance_are_the_problems(flat):
    robot = load_robot("example:two_link", "hand")
    tube = Tube(
        [[0.4, -0.2, 0], [0.4, 0.2, 0], [0.4, -0.2, 0]],
        0.05,
        orientations=[[0, 0, 0, 1]] * 3,
        rotation_tolerance=np.pi / 4,
    )
    problem = PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])), clearance=0.02)
    (run,) = judged_runs(problem, flat[1], by_hand(flat, np.zeros((1, 4, 2))))
    turned = abs(flat[1].position(TIME).sum(axis=1)).max()
    assert run.rotation.value == pytest.approx(turned - np.pi / 4)
    tools = 0.3 * np.array(
        [[np.cos(a) + np.cos(a + b), np.sin(a) + np.sin(a + b)] for a, b in flat[1].position(TIME)]
    )
    nearest = np.linalg.norm(tools - [0.4, 0.2], axis=1).min()
    assert run.points.value == pytest.approx(nearest - 0.05)
    assert run.clearance == 0.02


@pytest.mark.slow  # executes a motion of a UR5 by twelve arms
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
    far = ("tube", "rotation", "points", "tracking", "tool_tracking", "position", "velocity")
    near = ("obstacles", "self_collision")
    runs = [replace(run(0.0, 0.0), **of_all(far + near, value)) for value in (-0.3, -0.1, -0.2)]
    found = summaries(runs)
    assert set(found) == {*far, *near}
    assert {(found[name].worst.value, found[name].run) for name in far} == {(-0.1, 1)}
    assert {(found[name].worst.value, found[name].run) for name in near} == {(-0.3, 0)}
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
    none = dict.fromkeys(("rotation", "points", "position", "self_collision"), 0)
    assert verdict.broken == {"tube": 2, "obstacles": 2, **none}
    assert "3 of 4 runs failed: 2 left the tube; 2 came too near to an obstacle" in str(verdict)


@pytest.mark.parametrize(("failed", "runs"), [(0, 200), (1, 200), (200, 200), (1, 1)])
def test_the_share_of_all_arms_is_that_of_scipy(failed, runs):
    judged = [run(0.1 if k < failed else -0.1, 0.0) for k in range(runs)]
    expected = binomtest(failed, runs).proportion_ci(0.95, method="exact")
    assert run_verdict(judged).share == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_none_of_200_means_at_most_1_8_percent():
    verdict = run_verdict([run(-0.1, 0.0)] * 200)
    assert str(verdict) == "0 of 200 runs failed (at most 1.8 % of all, with 95 % confidence)"
    verdict = run_verdict([run(0.1, 0.0), *[run(-0.1, 0.0)] * 199])
    assert "between 0.0 and 2.8 % of all" in str(verdict)
