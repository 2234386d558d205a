"""Changes of limits, payload, start, goal, duration."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import partial
from math import ceil
from typing import Any

import numpy as np

from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.inverse_kinematics import WantedRotation, solve_position
from tubeplanner.first_guess.pose_configurations import middle_of
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.studies.changes import Change, Proposal, Question, exact, figures, from_to, rounded
from tubeplanner.task.endpoints import Seed, ToolPose, configuration_of
from tubeplanner.task.problem_reader import end_of

# ---- Changes of the joints' limits and of the payload.

_MAX_GROWTH = 10.0  # of an effort, relative
_MAX_WIDENING = 2 * np.pi  # [rad], or [m]: of a position limit
_TENTH = 0.1  # [rad], or [m]
_ROUNDING = 1e-6  # of a period
_DECIMALS = 6  # of joints


def limit_changes(question: Question) -> Iterator[Change]:
    """Yield the changes that widen limits of joints, or lighten the payload."""
    yield from effort_changes(question, 1)
    yield from payload_changes(question, -1)
    robot, own = question.robot, question.fields.robot.limits.position
    lower, upper = _own_positions(robot.limits)

    def wider(k: int, limits: tuple[float, float], end: int, sign: int, size: float) -> Proposal:
        after, joint = list(limits), robot.joint_names[k]
        after[end] = exact(limits[end] + sign * size)
        unit = "rad" if robot.revolute[k] else "m"
        name = ("lower", "upper")[end]
        text = f"{joint}: {name} limit {from_to(limits[end], after[end], unit)}"
        changes = _limit_of(question, "position", joint, after)
        return Proposal(changes, after, text, figures(after[end], unit))

    for k, joint in enumerate(robot.joint_names):
        limits = (lower[k], upper[k])
        for end, sign in enumerate((-1, 1)):
            if np.isfinite(limits[end]):
                yield Change(
                    kind="position",
                    field=f"robot.limits.position.{joint}",
                    before=list(limits),
                    unit="rad" if robot.revolute[k] else "m",
                    scale=_TENTH,
                    most=_MAX_WIDENING,
                    propose=partial(wider, k, limits, end, sign),
                    about=frozenset({joint}),
                    is_of_robot=not isinstance(own, Mapping) or joint not in own,
                )


def effort_changes(question: Question, sign: int) -> Iterator[Change]:
    """Yield the changes of the effort limit of each joint, more (sign 1) or less (-1)."""
    robot, limits = question.robot, question.fields.robot.limits
    scale = limits.scale.get("effort", 1.0)

    def changed(joint: str, before: float, unit: str, value: Any, size: float) -> Proposal:
        after = exact(before + sign * size)
        factor = after / before
        effort: Any  # as in the file: a number, a pair or a table
        if value is None:
            effort = after
        elif isinstance(value, int | float):
            effort = exact(factor * value)
        elif isinstance(value, list | tuple):
            effort = [exact(factor * each) for each in value]
        else:
            values = [exact(factor * each) for each in value.effort]
            effort = {"position": value.position, "effort": values}
        text = from_to(before, after, unit)
        if sign > 0:
            text = f"{figures(size, unit)} more ({text})"
        changes = _limit_of(question, "effort", joint, effort)
        return Proposal(changes, after, f"{joint}: {text}", figures(after, unit))

    for k, (joint, limit) in enumerate(
        zip(robot.joint_names, robot.limits.effort.tolist(), strict=True)
    ):
        if not np.isfinite(limit):
            continue
        unit = "N m" if robot.revolute[k] else "N"
        value = limits.effort.get(joint) if isinstance(limits.effort, dict) else None
        before = exact(limit / scale)
        yield Change(
            kind="effort",
            field=f"robot.limits.effort.{joint}",
            before=before,
            unit=unit,
            scale=before,
            most=_MAX_GROWTH * before if sign > 0 else 0.99 * before,
            propose=partial(changed, joint, before, unit, value),
            about=frozenset({joint}),
            is_loss=sign < 0,
            is_of_robot=value is None,
        )


def _own_positions(limits: JointLimits) -> tuple[list[float], list[float]]:
    """Return the lower and the upper position limits, without the margin from them."""
    margin = limits.position_margin
    return (limits.lower_position - margin).tolist(), (limits.upper_position + margin).tolist()


def _limit_of(question: Question, quantity: str, joint: str, value: Any) -> dict[str, Any]:
    """Return the values that give a joint another limit, and the others their present limits."""
    limits = getattr(question.fields.robot.limits, quantity)
    path = f"robot.limits.{quantity}"
    if isinstance(limits, Mapping):
        return {f"{path}.{joint}": value}
    # One value for all joints, or a list, becomes a map by name.
    robot, names = question.robot, question.robot.joint_names
    if quantity == "position":
        values = np.column_stack(_own_positions(robot.limits)).tolist()
    else:
        factor = question.fields.robot.limits.scale.get(quantity, 1.0)
        values = [exact(each / factor) for each in getattr(robot.limits, quantity).tolist()]
    return {path: {**dict(zip(names, values, strict=True)), joint: value}}


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


_MAX_MOVE = 1.0  # [rad], or [m]


def end_changes(question: Question) -> Iterator[Change]:
    """Yield the changes of start and goal, and of a required duration."""
    for end in ("start", "goal"):
        yield from _joints(question, end)
    # Joints of start and goal are left to inverse kinematics.
    start, goal = question.fields.start.joints, question.fields.goal
    if start is not None:
        with suppress(ProblemError):
            q = question.robot.limits.clip(configuration_of(question.robot, "start", start))
            seeded = Proposal(
                {"start": {"seed": q.tolist()}},
                {"seed": q.tolist()},
                "start: inverse kinematics of reference point 0, from the joints given as a seed,",
            )
            yield Change.switch("start", "start", question.spec.document["start"], seeded)
    if goal is not None and goal.joints is not None:
        opened = Proposal({"goal": None}, None, "goal: left out, its configuration open,")
        yield Change.switch("goal", "goal", question.spec.document["goal"], opened)
    yield from _loose_ends(question)
    objective, period = question.fields.objective, question.fields.period
    if objective is None or objective.duration is None:
        return
    before = objective.duration

    def longer(size: float) -> Proposal:
        after = before + size
        after = exact(after if not period else ceil(after / period - _ROUNDING) * period)
        text = f"objective.duration {from_to(before, after, 's')}"
        return Proposal({"objective.duration": after}, after, text, figures(after, "s"))

    yield Change("duration", "objective.duration", before, "s", before, 100 * before, longer)


def _joints(question: Question, end: str) -> Iterator[Change]:
    value = getattr(question.fields, end)
    if value is None or value.joints is None:
        return
    try:
        q = configuration_of(question.robot, end, value.joints)
    except ProblemError:  # it names an unknown joint: loading the problem reports that
        return
    revolute = question.robot.revolute

    def shifted(k: int, joint: str, sign: int, size: float) -> Proposal:
        after = q.tolist()
        after[k] = exact(after[k] + sign * size)
        brief = figures(size, "rad" if revolute[k] else "m")
        text = f"{end}: {'' if sign > 0 else '-'}{brief} on {joint}"
        return Proposal({f"{end}.joints": after}, after, text, brief)

    for k, joint in enumerate(question.robot.joint_names):
        for sign in (1, -1):
            yield Change(
                kind=end,
                field=f"{end}.joints",
                before=q.tolist(),
                unit="rad" if revolute[k] else "m",
                scale=_TENTH,
                most=_MAX_MOVE,
                propose=partial(shifted, k, joint, sign),
                about=frozenset({end, joint}),
            )


def _loose_ends(question: Question) -> Iterator[Change]:
    """Yield a start by joints near its point, a goal within a tolerance, and both together."""
    start = _start_nearby(question)
    if start is not None:
        yield Change.switch("start", "start", question.spec.document["start"], start)
    goal, last = question.fields.goal, question.segment_count
    about = frozenset({"goal", f"segment {last - 1}", f"point {last}"})
    has_position = goal is not None and goal.position is not None
    before = goal.tolerance if goal is not None and has_position else 0.0
    proposals: list[tuple[str, Proposal | None]] = [("goal", None)]
    if start is not None and (goal is None or goal.joints is None):
        proposals.append(("ends", start))

    def within(other_start: Proposal | None, size: float) -> Proposal:
        after = exact(before + size)
        changes: dict[str, Any] = {"goal.tolerance": after}
        text = f"goal.tolerance {from_to(before, after, 'm')}"
        if not has_position:
            pose = None if goal is None else goal.pose
            centre = question.points[-1].tolist() if pose is None else list(pose.position)
            changes = {"goal": {"position": centre, "tolerance": after}}
            name = f"reference point {last}" if pose is None else "its position"
            text = f"goal: within {figures(after, 'm')} of {name}, in any configuration"
        if other_start is not None:
            changes, text = {**other_start.changes, **changes}, f"{other_start.text} {text}"
        return Proposal(changes, after, text, figures(after, "m"))

    for kind, other in proposals:
        yield Change(
            kind=kind,
            field="goal.tolerance" if other is None else "start.joints, goal.tolerance",
            before=before,
            unit="m",
            scale=before or _TENTH,
            most=_MAX_MOVE,
            propose=partial(within, other),
            about=about,
        )


def _start_nearby(question: Question) -> Proposal | None:
    """Return a seed's or pose's configuration as near as the arm comes; None of other starts."""
    robot, fields, limits = question.robot, question.fields, question.robot.limits
    try:
        value = end_of("start", fields.start, fields, robot, question.spec.folder)
        if not isinstance(value, Seed | ToolPose):
            return None
        target, rotation = question.points[0], None
        seed = value.joints if isinstance(value, Seed) else value.seed
        if isinstance(value, ToolPose):
            target = value.position
            rotation = WantedRotation(value.rotation, np.zeros(3), np.ones(3, dtype=bool))
        if seed is None:
            seed = middle_of(limits.lower_position, limits.upper_position)
        q = limits.clip(configuration_of(robot, "start", seed))
    except ProblemError:  # loading the problem reports that
        return None
    bounds = limits.lower_position, limits.upper_position
    q = limits.clip(solve_position(robot, target, q, *bounds, rotation=rotation).q.round(_DECIMALS))
    apart = rounded(float(np.linalg.norm(robot.tool_position(q[None])[0] - target)))
    values = ", ".join(f"{value:g}" for value in q)
    text = f"start: joints [{values}], {figures(apart, 'm')} from its point;"
    return Proposal({"start": {"joints": q.tolist()}}, {"joints": q.tolist()}, text)
