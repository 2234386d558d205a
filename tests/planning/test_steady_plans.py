"""Bands that joints cannot hold: refused by formula, with remedies that help; steady: best."""

import re
from dataclasses import replace

import numpy as np
import pytest
from gantry import gantry

from tubeplanner import Objective, PlanOptions, load_problem, plan
from tubeplanner.errors import OptionError
from tubeplanner.outcome import PlanningClock
from tubeplanner.planning.steady_plans import steadiest_plan

A, RADIUS = 4.0, 0.002  # [m/s^2], [m]
# What a point mass can hold in a corner of 90 degrees whose bisector is along an axis.
HELD = np.sqrt(A * 2 * RADIUS / (1 - np.cos(np.pi / 4)))
SHORTEST = PlanOptions(slack=0.0)


def _corner(folder, least, most, radius=RADIUS, **process):
    limits = {"effort": np.inf, "velocity": 3.0, "acceleration": A}
    band = {"between": [float(least), float(most)]}
    tube = {
        "points": [[0, 0.2, 0], [0.05, 0.15, 0], [0.2, 0, 0], [0.35, 0.15, 0], [0.4, 0.2, 0]],
        "radius": radius,
        "tool_speed": [None, band, band, None],
        "process": process,
    }
    robot = {"urdf": "gantry.urdf", "tool_frame": "head", "limits": limits}
    return load_problem(gantry(folder, robot=robot, tube=tube, start={"joints": [0.0, 0.2]}))


def _speeds(problem, trajectory):
    time = np.linspace(0, trajectory.duration, 20001)
    q, v = trajectory.position(time), trajectory.velocity(time)
    tool, rate = problem.robot.tool_position(q), problem.robot.tool_velocity(q, v)[0]
    is_inside = abs(tool[:, 0] - 0.2) <= 0.15 - RADIUS
    return np.linalg.norm(rate, axis=1)[is_inside]


def test_a_point_mass_holds_what_the_formula_says(tmp_path):
    problem = _corner(tmp_path, 0.98 * HELD, 1.2 * HELD)
    result = plan(problem, SHORTEST)
    assert result.succeeded
    assert _speeds(problem, result.trajectory).min() >= 0.98 * HELD * (1 - 1e-6)


def test_more_is_refused_with_point_speed_limit_and_remedies(tmp_path):
    result = plan(_corner(tmp_path, 1.2 * HELD, 1.5 * HELD), SHORTEST)
    assert result.status == "no_trajectory" and result.method == "refinement"
    assert result.message.startswith(
        f"tool_speed: point 2 (90 degrees, 2 mm): about {HELD:.3f} m/s can be held "
        f"(acceleration of "
    )
    assert f"{1.2 * HELD:.4g} is asked" in result.message
    assert "process.steady: best helps" in result.message
    assert result.location.point == 2 and result.location.joint in ("along", "across")
    assert result.location.position == (0.2, 0.0, 0.0)
    assert result.proved is False and result.configuration is not None
    radius = float(re.search(r"a radius of (\S+) mm", result.message)[1]) / 1000
    speed = float(re.search(r"tool_speed (\S+),", result.message)[1])
    assert radius == pytest.approx(1.44 * RADIUS, rel=0.05)
    assert speed == pytest.approx(1.5 / 1.2 * HELD, rel=0.01)
    assert plan(_corner(tmp_path, 1.2 * HELD, 1.5 * HELD, radius), SHORTEST).succeeded
    assert plan(_corner(tmp_path, 0.99 * 1.2 / 1.5 * speed, speed), SHORTEST).succeeded


def test_best_loses_least(tmp_path):
    problem = _corner(tmp_path, 1.2 * HELD, 1.5 * HELD, steady="best")
    result = plan(problem, SHORTEST)
    assert result.succeeded
    least = _speeds(problem, result.trajectory).min()
    assert 0.97 * HELD < least < 1.1 * HELD
    (note,) = [each for each in result.notes if each.startswith("steady: best")]
    share, speed, off, point = re.fullmatch(
        r"steady: best: (\S+)% of the bead is in its band; down to (\S+) m/s \((-\d+)%\) about "
        r"point (\d)",
        note,
    ).groups()
    assert 80 < float(share) < 100
    assert float(speed) == pytest.approx(least, rel=0.01) and point == "2"
    assert float(off) == pytest.approx(100 * (least / (1.5 * HELD) - 1), abs=1.5)


def test_best_is_the_band_where_it_can_be_held(tmp_path):
    result = plan(_corner(tmp_path, 0.7 * HELD, 0.9 * HELD, steady="best"), SHORTEST)
    assert "steady: best: 100.0% of the bead is in its band" in result.notes


def test_best_that_is_stopped_is_the_motion_so_far(tmp_path):
    problem = _corner(tmp_path, 1.2 * HELD, 1.5 * HELD, steady="best")
    fastest = plan(problem, SHORTEST)
    stopped = steadiest_plan(problem.joined, fastest, PlanningClock(0.0, None))
    assert stopped.succeeded and stopped.stopped_by == "time_limit"
    assert stopped.trajectory is fastest.trajectory


@pytest.mark.parametrize("method", ["stop-at-corners", "suh-bishop", "branch-and-bound"])
def test_other_methods_are_refused_by_name(tmp_path, method):
    problem = _corner(tmp_path, 0.7 * HELD, 0.9 * HELD)
    with pytest.raises(OptionError, match=f"method '{method}' keeps no bands of tube.tool_speed"):
        plan(problem, PlanOptions(method=method))


@pytest.mark.parametrize(("longer", "is_in_band"), [(1.01, True), (1.5, False)])
def test_a_motion_is_run_slower_as_far_as_its_bands_hold(tmp_path, monkeypatch, longer, is_in_band):
    """Where the second stage finds no motion in the duration."""
    problem = _corner(tmp_path, 0.9 * HELD / 1.2, HELD / 1.2)
    shortest = plan(problem, SHORTEST)
    monkeypatch.setattr(
        "tubeplanner.planning.second_stage.second_stage_plan",
        lambda problem, shortest, *others: shortest,
    )
    duration = longer * shortest.duration
    result = plan(replace(problem, objective=Objective(duration=duration)))
    assert result.succeeded is is_in_band
    if is_in_band:
        assert result.duration == pytest.approx(duration, rel=1e-9)
        assert f"run slower, to last the required {duration:g} s" in result.notes[-1]
    else:
        most = shortest.duration / shortest.certificate.from_speed
        assert f"keeps them, run slower, up to {most:.6g} s; give" in result.message
