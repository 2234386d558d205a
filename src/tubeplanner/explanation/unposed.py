"""A problem that cannot be posed: why, and what can be drawn of it."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.explanation.question import Question
from tubeplanner.outcome import ContradictionError, Place
from tubeplanner.problem.joint_values import configuration_of
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.problem.problem_reader import solids_of
from tubeplanner.short_repr import short_repr
from tubeplanner.tube.tube import Tube

# What is left out of a tube that contradicts itself, one after the other, until it can be drawn.
_LEFT_OUT = (
    (),
    ("joint_signs",),
    ("orientations", "rotation_tolerance"),
    ("tool_radius", "tool_speed", "pass_through_points"),
)


@dataclass(frozen=True, eq=False)
class Unposed:
    """Why a problem cannot be posed, and what can be drawn of it.

    Attributes:
        message: Why, in one sentence.
        place: Where.
        proved: Whether it is proved that there is no motion; None: it is bad input alone.
        configuration: Of the arm at the place, shape (n,) [rad or m]; None: there is none.
        drawn: A problem of the same arm, tube and solids; None if the tube cannot be drawn.
    """

    message: str
    place: Place
    proved: bool | None
    configuration: FloatArray | None
    drawn: PlanningProblem | None

    __repr__ = short_repr

    @classmethod
    def of(cls, question: Question, error: ProblemError) -> "Unposed":
        """Return what is known of a problem whose loading raised an error.

        Raises:
            ProblemError: Its solids cannot be built.
        """
        drawn = _drawn(question)
        message = str(error).removeprefix(f"{question.posed.name}: ")
        if isinstance(error, ContradictionError):
            return cls(message, error.place, error.proved, error.configuration, drawn)
        return cls(message, Place(), None, None, drawn)


def _drawn(question: Question) -> PlanningProblem | None:
    """Return the problem without what may contradict it: only tube, solids and a start are left."""
    fields, robot, folder = question.fields, question.robot, question.posed.folder
    solids = solids_of(fields, robot, folder)
    for tube in _tubes(question):
        with suppress(ProblemError):
            start = Seed(robot.limits.clip(_given_start(question)))
            return PlanningProblem(robot, tube, start, name=question.posed.name, **solids)
    return None


def _tubes(question: Question) -> Iterator[Tube]:
    assert question.fields.tube is not None
    with suppress(ProblemError):
        given: dict[str, Any] = {**question.fields.tube.model_dump(), **question.given_tube}
        for names in _LEFT_OUT:
            for name in names:
                given.pop(name, None)
            with suppress(ProblemError):
                yield Tube(**given)


def _given_start(question: Question) -> FloatArray:
    """Return the joints (n,) that are given for the start, or for its inverse kinematics."""
    start = question.fields.start
    for given in (start.joints, start.seed):
        if given is not None:
            with suppress(ProblemError):  # it names a joint that is not there
                return configuration_of(question.robot, "start", given)
    return np.zeros(question.robot.joint_count)
