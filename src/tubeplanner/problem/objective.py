"""What an answer is to be beside short."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError, TubePlannerError, shown, unknown_name
from tubeplanner.options import in_figures, is_number
from tubeplanner.robot.robot_model import RobotModel

SMOOTHNESS, ENERGY, WORK = MINIMISED = ("smoothness", "energy", "work")
_SLACK, _MAX_SLACK = 0.005, 10.0
_MAX_DURATION = 1e4  # [s]
_ROUNDING = 1e-6  # of a period


@dataclass(frozen=True)
class Objective:
    """What an answer is to be beside short.

    Attributes:
        slack: It may take this share more time than the shortest motion; 0: it is that. None:
            0.005, unless a duration is given.
        minimise: What the time is used for: "smoothness", for efforts that change little and
            slowly and small jerks; "energy", for the integral of the weighted squared efforts;
            "work", for the integral of the power that motors put in.
        duration: How long it takes instead [s]; None: as slack says.
        weights: Of the squared efforts in the energy, by joint name, >= 0; those of other joints
            are 1/limit^2.

    Raises:
        ProblemError: On construction, for slack that is no number from 0 to 10, a duration that is
            no number above 0 or beside a slack, another name, or weights that are none or of
            nothing.
    """

    slack: float | None = None
    minimise: str = SMOOTHNESS
    duration: float | None = None
    weights: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.minimise, str) or self.minimise not in MINIMISED:
            message = unknown_name("objective", self.minimise, MINIMISED)
            raise ProblemError(f"objective.minimise: {message}")
        if self.duration is not None:
            self._require_duration(self.duration)
        elif self.slack is None:
            object.__setattr__(self, "slack", _SLACK)
        else:
            require_slack("objective.slack", self.slack)
        self._require_weights()

    def energy_weights(self, robot: RobotModel) -> FloatArray:
        """Return the weights of the joints' squared efforts, shape (n,).

        Raises:
            ProblemError: One is of no joint, or none is above zero.
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

    def _require_duration(self, duration: float) -> None:
        if self.slack is not None:
            raise ProblemError(
                f"objective.slack is {in_figures(self.slack)} and objective.duration "
                f"{in_figures(duration)} s; give one of them"
            )
        if not is_number(duration) or not 0 < duration <= _MAX_DURATION:
            raise ProblemError(
                f"objective.duration is {in_figures(duration)} s; give how long the motion is "
                f"to take, above 0 and up to {_MAX_DURATION:g} s, or a slack instead"
            )

    def _require_weights(self) -> None:
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


def require_slack(what: str, slack: Any, error: type[TubePlannerError] = ProblemError) -> None:
    """Raise an error unless something is a share of time."""
    if not is_number(slack) or not 0 <= slack <= _MAX_SLACK:
        raise error(
            f"{what} is {in_figures(slack)}; give a share of the shortest duration from 0 (the "
            f"shortest motion) to {_MAX_SLACK:g}"
        )


def is_multiple(duration: float, period: float) -> bool:
    """Return whether a duration is a multiple of a period, but for rounding."""
    return abs(duration / period - round(duration / period)) <= _ROUNDING
