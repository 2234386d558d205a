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

# ---- Changes of what the joints may do: efforts and ranges of positions, and what they carry.

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


# ---- Changes of where the motion begins and ends, and of how long it may take.

_FARTHEST = 1.0  # [rad], or [m]


def end_changes(question: Question) -> Iterator[Change]:
    """Yield the changes of single joints at start and goal, and of a duration that is asked."""
    for end in ("start", "goal"):
        yield from _joints(question, end)
    yield from _open_ends(question)
    yield from _goal_tolerance(question)
    yield from _duration(question)


def _joints(question: Question, end: str) -> Iterator[Change]:
    given = getattr(question.fields, end)
    if given is None or given.joints is None:
        return
    try:
        q = configuration_of(question.robot, end, given.joints)
    except ProblemError:  # it names a joint that is not there: what loads the problem says so
        return
    revolute = question.robot.revolute
    for k, joint in enumerate(question.robot.joint_names):
        for way in (1, -1):
            yield Change(
                kind=end,
                field=f"{end}.joints",
                before=q.tolist(),
                unit="rad" if revolute[k] else "m",
                scale=_TENTH,
                most=_FARTHEST,
                propose=partial(_turned, end, q, k, way, joint, "rad" if revolute[k] else "m"),
                about=frozenset({end, joint}),
            )


def _turned(
    end: str, q: FloatArray, k: int, way: int, joint: str, unit: str, size: float
) -> Proposal:
    after = q.tolist()
    after[k] = exact(after[k] + way * size)
    sign = "" if way > 0 else "-"
    text = f"{end}: {sign}{figures(size, unit)} on {joint}"
    return Proposal({f"{end}.joints": after}, after, text, figures(size, unit))


def _open_ends(question: Question) -> Iterator[Change]:
    """Yield the changes that leave to inverse kinematics what is given in joints."""
    start, goal = question.fields.start.joints, question.fields.goal
    if start is not None:
        with suppress(ProblemError):
            q = question.robot.limits.clip(configuration_of(question.robot, "start", start))
            made = Proposal(
                {"start": {"seed": q.tolist()}},
                {"seed": q.tolist()},
                "start: inverse kinematics of reference point 0, from the joints given as a seed,",
            )
            yield _switch("start", question.posed.document["start"], made)
    if goal is not None and goal.joints is not None:
        left_out = Proposal({"goal": None}, None, "goal: left out, its configuration open,")
        yield _switch("goal", question.posed.document["goal"], left_out)


def _switch(end: str, before: Any, made: Proposal) -> Change:
    return Change(
        *(end, end, before, "", 1.0, 1.0, lambda size: made), about=frozenset(), is_switch=True
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
        *("goal", "goal.tolerance", before, "m", before or _TENTH, _FARTHEST, wider),
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
