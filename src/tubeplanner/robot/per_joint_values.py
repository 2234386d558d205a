"""Values of joints as they are given: one for all, a list in chain order, or a map by name."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from tubeplanner.errors import RobotError, shown
from tubeplanner.options import is_number


def require_per_joint(where: str, given: Any, *, takes_number: bool = True) -> None:
    """Raise unless values are given in one of these ways.

    Args:
        where: What messages call them.
        given: What must be a list, a map, or one number.
        takes_number: Whether one number may serve for all joints.

    Raises:
        RobotError: They are given otherwise.
    """
    is_list = isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim > 0)
    if isinstance(given, Mapping) or is_list or (takes_number and is_number(given)):
        return
    if not takes_number:
        raise RobotError(
            f"{where} is {shown(given)}; it must be a map by name, or a list with one for each "
            "joint"
        )
    raise RobotError(
        f"{where} is {shown(given)}; it must be one number for all joints, a list with one for "
        "each, or a map by name, such as {'elbow_joint': 1.5}"
    )


def entries_of(where: str, given: Any) -> Iterator[tuple[str, Any]]:
    """Yield the values, each after what messages call it."""
    if isinstance(given, Mapping):
        yield from ((f"{where}: joint {shown(name)} at", value) for name, value in given.items())
    elif is_number(given):
        yield f"{where} is", given
    else:
        yield from ((f"{where}[{k}] is", value) for k, value in enumerate(given))


def values_by_name(
    where: str, given: Any, chain: Sequence[str], *, takes_number: bool = True
) -> Mapping[str, Any]:
    """Return values by joint name.

    Args:
        where: What messages call them.
        given: The values, as `require_per_joint` has them.
        chain: The joints of the planning group, in chain order.
        takes_number: Whether one number may serve for all joints.

    Raises:
        RobotError: A list has another number of values than there are joints.
    """
    if isinstance(given, Mapping):
        return given
    if is_number(given):
        return dict.fromkeys(chain, given)
    if len(given) != len(chain):
        alone = "one for all joints, " if takes_number else ""
        raise RobotError(
            f"{where} has {len(given)} values for {len(chain)} joints; give "
            f"{alone}a map by name, or a list in the order of the chain: {', '.join(chain)}"
        )
    return dict(zip(chain, given, strict=True))
