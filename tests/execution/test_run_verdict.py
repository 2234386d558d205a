"""Verdict over n runs: kept promises, worst and usual values, confidence bound."""

from dataclasses import replace

import numpy as np
import pytest
from cases import SLIDE, anywhere, judged_run, rest_to_rest
from scipy.stats import binomtest
from stored_trajectories import REFINEMENT

from tubeplanner import LimitOverrides, PlanningProblem, Seed, Tube, load_robot
from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.run_verdict import KEPT, judged_runs, run_verdict, summaries
from tubeplanner.execution.simulation import Execution, executed
from tubeplanner.outcome import Location
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
    assert away.tube_by_segment.argmax() == away.tube.location.segment
    assert away.tube.value > 0.05
    assert away.obstacles.value != pytest.approx(run.obstacles.value, abs=1e-3)
    assert away.self_collision == run.self_collision
    (longer,) = judged_runs(*case, shifted(exact, tool=np.array([0.0, 0.0, 0.03])))
    assert longer.tool_tracking.value == pytest.approx(0.03, abs=1e-3)
    (low,) = judged_runs(*case, shifted(exact, base=np.array([0.0, 0.0, -0.1])))
    assert "obstacles" in low.broken
    assert low.obstacles.location.obstacle is not None


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
    assert second.tool_tracking.location.time == TIME[away.argmax()]


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
    assert first.tracking == Extreme(pytest.approx(0.1), Location(time=0.2, joint="joint2"))
    assert first.velocity == Extreme(pytest.approx(1.5), Location(time=0.1, joint="joint1"))
    assert second.velocity == Extreme(pytest.approx(0.25), Location(time=0.2, joint="joint2"))
    assert (first.saturated, second.saturated) == (0.5, 0.0)
    beyond = [[-2 * np.pi - 0.2, 3.5 - np.pi], [7.0 - 2 * np.pi, -0.5 - np.pi]]
    np.testing.assert_allclose(second.position_by_joint, beyond)
    assert second.position == Extreme(
        pytest.approx(7.0 - 2 * np.pi), Location(time=0.1, joint="joint1")
    )
    assert first.position.value == pytest.approx(planned[3, 1] * -1 - np.pi)
    assert "position" not in first.broken
    assert "position" in second.broken


def test_a_run_that_is_too_fast_or_too_far_from_the_plan_fails(flat):
    """Of joint 2 at 1.06 of its limit, or 0.06 rad and 8 mm behind: at more than is tolerated."""
    velocity, moved = np.zeros((2, 4, 2)), np.zeros((2, 4, 2))
    velocity[0, 1, 1], moved[1, 2, 1] = 1.06 * 4.0, -0.06
    runs = by_hand(flat, moved, velocity=velocity)

    def broken(**stops):
        judged = judged_runs(*flat, runs, errors=Robustness(**stops))
        return [run.broken for run in judged]

    fast, far = judged_runs(*flat, runs)
    assert [fast.broken, far.broken] == [("velocity",), ("tracking",)]
    assert fast.velocity == Extreme(pytest.approx(1.06), Location(time=0.1, joint="joint2"))
    assert far.tracking == Extreme(pytest.approx(0.06), Location(time=0.2, joint="joint2"))
    np.testing.assert_allclose(fast.velocity_by_joint, [0.0, 1.06])
    np.testing.assert_allclose(far.tracking_by_joint, [0.0, 1.2], atol=1e-12)
    assert broken(velocity_tolerance=0.07, path_tolerance=0.061) == [(), ()]
    assert broken(path_tolerance=None) == [("velocity",), ()]
    tool = far.tool_tracking.value
    assert far.tool_tracking.location.time == 0.2
    near = {"velocity_tolerance": 0.07, "path_tolerance": None}
    assert broken(tool_tolerance=1.01 * tool, **near) == [(), ()]
    assert broken(tool_tolerance=0.99 * tool, **near) == [(), ("tool_tracking",)]
    (free,) = judged_runs(*flat, by_hand(flat, moved[1:]), errors=Robustness(path_tolerance=None))
    assert free.tracking_by_joint.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("limits", "problem", "most"), [(None, None, 1.05), (0.0, None, 1.0), (0.0, 0.02, 1.02)]
)
def test_velocities_are_tolerated_by_the_problem_or_else_by_the_preset(flat, limits, problem, most):
    robot = flat[0].robot
    own = replace(robot.limits, velocity_tolerance=limits)
    case = anywhere(robot.with_limits(own, robot.motors)), flat[1]
    velocity = np.zeros((2, 4, 2))
    velocity[:, 1, 0] = 2.0 * most - 1e-9, 2.0 * most + 1e-9
    runs = by_hand(flat, np.zeros((2, 4, 2)), velocity=velocity)
    judged = judged_runs(*case, runs, errors=Robustness(velocity_tolerance=problem))
    assert [run.broken for run in judged] == [(), ("velocity",)]


def test_millimetres_of_a_sliding_joint_count_as_hundredths_of_a_radian(tmp_path):
    """6 mm behind is more than 0.04 rad, and beyond a tenth of 0.05 rad."""
    (tmp_path / "slide.urdf").write_text(SLIDE)
    robot = load_robot(tmp_path / "slide.urdf", "tip")
    motion = rest_to_rest(robot.joint_names, np.zeros(3), [0.3, 0.2, 0.1], 0.3)
    moved = np.zeros((3, 4, 3))
    moved[:, 1, 0], moved[:, 2, 1] = [0.04, 0.04, 0.06], [0.006, 0.003, 0.004]
    slid, turned, both = judged_runs(
        anywhere(robot), motion, by_hand((anywhere(robot), motion), moved)
    )
    assert slid.tracking == Extreme(pytest.approx(0.006), Location(time=0.2, joint="extend"))
    assert slid.stops["tracking"] == pytest.approx(0.005)
    assert turned.tracking == Extreme(pytest.approx(0.04), Location(time=0.1, joint="turn"))
    assert [run.broken for run in (slid, turned, both)] == [("tracking",), (), ("tracking",)]
    np.testing.assert_allclose(both.tracking_by_joint, [1.2, 0.8, 0.0], atol=1e-12)


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
            assert [run.survives for run in runs] == [False, True] + 4 * [False]
            assert all(0.05 < run.saturated < 0.9 for run in runs if not run.survives)
            assert all(run.tracking.location.joint in problem.robot.joint_names for run in runs)
    assert 1e-3 < worst[0] < 0.02
    assert worst[1] < worst[0] / 2


def run(tube, distance, clearance=0.0, **others):
    given = {
        "tube": Extreme(tube, Location(segment=int(100 * tube))),
        "obstacles": Extreme(distance, Location()),
        "clearance": clearance,
        "tube_by_segment": np.array([tube]),
    }
    return judged_run(**(given | others))


def of_all(names, value):
    return {name: Extreme(value, Location()) for name in names}


def test_the_worst_is_the_farthest_out_and_the_nearest():
    found = summaries([run(0.01, 0.05), run(0.04, 0.03), run(0.02, -0.01)])
    assert (found["tube"].worst.value, found["tube"].run, found["tube"].median) == (0.04, 1, 0.02)
    assert found["tube"].worst.location.segment == 4
    near = found["obstacles"]
    assert (near.worst.value, near.run, near.median) == (-0.01, 2, 0.03)
    assert found["rotation"] is None
    assert found["tube"].as_dict()["worst"]["place"]["segment"] == 4
    far = ("tube", "rotation", "points", "tracking", "tool_tracking", "position", "velocity")
    far += ("holding", "part")
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
    # A controller stops at bounds of its own, if it has one.
    stops = {"velocity": 1.02, "tracking": 0.03, "tool_tracking": 0.01}
    for name, stop in stops.items():
        assert run(0.0, 0.0, stops=stops, **of_all([name], stop)).survives
        assert run(0.0, 0.0, stops=stops, **of_all([name], stop + 1e-9)).broken == (name,)
        assert run(0.0, 0.0, stops={}, **of_all([name], stop + 1e-9)).survives


def test_a_verdict_counts_every_run_once():
    verdict = run_verdict([run(0.1, 0.0), run(0.1, -0.1), run(-0.1, 0.0), run(-0.1, -0.1)])
    assert (verdict.runs, verdict.failed) == (4, 3)
    assert verdict.broken == dict.fromkeys(KEPT, 0) | {"tube": 2, "obstacles": 2}
    assert "3 of 4 runs failed: 2 left the tube; 2 came too near to an obstacle" in str(verdict)


@pytest.mark.parametrize(("failed", "runs"), [(0, 200), (1, 200), (200, 200), (1, 1)])
def test_the_share_of_all_arms_is_that_of_scipy(failed, runs):
    judged = [run(0.1 if k < failed else -0.1, 0.0) for k in range(runs)]
    expected = binomtest(failed, runs).proportion_ci(0.95, method="exact")
    assert run_verdict(judged).fraction == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_none_of_200_means_at_most_1_8_percent():
    verdict = run_verdict([run(-0.1, 0.0)] * 200)
    assert str(verdict) == "0 of 200 runs failed (at most 1.8 % of all, with 95 % confidence)"
    verdict = run_verdict([run(0.1, 0.0), *[run(-0.1, 0.0)] * 199])
    assert "between 0.0 and 2.8 % of all" in str(verdict)


def test_a_verdict_says_which_errors_were_survived_and_how_fast_and_how_far_from_the_plan():
    errors = Robustness.exact(mass=0.05, delay=0.002)
    fast = of_all(["velocity"], 1.034), of_all(["velocity"], 0.9)
    near = of_all(["tracking"], 0.002), of_all(["tracking"], 0.0123)
    judged = [run(-0.1, 0.0, **a, **b) for a, b in zip(fast, near, strict=True)]
    verdict = run_verdict([*judged, *judged[:1] * 198])
    assert (verdict.velocity, verdict.tracking) == (1.034, 0.0123)
    assert {name: verdict.as_dict()[name] for name in ("velocity", "tracking")} == {
        "velocity": 1.034,
        "tracking": 0.0123,
    }
    assert verdict.survived(errors) == (
        "survived 200 of 200 simulated arms whose errors are up to mass 5 %, delay 2 ms, velocity "
        "up to 1.03 of its limit, a joint up to 12.3 mrad or mm from the plan (at most 1.8 % of "
        "all fail, with 95 % confidence)"
    )
    unlimited = run_verdict([run(0.1, 0.0), run(-0.1, 0.0)])
    assert unlimited.velocity is None
    assert unlimited.survived(errors).startswith(
        "survived 1 of 2 simulated arms whose errors are up to mass 5 %, delay 2 ms, a joint up to "
        "0 mrad or mm from the plan: 1 left the tube (between 1.3 and 98.7 % of all fail"
    )
