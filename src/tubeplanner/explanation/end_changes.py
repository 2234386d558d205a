"""Changes of where the motion begins and ends, and of how long it may take."""

from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import Any

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.explanation.change import Change, Proposal, exact, figures, from_to
from tubeplanner.explanation.question import Question
from tubeplanner.problem.joint_values import configuration_of

_TENTH = 0.1  # [rad], or [m]
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
