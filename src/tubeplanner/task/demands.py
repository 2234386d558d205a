"""Demands beside the tube: contacts, objective, controller period, robustness."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import ceil, floor, inf
from typing import Any, Literal

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import ProblemError, TubePlannerError, shown, unknown_name
from tubeplanner.fields import Finite, declared, documented
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.geometry.solids import MAX_SIZE
from tubeplanner.robot.model import RobotModel

# ---- Contacts at the ends of the motion, and clearances of pairs.

START, GOAL = "start", "goal"
ENDS = (START, GOAL)
_MIN_WITHIN = 1e-6  # [m]

Names = tuple[str, str]


@dataclass(frozen=True)
class Contact:
    """Two solids that touch, or nearly touch, at start or goal.

    Near that end (the tool centre point in the tube's first or last segment, within a distance of
    its position at the end) the required distance of the two solids is their distance at the end,
    or their clearance, if that is less. At an open goal they must not overlap.

    Attributes:
        links: Names of links, attached solids or obstacles.
        within: Distance of the tool centre point from its position at the end [m].
        ends: "start", "goal" or both.

    Raises:
        ProblemError: On construction, if a distance is out of bounds or an end is unknown.
    """

    links: Names
    within: float
    ends: tuple[str, ...] = ENDS

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", _names("contacts", self.links))
        if not is_number(self.within) or not _MIN_WITHIN <= self.within <= MAX_SIZE:
            raise ProblemError(
                f"contacts: within is {in_figures(self.within)} m for {_label(self.links)}; "
                f"{_MIN_WITHIN:g} to {MAX_SIZE:g} m are accepted"
            )
        ends = (self.ends,) if isinstance(self.ends, str) else self.ends
        if not isinstance(ends, list | tuple):
            raise ProblemError(f"contacts: ends is {shown(ends)}; give a list of {', '.join(ENDS)}")
        ends = tuple(ends)
        for end in ends:
            if not isinstance(end, str) or end not in ENDS:
                raise ProblemError(f"contacts: {unknown_name('end', end, ENDS)}")
        object.__setattr__(self, "ends", ends)


def pair_distances(value: Mapping[Names, float]) -> Mapping[Names, float]:
    """Return clearances [m] by pairs of names, checked."""
    if not isinstance(value, Mapping):
        raise ProblemError(
            f"clearance.pairs is {shown(value)}; give a map from pairs of names to distances [m]"
        )
    distances = {}
    for links, clearance in value.items():
        names = _names("clearance.pairs", links)
        if not is_number(clearance) or not 0 <= clearance <= MAX_SIZE:
            raise ProblemError(
                f"clearance.pairs: clearance is {in_figures(clearance)} m for {_label(names)}; "
                f"0 to {MAX_SIZE:g} m are accepted"
            )
        distances[names] = float(clearance)
    return distances


def require_checked(checker: CollisionChecker, field: str, pairs: Iterable[Names]) -> None:
    """Raise ProblemError unless the solids of a field's pairs are checked against each other."""
    owners = list(dict.fromkeys(shape.owner for shape in checker.shapes))
    for names in pairs:
        for name in names:
            if name not in owners:
                kind = "link with collision geometry or obstacle"
                raise ProblemError(f"{field}: {unknown_name(kind, name, owners)}")
        if not checker.between(*names).any():
            reasons = {frozenset(pair.links): pair.reason for pair in checker.left_out}
            reason = reasons.get(frozenset(names), "no joint moves one against the other")
            raise ProblemError(
                f"{field}: {_label(names)} are not checked against each other ({reason}): remove "
                "the pair"
            )


def _names(field: str, value: object) -> Names:
    if isinstance(value, list | tuple) and len(value) == 2:
        first, second = value
        if isinstance(first, str) and isinstance(second, str) and first != second:
            return first, second
    raise ProblemError(
        f"{field}: {shown(value)} is no pair of names of different links or obstacles"
    )


def _label(names: Names) -> str:
    return f"'{names[0]}' and '{names[1]}'"


# ---- The objective beside the shortest duration.

SMOOTHNESS, ENERGY, WORK, DEVIATION = MINIMISED = ("smoothness", "energy", "work", "deviation")
_SLACK, _MAX_SLACK = 0.005, 10.0
_MAX_DURATION = 1e4  # [s]
_ROUNDING = 1e-6  # of a period


@documented
@dataclass(frozen=True)
class Objective:
    """Objective of a trajectory beside the shortest duration.

    Minimised is "smoothness", efforts that change little and slowly, and small jerks; "energy", the
    integral of weighted squared efforts; "work", the integral of the power that motors put in; or
    "deviation", the mean over time of the squared distance from the tube's reference, in radii.

    Raises:
        ProblemError: On construction, for a slack that is no number from 0 to 10, a duration that
            is no number above 0 or beside a slack, an unknown objective, weights that are no
            numbers >= 0, or weights without "energy".
    """

    slack: Finite | None = declared(
        None,
        "fraction of the shortest duration that it may take more; 0: the shortest; left out: "
        "0.005, unless a duration is given",
    )
    minimise: str = declared(
        SMOOTHNESS,
        "what that time is used for: efforts and jerks that change little, the integral of "
        "squared efforts, that of positive power, or squared distances from the reference",
        Literal[MINIMISED],
    )
    duration: Finite | None = declared(
        None, "how long it takes [s], in place of a slack; left out: as that says"
    )
    weights: Mapping[str, float] = declared(
        {},
        "of the squared efforts in the energy, by joint; left out: 1/limit^2",
        dict[str, Finite],
    )

    def __post_init__(self) -> None:
        if not isinstance(self.minimise, str) or self.minimise not in MINIMISED:
            message = unknown_name("objective", self.minimise, MINIMISED)
            raise ProblemError(f"objective.minimise: {message}")
        if self.duration is not None:
            if self.slack is not None:
                raise ProblemError(
                    f"objective.slack is {in_figures(self.slack)} and objective.duration "
                    f"{in_figures(self.duration)} s; give one of them"
                )
            if not is_number(self.duration) or not 0 < self.duration <= _MAX_DURATION:
                raise ProblemError(
                    f"objective.duration is {in_figures(self.duration)} s; give how long the "
                    f"motion is to take, above 0 and up to {_MAX_DURATION:g} s, or a slack instead"
                )
        elif self.slack is None:
            object.__setattr__(self, "slack", _SLACK)
        else:
            require_slack("objective.slack", self.slack)
        if not isinstance(self.weights, Mapping):
            raise ProblemError(
                f"objective.weights is {shown(self.weights)}; give a map by joint name"
            )
        if self.weights and self.minimise != ENERGY:
            raise ProblemError(
                f"objective.weights are of energy, but '{self.minimise}' is minimised; leave them "
                f"out, or minimise '{ENERGY}'"
            )
        for name, weight in self.weights.items():
            if not is_number(weight) or not 0 <= weight < inf:
                raise ProblemError(
                    f"objective.weights of '{name}' is {in_figures(weight)}; give a finite number, "
                    "0 or more"
                )

    def energy_weights(self, robot: RobotModel) -> FloatArray:
        """Return the weights of the joints' squared efforts, shape (n,).

        Raises:
            ProblemError: A weight is of an unknown joint, or no weight is above zero.
        """
        for name in self.weights:
            if name not in robot.joint_names:
                message = unknown_name("joint", name, robot.joint_names)
                raise ProblemError(f"objective.weights: {message}")
        weights = 1 / robot.limits.effort**2
        for joint, name in enumerate(robot.joint_names):
            weights[joint] = self.weights.get(name, weights[joint])
        if not weights.any():
            raise ProblemError(
                "objective.weights are all zero, as those of joints without an effort limit are "
                "unless given: nothing is to be saved; give some"
            )
        return np.asarray(weights)


def require_slack(what: str, slack: Any, error: type[TubePlannerError] = ProblemError) -> None:
    """Raise an error unless a slack is a number from 0 to 10."""
    if not is_number(slack) or not 0 <= slack <= _MAX_SLACK:
        raise error(
            f"{what} is {in_figures(slack)}; give a fraction of the shortest duration from 0 (the "
            f"shortest motion) to {_MAX_SLACK:g}"
        )


def is_multiple(duration: float, period: float) -> bool:
    """Return True if a duration is a multiple of a period, up to rounding."""
    return abs(duration / period - round(duration / period)) <= _ROUNDING


_MIN_PERIOD, _MAX_CONTROLLER_PERIOD = 1e-5, 1.0  # [s]


def require_period(period: float, duration: float | None) -> None:
    """Raise unless a period [s] is within bounds and divides the duration [s], if there is one."""
    if not is_number(period) or not _MIN_PERIOD <= period <= _MAX_CONTROLLER_PERIOD:
        raise ProblemError(
            f"period is {in_figures(period)} s; give the controller's, {_MIN_PERIOD:g} to "
            f"{_MAX_CONTROLLER_PERIOD:g} s, or leave it out"
        )
    if duration is not None and not is_multiple(duration, period):
        counts = {max(round_to(duration / period), 1) for round_to in (floor, ceil)}
        nearest = " or ".join(f"{count * period:.9g}" for count in sorted(counts))
        raise ProblemError(
            f"objective.duration is {in_figures(duration)} s, no multiple of the period, "
            f"{period:g} s; give {nearest}, or leave one of them out"
        )


# ---- Errors of the real arm and its control against the model.

COMPUTED_TORQUE, FEEDFORWARD_PD, PD = CONTROLLERS = ("computed-torque", "feedforward-pd", "pd")
_MAX_TOLERANCE = 10.0


def _error(default: float, description: str, most: float, unit: str = "") -> Any:
    """Return a field for the size of an error; masses and frictions stay above zero."""
    return declared(default, description, Finite, bounds=(0.0, most), unit=unit, is_error=True)


@documented
@dataclass(frozen=True)
class Robustness:
    """Errors that a plan must survive, the controller that meets them, and its stops.

    Errors are bounds: a plan must survive all errors between nothing and the bound. Controllers are
    "computed-torque", "feedforward-pd" and "pd".

    Raises:
        ProblemError: On construction, for a value out of its bounds or an unknown controller.
    """

    mass: float = _error(0.05, "of every body, relative, uniform in +-", 0.9)
    com: float = _error(0.005, "of every centre of mass, uniform in a ball [m]", 1.0, "m")
    payload: float = _error(0.1, "of the payload's mass, relative, uniform in +-", 0.9)
    friction: float = _error(0.2, "of every modelled friction, relative, uniform in +-", 0.9)
    unmodelled_friction: float = _error(
        0.02, "viscous, fraction of the effort limit at full speed, uniform from zero", 0.9
    )
    lag: float = _error(0.001, "time constant of the motors, from zero [s]", 1.0, "s")
    delay: float = _error(0.001, "from measurement to effort, from zero [s]", 1.0, "s")
    noise: float = _error(1e-5, "of measured positions, normal [rad, m]", 0.1, "rad or m")
    tool: float = _error(0.0005, "of the tool centre point, uniform in a ball [m]", 1.0, "m")
    base: float = _error(0.0005, "of the base, uniform in a ball [m]", 1.0, "m")
    control_period: float = declared(
        0.001, "of the controller [s]", Finite, bounds=(1e-4, 0.1), unit="s"
    )
    controller: str = declared(COMPUTED_TORQUE, "what follows the plan", Literal[CONTROLLERS])
    # Beyond 80 rad/s a delay of 2 ms leaves the loop little damping.
    bandwidth: float = declared(
        30.0, "of the feedback, at least [rad/s]", Finite, bounds=(1.0, 80.0), unit="rad/s"
    )
    velocity_tolerance: float | None = declared(
        None,
        "fraction of a velocity limit beyond it at which the controller stops; default: the "
        "preset's, or 0.05",
        Finite | None,
        bounds=(0.0, _MAX_TOLERANCE),
        unit="",
    )
    path_tolerance: float | None = declared(
        0.05,
        "distance of a joint from the plan at which the controller stops [rad]; of a sliding "
        "joint a tenth of it [m]; null: none",
        Finite | None,
        bounds=(1e-6, _MAX_TOLERANCE),
        unit="rad",
    )
    tool_tolerance: float | None = declared(
        None,
        "likewise, of the tool centre point [m]",
        Finite | None,
        bounds=(1e-6, _MAX_TOLERANCE),
        unit="m",
    )

    def __post_init__(self) -> None:
        for name, own in self.__dataclass_fields__.items():
            value, optional = getattr(self, name), own.type == float | None
            if "bounds" not in own.metadata or (optional and value is None):
                continue
            least, most = own.metadata["bounds"]
            unit = f" {own.metadata['unit']}".rstrip()
            if not is_number(value) or not least <= value <= most:
                raise ProblemError(
                    f"robustness.{name} is {in_figures(value)}{unit}; give a number from {least:g} "
                    f"to {most:g}{unit}"
                )
        if self.controller not in CONTROLLERS:
            message = unknown_name("controller", self.controller, CONTROLLERS)
            raise ProblemError(f"robustness.controller: {message}")

    @classmethod
    def exact(cls, **fields: float | str) -> "Robustness":
        """Return errors of zero, except for given fields."""
        return cls(**(dict.fromkeys(ERRORS, 0.0) | fields))  # type: ignore[arg-type]

    def enlarged(self, factor: float) -> "Robustness":
        """Return the errors times a factor, up to the largest accepted."""
        larger: dict[str, Any] = {
            name: min(factor * getattr(self, name), field["bounds"][1])
            for name, field in ERRORS.items()
        }
        return replace(self, **larger)

    @property
    def in_words(self) -> str:
        """The bounds of the errors that are not zero."""
        words = []
        for name, field in ERRORS.items():
            error, unit = getattr(self, name), field["unit"]
            if error > 0:
                small_unit = "mrad or mm" if unit == "rad or m" else "m" + unit
                size = f"{1000 * error:.3g} {small_unit}" if unit else f"{100 * error:.3g} %"
                words.append(f"{name.replace('_', ' ')} {size}")
        return ", ".join(words) or "nothing"


ERRORS = {
    name: field.metadata
    for name, field in Robustness.__dataclass_fields__.items()
    if "is_error" in field.metadata
}
