"""By how much a real arm and its control may differ from the model that is planned with."""

from dataclasses import dataclass, replace
from typing import Any

from tubeplanner.errors import ProblemError, unknown_name
from tubeplanner.options import in_figures, is_number

COMPUTED_TORQUE, FEEDFORWARD_PD, PD = CONTROLLERS = ("computed-torque", "feedforward-pd", "pd")
# The most of each quantity, and its unit. Masses and frictions stay above zero.
_MOST = {
    "mass": (0.9, ""),
    "com": (1.0, "m"),
    "payload": (0.9, ""),
    "friction": (0.9, ""),
    "unmodelled_friction": (0.9, ""),
    "lag": (1.0, "s"),
    "delay": (1.0, "s"),
    "noise": (0.1, "rad or m"),
    "tool": (1.0, "m"),
    "base": (1.0, "m"),
}
ERRORS = tuple(_MOST)
_SPREAD = ("mass", "com", "payload", "friction", "tool", "base")  # drawn about what is expected
_LEAST_PERIOD, _MAX_PERIOD = 1e-4, 0.1  # [s]


@dataclass(frozen=True)
class Robustness:
    """Errors that a plan is to survive, and the control that meets them.

    Attributes:
        mass: Relative error of each body's mass, uniform in +-.
        com: Of each body's centre of mass, uniform in a ball of this radius [m].
        payload: Relative error of the payload's mass, uniform in +-.
        friction: Relative error of each joint's viscous friction, and of its Coulomb friction each
            way, uniform in +-.
        unmodelled_friction: Viscous friction beside the modelled, as a share of the joint's effort
            limit at its velocity limit, uniform between half of it and it.
        lag: Time constant with which motors follow the effort that is asked of them [s].
        delay: From a measurement to the effort that follows from it [s].
        noise: Standard deviation of measured joint positions, normal [rad or m].
        tool: Of the tool centre point in its link, uniform in a ball of this radius [m].
        base: Of the robot's base in its cell, likewise [m].
        control_period: [s].
        controller: "computed-torque", "feedforward-pd" or "pd".

    Raises:
        ProblemError: On construction, for a value out of its bounds or an unknown controller.
    """

    mass: float = 0.05
    com: float = 0.005
    payload: float = 0.1
    friction: float = 0.2
    unmodelled_friction: float = 0.02
    lag: float = 0.001
    delay: float = 0.001
    noise: float = 1e-5
    tool: float = 0.0005
    base: float = 0.0005
    control_period: float = 0.001
    controller: str = COMPUTED_TORQUE

    def __post_init__(self) -> None:
        for name, (most, unit) in _MOST.items():
            self._require_between(name, 0.0, most, unit)
        self._require_between("control_period", _LEAST_PERIOD, _MAX_PERIOD, "s")
        if self.controller not in CONTROLLERS:
            message = unknown_name("controller", self.controller, CONTROLLERS)
            raise ProblemError(f"robustness.controller: {message}")

    @classmethod
    def exact(cls, **fields: float | str) -> "Robustness":
        """Return no errors at all, but for some fields."""
        return cls(**(dict.fromkeys(_MOST, 0.0) | fields))  # type: ignore[arg-type]

    def enlarged(self, factor: float) -> "Robustness":
        """Return the errors of the arm's build with larger spreads, as far as they may be."""
        larger: dict[str, Any] = {
            name: min(factor * getattr(self, name), _MOST[name][0]) for name in _SPREAD
        }
        return replace(self, **larger)

    def _require_between(self, name: str, least: float, most: float, unit: str) -> None:
        value = getattr(self, name)
        if not is_number(value) or not least <= value <= most:
            of_unit = f" {unit}" if unit else ""
            raise ProblemError(
                f"robustness.{name} is {in_figures(value)}{of_unit}; give a number from {least:g} "
                f"to {most:g}{of_unit}"
            )
