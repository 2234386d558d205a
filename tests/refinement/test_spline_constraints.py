"""Conditions of the optimisation: against what they stand for and against finite differences."""

import numpy as np
import pytest

from tubeplanner.refinement.limit_constraints import LimitConstraints
from tubeplanner.refinement.linear_rows import StepSize
from tubeplanner.refinement.link_constraints import LinkConstraints
from tubeplanner.refinement.phased_spline import PhasedSpline, VelocityHull
from tubeplanner.refinement.rotation_constraints import evaluated_rotation
from tubeplanner.refinement.sampled_spline import sampled

SWITCHING_TIMES = np.array([0.0, 0.4, 1.0])
STEP = 1e-6
LIMITS = ("effort", "velocity", "rates")
KINDS = (*LIMITS, "rotation", "links")
EVERY_LIMIT = ("effort", "velocity", "acceleration", "jerk")


class Kinds:
    """The rows of one kind of condition at a trajectory, and their slack at another."""

    def __init__(self, kind, case):
        self.kind, (self.problem, spline, self.samples) = kind, case
        self.links = LinkConstraints(self.problem)
        self.links.look_at(
            spline, spline.grid.samples_at(SWITCHING_TIMES, np.linspace(0.2, 0.8, 9))
        )

    def at(self, spline):
        if self.kind in LIMITS:
            places = {"velocity": VelocityHull(len(spline.control_points))}
            kinds = ("acceleration", "jerk") if self.kind == "rates" else (self.kind,)
            limits = LimitConstraints(self.problem.robot)
            return limits.at(spline, places.get(self.kind, self.samples), kinds)
        if self.kind == "rotation":
            robot, rotation = self.problem.robot, self.problem.tube.rotation
            at = sampled(spline, self.samples)
            return evaluated_rotation(robot, rotation, at, self.samples.phase, 0.005, 0)
        return self.links.at(spline)

    def rows(self, spline, duration, size=None):
        here = self.at(spline)
        return here.rows(duration, size) if self.kind in LIMITS else here.rows(size)

    def slack(self, spline, other, duration, eta):
        """Return the slack of the rows at a trajectory, elsewhere."""
        if self.kind in LIMITS:
            return self.at(other).slack(duration, 1 + eta)
        return self.at(other).slack


@pytest.mark.parametrize("kind", KINDS)
def test_rows_have_the_derivatives_of_their_slack(case, kind):
    """By control points, switching_times and the duration together, along a random direction."""
    kinds, spline, duration = Kinds(kind, case), case[1], 0.8
    rows = kinds.rows(spline, duration)
    assert len(rows) > 0
    rng = np.random.default_rng(5)
    change = rng.normal(size=spline.control_points.shape)
    change[:3] = change[-3:] = 0.0
    switching, eta = rng.normal(size=1), 0.7
    taken = change[rows.first[:, None] + np.arange(4)]
    expected = (
        np.einsum("rkj,rkj->r", rows.control, taken)
        + rows.switching @ switching
        + rows.duration * eta
    )
    sides = []
    for sign in (STEP, -STEP):
        switching_times = SWITCHING_TIMES + sign * np.array([0, switching[0], 0])
        moved = PhasedSpline(spline.grid, switching_times, spline.control_points + sign * change)
        sides.append(kinds.slack(spline, moved, duration, sign * eta)[rows.index])
    numeric = -(sides[0] - sides[1]) / (2 * STEP)
    scale = abs(expected).max()
    np.testing.assert_allclose(numeric / scale, expected / scale, atol=3e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_their_slack_at_the_trajectory_itself_is_theirs(case, kind):
    kinds, spline = Kinds(kind, case), case[1]
    rows = kinds.rows(spline, 0.8)
    there = kinds.slack(spline, spline, 0.8, 0.0)
    np.testing.assert_allclose(there[rows.index], rows.slack, atol=1e-12)
    bounded = np.flatnonzero(np.isfinite(there) & (there < 1 - 0.005 - 1e-12))
    assert set(bounded.tolist()) <= set(rows.index.tolist()) <= set(range(len(there)))


@pytest.mark.parametrize("kind", KINDS)
def test_rows_left_out_cannot_be_broken_by_the_step(case, kind):
    kinds, spline = Kinds(kind, case), case[1]
    size = StepSize(0.01, np.array([0.005]))
    every, some = kinds.rows(spline, 0.8), kinds.rows(spline, 0.8, size)
    left_out = ~np.isin(every.index, some.index)
    farthest = StepSize(
        0.01, np.array([0.005])
    )  # every control point and switching time, either way
    worst = farthest.control * np.einsum("rkj,rkj->r", every.control, np.sign(every.control))
    worst += abs(every.switching) @ farthest.switching
    np.testing.assert_allclose(every.reach(size), worst, rtol=1e-12)
    assert (every.slack[left_out] >= worst[left_out]).all()
    np.testing.assert_array_equal(every.where(~left_out).slack, some.slack)


@pytest.mark.parametrize("kinds", [EVERY_LIMIT, ("effort",)], ids=["all", "effort"])
def test_rows_know_what_the_duration_gives(case, kinds):
    """At the duration that the limits allow, the tightest row has no slack; beyond it, some."""
    problem, spline, samples = case
    limits = LimitConstraints(problem.robot).at(spline, samples, kinds)
    y = float(limits.squared_durations.max())
    rows = limits.rows(np.sqrt(y), None)
    assert rows.slack.min() == pytest.approx(0.0, abs=1e-9)
    eta = 1e-5
    later = limits.rows(np.sqrt(y * (1 + eta)), None)
    tight = int(rows.slack.argmin())
    gained = (later.slack[tight] - rows.slack[tight]) / eta
    assert -rows.duration[tight] == pytest.approx(gained, rel=1e-3)


def test_the_least_duration_is_that_of_every_limit(case):
    """Run in it, some limit is just met, and none is broken."""
    problem, spline, samples = case
    robot, limits = problem.robot, problem.robot.limits
    evaluated = LimitConstraints(robot).at(spline, samples, EVERY_LIMIT)
    for i, y in enumerate(evaluated.squared_durations):
        rates = [evaluated.at.rate(order, float(np.sqrt(y)))[i : i + 1] for order in (1, 2, 3)]
        q, (v, a, j) = evaluated.at.position[i : i + 1], rates
        used = [
            abs(robot.inverse_dynamics(q, v, a)) / limits.effort,
            abs(v) / limits.velocity,
            abs(a) / limits.acceleration,
            abs(j) / limits.jerk,
        ]
        assert np.max(used) == pytest.approx(1.0, abs=1e-9)


def test_every_limit_has_a_name_and_rows(case):
    problem, spline, samples = case
    conditions = LimitConstraints(problem.robot)
    rows = conditions.at(spline, samples, EVERY_LIMIT).rows(0.8, None)
    assert np.unique(rows.limit).tolist() == list(range(len(conditions.names)))
    n = problem.robot.joint_count
    assert conditions.names[:n] == [("effort", j) for j in range(n)]
    assert ("jerk", 0) in conditions.names
    assert ("jerk", 1) not in conditions.names


@pytest.mark.parametrize("margin", [0.0, 0.1])
def test_the_rotations_rows_and_its_ball_are_its_margin(case, margin):
    """The tightest of components and angle has the slack that the tube's own margin says."""
    problem, spline, samples = case
    tube, at = problem.tube.rotation, sampled(spline, samples)
    evaluated = evaluated_rotation(problem.robot, tube, at, samples.phase, margin, 0)
    error = tube.error(*problem.robot.tool_pose(at.position), samples.phase)
    used = np.hstack([abs(error), np.linalg.norm(error, axis=1, keepdims=True)])
    used /= tube.bounds[samples.phase]
    np.testing.assert_allclose(evaluated.excess, used[:, :3].max(axis=1) - 1 + margin, atol=1e-12)
    np.testing.assert_allclose(evaluated.angle().excess, used[:, 3] - 1 + margin, atol=1e-12)
    slack = evaluated.slack.reshape(len(used), -1).min(axis=1)
    np.testing.assert_allclose(slack, 1 - margin - used[:, :3].max(axis=1), atol=1e-12)
    assert np.unique(evaluated.rows(None).limit).tolist() == [1]  # components of the second alone
    assert evaluated.angle().limit.tolist() == samples.phase.tolist()
