"""Joint values as users give them: in group order, or by joint name."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.robot.robot_model import RobotModel


def configuration_of(robot: RobotModel, what: str, values: Any) -> FloatArray:
    """Return joint values given in group order or by name as an array (n,) [rad or m].

    Args:
        robot: The arm.
        what: What messages call them, such as "start".
        values: n numbers, or a map from joint name to number.

    Raises:
        ProblemError: They are not n finite numbers, or a name is unknown or missing.
    """
    names = robot.joint_names
    if isinstance(values, Mapping):
        for name in values:
            if name not in names:
                raise ProblemError(f"{what}: {unknown_name('joint', name, names)}")
        missing = [name for name in names if name not in values]
        if missing:
            raise ProblemError(f"{what}: no value for joint {', '.join(missing)}")
        values = [values[name] for name in names]
    try:
        if any(isinstance(value, bool) for value in values):
            raise TypeError("a truth value is no number")
        q = read_only(values)
    except (TypeError, ValueError) as error:
        raise ProblemError(
            f"{what} {shown(values)} must be numbers, one per joint ({error})"
        ) from None
    if q.shape != (len(names),):
        raise ProblemError(
            f"{what} has {q.size} values for the {len(names)} joints {', '.join(names)}"
        )
    if not np.isfinite(q).all():
        raise ProblemError(f"{what} must be finite numbers")
    return q
