"""Energy and work saved: against physics, within a slack and in a fixed duration."""

import json
import re
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from ruamel.yaml import YAML

from cases import INERTIA, one_joint
from tubeplanner import Objective, PlanningProblem, PlanOptions, Tube, plan, verify
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.second_stage_plan import SecondStage
from tubeplanner.resources import bundled_problems

LINE, POST = "two_link/paper_1_30mm", "two_link/around_a_post"
TRAVEL = 1.7  # [rad], of the bar


def turning(tmp_path, start=0.0, mass=0.0, objective=None):
    """A bar that turns by so much; nothing is asked of it but its limits."""
    robot = one_joint(tmp_path, mass)
    tube = Tube([[0.0, 0, 0], [1.0, 0, 0]], 1000.0)
    ends = np.array([start]), np.array([start + TRAVEL])
    return PlanningProblem(robot, tube, *ends, self_collision=False, objective=objective)


def quadrature(robot, trajectory, integrand, count=20_001):
    """Return the integral of a function of efforts and velocities, by midpoints of even steps."""
    width = trajectory.duration / count
    t = (np.arange(count) + 0.5) * width
    state = trajectory.position(t), trajectory.velocity(t), trajectory.acceleration(t)
    return integrand(robot.inverse_dynamics(*state), state[1]).sum() * width


def energy_of(robot, trajectory, weights=None):
    weights = robot.limits.effort**-2 if weights is None else weights
    return quadrature(robot, trajectory, lambda effort, _: effort**2 @ weights)


def work_of(robot, trajectory):
    return quadrature(robot, trajectory, lambda effort, velocity: np.maximum(effort * velocity, 0))


COSTS = {"energy": energy_of, "work": work_of}


@pytest.fixture(scope="module")
def planned(bundled):
    """Return a function from a problem's name and an objective's fields to the answer."""

    @cache
    def of(name, *fields):
        problem = replace(bundled(name), objective=Objective(*fields))
        return problem, plan(problem)

    return of


# --- physics -------------------------------------------------------------------------------------


@pytest.mark.parametrize("duration", [3.0, 6.0])
def test_a_bar_in_free_rotation_takes_little_more_energy_than_any_motion_must(duration, tmp_path):
    """12 (I angle)^2 / T^3: the cubic, which only motions with a jump of effort at both ends are.

    (Euler and Lagrange: the effort of least energy from rest to rest is a straight line.)
    """
    problem = turning(tmp_path, objective=Objective(None, "energy", duration))
    result = plan(problem)
    bound = 12 * (INERTIA * TRAVEL) ** 2 / duration**3
    found = energy_of(problem.robot, result.trajectory, np.ones(1))
    assert result.duration == pytest.approx(duration, rel=1e-12)
    assert bound < found < 1.03 * bound
    smooth = plan(replace(problem, objective=Objective(duration=duration)))
    assert energy_of(problem.robot, smooth.trajectory, np.ones(1)) > 1.05 * bound


@pytest.mark.parametrize("duration", [4.0, 8.0])
def test_a_bar_that_is_lifted_takes_little_more_work_than_its_height(duration, tmp_path):
    """m g h: what is put into speed is given back on the way up."""
    mass, start = 0.5, -1.2
    problem = turning(tmp_path, start, mass, Objective(None, "work", duration))
    result = plan(problem)
    height = 0.5 * (np.sin(start + TRAVEL) - np.sin(start))
    bound = mass * 9.81 * height
    found = work_of(problem.robot, result.trajectory)
    assert result.shortest is not None
    assert bound <= found * (1 + 1e-6)
    assert found < 1.03 * bound
    assert work_of(problem.robot, result.shortest) > 1.5 * bound


@pytest.mark.parametrize("minimise", COSTS)
def test_it_falls_as_slack_grows_and_below_that_of_the_smooth_motion(minimise, planned):
    cost = COSTS[minimise]
    shortest = planned(POST, 0.0)[1].trajectory
    found = [cost(planned(POST, 0.0)[0].robot, shortest)]
    for slack in (0.005, 0.05, 0.2):
        problem, result = planned(POST, slack, minimise)
        assert result.succeeded
        assert verify(problem, result.trajectory).passed
        assert shortest.duration < result.duration <= (1 + slack) * shortest.duration * (1 + 1e-9)
        found.append(cost(problem.robot, result.trajectory))
        smooth = planned(POST, slack)[1].trajectory
        assert found[-1] < 0.98 * cost(problem.robot, smooth)
    assert all(later < 0.95 * earlier for earlier, later in pairwise(found))


def test_what_weights_make_dear_is_spared(bundled):
    problem = bundled(POST)
    alone = []
    for weights in ({"joint1": 1.0, "joint2": 0.0}, {"joint1": 0.0, "joint2": 1.0}):
        asks = replace(problem, objective=Objective(0.05, "energy", weights=weights))
        trajectory = plan(asks).trajectory
        alone.append([energy_of(problem.robot, trajectory, own) for own in np.eye(2)])
    assert alone[0][0] < 0.95 * alone[1][0]
    assert alone[1][1] < 0.95 * alone[0][1]


# --- what is said --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("minimise", "weights", "unit"),
    [
        ("energy", None, "limits^2 s"),
        ("energy", {"joint1": 2.0, "joint2": 3.0}, "with the given weights"),
        ("work", None, "J"),
    ],
)
def test_the_note_says_what_was_gained(minimise, weights, unit, bundled):
    problem = bundled(LINE)
    robot = problem.robot
    objective = Objective(0.05, minimise, weights=weights or {})
    result = plan(replace(problem, objective=objective))
    (note,) = [note for note in result.notes if note.startswith(f"{minimise} saved: ")]
    assert "in 5.00 % more time" in note
    after, before = map(float, re.search(r"is (\S+) instead of (\S+) ", note).groups())
    assert note.endswith(f" {unit}")
    given = () if weights is None else (np.array([2.0, 3.0]),)
    for said, trajectory in ((after, result.trajectory), (before, result.shortest)):
        assert said == pytest.approx(COSTS[minimise](robot, trajectory, *given), rel=1e-3)
    assert after < before


# --- a fixed duration ----------------------------------------------------------------------------


@pytest.mark.parametrize("minimise", ["smoothness", *COSTS])
def test_a_fixed_duration_is_kept_exactly(minimise, planned):
    shortest = planned(LINE, 0.0)[1].trajectory
    for duration in (shortest.duration * 1.0005, 1.1, 2.0):
        problem, result = planned(LINE, None, minimise, duration)
        assert result.succeeded
        assert result.duration == pytest.approx(duration, rel=1e-12)
        assert result.shortest_duration == shortest.duration
        assert verify(problem, result.trajectory).passed


def test_a_slack_of_options_holds_before_it(planned):
    problem, result = planned(LINE, None, "energy", 1.1)
    assert plan(problem, PlanOptions(slack=0)).duration == result.shortest_duration


@pytest.mark.parametrize("period", [None, 0.004])
def test_less_than_the_shortest_is_no_trajectory(period, bundled):
    """The message has what must be given; that is enough."""
    problem = replace(bundled(LINE), period=period, objective=Objective(None, "energy", 0.6))
    result = plan(problem)
    assert (result.status, result.trajectory) == (PlanStatus.NO_TRAJECTORY, None)
    shortest = plan(replace(problem, objective=Objective(0.0)))
    assert result.shortest_duration == shortest.duration
    assert f"takes {shortest.duration:.6g} s; give " in result.message
    least = float(re.search(r"give (\S+) s or more", result.message).group(1))
    assert shortest.duration * (1 - 1e-12) <= least < shortest.duration + 1.1e-4
    enough = plan(replace(problem, objective=Objective(None, "energy", least)))
    assert enough.duration == pytest.approx(least, rel=1e-12)


def test_then_nothing_is_written(run, tmp_path):
    data = YAML(typ="safe").load(bundled_problems()[LINE].read_text())
    problem, output = tmp_path / "problem.yaml", tmp_path / "t.json"
    with problem.open("w") as file:
        YAML(typ="safe").dump({**data, "objective": {"duration": 0.5}}, file)
    status, out, _ = run("plan", problem, "-o", output, "--json")
    answer = json.loads(out)
    assert (status, answer["status"], answer["duration"]) == (1, "no_trajectory", None)
    assert f"{answer['shortest_duration']:.6g} s" in answer["message"]
    assert not output.exists()


def test_with_a_period_all_breakpoints_are_multiples_of_it(bundled):
    problem = replace(bundled(LINE), period=0.004, objective=Objective(None, "work", 0.88))
    trajectory = plan(problem).trajectory
    periods = trajectory.breakpoints / 0.004
    assert trajectory.duration == pytest.approx(0.88, rel=1e-12)
    np.testing.assert_allclose(periods, np.round(periods), atol=1e-9)


def test_where_nothing_better_is_found_the_shortest_motion_is_run_slower(planned, monkeypatch):
    monkeypatch.setattr(SecondStage, "run", lambda self: False)
    problem, _ = planned(LINE, None, "energy", 1.1)
    result = plan(problem)
    assert result.duration == pytest.approx(1.1, rel=1e-12)
    assert verify(problem, result.trajectory).passed
    assert "the answer is the shortest motion, not changed to save anything: no " in str(
        result.notes
    )
    assert "run slower, in the duration that is asked for, 1.1 s" in result.notes[-1]


def test_so_it_is_where_planning_was_stopped(planned):
    problem, _ = planned(LINE, None, "energy", 1.1)
    interrupts = []

    def interrupt_once(progress):
        if progress.best_duration is not None and not interrupts:
            interrupts.append(progress.stage)
            raise KeyboardInterrupt

    result = plan(problem, progress=interrupt_once)
    assert (result.succeeded, result.stopped_by) == (True, "interrupt")
    assert result.duration == pytest.approx(1.1, rel=1e-12)
