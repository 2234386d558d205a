"""Verdicts of robot controllers on a trajectory: libfranka's joint positions, ros2_control."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import OptionError
from tubeplanner.output.files.samples import motion_samples
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.overrides import QUANTITIES, LimitOverrides
from tubeplanner.task.motion import Motion
from tubeplanner.task.side_files import read_preset
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import peak_magnitudes
from tubeplanner.trajectory.reader import GivenSamples, TrajectoryFile


class Effect(StrEnum):
    """Consequence of a finding.

    The controller refuses or aborts the motion; executes another motion than the file's; or accepts
    it, with a remark.
    """

    REFUSED = "refused"
    ALTERED = "altered"
    NOTED = "noted"


@dataclass(frozen=True)
class ControllerFinding:
    """A finding of a controller; fields that do not apply are None."""

    effect: Effect  # consequence of the finding
    error: str  # in the controller's words: the name of its error, or its action
    message: str  # one sentence
    joint: str | None = None  # joint of the value
    value: float | None = None  # of the joint or of the tool
    limit: float | None = None  # limit of the value
    unit: str | None = None  # of value and limit
    time: float | None = None  # of the value [s]
    first_time: float | None = None  # first time beyond the limit [s]; a refused motion ends there


@dataclass(frozen=True)
class ControllerVerdict:
    """Findings of a controller on a trajectory."""

    name: str  # of the controller: one of `CONTROLLERS`
    title: str  # description of the controller
    refuses: str  # its action on a bad motion: "abort" or "refuse"
    findings: tuple[ControllerFinding, ...]  # in the order of their effects

    @property
    def accepted(self) -> bool:
        """True if the controller executes the trajectory unchanged."""
        return self.gravest is None

    @property
    def gravest(self) -> ControllerFinding | None:
        """First finding that prevents acceptance, refusals before others; None if accepted."""
        for effect in (Effect.REFUSED, Effect.ALTERED):
            for finding in self.findings:
                if finding.effect is effect:
                    return finding
        return None

    @property
    def summary(self) -> str:
        """Action of the controller, in a few words."""
        gravest = self.gravest
        return "accepted" if gravest is None else self._begins[gravest.effect]

    @property
    def _begins(self) -> dict[Effect, str]:
        """Begin of the line of a finding, by its effect."""
        return {
            Effect.REFUSED: f"would {self.refuses}",
            Effect.ALTERED: "would run otherwise",
            Effect.NOTED: "note",
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {"accepted": self.accepted, **asdict(self)}

    def lines(self) -> list[str]:
        """Return a heading with the verdict, then a line per finding."""
        return [
            f"{self.name} ({self.title}): {self.summary}",
            *(
                f"  {self._begins[each.effect]}: {each.error}: {each.message}"
                for each in self.findings
            ),
        ]


# ---- The limits of Franka's arms: the presets' limits, and a few that only the control has.

_JOINTS = tuple(f"joint {k + 1}" for k in range(7))
# Position limits where the preset leaves them to the URDF [rad]; acceleration and jerk of Cartesian
# commands [m/s^2, m/s^3]. From "Limits for Panda" of Franka's documentation and, of the FR3,
# `kMaxTranslationalAcceleration` and `kMaxTranslationalJerk` of libfranka.
_POSITION = {
    "fer": (
        (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    )
}
_TOOL = {"fer": (13.0, 6500.0), "fr3": (9.0, 4500.0)}
FRANKA_ARMS = {"fer": "Franka Emika Robot (Panda)", "fr3": "Franka Research 3"}
_LAWS, _LAW_KEYS = "velocity_by_position", ("deceleration", "offset", "lower", "upper")


@dataclass(frozen=True, eq=False)
class FrankaLimits:
    """Limits of an arm of seven joints, in chain order."""

    name: str  # of the arm
    position: FloatArray  # lower and upper, shape (2, 7) [rad]
    most: Mapping[str, FloatArray]  # by quantity, of `QUANTITIES` and in its unit, shape (7,)
    # limits of Cartesian translations: velocity, acceleration and jerk [m/s, m/s^2, m/s^3]
    tool_rates: tuple[float, float, float]
    # velocity limits by position: deceleration [rad/s^2], offset [rad/s], lower and upper position
    # [rad], shape (4, 7); None: constant limits
    velocity_laws: FloatArray | None = None

    def velocity_bounds(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest velocity at positions, each (N, 7) [rad/s].

        Args:
            q: Positions, shape (N, 7) [rad].
        """
        most = np.broadcast_to(self.most["velocity"], q.shape)
        if self.velocity_laws is None:
            return -most, most
        deceleration, offset, lower, upper = self.velocity_laws
        slowest, fastest = (
            np.clip(np.sqrt(2 * deceleration * np.maximum(slack, 0.0)) - offset, 0.0, most)
            for slack in (q - lower, upper - q)
        )
        return -slowest, fastest


def franka_limits(name: str) -> FrankaLimits:
    """Return the limits of an arm.

    Args:
        name: Of its preset: one of `FRANKA_ARMS`.
    """
    limits = read_preset(name).limits
    position, laws = _POSITION.get(name), None
    if limits.velocity_by_position:
        by_joint = limits.by_name(_LAWS, _JOINTS, _LAWS)
        laws = read_only([[by_joint[joint][key] for joint in _JOINTS] for key in _LAW_KEYS])
    return FrankaLimits(
        name=FRANKA_ARMS[name],
        position=read_only(_rows(limits, "position").T if position is None else position),
        most={each: _rows(limits, each) for each in QUANTITIES if getattr(limits, each)},
        tool_rates=(np.inf if limits.tool_speed is None else limits.tool_speed, *_TOOL[name]),
        velocity_laws=laws,
    )


def _rows(limits: LimitOverrides, quantity: str) -> FloatArray:
    """Return a preset's values of a quantity, shape (7,) or (7, 2)."""
    by_joint = limits.by_name(quantity, _JOINTS, quantity)
    return read_only([by_joint[joint] for joint in _JOINTS])


# ---- The verdict of libfranka's control of joint positions.
#
# Every millisecond a position is sent to the robot. It takes differences: (q_k - q_(k-1)) / 1 ms is
# the velocity, and so on to jerk. Before the first command and after the last the arm is at rest,
# so that a motion that does not begin or end at rest appears as a jump. The names of errors are
# those of `franka::Errors`; which limits are necessary and which recommended is from Franka's
# "Robot and interface specifications".

PERIOD = 1e-3  # [s]
_STILL = 3  # commands before the first and after the last: a jerk takes three differences
_ROUNDING = 1e-6  # fraction of a limit
_AT_REST = 1e-3  # fraction of a limit: velocity and acceleration at both ends
_GENERATOR = "joint_motion_generator"
_VELOCITY_JUMP = f"{_GENERATOR}_velocity_discontinuity"
_ACCELERATION_JUMP = f"{_GENERATOR}_acceleration_discontinuity"
_RECOMMENDED = "recommended only, the robot follows otherwise without an error"
_CARTESIAN = "enforced for Cartesian commands only"


@dataclass(frozen=True)
class _Quantity:
    """A limited quantity: its name, its unit, the effect and the error of exceeding a limit."""

    name: str
    unit: str
    effect: Effect
    error: str


_ABORTS = (
    _Quantity("position", "rad", Effect.REFUSED, f"{_GENERATOR}_position_limits_violation"),
    _Quantity("velocity", "rad/s", Effect.REFUSED, f"{_GENERATOR}_velocity_limits_violation"),
    _Quantity("acceleration", "rad/s^2", Effect.REFUSED, _VELOCITY_JUMP),
    _Quantity("jerk", "rad/s^3", Effect.REFUSED, _ACCELERATION_JUMP),
)
_EFFORTS = {
    "effort": _Quantity("torque", "N m", Effect.NOTED, _RECOMMENDED),
    "effort_rate": _Quantity("torque rate", "N m/s", Effect.NOTED, _RECOMMENDED),
}
_TOOL_RATES = tuple(
    _Quantity(f"tool {name}", unit, Effect.NOTED, _CARTESIAN)
    for name, unit in (("speed", "m/s"), ("acceleration", "m/s^2"), ("jerk", "m/s^3"))
)


def judged_by_franka(
    name: str, robot: RobotModel, trajectory: JointTrajectory, limits: FrankaLimits
) -> ControllerVerdict:
    """Return the verdict of the control of joint positions on a trajectory.

    Args:
        name: One of `CONTROLLERS`.
        robot: The arm.
        trajectory: Of its joints, in any order; its polynomials are sampled every millisecond.
        limits: Limits of the controller.

    Raises:
        OptionError: The robot has another number of joints than the limits.
    """
    chain = [joint for joint in robot.urdf.chain(robot.tool_frame) if joint in robot.joint_names]
    if len(chain) != robot.joint_count or len(chain) != len(_JOINTS):
        raise OptionError(
            f"--for {name}: the {limits.name} has {len(_JOINTS)} joints; the problem plans "
            f"{robot.joint_count} ({', '.join(robot.joint_names)})"
        )
    commands = _Commands(trajectory.reordered(chain))
    findings = (
        *_aborts(commands, limits),
        *_unrest(commands, limits),
        *_recommended(robot, commands, limits),
        *_cartesian(robot, commands, limits),
    )
    title = f"{limits.name}, libfranka, joint positions at {1 / PERIOD:g} Hz"
    return ControllerVerdict(name, title, "abort", findings)


class _Commands:
    """The commanded positions, and the differences that the robot takes of the positions.

    Attributes:
        trajectory: Joints in chain order.
        time: Of every command, shape (N,) [s]; below 0 and beyond the duration the arm is at rest.
        position: Shape (N, n) [rad].
    """

    def __init__(self, trajectory: JointTrajectory) -> None:
        count = int(np.ceil(trajectory.duration / PERIOD - _ROUNDING))
        self.trajectory = trajectory
        self.time = np.arange(-_STILL, count + _STILL + 1) * PERIOD
        self.position = trajectory.position(self.time)

    def instants(self, order: int) -> FloatArray:
        """Return the time of the command that ends each difference, shape (N - order,) [s]."""
        return np.clip(self.time[order:], 0.0, self.trajectory.duration)


def _differences(values: FloatArray, order: int) -> FloatArray:
    """Return differences of rows over the period, shape (N - order, n)."""
    result: FloatArray = np.diff(values, order, axis=0) / PERIOD**order
    return result


def _aborts(commands: _Commands, limits: FrankaLimits) -> Iterator[ControllerFinding]:
    """Yield positions and differences of positions beyond the necessary limits."""
    position = commands.position
    # As in libfranka's own rate limiter: the limit at the position of the last command.
    bounds = [(*limits.position, np.ones(position.shape[1]))]
    bounds.append((*limits.velocity_bounds(position[:-1]), limits.most["velocity"]))
    for name in ("acceleration", "jerk"):
        bounds.append((-limits.most[name], limits.most[name], limits.most[name]))
    names = commands.trajectory.joint_names
    for order, (quantity, sides) in enumerate(zip(_ABORTS, bounds, strict=True)):
        value, time = _differences(position, order), commands.instants(order)
        yield from _exceeded(quantity, names, time, value, *sides)


def _unrest(commands: _Commands, limits: FrankaLimits) -> Iterator[ControllerFinding]:
    """Yield joints that do not begin or end at rest."""
    trajectory = commands.trajectory
    ends = trajectory.per_piece(2)
    for quantity, jump, rows in (
        (_ABORTS[1], _VELOCITY_JUMP, ends.velocity),
        (_ABORTS[2], _ACCELERATION_JUMP, ends.acceleration),
    ):
        limit = limits.most[quantity.name]
        for side, row in (("start", 0), ("end", -1)):
            joint = int((abs(rows[row]) / limit).argmax())
            value, name = float(rows[row, joint]), trajectory.joint_names[joint]
            if abs(value) <= _AT_REST * limit[joint]:
                continue
            time = 0.0 if row == 0 else trajectory.duration
            message = (
                f"{name} {quantity.name} {value:.3g} {quantity.unit} at the {side}, "
                f"t = {time:.4f} s; it must be 0"
            )
            yield ControllerFinding(
                Effect.REFUSED, jump, message, name, value, 0.0, quantity.unit, time
            )


def _recommended(
    robot: RobotModel, commands: _Commands, limits: FrankaLimits
) -> Iterator[ControllerFinding]:
    """Yield model torques and torque rates beyond the recommended limits."""
    within = commands.trajectory.reordered(robot.joint_names)
    at = within.at(np.clip(commands.time, 0.0, within.duration))
    effort = robot.inverse_dynamics(at.position, at.velocity, at.acceleration)
    names = commands.trajectory.joint_names
    effort = effort[:, [robot.joint_names.index(name) for name in names]]
    for order, (name, quantity) in enumerate(_EFFORTS.items()):
        value, time = _differences(effort, order), commands.instants(order)
        limit = limits.most[name]
        yield from _exceeded(quantity, names, time, value, -limit, limit, limit)


def _cartesian(
    robot: RobotModel, commands: _Commands, limits: FrankaLimits
) -> Iterator[ControllerFinding]:
    """Yield rates of the tool centre point beyond the limits of Cartesian commands."""
    within = commands.trajectory.reordered(robot.joint_names)
    tool = robot.tool_position(within.position(commands.time))
    for order, (quantity, most) in enumerate(zip(_TOOL_RATES, limits.tool_rates, strict=True), 1):
        value = np.linalg.norm(_differences(tool, order), axis=1, keepdims=True)
        limit = np.array([most])
        time = commands.instants(order)
        yield from _exceeded(quantity, (None,), time, value, -limit, limit, limit)


def _exceeded(
    quantity: _Quantity,
    names: tuple[str | None, ...],
    time: FloatArray,
    value: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    scale: FloatArray,
) -> Iterator[ControllerFinding]:
    """Yield the worst value beyond its bounds, if any, and the time of the first excess.

    Args:
        quantity: The compared quantity.
        names: Of the n columns.
        time: Of the N rows [s].
        value: Shape (N, n).
        lower: Shape (n,) or (N, n).
        upper: Shape (n,) or (N, n).
        scale: Divides excesses before joints are compared, shape (n,).
    """
    over = np.maximum(value - upper, lower - value) / scale
    if not over.max() > _ROUNDING:
        return
    row, column = np.unravel_index(int(over.argmax()), over.shape)
    worst, name = float(value[row, column]), names[column]
    below = worst < np.broadcast_to(lower, value.shape)[row, column]
    limit = float(np.broadcast_to(lower if below else upper, value.shape)[row, column])
    first = float(time[int((over > _ROUNDING).any(axis=1).argmax())])
    owner = "" if name is None else f"{name} "
    begins = "" if first == time[row] else f", first at t = {first:.4f} s"
    message = (
        f"{owner}{quantity.name} {_number_text(worst)} {'<' if below else '>'} "
        f"{_number_text(limit)} {quantity.unit} at t = {time[row]:.4f} s{begins}"
    )
    effect, error, unit = quantity.effect, quantity.error, quantity.unit
    instant = float(time[row])
    yield ControllerFinding(effect, error, message, name, worst, limit, unit, instant, first)


def _number_text(value: float) -> str:
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"


# ---- The JointTrajectoryController of ros2_control.
#
# It refuses messages by its `validate_trajectory_msg`, with parameters at their defaults, and joins
# points by polynomials of the degree that the given derivatives determine. It does not check
# whether the arm can follow: limits are checked by the certificate.

_RATE = 500.0  # [Hz], as `plan --ros` writes
_MOVES = float(np.finfo(np.float32).eps)  # the controller's own bound
_FIELDS = {1: "velocities", 2: "accelerations"}
_JOINED = {1: "straight lines", 2: "cubics"}
_TITLE = "JointTrajectoryController of ros2_control, parameters at their defaults"


def judged_by_jtc(name: str, motion: Motion, file: TrajectoryFile) -> ControllerVerdict:
    """Return the verdict on the points of a file, or on exported points of its polynomials.

    Args:
        name: One of `CONTROLLERS`.
        motion: The motion of the file.
        file: The file.
    """
    robot, trajectory, points = motion.task.robot, motion.trajectory, file.samples
    notes: tuple[str, ...] = ()
    if points is None:
        points = GivenSamples(0.0, ("position", "velocity", "acceleration"))
        notes = motion_samples(motion, _RATE).notes
    findings = (
        *_refused(robot, trajectory, points),
        *_altered(robot, trajectory, points),
        *(ControllerFinding(Effect.NOTED, "as plan --ros writes it", note) for note in notes),
    )
    return ControllerVerdict(name, _TITLE, "refuse", findings)


def _refused(
    robot: RobotModel, trajectory: JointTrajectory, points: GivenSamples
) -> Iterator[ControllerFinding]:
    """Yield the refusals of `validate_trajectory_msg` for a readable file."""
    velocity = trajectory.velocity(trajectory.duration)
    joint = int(abs(velocity).argmax())
    if "velocity" in points.quantities and abs(velocity[joint]) > _MOVES:
        error = f"Velocity of last trajectory point of joint {robot.joint_names[joint]} is not zero"
        time = points.first_time + trajectory.duration
        yield _moving(robot, joint, 1, velocity[joint], Effect.REFUSED, error, time)
    if points.has_effort:
        error = (
            "Trajectories with effort fields are only supported for controllers using the 'effort' "
            "command interface"
        )
        yield ControllerFinding(Effect.REFUSED, error, "leave them out, as plan --ros does")


def _altered(
    robot: RobotModel, trajectory: JointTrajectory, points: GivenSamples
) -> Iterator[ControllerFinding]:
    """Yield the differences between the executed motion and the file's."""
    if points.first_time > 0:
        message = (
            "the controller adds a segment of its own, from where the arm is to the first point, "
            f"at t = {points.first_time:.4f} s"
        )
        time = points.first_time
        yield ControllerFinding(Effect.ALTERED, "no point at t = 0", message, time=time)
    for order, what in ((1, "velocity"), (2, "acceleration")):
        coefficients = trajectory.derivative_coefficients(order)
        start = coefficients[-1, 0]
        largest = peak_magnitudes(coefficients, trajectory.widths).value
        joint = int(abs(start).argmax())
        if what in points.quantities and abs(start[joint]) > _AT_REST * largest.max():
            error = f"the {what} jumps where it begins"
            time = points.first_time
            yield _moving(robot, joint, order, start[joint], Effect.ALTERED, error, time)
        if what not in points.quantities:
            error = f"points without {_FIELDS[order]} are joined by {_JOINED[order]}"
            message = f"the {what} jumps at every one; give positions, velocities and accelerations"
            yield ControllerFinding(Effect.ALTERED, error, message)
            return


def _moving(
    robot: RobotModel, joint: int, order: int, value: float, effect: Effect, error: str, time: float
) -> ControllerFinding:
    """Return the finding of a joint that is not at rest at the start or the end."""
    unit = ("rad" if robot.revolute[joint] else "m") + ("/s" if order == 1 else "/s^2")
    name = robot.joint_names[joint]
    message = f"{name} {value:.6g} {unit} at t = {time:.4f} s; it must be 0"
    return ControllerFinding(effect, error, message, name, float(value), 0.0, unit, time)
