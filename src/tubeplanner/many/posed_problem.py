"""A problem or a cycle as its file holds it, ready to travel to where it is planned."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tubeplanner.arguments import given_path
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_format import CycleFields
from tubeplanner.cycle.cycle_reader import parse_cycle
from tubeplanner.many.content_hash import content_hash, document_hash
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.problem.document_kind import is_cycle
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.problem_fields import changed_problem
from tubeplanner.problem.problem_format import ProblemFields, check_problem_fields
from tubeplanner.problem.problem_layers import ProblemLayers
from tubeplanner.problem.problem_reader import build_problem
from tubeplanner.resources import find_problem

# What robot and solids are made of; problems that agree in it share them.
_CELL = ("robot", "obstacles", "collision")
_KEPT = 16
_known: dict[str, PlanningProblem] = {}  # by the hash of their cells, the latest last


@dataclass(frozen=True)
class PosedProblem:
    """What a problem file or a cycle file holds, with all that it includes.

    Attributes:
        document: As dictionaries and lists.
        folder: Where its relative paths start.
        name: What messages call it.
    """

    document: Any
    folder: Path
    name: str

    def __repr__(self) -> str:
        kind = "cycle" if is_cycle(self.document) else "problem"
        return f"<PosedProblem {self.name}: a {kind} in {self.folder}>"

    @classmethod
    def read(cls, problem: str | Path, directory: str | Path = ".") -> "PosedProblem":
        """Read a problem file or a cycle file, and what it includes.

        Args:
            problem: A path, or `example:ROBOT/NAME` for a bundled one.
            directory: Where a relative path starts.

        Raises:
            ProblemError: A file cannot be read, or files include each other in a circle.
        """
        path = find_problem(problem, given_path("directory", directory)).resolve()
        return cls(ProblemLayers.read(path).merged, path.parent, f"{path.parent.name}/{path.stem}")

    def changed(self, changes: Mapping[str, Any] | None) -> "PosedProblem":
        """Return it with other values by field path; None: the same ones.

        Raises:
            ProblemError: A path leads nowhere.
        """
        model = CycleFields if is_cycle(self.document) else ProblemFields
        document = changed_problem(self.document, changes, model)
        return PosedProblem(document, self.folder, self.name)

    def content_hash(self, options: PlanOptions) -> str:
        """Return a hash of all that its plan with some options depends on."""
        return content_hash(self.document, self.folder, options)

    def load(self) -> PlanningProblem | Cycle:
        """Return what it poses; robot and solids that this process knows are not built again.

        Raises:
            ProblemError: It contradicts its format, itself or its robot.
            RobotError: The robot cannot be planned with.
        """
        if is_cycle(self.document):
            return parse_cycle(self.document, self.folder, self.name)
        fields = check_problem_fields(self.document, self.name)
        key = self._cell_hash
        like = _known.get(key)
        problem = build_problem(fields, self.folder, self.name, self.name, like=like)
        _keep(key, problem)
        return problem

    @property
    def _cell_hash(self) -> str:
        cell = {key: self.document[key] for key in _CELL if key in self.document}
        return document_hash(cell, self.folder)


def _keep(key: str, problem: PlanningProblem) -> None:
    """Keep a problem for its robot and solids, and forget the one not used for longest."""
    _known.pop(key, None)
    _known[key] = problem
    for oldest in list(_known)[:-_KEPT]:
        _known.pop(oldest, None)
