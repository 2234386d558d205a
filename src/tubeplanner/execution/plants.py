"""Plants drawn at random about the model; stages with a carried load."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.checks import require_count
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import JointMotors
from tubeplanner.robot.pinocchio_model import BodyInertia, Payload
from tubeplanner.task.demands import Robustness
from tubeplanner.text import short_repr

# ---- Plants: arms drawn at random about the planning model.


@dataclass(frozen=True, eq=False)
class Plant:
    """An arm as it may really be; its kinematics are the robot's.

    Attributes:
        bodies: Mass properties of all bodies, payload included, the base's first.
        motors: Motors of the joints, with the real friction.
        lag: Time constant of the motors [s].
        delay: Time from a measurement to the effort that answers it [s].
        noise: Standard deviation of measured positions [rad or m].
        tool: Shift of the tool centre point in its own frame, shape (3,) [m].
        base: Shift of the robot in the base frame, shape (3,) [m].
        noise_seed: Seed of the noise.
        contact_friction: Real over nominal friction of contacts that hold parts.
        part_mass: Real over nominal mass of held parts.
    """

    bodies: tuple[BodyInertia, ...]
    motors: JointMotors
    lag: float
    delay: float
    noise: float
    tool: FloatArray
    base: FloatArray
    noise_seed: int
    contact_friction: float = 1.0
    part_mass: float = 1.0

    __repr__ = short_repr

    def displaced(
        self, rotation: FloatArray, position: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return tool poses (K, 3, 3), (K, 3) [m] of the model, displaced as on this plant."""
        return rotation, position + rotation @ self.tool + self.base


@dataclass(frozen=True)
class Draw:
    """The number and the seed of drawn plants.

    Attributes:
        runs: Number of plants.
        seed: Seed; plant k of a seed is the same for any number of plants.

    Raises:
        OptionError: On construction, for numbers out of their bounds.
    """

    runs: int = 50
    seed: int = 0

    def __post_init__(self) -> None:
        require_count(self, 1, "runs", most=100_000)
        require_count(self, 0, "seed")


CORNERS = {0: 1.0, 1: 0.0}  # by run: all errors at their bounds, no errors


def drawn_plants(robot: RobotModel, errors: Robustness, draw: Draw | None = None) -> list[Plant]:
    """Return arms that differ from the model by independently drawn errors.

    The first arm has every error at its bound, the second has none, so that few arms hold both
    corners. Lag, delay and noise are drawn from zero up to their bounds as well: a plan may survive
    a slow drive and fail on a quick one.

    Args:
        robot: The model.
        errors: Bounds of the errors. Links that move as one have one error.
        draw: Number and seed; default: 50, from seed 0.
    """
    draw = draw or Draw()
    errors_drawn = (
        _Error(np.random.default_rng([draw.seed, run]), CORNERS.get(run))
        for run in range(draw.runs)
    )
    # The order of the fields is that of the draws: a run of a seed stays the same arm.
    return [
        Plant(
            bodies=_drawn_bodies(robot, errors, error),
            motors=_drawn_motors(robot, errors, error),
            lag=errors.lag * float(error.fraction()),
            delay=errors.delay * float(error.fraction()),
            noise=errors.noise * float(error.fraction()),
            tool=error.vector(errors.tool),
            base=error.vector(errors.base),
            noise_seed=int(error.random.integers(2**63)),
            contact_friction=1 + errors.friction * float(error.sided()),
            part_mass=1 + errors.payload * float(error.sided()),
        )
        for error in errors_drawn
    ]


@dataclass(frozen=True)
class _Error:
    """The errors of one arm, as fractions of their bounds."""

    random: np.random.Generator
    corner: float | None  # 1 for an arm with all errors at their bounds, 0 without any; None: drawn

    def fraction(self, *shape: int) -> FloatArray:
        """Return fractions from 0 to 1."""
        drawn = np.asarray(self.random.uniform(0.0, 1.0, shape))
        return drawn if self.corner is None else np.full(shape, self.corner)

    def sided(self, *shape: int) -> FloatArray:
        """Return fractions from -1 to 1, in corners of random signs."""
        drawn = np.asarray(self.random.uniform(-1.0, 1.0, shape))
        return drawn if self.corner is None else self.corner * np.sign(drawn)

    def vector(self, radius: float) -> FloatArray:
        """Return a vector (3,) drawn uniformly from a ball, in a corner from its surface."""
        direction = self.random.normal(size=3)
        distance = radius * float(self.fraction()) ** (1 / 3)
        return read_only(distance * direction / np.linalg.norm(direction))


def _drawn_bodies(robot: RobotModel, errors: Robustness, error: _Error) -> tuple[BodyInertia, ...]:
    payload = payload_body(robot, robot.payload or Payload(0.0))
    carrier = robot.link_body[robot.tool_frame]
    drawn = [robot.inertias[0]]
    for body, inertia in enumerate(robot.inertias[1:], start=1):
        own = inertia.plus(payload.scaled(-1.0)) if body == carrier else inertia
        factor, by = 1 + errors.mass * float(error.sided()), error.vector(errors.com)
        drawn.append(own.scaled(factor).shifted(by))
    factor = 1 + errors.payload * float(error.sided())
    drawn[carrier] = drawn[carrier].plus(payload.scaled(factor))
    return tuple(drawn)


def payload_body(robot: RobotModel, payload: Payload) -> BodyInertia:
    """Return the mass properties of a payload in the frame of its carrier body."""
    own = BodyInertia(payload.mass, np.array(payload.com), payload.inertia_matrix())
    return own.placed(robot.link_placement[robot.tool_frame])


def _drawn_motors(robot: RobotModel, errors: Robustness, error: _Error) -> JointMotors:
    limits, motors = robot.limits, robot.motors
    is_limited = np.isfinite(limits.effort) & np.isfinite(limits.velocity)
    slope = np.zeros(robot.joint_count)
    np.divide(limits.effort, limits.velocity, out=slope, where=is_limited)
    kinds = ("viscous_friction", "backwards_friction", "forwards_friction")
    factors = 1 + errors.friction * error.sided(3, robot.joint_count)
    drawn = {
        kind: factor * getattr(motors, kind) for kind, factor in zip(kinds, factors, strict=True)
    }
    fraction = errors.unmodelled_friction * error.fraction(robot.joint_count)
    drawn["viscous_friction"] = drawn["viscous_friction"] + fraction * slope
    return replace(motors, **drawn)


# ---- Stages: the arms while their load stays the same.

_SAME_INSTANT = 1e-9  # [s], of rounding


@dataclass(frozen=True, eq=False)
class Stage:
    """The arms and their model from a time on, until the next stage."""

    begin: float  # begin of the stage [s]
    robot: RobotModel  # the controller's model
    plants: Sequence[Plant]  # the arms; in all stages equally many, with equal delays and noise

    __repr__ = short_repr


def first_instant(time: FloatArray, begin: float) -> int:
    """Return the index of the first of increasing instants [s] that is no earlier than `begin`."""
    return int(np.searchsorted(time, begin - _SAME_INSTANT))


def last_instant(time: FloatArray, end: float) -> int:
    """Return the index of the last of increasing instants [s] that is no later than `end`."""
    return int(np.searchsorted(time, end + _SAME_INSTANT, side="right")) - 1
