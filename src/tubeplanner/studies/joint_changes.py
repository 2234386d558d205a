"""Changes of limits, payload, start, goal, duration."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.studies.changes import Change, Proposal, Question, exact, figures, from_to
from tubeplanner.task.endpoints import configuration_of

# ---- Changes of the joints' limits and of the payload.

_MAX_GROWTH = 10.0  # of an effort, relative
_MAX_WIDENING = 2 * np.pi  # [rad], or [m]: of a position limit
_TENTH = 0.1  # [rad], or [m]


def limit_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that widen limits of joints, or lighten the payload."""
    yield from effort_changes(question, 1)
    yield from payload_changes(question, -1)
    yield from _positions(question)


def effort_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of the effort limit of each joint, more (sign 1) or less (-1)."""
    robot, limits = question.robot, question.fields.robot.limits
    factor = limits.scale.get("effort", 1.0)
    for joint, limit in zip(robot.joint_names, robot.limits.effort.tolist(), strict=True):
        if not np.isfinite(limit):
            continue
        value = limits.effort.get(joint) if isinstance(limits.effort, dict) else None
        before = exact(limit / factor)
        yield Change(
            kind="effort",
            field=f"robot.limits.effort.{joint}",
            before=before,
            unit=_effort_unit(question, joint),
            scale=before,
            most=_MAX_GROWTH * before if sign > 0 else 0.99 * before,
            propose=partial(_effort, question, joint, before, value, sign),
            about=frozenset({joint}),
            is_loss=sign < 0,
        )


def _effort_unit(question: Question, joint: str) -> str:
    return "N m" if question.robot.revolute[question.robot.joint_names.index(joint)] else "N"


def _effort(
    question: Question, joint: str, before: float, value: Any, sign: int, size: float
) -> Proposal:
    after = exact(before + sign * size)
    unit = _effort_unit(question, joint)
    changed = _scaled_effort(value, after / before) if value is not None else after
    if sign > 0:
        text = f"{joint}: {figures(size, unit)} more ({from_to(before, after, unit)})"
    else:
        text = f"{joint}: {from_to(before, after, unit)}"
    changes = _limit_of(question, "effort", joint, changed)
    return Proposal(changes, after, text, figures(after, unit))


def _scaled_effort(effort: Any, factor: float) -> Any:
    """Return the effort of a file, scaled: a number, a pair or a table."""
    if isinstance(effort, int | float):
        return exact(factor * effort)
    if isinstance(effort, list | tuple):
        return [exact(factor * value) for value in effort]
    return {"position": effort.position, "effort": [exact(factor * x) for x in effort.effort]}


def _limit_of(question: Question, quantity: str, joint: str, value: Any) -> dict[str, Any]:
    """Return the values that give a joint another limit, and the others their present limits."""
    limits = getattr(question.fields.robot.limits, quantity)
    path = f"robot.limits.{quantity}"
    if isinstance(limits, Mapping):
        return {f"{path}.{joint}": value}
    # One value for all joints, or a list, becomes a map by name.
    robot, names = question.robot, question.robot.joint_names
    if quantity == "position":
        bounds = (robot.limits.lower_position, robot.limits.upper_position)
        values = np.column_stack(bounds).tolist()
    else:
        factor = question.fields.robot.limits.scale.get(quantity, 1.0)
        values = [exact(each / factor) for each in getattr(robot.limits, quantity).tolist()]
    return {path: {**dict(zip(names, values, strict=True)), joint: value}}


def _positions(question: Question) -> Iterator[Change]:
    """Yield the changes that move an end of a joint's range outwards."""
    robot = question.robot
    lower, upper = robot.limits.lower_position.tolist(), robot.limits.upper_position.tolist()
    for k, joint in enumerate(robot.joint_names):
        limits = (lower[k], upper[k])
        for end, sign in enumerate((-1, 1)):
            if np.isfinite(limits[end]):
                yield Change(
                    kind="position",
                    field=f"robot.limits.position.{joint}",
                    before=list(limits),
                    unit=_position_unit(question, joint),
                    scale=_TENTH,
                    most=_MAX_WIDENING,
                    propose=partial(_range, question, joint, limits, end, sign),
                    about=frozenset({joint}),
                )


def _position_unit(question: Question, joint: str) -> str:
    return "rad" if question.robot.revolute[question.robot.joint_names.index(joint)] else "m"


def _range(
    question: Question, joint: str, limits: tuple[float, float], end: int, sign: int, size: float
) -> Proposal:
    after = list(limits)
    after[end] = exact(limits[end] + sign * size)
    name = ("lower", "upper")[end]
    unit = _position_unit(question, joint)
    text = f"{joint}: {name} limit {from_to(limits[end], after[end], unit)}"
    changes = _limit_of(question, "position", joint, after)
    return Proposal(changes, after, text, figures(after[end], unit))


def payload_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of the payload's mass, more (sign 1) or less (-1)."""
    payload = question.fields.robot.payload
    if payload is None or payload.mass <= 0:
        return
    before = payload.mass

    def changed(size: float) -> Proposal:
        after = exact(before + sign * size)
        changes = {"robot.payload.mass": after}
        brief = figures(after, "kg")
        return Proposal(changes, after, f"payload at most {brief}", brief)

    most = _MAX_GROWTH * before if sign > 0 else 0.999 * before
    yield Change(
        *("payload", "robot.payload.mass", before, "kg", before, most, changed), is_loss=sign < 0
    )


# ---- Changes of start, goal and duration.

_MAX_MOVE = 1.0  # [rad], or [m]


def end_changes(question: Question) -> Iterator[Change]:
    """Yield the changes of start and goal, and of a required duration."""
    for end in ("start", "goal"):
        yield from _joints(question, end)
    yield from _open_ends(question)
    yield from _goal_tolerance(question)
    yield from _duration(question)


def _joints(question: Question, end: str) -> Iterator[Change]:
    value = getattr(question.fields, end)
    if value is None or value.joints is None:
        return
    try:
        q = configuration_of(question.robot, end, value.joints)
    except ProblemError:  # it names an unknown joint: loading the problem reports that
        return
    revolute = question.robot.revolute
    for k, joint in enumerate(question.robot.joint_names):
        for sign in (1, -1):
            yield Change(
                kind=end,
                field=f"{end}.joints",
                before=q.tolist(),
                unit="rad" if revolute[k] else "m",
                scale=_TENTH,
                most=_MAX_MOVE,
                propose=partial(_shifted, end, q, k, sign, joint, "rad" if revolute[k] else "m"),
                about=frozenset({end, joint}),
            )


def _shifted(
    end: str, q: FloatArray, k: int, sign: int, joint: str, unit: str, size: float
) -> Proposal:
    after = q.tolist()
    after[k] = exact(after[k] + sign * size)
    minus = "" if sign > 0 else "-"
    text = f"{end}: {minus}{figures(size, unit)} on {joint}"
    return Proposal({f"{end}.joints": after}, after, text, figures(size, unit))


def _open_ends(question: Question) -> Iterator[Change]:
    """Yield the changes of start and goal from given joints to inverse kinematics."""
    start, goal = question.fields.start.joints, question.fields.goal
    if start is not None:
        with suppress(ProblemError):
            q = question.robot.limits.clip(configuration_of(question.robot, "start", start))
            seeded = Proposal(
                {"start": {"seed": q.tolist()}},
                {"seed": q.tolist()},
                "start: inverse kinematics of reference point 0, from the joints given as a seed,",
            )
            yield _switch("start", question.posed.document["start"], seeded)
    if goal is not None and goal.joints is not None:
        opened = Proposal({"goal": None}, None, "goal: left out, its configuration open,")
        yield _switch("goal", question.posed.document["goal"], opened)


def _switch(end: str, before: Any, proposal: Proposal) -> Change:
    return Change(
        *(end, end, before, "", 1.0, 1.0, lambda size: proposal), about=frozenset(), is_switch=True
    )


def _goal_tolerance(question: Question) -> Iterator[Change]:
    goal = question.fields.goal
    if goal is None or goal.position is None:
        return
    before = goal.tolerance

    def wider(size: float) -> Proposal:
        after = exact(before + size)
        text = f"goal.tolerance {from_to(before, after, 'm')}"
        return Proposal({"goal.tolerance": after}, after, text, figures(after, "m"))

    yield Change(
        *("goal", "goal.tolerance", before, "m", before or _TENTH, _MAX_MOVE, wider),
        about=frozenset({"goal"}),
    )


def _duration(question: Question) -> Iterator[Change]:
    objective = question.fields.objective
    if objective is None or objective.duration is None:
        return
    before = objective.duration

    def longer(size: float) -> Proposal:
        after = exact(before + size)
        text = f"objective.duration {from_to(before, after, 's')}"
        return Proposal({"objective.duration": after}, after, text, figures(after, "s"))

    path = "objective.duration"
    yield Change("duration", path, before, "s", before, 100 * before, longer)
