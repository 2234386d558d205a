"""Changes of what the joints may do: efforts and ranges of positions, and what they carry."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from tubeplanner.explanation.change import Change, Proposal, exact, figures, from_to
from tubeplanner.explanation.question import Question

_MOST_TIMES = 10.0  # of an effort, its growth
_TURN = 2 * np.pi  # [rad], or [m]: the most that a position limit is widened
_TENTH = 0.1  # [rad], or [m]


def limit_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that give motors more effort or joints more room, or less to carry."""
    yield from effort_changes(question, 1)
    yield from payload_changes(question, -1)
    yield from _positions(question)


def effort_changes(question: Question, way: int) -> Iterator[Change]:
    """Yield the changes of the effort of each joint, more or (-1) less."""
    robot, limits = question.robot, question.fields.robot.limits
    factor = limits.scale.get("effort", 1.0)
    for joint, limit in zip(robot.joint_names, robot.limits.effort.tolist(), strict=True):
        if not np.isfinite(limit):
            continue
        given = limits.effort.get(joint) if isinstance(limits.effort, dict) else None
        before = exact(limit / factor)
        yield Change(
            kind="effort",
            field=f"robot.limits.effort.{joint}",
            before=before,
            unit=_effort_unit(question, joint),
            scale=before,
            most=_MOST_TIMES * before if way > 0 else 0.99 * before,
            propose=partial(_effort, question, joint, before, given, way),
            about=frozenset({joint}),
            is_loss=way < 0,
        )


def _effort_unit(question: Question, joint: str) -> str:
    return "N m" if question.robot.revolute[question.robot.joint_names.index(joint)] else "N"


def _effort(
    question: Question, joint: str, before: float, given: Any, way: int, size: float
) -> Proposal:
    after = exact(before + way * size)
    unit = _effort_unit(question, joint)
    value = _scaled_effort(given, after / before) if given is not None else after
    if way > 0:
        text = f"{joint}: {figures(size, unit)} more ({from_to(before, after, unit)})"
    else:
        text = f"{joint}: {from_to(before, after, unit)}"
    changes = _limit_of(question, "effort", joint, value)
    return Proposal(changes, after, text, figures(after, unit))


def _scaled_effort(given: Any, factor: float) -> Any:
    """Return an effort as a file has it, scaled: one number, a pair or a table."""
    if isinstance(given, int | float):
        return exact(factor * given)
    if isinstance(given, list | tuple):
        return [exact(factor * value) for value in given]
    return {"position": given.position, "effort": [exact(factor * x) for x in given.effort]}


def _limit_of(question: Question, quantity: str, joint: str, value: Any) -> dict[str, Any]:
    """Return the changes that give one joint another limit, others the one they have."""
    given = getattr(question.fields.robot.limits, quantity)
    path = f"robot.limits.{quantity}"
    if isinstance(given, Mapping):
        return {f"{path}.{joint}": value}
    # One for all, or a list: by name from here on.
    robot = question.robot
    others = _limits_by_name(question, quantity)
    return {path: {name: value if name == joint else others[name] for name in robot.joint_names}}


def _limits_by_name(question: Question, quantity: str) -> dict[str, Any]:
    limits, names = question.robot.limits, question.robot.joint_names
    if quantity == "position":
        bounds = np.column_stack([limits.lower_position, limits.upper_position]).tolist()
        return dict(zip(names, bounds, strict=True))
    factor = question.fields.robot.limits.scale.get(quantity, 1.0)
    values = [exact(value / factor) for value in getattr(limits, quantity).tolist()]
    return dict(zip(names, values, strict=True))


def _positions(question: Question) -> Iterator[Change]:
    """Yield the changes that move one end of a joint's range outwards."""
    robot = question.robot
    lower, upper = robot.limits.lower_position.tolist(), robot.limits.upper_position.tolist()
    for k, joint in enumerate(robot.joint_names):
        both = (lower[k], upper[k])
        for end, way in enumerate((-1, 1)):
            if np.isfinite(both[end]):
                yield Change(
                    kind="position",
                    field=f"robot.limits.position.{joint}",
                    before=list(both),
                    unit=_position_unit(question, joint),
                    scale=_TENTH,
                    most=_TURN,
                    propose=partial(_range, question, joint, both, end, way),
                    about=frozenset({joint}),
                )


def _position_unit(question: Question, joint: str) -> str:
    return "rad" if question.robot.revolute[question.robot.joint_names.index(joint)] else "m"


def _range(
    question: Question, joint: str, both: tuple[float, float], end: int, way: int, size: float
) -> Proposal:
    after = list(both)
    after[end] = exact(both[end] + way * size)
    which = ("lower", "upper")[end]
    unit = _position_unit(question, joint)
    text = f"{joint}: {which} limit {from_to(both[end], after[end], unit)}"
    changes = _limit_of(question, "position", joint, after)
    return Proposal(changes, after, text, figures(after[end], unit))


def payload_changes(question: Question, way: int) -> Iterator[Change]:
    """Yield the changes of the payload's mass, more or (-1) less."""
    payload = question.fields.robot.payload
    if payload is None or payload.mass <= 0:
        return
    before = payload.mass

    def carried(size: float) -> Proposal:
        after = exact(before + way * size)
        changes = {"robot.payload.mass": after}
        brief = figures(after, "kg")
        return Proposal(changes, after, f"payload at most {brief}", brief)

    most = _MOST_TIMES * before if way > 0 else 0.999 * before
    yield Change(
        *("payload", "robot.payload.mass", before, "kg", before, most, carried), is_loss=way < 0
    )
