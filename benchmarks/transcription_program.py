"""The minimum-time problem through a tube as one nonlinear program, for `direct_transcription.py`.

Unknown are position, velocity and acceleration at the nodes, the durations of the phases, and for
every tube sample a place on the capsule's axis. Jerk is constant in every interval. Constraints are
the same small function again and again, applied to other unknowns; CasADi derives it.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pinocchio as pin

from tubeplanner import JointTrajectory, PlanningProblem, RobotModel

AGREEMENT = 1e-9  # between the symbolic arm and RobotModel, relative to the largest value
RANGE_SAMPLES = (0.25, 0.5, 0.75)  # at the nodes, ranges are bounds on unknowns
MOTOR_SAMPLES = (0.0, 0.5)
TUBE_SAMPLES = (0.0, 0.25, 0.5, 0.75)
TUBE_MARGIN = 1e-5  # [m]: kept free, so that what lies between samples stays inside too
MIN_PHASE = 1e-3  # [s]
SAMPLES_PER_PIECE = 41  # per interval, for what is broken between samples
BROKEN = 1e-4  # fraction of a velocity or effort limit


class SymbolicArm:
    """Tool position and recursive Newton-Euler dynamics of an arm as CasADi expressions."""

    def __init__(self, robot: RobotModel) -> None:
        """Read the arm's geometry and masses, and compare both with the arm itself."""
        # Public properties hold norms of them only; what is read here is checked below.
        self._robot, self._model = robot, robot._model
        self._axes = joint_axes(self._model)
        self._require_agreement()

    def tool_position(self, q: ca.SX) -> ca.SX:
        """Return the tool centre point (3,) [m]."""
        rotations, offsets = self._joint_poses(q)
        rotation, position = {0: ca.SX.eye(3)}, {0: ca.SX.zeros(3)}
        for body in range(1, self._model.njoints):
            parent = self._model.parents[body]
            position[body] = position[parent] + rotation[parent] @ offsets[body]
            rotation[body] = rotation[parent] @ rotations[body]
        frame = self._model.frames[self._robot._tool_id]
        body = frame.parentJoint
        return position[body] + rotation[body] @ _clean(frame.placement.translation)

    def inverse_dynamics(self, q: ca.SX, v: ca.SX, a: ca.SX) -> ca.SX:
        """Return the joint efforts (n,) [N m or N]."""
        rotations, offsets = self._joint_poses(q)
        forces, moments = self._body_wrenches(rotations, offsets, v, a)
        efforts = ca.SX.zeros(self._robot.joint_count)
        for body in range(self._model.njoints - 1, 0, -1):
            joint, parent = self._robot.body_joints[body], self._model.parents[body]
            turns = self._robot.revolute[joint]
            efforts[joint] = ca.dot(self._axes[body], moments[body] if turns else forces[body])
            if parent > 0:
                force, moment = rotations[body] @ forces[body], rotations[body] @ moments[body]
                forces[parent] += force
                moments[parent] += moment + ca.cross(offsets[body], force)
        return efforts

    def _joint_poses(self, q: ca.SX) -> tuple[dict[int, ca.SX], dict[int, ca.SX]]:
        """Return rotation and origin of every body in its parent's frame."""
        rotations, offsets = {}, {}
        for body in range(1, self._model.njoints):
            placement, axis = self._model.jointPlacements[body], self._axes[body]
            joint = self._robot.body_joints[body]
            base, offset = _clean(placement.rotation), _clean(placement.translation)
            if self._robot.revolute[joint]:
                cross = ca.skew(axis)
                turn = ca.sin(q[joint]) * cross + (1 - ca.cos(q[joint])) * (cross @ cross)
                rotations[body], offsets[body] = base @ (ca.SX.eye(3) + turn), ca.SX(offset)
            else:
                rotations[body], offsets[body] = ca.SX(base), offset + base @ axis * q[joint]
        return rotations, offsets

    def _body_wrenches(
        self, rotations: dict[int, ca.SX], offsets: dict[int, ca.SX], v: ca.SX, a: ca.SX
    ) -> tuple[dict[int, ca.SX], dict[int, ca.SX]]:
        """Return the force on every body and its moment about the body's origin."""
        spin, turning = {0: ca.SX.zeros(3)}, {0: ca.SX.zeros(3)}
        acceleration = {0: ca.SX(-self._robot.gravity)}
        forces, moments = {}, {}
        for body in range(1, self._model.njoints):
            parent, joint = self._model.parents[body], self._robot.body_joints[body]
            back, axis, offset = rotations[body].T, self._axes[body], offsets[body]
            carried = back @ spin[parent]
            pulled = ca.cross(spin[parent], ca.cross(spin[parent], offset))
            pulled += acceleration[parent] + ca.cross(turning[parent], offset)
            spin[body], turning[body], acceleration[body] = (
                carried,
                back @ turning[parent],
                back @ pulled,
            )
            relative = ca.cross(carried, axis * v[joint])
            if self._robot.revolute[joint]:
                spin[body] += axis * v[joint]
                turning[body] += axis * a[joint] + relative
            else:
                acceleration[body] += axis * a[joint] + 2 * relative
            inertia = self._model.inertias[body]
            com, moment = _clean(inertia.lever), _clean(inertia.inertia)
            forces[body] = inertia.mass * (
                acceleration[body]
                + ca.cross(turning[body], com)
                + ca.cross(spin[body], ca.cross(spin[body], com))
            )
            moments[body] = moment @ turning[body] + ca.cross(spin[body], moment @ spin[body])
            moments[body] += ca.cross(com, forces[body])
        return forces, moments

    def _require_agreement(self) -> None:
        rng, count = np.random.default_rng(0), self._robot.joint_count
        states = rng.uniform(-2, 2, (3, 20, count))
        q, v, a = (ca.SX.sym(name, count) for name in "qva")
        own = ca.Function("own", [q, v, a], [self.inverse_dynamics(q, v, a), self.tool_position(q)])
        efforts, tools = (np.array(rows).T for rows in own.map(20)(*(s.T for s in states)))
        for found, wanted in (
            (efforts, self._robot.inverse_dynamics(*states)),
            (tools, self._robot.tool_position(states[0])),
        ):
            assert abs(found - wanted).max() <= AGREEMENT * max(1.0, abs(wanted).max())


def joint_axes(model: pin.Model) -> dict[int, np.ndarray]:
    """Return every joint's axis in the frame of the body that it moves."""
    data = model.createData()
    pin.computeJointJacobians(model, data, np.zeros(model.nq))
    axes = {}
    for body in range(1, model.njoints):
        column = pin.getJointJacobian(model, data, body, pin.LOCAL)[:, model.idx_vs[body]]
        axes[body] = _clean(column[:3] + column[3:])  # one of the halves is zero
    return axes


def _clean(values: np.ndarray) -> np.ndarray:
    """Return values without the rounding that would keep expressions from becoming simpler."""
    return np.where(abs(values) < 1e-14, 0.0, values)


def _rule(unknowns: ca.SX, numbers: ca.SX, value: ca.SX) -> ca.Function:
    """Return a small constraint function of unknowns and given numbers."""
    return ca.Function("rule", [unknowns, numbers], [ca.densify(value)])


@dataclass(frozen=True, eq=False)
class ArmRules:
    """All rules of one arm; z is q, v, a, the next a and the phase's duration T unless said.

    Time is counted in a unit of about the trajectory's duration: all unknowns are near 1 then.
    """

    gap: ca.Function  # p: width; z has all of the next node
    ranges: ca.Function  # p: width, place
    motors: ca.Function  # p: width, place, time unit [s]
    jerk: ca.Function  # p: width
    tube: ca.Function  # p: width, place, A, B - A, radius; z has the fraction of the axis too


@cache
def arm_rules(robot: RobotModel) -> ArmRules:
    """Return the rules of an arm: efforts as shares of their limits, tube as distance^2 / radius.

    Squared distances alone, or as shares of squared radii, have slopes far from 1 beside a thin
    axis; the solver fails with them.
    """
    arm, n = SymbolicArm(robot), robot.joint_count
    q, v, a, next_q, next_v, next_a = (ca.SX.sym(name, n) for name in "qvaQVA")
    total, width, place = (ca.SX.sym(name) for name in ("T", "width", "place"))
    z, h, t = ca.vertcat(q, v, a, next_a, total), width * total, place * width * total
    a_t = a + place * (next_a - a)
    v_t = v + t * (a + place * (next_a - a) / 2)
    q_t = q + t * v + t * t * (a / 2 + place * (next_a - a) / 6)
    gap = ca.vertcat(
        q + h * v + h * h * (2 * a + next_a) / 6 - next_q, v + h * (a + next_a) / 2 - next_v
    )
    bounded = np.flatnonzero(np.isfinite(robot.limits.effort)).tolist()
    unit = ca.SX.sym("unit")
    efforts = arm.inverse_dynamics(q_t, v_t / unit, a_t / unit**2)
    motors = ca.vertcat(*(efforts[j] / robot.limits.effort[j] for j in bounded))
    begin, along = ca.SX.sym("begin", 3), ca.SX.sym("along", 3)
    radius, axis_fraction = ca.SX.sym("radius"), ca.SX.sym("axis_share")
    off = arm.tool_position(q_t) - begin - axis_fraction * along
    sample = ca.vertcat(width, place)
    return ArmRules(
        _rule(ca.vertcat(q, v, a, next_q, next_v, next_a, total), width, gap),
        _rule(z, sample, ca.vertcat(q_t, v_t)),
        _rule(z, ca.vertcat(sample, unit), motors),
        _rule(z, width, (next_a - a) / h),
        _rule(
            ca.vertcat(z, axis_fraction),
            ca.vertcat(sample, begin, along, radius),
            ca.dot(off, off) / radius,
        ),
    )


@dataclass(frozen=True, eq=False)
class Grid:
    """Intervals of phases, K in all.

    Attributes:
        phase: Of every interval, shape (K,).
        width: As a fraction of the phase, shape (K,).
    """

    phase: np.ndarray
    width: np.ndarray

    def times(self, durations: np.ndarray) -> np.ndarray:
        """Return the nodes' times (K+1,) [s] for durations of the phases (m,) [s]."""
        return np.concatenate([[0.0], np.cumsum(self.width * durations[self.phase])])

    @property
    def last_of_phase(self) -> np.ndarray:
        """Whether an interval ends a phase, shape (K,)."""
        return np.diff(self.phase, append=self.phase[-1] + 1) > 0


def phase_grid(switching_times: np.ndarray, intervals: int, *, clustered: bool) -> Grid:
    """Return about so many intervals for phases between switching times (m+1,) from 0 to 1.

    Args:
        switching_times: Ends of the phases.
        intervals: Of all phases.
        clustered: Denser at both ends of the trajectory, as Chebyshev points are; else uniform.
    """
    place = (
        np.arccos(np.clip(1 - 2 * switching_times, -1, 1)) / np.pi if clustered else switching_times
    )
    phase, width = [], []
    for k in range(len(switching_times) - 1):
        count = max(3, round(intervals * (place[k + 1] - place[k])))
        nodes = np.linspace(place[k], place[k + 1], count + 1)
        if clustered:
            nodes = (1 - np.cos(np.pi * nodes)) / 2
        phase.append(np.full(count, k))
        width.append(np.diff(nodes) / (nodes[-1] - nodes[0]))
    return Grid(np.concatenate(phase), np.concatenate(width))


@dataclass(frozen=True, eq=False)
class Samples:
    """Where conditions are imposed, each by interval (N,) and place in it (N,) from 0 to 1."""

    ranges: tuple[np.ndarray, np.ndarray]
    motors: tuple[np.ndarray, np.ndarray]
    tube: tuple[np.ndarray, np.ndarray]

    def and_also(self, other: "Samples") -> "Samples":
        """Return these samples and others."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in vars(self))
        return Samples(
            *(tuple(np.concatenate(both) for both in zip(*pair, strict=True)) for pair in pairs)
        )

    @property
    def count(self) -> int:
        """Number of samples."""
        return sum(len(interval) for interval, _ in vars(self).values())


def regular_samples(grid: Grid) -> Samples:
    """Return the same samples for every interval; trajectory and phases have their ends too."""
    count, last = len(grid.phase), np.flatnonzero(grid.last_of_phase)
    parts = (
        (RANGE_SAMPLES, np.zeros(0, dtype=int)),
        (MOTOR_SAMPLES, last[-1:]),
        (TUBE_SAMPLES, last),
    )
    return Samples(
        *(
            (
                np.append(np.repeat(np.arange(count), len(places)), ends),
                np.append(np.tile(places, count), np.ones(len(ends))),
            )
            for places, ends in parts
        )
    )


@dataclass(frozen=True, eq=False)
class PhasedTrajectory:
    """A trajectory with the times at which phases end.

    Attributes:
        trajectory: The trajectory.
        switching_times: Shape (m+1,) [s], from 0 to the duration.
    """

    trajectory: JointTrajectory
    switching_times: np.ndarray


@dataclass(frozen=True, eq=False)
class Solution:
    """What the solver made of a start.

    Attributes:
        trajectory: Its trajectory.
        converged: Whether it says that this is a local optimum.
        iterations: How many it took.
    """

    phased: PhasedTrajectory
    converged: bool
    iterations: int


@dataclass(frozen=True, eq=False)
class _Block:
    """A rule applied B times: unknowns (z, B), numbers (p, B), bounds (c, B)."""

    rule: ca.Function
    unknowns: np.ndarray
    numbers: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class Transcription:
    """The program of one problem on one grid.

    The tool of phase k stays in capsule k, at the phase's ends in those of both its neighbours.
    """

    def __init__(
        self, problem: PlanningProblem, ends: np.ndarray, grid: Grid, unit: float, samples: Samples
    ) -> None:
        """Set the program up.

        Args:
            problem: The planning problem; obstacles are ignored.
            ends: First and last configuration, shape (2, n).
            grid: The intervals.
            unit: Of time, about the trajectory's duration [s].
            samples: Where conditions are imposed.
        """
        self._problem, self._ends, self._grid, self._unit = problem, ends, grid, unit
        self._n, self._count = problem.robot.joint_count, len(grid.phase)
        self._phases = problem.tube.segment_count
        self._samples, self._tube_at = samples, samples.tube
        self._nodes = np.arange((self._count + 1) * 3 * self._n).reshape(-1, 3 * self._n)
        self._durations = self._nodes.size + np.arange(self._phases)
        self._axis_fractions = self._nodes.size + self._phases + np.arange(len(self._tube_at[0]))
        self._size = self._nodes.size + self._phases + len(self._axis_fractions)
        self._blocks = self._all_blocks()

    def solved(self, start: PhasedTrajectory, seconds: float, options: dict) -> Solution:
        """Return what the solver makes of a start within some seconds of wall time."""
        unknown = ca.MX.sym("x", self._size)
        values = [_applied(block, unknown) for block in self._blocks]
        duration = ca.sum1(unknown[self._durations.tolist()])
        settings = {"max_wall_time": max(seconds, 1.0), **options}
        solver = ca.nlpsol(
            "solver",
            "ipopt",
            {"x": unknown, "f": duration, "g": ca.vertcat(*values)},
            {
                "print_time": False,
                "error_on_fail": False,
                **{f"ipopt.{name}": value for name, value in settings.items()},
            },
        )
        lower, upper = self._bounds()
        answer = solver(
            x0=np.clip(self._guess(start), lower, upper),
            lbx=lower,
            ubx=upper,
            lbg=np.concatenate([block.lower.ravel(order="F") for block in self._blocks]),
            ubg=np.concatenate([block.upper.ravel(order="F") for block in self._blocks]),
        )
        stats = solver.stats()
        phased = self._trajectory(np.array(answer["x"]).ravel())
        return Solution(phased, bool(stats["success"]), int(stats["iter_count"]))

    def broken_between_samples(self, phased: PhasedTrajectory) -> Samples:
        """Return the worst place of every interval in which a condition is broken."""
        trajectory, robot = phased.trajectory, self._problem.robot
        states = trajectory.per_piece(SAMPLES_PER_PIECE)
        q, v, a = states.position, states.velocity, states.acceleration
        phase = np.repeat(self._grid.phase, SAMPLES_PER_PIECE)
        lower, upper = self._problem.joint_lower[phase], self._problem.joint_upper[phase]
        ranges = np.hstack([lower - q, q - upper, abs(v) / robot.limits.velocity - 1])
        effort = abs(robot.inverse_dynamics(q, v, a)) / robot.limits.effort - 1
        margin = self._problem.tube.margin(robot.tool_position(q))
        outside = -margin[np.arange(len(phase)), phase]
        return Samples(
            self._worst(ranges.max(axis=1), BROKEN),
            self._worst(effort.max(axis=1), BROKEN),
            self._worst(outside, 0.0),
        )

    def _worst(self, excess: np.ndarray, allowed: float) -> tuple[np.ndarray, np.ndarray]:
        by_interval = excess.reshape(self._count, SAMPLES_PER_PIECE)
        chosen = np.flatnonzero(by_interval.max(axis=1) > allowed)
        return chosen, by_interval[chosen].argmax(axis=1) / (SAMPLES_PER_PIECE - 1)

    def _all_blocks(self) -> list[_Block]:
        robot, rules, n = self._problem.robot, arm_rules(self._problem.robot), self._n
        limits, intervals = robot.limits, np.arange(self._count)
        width = self._grid.width[None]
        gap = np.vstack([self._nodes[:-1].T, self._nodes[1:].T, self._phase_durations(intervals)])
        blocks = [_block(rules.gap, gap, width, 0.0, 0.0)]
        if np.isfinite(limits.effort).any():
            blocks.append(self._motor_block(rules.motors))
        lower, upper = self._problem.joint_lower, self._problem.joint_upper
        velocity = np.broadcast_to(limits.velocity * self._unit, lower.shape)
        low, high = np.hstack([lower, -velocity]), np.hstack([upper, velocity])
        interval, place = self._samples.ranges
        unknowns, phase = self._sample_unknowns(interval), self._grid.phase[interval]
        numbers = np.vstack([self._grid.width[interval], place])
        blocks.append(_block(rules.ranges, unknowns, numbers, low[phase].T, high[phase].T))
        if np.isfinite(limits.jerk).any():
            unknowns = self._sample_unknowns(intervals)
            jerk = limits.jerk[:, None] * self._unit**3
            blocks.append(_block(rules.jerk, unknowns, width, -jerk, jerk))
        return [*blocks, self._tube_block(rules.tube, n)]

    def _tube_block(self, rule: ca.Function, n: int) -> _Block:
        interval, place = self._tube_at
        tube, phase = self._problem.tube, self._grid.phase[interval]
        numbers = np.vstack(
            [
                self._grid.width[interval],
                place,
                tube.points[phase].T,
                np.diff(tube.points, axis=0)[phase].T,
                tube.effective_radius[phase] - TUBE_MARGIN,
            ]
        )
        unknowns = np.vstack([self._sample_unknowns(interval), self._axis_fractions])
        return _block(rule, unknowns, numbers, -np.inf, numbers[-1:])

    def _motor_block(self, rule: ca.Function) -> _Block:
        interval, place = self._samples.motors
        numbers = [self._grid.width[interval], place, np.full(len(place), self._unit)]
        return _block(rule, self._sample_unknowns(interval), np.vstack(numbers), -1.0, 1.0)

    def _sample_unknowns(self, interval: np.ndarray) -> np.ndarray:
        following = self._nodes[interval + 1, 2 * self._n :]
        durations = self._phase_durations(interval)
        return np.vstack([self._nodes[interval].T, following.T, durations])

    def _phase_durations(self, interval: np.ndarray) -> np.ndarray:
        return self._durations[self._grid.phase[interval]][None]

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds on the unknowns; a node between phases keeps to both."""
        limits, phase = self._problem.robot.limits, self._grid.phase
        before, after = np.append(phase[0], phase), np.append(phase, phase[-1])
        lower, upper = self._problem.joint_lower, self._problem.joint_upper
        rates = np.concatenate([limits.velocity * self._unit, limits.acceleration * self._unit**2])
        rates = np.broadcast_to(rates, (self._count + 1, 2 * self._n))
        low = np.hstack([np.maximum(lower[before], lower[after]), -rates])
        high = np.hstack([np.minimum(upper[before], upper[after]), rates])
        for node, q in zip((0, -1), self._ends, strict=True):
            low[node] = high[node] = np.concatenate([q, np.zeros(2 * self._n)])
        free = np.zeros(self._phases), np.full(self._phases, np.inf)
        fractions = len(self._axis_fractions)
        return (
            np.concatenate([low.ravel(), free[0] + MIN_PHASE / self._unit, np.zeros(fractions)]),
            np.concatenate([high.ravel(), free[1], np.ones(fractions)]),
        )

    def _guess(self, start: PhasedTrajectory) -> np.ndarray:
        durations = np.maximum(np.diff(start.switching_times), MIN_PHASE)
        samples = start.trajectory.at(self._grid.times(durations))
        rates = [samples.velocity * self._unit, samples.acceleration * self._unit**2]
        nodes = np.hstack([samples.position, *rates])
        interval, place = self._tube_at
        times = self._grid.times(durations)
        tool = self._problem.robot.tool_position(
            start.trajectory.position(times[interval] + place * np.diff(times)[interval])
        )
        phase, tube = self._grid.phase[interval], self._problem.tube
        nearest = tube.nearest(tool)[np.arange(len(phase)), phase] - tube.points[phase]
        along = np.diff(tube.points, axis=0)[phase]
        fraction = np.sum(nearest * along, axis=1) / np.sum(along**2, axis=1)
        return np.concatenate([nodes.ravel(), durations / self._unit, fraction])

    def _trajectory(self, unknown: np.ndarray) -> PhasedTrajectory:
        q, v, a = np.split(unknown[: self._nodes.size].reshape(self._count + 1, -1), 3, axis=1)
        durations = unknown[self._durations] * self._unit
        v, a = v / self._unit, a / self._unit**2
        times = self._grid.times(durations)
        rows = [np.diff(a, axis=0) / (6 * np.diff(times)[:, None]), a[:-1] / 2, v[:-1], q[:-1]]
        trajectory = JointTrajectory(self._problem.robot.joint_names, times, rows)
        return PhasedTrajectory(trajectory, np.concatenate([[0.0], np.cumsum(durations)]))


def _block(
    rule: ca.Function, unknowns: np.ndarray, numbers: np.ndarray, lower: object, upper: object
) -> _Block:
    shape = (rule.size1_out(0), unknowns.shape[1])
    bounds = (np.array(np.broadcast_to(bound, shape), dtype=float) for bound in (lower, upper))
    return _Block(rule, unknowns, numbers, *bounds)


def _applied(block: _Block, unknown: ca.MX) -> ca.MX:
    """Return the values of a rule that is applied many times, one below the other."""
    columns = ca.reshape(unknown[block.unknowns.ravel(order="F").tolist()], block.unknowns.shape)
    return ca.vec(block.rule.map(block.unknowns.shape[1])(columns, block.numbers))
