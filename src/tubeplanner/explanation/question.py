"""The problem that is asked about: what its file holds, and what changes of it need to know."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.problem.document_kind import require_problem
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.problem_format import ProblemFields, check_problem_fields
from tubeplanner.problem.problem_reader import points_of, robot_of
from tubeplanner.robot.robot_model import RobotModel


@dataclass(frozen=True, eq=False)
class Question:
    """A problem that is asked about; it need not be one that can be posed.

    Attributes:
        posed: As its file holds it.
        fields: The same, checked against the format.
        robot: Its arm.
    """

    posed: PosedProblem
    fields: ProblemFields
    robot: RobotModel

    def __repr__(self) -> str:
        return f"<Question about {self.posed.name}>"

    @classmethod
    def of(cls, posed: PosedProblem) -> "Question":
        """Take a problem.

        Raises:
            ProblemError: It is a cycle or a study, contradicts its format, or has no tube.
            RobotError: Its robot cannot be planned with.
        """
        require_problem(posed.document, posed.name)
        fields = check_problem_fields(posed.document, posed.name)
        if fields.tube is None:
            raise ProblemError(
                f"{posed.name}: tube is required; `tubeplanner route` finds one from start, goal "
                "and obstacles"
            )
        return cls(posed, fields, robot_of(fields, posed.folder))

    @cached_property
    def given_tube(self) -> Mapping[str, Any]:
        """Points, radius and orientations, from the problem file or its file of points."""
        assert self.fields.tube is not None
        return points_of(self.fields.tube, self.posed.folder)

    @cached_property
    def points(self) -> FloatArray:
        """The reference points, shape (m + 1, 3) [m]."""
        return np.array(self.given_tube["points"], dtype=float)

    @property
    def segment_count(self) -> int:
        """Number m of segments."""
        return len(self.points) - 1

    def segment_near(self, position: FloatArray) -> int:
        """Return the segment whose line is nearest to a point (3,) [m]."""
        begin, along = self.points[:-1], np.diff(self.points, axis=0)
        square = np.maximum(np.einsum("mi,mi->m", along, along), np.finfo(float).tiny)
        share = np.einsum("mi,mi->m", position - begin, along) / square
        nearest = begin + np.clip(share, 0, 1)[:, None] * along
        return int(np.linalg.norm(position - nearest, axis=1).argmin())

    def per_segment(self, given: Any) -> list[Any]:
        """Return what is given once or for each segment as a list of m."""
        return list(given) if isinstance(given, list | tuple) else [given] * self.segment_count

    def load(self, changes: Mapping[str, Any] | None = None) -> PlanningProblem:
        """Return the problem with other values by field path.

        Raises:
            ProblemError: It contradicts itself then.
            RobotError: The robot cannot be planned with.
        """
        loaded = self.posed.changed(changes).load()
        assert isinstance(loaded, PlanningProblem)
        return loaded
