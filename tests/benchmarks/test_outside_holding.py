"""The outside judge of held parts: the certificate's margins by other code, and what it refuses."""

import numpy as np
import pytest
import yaml

import tubeplanner as t
from outside.arm import Arm
from outside.files import BadInput
from outside.holding import judge_holding, read_holding
from outside.judge import Judge
from outside.problem import problem_of
from outside.trajectory import Trajectory
from outside_judge import TOLERANCE
from tubeplanner.certificate.judged_motion import JudgedMotion
from tubeplanner.certificate.verification import JUDGED
from tubeplanner.resources import bundled_problems

PART = {"mass": 0.8, "com": [0.004, -0.002, 0.05], "inertia": [4e-4, 5e-4, 6e-4, 3e-5, 2e-5, 1e-5]}
THERE = {"position": [0.002, -0.001, 0.03], "normal": [0.05, -0.02, 1]}
HOLDINGS = {
    "cup": {"part": PART, "cup": {"force": 60, "radius": 0.03, "friction": 0.5, **THERE}},
    "tray": {"part": PART, "tray": {"friction": 0.6, "foot": [0.08, 0.1], **THERE}},
    "disc": {"part": PART, "tray": {"friction": 0.6, "foot": 0.05, "safety": 1.0, **THERE}},
    "gripper": {
        "part": PART,
        "gripper": {"force": 60, "friction": 0.5, "pad": [0.05, 0.06], "position": [0, 0, 0.04]},
    },
    "liquid": {"liquid": {"tilt": 0.4}},
}
HOLDINGS["several"] = [HOLDINGS["tray"], HOLDINGS["liquid"]]


@pytest.fixture(scope="module")
def waiter():
    """Return the fields of the waiter's problem without holding, and a motion of its arm.

    The tray stays upright, within some degrees, while it moves and turns about.
    """
    path = bundled_problems()["ur5/waiter"]
    fields = yaml.safe_load(path.read_text())
    problem = t.parse_problem(fields, path.parent)
    start = np.array(problem.start)
    rng = np.random.default_rng(4)
    shape = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])[:, None, None]
    steps = rng.uniform(-0.5, 0.5, (3, 6)) * [1, 0.1, 0.1, 0.1, 0.1, 1]
    rows = shape * steps
    rows[-1] += start + np.cumsum(np.vstack([np.zeros(6), steps[:-1]]), axis=0)
    names = problem.robot.joint_names
    return fields, path.parent, t.JointTrajectory(names, np.arange(4) * 0.6, rows).scaled(1.0)


def by_both(waiter, holding, duration, **robot):
    fields, folder, trajectory = waiter
    fields = {**fields, "holding": holding, "robot": {**fields["robot"], **robot}}
    timed = trajectory.scaled(duration)
    other = Trajectory(list(timed.joint_names), timed.breakpoints, timed.coefficients)
    arm = Arm(problem_of(fields, folder))
    outside = judge_holding(read_holding(holding), arm, other, other.samples(500))
    motion = JudgedMotion(t.parse_problem(fields, folder), timed, t.Tolerance())
    return outside, JUDGED["holding"](motion)


@pytest.mark.parametrize("duration", [0.4, 0.8, 3.0])
@pytest.mark.parametrize("name", HOLDINGS)
def test_both_judges_have_the_same_margin_of_held_parts(waiter, name, duration):
    outside, inside = by_both(waiter, HOLDINGS[name], duration)
    assert outside.margin == pytest.approx(inside.margin, abs=1e-4 + 0.02 * abs(inside.margin))
    assert outside.margin >= inside.margin - 1e-6
    assert outside.holds(TOLERANCE) == inside.holds(t.Tolerance())
    told = inside.where.contact.replace(" (holding[0])", "").replace(" (holding[1])", "")
    assert outside.where == told or outside.margin - inside.margin > -1e-4


def test_both_judges_know_what_gravity_is_and_where_the_tool_frame_is(waiter):
    offset = {"position": [0.1, 0.0, 0.2], "rpy": [0.4, 0.2, 0.1]}
    fields, *others = waiter
    waiter = ({**fields, "start": {"seed": fields["start"]["joints"]}}, *others)
    for changes in ({"tool_offset": offset}, {"gravity": [0.5, 0.0, -5.0]}):
        outside, inside = by_both(waiter, HOLDINGS["cup"], 1.5, **changes)
        assert outside.margin == pytest.approx(inside.margin, abs=1e-4)


def test_the_judge_of_a_problem_tells_of_what_is_held(waiter):
    fields, folder, trajectory = waiter
    other = Trajectory(
        list(trajectory.joint_names), trajectory.breakpoints, trajectory.coefficients
    )
    found = Judge(problem_of(fields, folder)).judge(other, 100)["holding"]
    inside = t.verify(t.parse_problem(fields, folder), trajectory).conditions["holding"]
    assert found.margin == pytest.approx(inside.margin, rel=0.02)
    assert found.where == inside.where.contact


def test_nothing_is_asked_of_who_holds_nothing(waiter):
    outside, inside = by_both(waiter, None, 1.0)
    assert (outside.margin, inside.margin) == (None, None)


@pytest.mark.parametrize(
    ("holding", "message"),
    [
        ({"part": PART}, "one of cup, tray, gripper, liquid"),
        ({"liquid": {"tilt": 0.2}, "tray": {"friction": 1}}, "one of cup"),
        ({"liquid": {"tilt": 0.2, "foam": 1}}, "holding.liquid.foam is not known"),
        ({"magnet": {}}, "holding.magnet is not known"),
        ([{"liquid": {"tilt": 0.2}, "part": {"weight": 1}}], None),
    ],
)
def test_what_is_not_known_is_refused(holding, message):
    if message is None:
        assert len(read_holding(holding)) == 1  # a liquid has no part
        return
    with pytest.raises(BadInput, match=message):
        read_holding(holding)
