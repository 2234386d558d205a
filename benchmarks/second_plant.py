"""Do robust plans survive on a second simulation, written apart from the package's own?

    python benchmarks/second_plant.py [--runs 100] [--seed 1000] [--problems NAME ...]
        [--controller computed-torque]

The second plant is Pinocchio's articulated-body algorithm on the URDF, with an integrator, errors,
a controller and a judge of its own; the judge takes segments of round tubes in any order. Prints
durations [s] of the default plan, of the robust plan, and of two plans that are run slower as a
whole until all arms of the package's simulation survive: of the default plan, and of that of a tube
narrowed, and obstacles enlarged, by hand. Then, of the robust plan with errors of no, half and full
size, by both plants: failed runs, the largest velocity over its limit, and the largest distance of
a joint from the plan [rad]. Without errors two arms run: all are alike. Exit status 1 if an arm
without errors leaves the stored motions, if both plants differ, or if a slowed plan is shorter.
"""

import argparse
import sys
from collections import Counter
from dataclasses import replace

import numpy as np
import pinocchio as pin

from shared import ARMS, HERE, figure
from tubeplanner import JointTrajectory, PlanningProblem, Robustness, load_problem, plan
from tubeplanner.arrays import FloatArray
from tubeplanner.execution.error_contributions import simulated_runs
from tubeplanner.execution.plants import Draw
from tubeplanner.execution.run_verdict import RunVerdict, run_verdict
from tubeplanner.planning.tightening import Tightening, tightened_problem
from tubeplanner.trajectory.reader import read_trajectory

PROBLEMS = (*ARMS, "ur5/level_tray")
SIZES = (0.0, 0.5, 1.0)  # of the errors, over their bounds
MAX_DIFFERENCE = 0.01  # fraction of the runs
MAX_STRAY = 1e-3  # [rad], of an arm without errors from a stored motion
AFTERWARDS = 0.2  # [s], for which the goal is held
STEPS = 4  # of the integration, in a control period
MAX_VELOCITY = 1e3  # [rad/s]: arms out of control stay finite
MAX_BANDWIDTH, MAX_ANGLE = 80.0, 0.4  # [rad/s], and [rad] in a control period
TRAVEL = 0.1  # [rad]: an error that the effort limit answers
SLIDE = 0.1  # [m/rad]: sliding joints beside turning ones
INTEGRAL, FREEDOMS = 0.1, 2.0  # of the effort limit; of a joint's inertia over that of all locked
BETWEEN = np.arange(10)[:, None] / 10  # of control instants, where the tool is judged
VELOCITY_TOLERANCE = 0.05  # where neither the field nor a preset has one
SLOWER, BY_HAND = 1.05 ** np.arange(25), 0.0015  # [m], of a radius and of the clearance


class Chances:
    """Errors of R arms, over their bounds: the first arm has all of them, the second none."""

    def __init__(self, draw: Draw) -> None:
        seeds = [[draw.seed, k] for k in range(draw.runs)]
        self.random = [np.random.Generator(np.random.MT19937(seed)) for seed in seeds]

    def fraction(self, *shape: int) -> FloatArray:
        """Return numbers from 0 to 1, shape (R, ...)."""
        drawn = np.array([random.random(shape) for random in self.random])
        drawn[:1], drawn[1:2] = 1.0, 0.0
        return drawn

    def signed(self, *shape: int) -> FloatArray:
        """Return numbers from -1 to 1, shape (R, ...)."""
        return self.fraction(*shape) * [each.choice([-1.0, 1.0], shape) for each in self.random]

    def ball(self, *shape: int) -> FloatArray:
        """Return vectors from the unit ball, shape (R, ..., 3)."""
        direction = np.array([random.normal(size=(*shape, 3)) for random in self.random])
        distance = np.linalg.norm(direction, axis=-1, keepdims=True)
        return np.asarray(np.cbrt(self.fraction(*shape, 1)) * direction / distance)


def arm_model(
    problem: PlanningProblem, mass: FloatArray, com: FloatArray, payload: float
) -> pin.Model:
    """Return a model of the n joints with factors on masses and shifted centres (n, 3) [m]."""
    robot, load = problem.robot, problem.robot.payload
    whole = pin.buildModelFromUrdf(str(robot.urdf.path))
    locked = [k for k, name in enumerate(whole.names) if k and name not in robot.joint_names]
    rest = np.clip(pin.neutral(whole), whole.lowerPositionLimit, whole.upperPositionLimit)
    model = pin.buildReducedModel(whole, locked, rest)
    if tuple(model.names)[1:] != robot.joint_names or model.nq != model.nv or robot.locked_joints:
        raise SystemExit(f"{problem.name}: joints in another order, continuous or locked by hand")
    model.gravity = pin.Motion(robot.in_root_frame().gravity, np.zeros(3))
    model.armature = np.array(robot.motors.armature)
    for body, (factor, shift) in enumerate(zip(mass, com, strict=True), start=1):
        own = model.inertias[body]
        centre = own.lever + shift
        model.inertias[body] = pin.Inertia(factor * own.mass, centre, factor * own.inertia)
    if load is not None:
        xx, yy, zz, xy, xz, yz = load.inertia
        inertia = payload * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        frame = model.frames[model.getFrameId(robot.tool_frame, pin.FrameType.BODY)]
        carried = pin.Inertia(payload * load.mass, np.array(load.com), inertia)
        model.appendBodyToJoint(frame.parentJoint, carried, frame.placement)
    return model


class RealArms:
    """R arms with errors, in motion.

    Positions and velocities are `state` (2, R, n); `noise` (R, K, n) is added to those measured.
    `tool` and `base` (R, 3) are shifts of the tool, in its frame, and of the robot [m].
    """

    def __init__(
        self, problem: PlanningProblem, errors: Robustness, draw: Draw, controller: "Controller"
    ) -> None:
        """Draw the arms; they rest at the start of the controller's plan."""
        chances, (count, n), runs = Chances(draw), controller.position.shape, draw.runs
        motors, limits = problem.robot.motors, problem.robot.limits
        mass, com = 1 + errors.mass * chances.signed(n), errors.com * chances.ball(n)
        wrong = zip(mass, com, 1 + errors.payload * chances.signed(), strict=True)
        self._models = [arm_model(problem, *each) for each in wrong]
        self._data = [model.createData() for model in self._models]
        friction = motors.viscous_friction, motors.backwards_friction, motors.forwards_friction
        real = (1 + errors.friction * chances.signed(3, n)) * friction
        slope = np.where(np.isfinite(limits.velocity), limits.effort / limits.velocity, 0.0)
        self._viscous = real[:, 0] + errors.unmodelled_friction * chances.fraction(n) * slope
        self._backwards, self._forwards = real[:, 1], real[:, 2]
        self._step, lag = errors.control_period / STEPS, errors.lag * chances.fraction(1)
        # Shares of a lag at the begin, in the middle and at the end of a step.
        after = self._step * np.array([0.0, 0.5, 1.0])[:, None, None]
        self._left = np.exp(-after / np.maximum(lag, 1e-12)) * (lag > 0)
        self._late = np.rint(errors.delay * chances.fraction() / self._step).astype(int)
        self.tool, self.base = errors.tool * chances.ball(), errors.base * chances.ball()
        drawn = [random.normal(size=(count, n)) for random in chances.random]
        self.noise = errors.noise * chances.fraction(1, 1) * np.array(drawn)
        self.state = np.stack([np.tile(controller.position[0], (runs, 1)), np.zeros((runs, n))])
        self._effort = np.tile(controller.start_effort, (runs, 1))
        self._sent = [self._effort] * (int(self._late.max()) + 1)
        # Coulomb friction is whole from the velocity that it takes away within a step.
        most = np.maximum(motors.backwards_friction, motors.forwards_friction)
        self._creep = np.maximum(most / controller.inertia[0] * self._step, 1e-9)

    def move(self, command: FloatArray) -> None:
        """Integrate a control period (Runge-Kutta, fourth order) under commands (R, n)."""
        h = self._step
        for _ in range(STEPS):
            self._sent = [*self._sent[1:], command]
            late = np.array(self._sent)[len(self._sent) - 1 - self._late, np.arange(len(command))]
            begin, middle, end = late + self._left * (self._effort - late)
            x, self._effort = self.state, end
            k1 = self._rate(x, begin)
            k2 = self._rate(x + h / 2 * k1, middle)
            k3 = self._rate(x + h / 2 * k2, middle)
            k4 = self._rate(x + h * k3, end)
            self.state = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            self.state[1] = np.clip(self.state[1], -MAX_VELOCITY, MAX_VELOCITY)

    def _rate(self, state: FloatArray, effort: FloatArray) -> FloatArray:
        q, v = state
        coulomb = np.where(v > 0, self._forwards, self._backwards) * np.tanh(v / self._creep)
        net = effort - self._viscous * v - coulomb
        arms = zip(self._models, self._data, q, v, net, strict=True)
        return np.array([v, [pin.aba(*arm) for arm in arms]])


class Controller:
    """A controller of R arms that knows the plan, at K control instants, and the exact arm."""

    def __init__(
        self, problem: PlanningProblem, motion: JointTrajectory, errors: Robustness
    ) -> None:
        n = problem.robot.joint_count
        self._model = arm_model(problem, np.ones(n), np.zeros((n, 3)), 1.0)
        self._data, self._motors = self._model.createData(), problem.robot.motors
        self._name, self._period = errors.controller, errors.control_period
        time = self._period * np.arange(np.ceil((motion.duration + AFTERWARDS) / self._period) + 1)
        self.position, self._velocity = _held(motion, time)
        q, v = self._middle = _held(motion, time + self._period / 2)
        after = _held(motion, time + self._period)[1]
        self._mean = (after - self._velocity) / self._period
        diagonals = [np.diag(pin.computeMinverse(self._model, self._data, each)) for each in q]
        locked = [np.diag(pin.crba(self._model, self._data, each)) for each in q]
        self.inertia, self._limit = 1 / np.array(diagonals), problem.robot.limits.effort
        self._growth = np.minimum(FREEDOMS * self.inertia / np.array(locked), 1.0)
        stiffness = self._limit / (TRAVEL * np.where(problem.robot.revolute, 1.0, SLIDE))
        fastest = min(MAX_BANDWIDTH, MAX_ANGLE / self._period)
        stiff = np.minimum(np.sqrt(stiffness / (3 * self.inertia)), fastest)
        least = min(errors.bandwidth, fastest)
        # An impedance of constant stiffness has no least bandwidth.
        self._bandwidth = np.maximum(stiff, 0.0 if self._name == "pd" else least)
        self._coulomb = self._motors.coulomb_effort(v)
        self._effort = self._inverse_dynamics(q, v, self._mean) + self._coulomb
        self._integral: FloatArray | float = 0.0
        self.start_effort = self._inverse_dynamics(self.position[:1], 0 * v[:1], 0 * v[:1])[0]

    def command(self, k: int, q: FloatArray, v: FloatArray) -> FloatArray:
        """Return efforts (R, n) at instant k for measured positions and velocities (R, n)."""
        w, inertia, most = self._bandwidth[k], self.inertia[k], INTEGRAL * self._limit
        error, rate = self.position[k] - q, self._velocity[k] - v
        grown = self._integral + self._growth[k] * inertia * w**3 * error * self._period
        self._integral = np.clip(grown, -most, most)
        feedback = 3 * w**2 * error + 3 * w * rate + self._integral / inertia
        if self._name == "computed-torque":
            # At the measured state, moved on to the middle of the period.
            q, v = self._middle[0][k] - error, self._middle[1][k] - rate
            asked = self._inverse_dynamics(q, v, self._mean[k] + feedback) + self._coulomb[k]
        else:
            asked = self._effort[k] + inertia * feedback
        return np.clip(asked, -self._limit, self._limit)

    def _inverse_dynamics(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        rigid = [pin.rnea(self._model, self._data, *state) for state in zip(q, v, a, strict=True)]
        return np.array(rigid) + self._motors.viscous_friction * v


def _held(motion: JointTrajectory, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    moving = (time < motion.duration)[:, None]
    return motion.position(time), np.where(moving, motion.velocity(time), 0.0)


def second_verdict(
    problem: PlanningProblem, motion: JointTrajectory, errors: Robustness, draw: Draw
) -> RunVerdict:
    """Return what the second plant's runs of a motion show."""
    robot, states = problem.robot, []
    controller = Controller(problem, motion.reordered(robot.joint_names), errors)
    arms = RealArms(problem, errors, draw, controller)
    rates = np.diff(arms.noise, axis=1, prepend=0.0) / errors.control_period
    for k in range(len(controller.position)):
        states.append(arms.state)
        q, v = arms.state
        arms.move(controller.command(k, q + arms.noise[:, k], v + rates[:, k]))
    q, v = np.array(states).transpose(1, 2, 0, 3)  # (R, K, n) each
    off = abs(q - controller.position) / np.where(robot.revolute, 1.0, SLIDE)
    speed, tracking = (abs(v) / robot.limits.velocity).max(axis=(1, 2)), off.max(axis=(1, 2))
    tolerances = errors.velocity_tolerance, robot.limits.velocity_tolerance, VELOCITY_TOLERANCE
    fast = 1 + next(each for each in tolerances if each is not None)
    counts, failed = Counter[str](), 0
    for run in range(draw.runs):
        broken = _broken_places(problem, q[run], arms.tool[run], arms.base[run])
        broken["velocity"] = bool(speed[run] > fast)
        broken["tracking"] = bool(tracking[run] > (errors.path_tolerance or np.inf))
        counts.update(name for name, is_broken in broken.items() if is_broken)
        failed += any(broken.values())
    return RunVerdict(draw.runs, failed, counts, float(speed.max()), float(tracking.max()))


def _broken_places(
    problem: PlanningProblem, q: FloatArray, shift: FloatArray, base: FloatArray
) -> dict[str, bool]:
    """Return whether a run (K, n) with shifts of tool and base breaks each rule of place."""
    robot, tube, limits = problem.robot, problem.tube, problem.robot.limits
    # At 3 m/s a tool passes a corner by a millimetre between two control instants.
    dense = (q[:-1, None] + BETWEEN * np.diff(q, axis=0)[:, None]).reshape(-1, q.shape[1])
    turn, tool = robot.tool_pose(dense)
    tool = tool + turn @ shift + base
    begin, along = tube.points[:-1], np.diff(tube.points, axis=0)
    fraction = np.einsum("kmi,mi->km", tool[:, None] - begin, along) / (along**2).sum(axis=1)
    nearest = begin + np.clip(fraction, 0.0, 1.0)[:, :, None] * along
    slack = tube.radius - np.linalg.norm(tool[:, None] - nearest, axis=2)
    lower, upper = tube.ranges_of(robot.joint_names)
    in_ranges = np.minimum(dense[:, None] - lower, upper - dense[:, None]).min(axis=2)
    fits = np.minimum(np.minimum(slack, in_ranges), tube.rotation_margin(turn, tool))
    (rotation, origin), checker, broken = robot.body_poses(q), problem.collision, {}
    moved = np.concatenate([origin[:, :1], origin[:, 1:] + base], axis=1)
    for name, at, pairs, least in (
        ("obstacles", moved, checker.obstacle_pairs, problem.clearance),
        ("self_collision", origin, checker.link_pairs, 0.0),
    ):
        row, column = np.nonzero(checker.sphere_distances(rotation, at, pairs) < least)
        close = checker.box_distances(rotation, at, row, pairs[column]) < least
        row, pair = row[close], pairs[column[close]]
        found = checker.closest_points(rotation[row], at[row], pair).distance
        broken[name] = bool((found < least).any())
    broken["tube"] = bool((fits.max(axis=1) < 0).any())
    broken["position"] = bool(((q < limits.lower_position) | (q > limits.upper_position)).any())
    return broken


def largest_stray(name: str) -> float:
    """Return the largest distance of an arm without errors from stored motions [rad]."""
    problem, folder = load_problem(f"example:{name}"), HERE / "tests/data/trajectories"
    return max(
        second_verdict(problem, read_trajectory(path), Robustness.exact(), Draw(1)).tracking
        for path in folder.glob(f"{name.replace('/', '.')}.*.json")
    )


def printed_row(name: str, draw: Draw, controller: str) -> list[str]:
    """Print the row of a problem; return its faults in words."""
    problem, errors = load_problem(f"example:{name}"), Robustness(controller=controller)
    surviving = load_problem(f"example:{name}", changes={"robustness": {"controller": controller}})
    default, robust = plan(problem).trajectory, plan(surviving).trajectory
    if robust is None or default is None:
        return [f"{name}: no plan"]

    def verdict(second: bool, motion: JointTrajectory, size: float, runs: int) -> RunVerdict:
        arms, wrong = Draw(runs, draw.seed), errors.enlarged(size)
        if second:
            return second_verdict(problem, motion, wrong, arms)
        return run_verdict(simulated_runs(problem.joined, motion, wrong, arms))

    def slowed(motion: JointTrajectory | None) -> float | None:
        for slower in [] if motion is None else map(motion.scaled, SLOWER):
            if not any(verdict(False, slower, 1.0, runs).failed for runs in (10, draw.runs)):
                return slower.duration
        return None

    none = Tightening.nothing(problem.joined)
    by_hand = replace(none, radius=none.radius + BY_HAND, clearance=BY_HAND)
    slow = slowed(default), slowed(plan(tightened_problem(problem.joined, by_hand)).trajectory)
    row = f"{name:26}{default.duration:8.4f}{robust.duration:8.4f}"
    row += "".join(f"{figure(each):>8}" for each in slow)
    faults = [
        f"{name}: slowed to {each:.4f} s it survives, and the robust plan takes longer"
        for each in slow
        if each is not None and each < robust.duration
    ]
    for size in SIZES:
        runs = draw.runs if size else 2
        both = [verdict(second, robust, size, runs) for second in (False, True)]
        for each in both:
            row += f"{each.failed:5d}{each.velocity or 0.0:6.3f}{each.tracking:7.4f}"
        if abs(both[0].failed - both[1].failed) > MAX_DIFFERENCE * runs:
            faults.append(f"{name}, errors times {size:g}: {both[0]}; second plant: {both[1]}")
    print(row, flush=True)
    return faults


def main() -> int:
    """Print the table and the faults; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100, help="arms of every size of errors")
    parser.add_argument("--seed", type=int, default=1000, help="planning draws from 0 and 1")
    parser.add_argument("--problems", nargs="+", default=PROBLEMS, metavar="NAME")
    parser.add_argument("--controller", default=Robustness.controller)
    asked = parser.parse_args()
    sizes = "".join(f"{f'errors times {size:g}':>18}{'second plant':>18}" for size in SIZES)
    print(f"{'':26} default  robust  slowed by hand{sizes}")
    print(f"{'problem':58}{2 * len(SIZES) * ' fail     v    off'}", flush=True)
    faults = []
    for name in asked.problems:
        if (stray := largest_stray(name)) > MAX_STRAY:
            faults.append(f"{name}: an arm without errors is {stray:.2g} rad from a stored motion")
        faults += printed_row(name, Draw(asked.runs, asked.seed), asked.controller)
    print("\n".join(faults) or "both plants agree")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
