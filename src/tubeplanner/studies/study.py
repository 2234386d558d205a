"""A study: problems, the fields in which they vary, and how every point is planned."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from tubeplanner.errors import ProblemError, shown
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.short_repr import short_repr
from tubeplanner.studies.axes import Axis
from tubeplanner.studies.study_points import Latin, StudyPoint, StudyPoints

PROBLEM = "problem"  # what the axis of several problems is called


@dataclass(frozen=True, eq=False)
class Study:
    """Many plans that belong together.

    Attributes:
        name: What figures call it.
        problems: By their names.
        axes: What is varied; the axis "problem" chooses among several problems.
        latin: Which points; None: all of the grid.
        options: How every point is planned.
        files: It was read from.

    Raises:
        ProblemError: On construction: nothing is varied, a path leads nowhere, or to no number
            where a factor is given, or the grid is too large.
    """

    name: str
    problems: Mapping[str, PosedProblem]
    axes: Sequence[Axis]
    latin: Latin | None = None
    options: PlanOptions = field(default_factory=PlanOptions)
    files: Sequence[Path] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not self.axes:
            raise ProblemError("nothing is varied; give at least one field or several problems")
        if empty := [axis.path for axis in self.axes if len(axis.ends) == 0]:
            raise ProblemError(f"{empty[0]}: give at least one value")
        assert len(self.points) > 0
        self._require_paths()

    @staticmethod
    def require(study: object) -> None:
        """Raise ProblemError unless something is a study."""
        if not isinstance(study, Study):
            raise ProblemError(f"the study is {shown(study)}; give a Study, as load_study returns")

    @cached_property
    def points(self) -> StudyPoints:
        """What is planned, in order."""
        return StudyPoints(self.axes, self.latin)

    def posed(self, point: StudyPoint) -> PosedProblem:
        """Return the problem of a point.

        Raises:
            ProblemError: Its values cannot be set together.
        """
        changes = dict(point.values)
        name = changes.pop(PROBLEM, next(iter(self.problems)))
        return self.problems[name].changed(changes)

    def _require_paths(self) -> None:
        """Raise unless every value can be set in every problem, beside the first of the others."""
        first = {axis.path: axis.ends[0] for axis in self.axes if axis.path != PROBLEM}
        for name, problem in self.problems.items():
            for axis in self.axes:
                for value in axis.ends if axis.path in first else ():
                    try:
                        problem.changed({**first, axis.path: value})
                    except ProblemError as error:
                        where = f"{name}: " if len(self.problems) > 1 else ""
                        raise ProblemError(f"{where}{error}") from None
