"""A JointTrajectoryController: files that it refuses, runs otherwise, takes; what verdicts say."""

import json

import numpy as np
import pytest

from tubeplanner import JointTrajectory
from tubeplanner.output.controllers import (
    ControllerFinding,
    ControllerVerdict,
    Effect,
    judged_by_jtc,
)
from tubeplanner.task.motion import motion_of_file
from tubeplanner.trajectory.reader import read_trajectory_file

NAMES = ("joint1", "joint2")
TIMES = np.linspace(0.0, 1.0, 11)
SHAPE = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def problem(bundled):
    return bundled("two_link/around_a_post")


def judged_file(problem, path):
    file = read_trajectory_file(path)
    return judged_by_jtc("jtc", motion_of_file(problem, path, file), file)


@pytest.fixture
def judged(problem, tmp_path):
    """Return a function that writes points as ROS YAML and returns the verdict."""

    def judge(points):
        path = tmp_path / "t.yaml"
        path.write_text(json.dumps({"joint_names": NAMES, "points": points}))
        return judged_file(problem, path)

    return judge


def points(first=0.0, end=1.0, fields=("positions", "velocities", "accelerations")):
    """Return the points of a quintic, from its own time `first` to `end`."""
    move = JointTrajectory(NAMES, [0, 1.0], SHAPE[:, None, None] * np.array([0.4, -0.2]))
    rows = []
    for time in first + (end - first) * TIMES:
        values = move.position(time), move.velocity(time), move.acceleration(time)
        known = dict(zip(("positions", "velocities", "accelerations"), values, strict=True))
        stamp = {"sec": 0, "nanosec": round((time - first) * 1e9)}
        rows.append({field: known[field].tolist() for field in fields} | {"time_from_start": stamp})
    return rows


def effects(verdict):
    return [(each.effect, each.error) for each in verdict.findings]


def test_points_from_rest_to_rest_are_accepted(judged):
    verdict = judged(points())
    assert verdict.accepted
    assert verdict.findings == ()
    assert verdict.lines()[0].endswith("accepted")


def test_a_last_velocity_is_refused(judged):
    verdict = judged(points(end=0.5))
    (finding,) = verdict.findings
    assert finding.effect is Effect.REFUSED
    assert "Velocity of last trajectory point of joint joint1 is not zero" in finding.error
    assert (finding.joint, finding.unit) == ("joint1", "rad/s")
    assert finding.value == pytest.approx(0.4 * 1.875)
    assert finding.time == pytest.approx(0.5)
    assert verdict.summary == "would refuse"


@pytest.mark.parametrize(("velocity", "refused"), [(1e-7, False), (2e-7, True), (-2e-7, True)])
def test_the_bound_on_the_last_velocity_is_the_controller_s(judged, velocity, refused):
    rows = points()
    rows[-1]["velocities"][1] = velocity
    assert judged(rows).accepted is not refused


def test_a_start_in_motion_is_run_otherwise(judged):
    verdict = judged(points(first=0.5))
    assert effects(verdict) == [(Effect.ALTERED, "the velocity jumps where it begins")]
    assert not verdict.accepted
    assert verdict.summary == "would run otherwise"
    pushed = judged(points(first=0.02))
    assert (Effect.ALTERED, "the acceleration jumps where it begins") in effects(pushed)


def test_a_late_first_point_is_reached_by_a_segment_of_the_controller_s_own(judged):
    rows = points()
    for row in rows:
        row["time_from_start"]["sec"] += 2
    verdict = judged(rows)
    assert effects(verdict) == [(Effect.ALTERED, "no point at t = 0")]
    assert verdict.findings[0].time == 2.0


def test_points_that_lack_derivatives_jump(judged):
    for fields, error in (
        (("positions",), "points without velocities are joined by straight lines"),
        (("positions", "velocities"), "points without accelerations are joined by cubics"),
    ):
        assert effects(judged(points(fields=fields))) == [(Effect.ALTERED, error)]


def test_efforts_are_refused(judged):
    rows = points()
    rows[3]["effort"] = [0.0, 1.0]
    ((effect, error),) = effects(judged(rows))
    assert effect is Effect.REFUSED
    assert "'effort' command interface" in error


def test_what_plan_writes_is_accepted_and_of_polynomials_what_it_would_write(
    problem, stored, tmp_path
):
    _, trajectory = stored("two_link/around_a_post", "refinement")
    verdicts = []
    for name in ("t.json", "t.csv", "t.yaml"):
        notes = trajectory.save(tmp_path / name, problem)
        verdicts.append(judged_file(problem, tmp_path / name))
    assert all(verdict.accepted for verdict in verdicts)
    assert [each.message for each in verdicts[0].findings] == list(notes)
    assert verdicts[1].findings == verdicts[2].findings == ()


# What any controller says, as text and as JSON.


def verdict(*effects):
    findings = tuple(ControllerFinding(effect, "an error", "a message") for effect in effects)
    return ControllerVerdict("fer", "an arm", "abort", findings)


@pytest.mark.parametrize(
    ("effects", "accepted", "summary"),
    [
        ((), True, "accepted"),
        ((Effect.NOTED,), True, "accepted"),
        ((Effect.ALTERED, Effect.NOTED), False, "would run otherwise"),
        ((Effect.ALTERED, Effect.REFUSED), False, "would abort"),
    ],
)
def test_the_gravest_finding_decides(effects, accepted, summary):
    result = verdict(*effects)
    assert (result.accepted, result.summary) == (accepted, summary)
    assert result.lines()[0] == f"fer (an arm): {summary}"
    assert len(result.lines()) == 1 + len(effects)
    fields = json.loads(json.dumps(result.as_dict()))
    assert fields["accepted"] is accepted
    assert [each["effect"] for each in fields["findings"]] == [each.value for each in effects]
    assert all(each["time"] is None for each in fields["findings"])
