"""A problem whose robot may stand elsewhere: joints at start and goal are seeds there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.errors import ProblemError
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.orientation import rpy_of_matrix
from tubeplanner.problem.document_kind import require_problem
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.problem_format import check_problem_fields
from tubeplanner.problem.problem_reader import end_of, robot_of
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.studies.placement_region import Stand

_ENDS = ("start", "goal")


@dataclass(frozen=True)
class MovableProblem:
    """A problem file's contents, ready for any stand of the robot.

    Attributes:
        posed: The problem as given.
        seeds: Start and goal, where they are configurations: these joints [rad or m] are where
            inverse kinematics begins.
        given: Where the robot stands as given.
        tilt: Its roll and pitch, which it keeps [rad].
    """

    posed: PosedProblem
    seeds: Mapping[str, Any]
    given: Stand
    tilt: tuple[float, float]

    @classmethod
    def of(cls, posed: PosedProblem) -> "MovableProblem":
        """Take a problem.

        Raises:
            ProblemError: It is a cycle, or contradicts its format.
            RobotError: Its robot cannot be planned with.
        """
        require_problem(posed.document, posed.name)
        fields = check_problem_fields(posed.document, posed.name)
        robot = robot_of(fields, posed.folder)
        seeds = {}
        for end in _ENDS:
            try:
                given = end_of(end, getattr(fields, end), fields, robot, posed.folder)
            except ProblemError as error:
                raise ProblemError(f"{posed.name}: {error}") from None
            if isinstance(given, np.ndarray):
                seeds[end] = given.tolist()
            elif isinstance(given, dict):
                seeds[end] = given
        stand, tilt = _stand_of(robot)
        return cls(posed, seeds, stand, tilt)

    def changes(
        self, stand: Stand, seeds: Mapping[str, Sequence[float]] | None = None
    ) -> dict[str, Any]:
        """Return what is to be changed for a stand, by field path.

        Args:
            stand: Where the root link is to stand.
            seeds: Other seeds than the joints given, by end.
        """
        place = {"position": [stand.x, stand.y, stand.z], "rpy": [*self.tilt, stand.yaw]}
        ends = {**self.seeds, **(seeds or {})}
        return {"robot.base": place, **{end: {"seed": values} for end, values in ends.items()}}

    def at(self, stand: Stand, seeds: Mapping[str, Sequence[float]] | None = None) -> PosedProblem:
        """Return the problem with the robot at a stand; arguments as of `changes`."""
        return self.posed.changed(self.changes(stand, seeds))

    def load(
        self, stand: Stand, seeds: Mapping[str, Sequence[float]] | None = None
    ) -> PlanningProblem:
        """Return `at` as a planning problem.

        Raises:
            ProblemError: It contradicts itself there.
            RobotError: The robot cannot be planned with.
        """
        loaded = self.at(stand, seeds).load()
        assert isinstance(loaded, PlanningProblem)
        return loaded


def _stand_of(robot: RobotModel) -> tuple[Stand, tuple[float, float]]:
    """Return where a robot stands, and its roll and pitch [rad]."""
    base = robot.base
    if base is None:
        return Stand(0.0, 0.0, 0.0, 0.0), (0.0, 0.0)
    roll, pitch, yaw = base.rpy or rpy_of_matrix(base.placement[:3, :3])
    return Stand(*base.position, yaw), (roll, pitch)
