"""One place of a robot that was tried, and what came of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tubeplanner.errors import TubePlannerError
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.planner import plan
from tubeplanner.planning.standing_base import require_base_free
from tubeplanner.short_repr import short_repr
from tubeplanner.studies.answer_fields import require_fields
from tubeplanner.studies.leading_seeds import leading_seeds
from tubeplanner.studies.movable_problem import MovableProblem
from tubeplanner.studies.placement_region import Stand

BASE_IN_OBSTACLE = "base_in_obstacle"
# The kinds of answers, from that which says least about the rest to that which says all.
KINDS = (
    *(PlanStatus.CRASHED, PlanStatus.BAD_INPUT, BASE_IN_OBSTACLE, PlanStatus.UNREACHABLE),
    *(PlanStatus.GRAVITY_EXCEEDS_EFFORT, PlanStatus.TUBE_BLOCKED, PlanStatus.NO_TRAJECTORY),
    *(PlanStatus.CERTIFICATE_FAILED, PlanStatus.SUCCESS),
)


@dataclass(frozen=True, eq=False)
class PlacementRow:
    """One place of the robot, and what planning there gave.

    Attributes:
        stand: Where the root link stands.
        status: "base_in_obstacle", or how planning ended, as of `PlanResult`.
        message: One sentence: the answer, or why there is none.
        place: Where, if there is no answer.
        duration: Of the shortest certified motion that was found with quality "fast" [s]; None if
            there is none.
        seeds: Of start and goal, where the joints given lead to no configuration that is free.
    """

    stand: Stand
    status: str
    message: str
    place: Place = field(default_factory=Place)
    duration: float | None = None
    seeds: Mapping[str, Sequence[float]] = field(default_factory=dict)

    __repr__ = short_repr

    @property
    def is_feasible(self) -> bool:
        """Whether there is a certified motion."""
        return self.duration is not None

    @property
    def reason(self) -> str:
        """Why there is no motion, without the numbers, so that many places have the same."""
        words = str(self.status).replace("_", " ")
        links, obstacle, joint = self.place.links or (), self.place.obstacle, self.place.joint
        if links and obstacle is not None:
            between = "in" if self.status == BASE_IN_OBSTACLE else "and"
            return f"{words}: '{links[0]}' {between} '{obstacle}'"
        if links:
            return f"{words}: {' and '.join(map(repr, links))}"
        if joint is not None:
            return f"{words}: {joint}"
        return words if self.place.segment is None else f"{words}: segment {self.place.segment}"

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        return {
            "position": list(self.stand[:3]),
            "yaw": self.stand.yaw,
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "duration": self.duration,
            "seeds": {end: list(values) for end, values in self.seeds.items()},
        }

    @classmethod
    def of_dict(cls, fields: Mapping[str, Any]) -> "PlacementRow":
        """Return the row of which `as_dict` gave the values.

        Raises:
            KeyError: A value is missing.
            ValueError: There are others, or a type is another one.
        """
        where: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value
            for key, value in fields["where"].items()
        }
        x, y, z = fields["position"]
        names = {"position": "stand", "where": "place"}
        plain = {names.get(key, key): value for key, value in fields.items() if key != "yaw"}
        require_fields(cls, {**plain, "stand": [x, y, z, fields["yaw"]]})
        return cls(
            Stand(x, y, z, fields["yaw"]),
            fields["status"],
            fields["message"],
            Place(**where),
            fields["duration"],
            fields["seeds"],
        )


def tried(call: tuple[MovableProblem, Stand, Sequence[str], PlanOptions]) -> PlacementRow:
    """Return what comes of a problem, its robot at a stand.

    Args:
        call: The problem, the stand, names of obstacles that links which no joint moves may touch,
            and how to plan.
    """
    movable, stand, stands_on, options = call
    try:
        problem = movable.load(stand)
        try:
            require_base_free(problem, stands_on)
        except Infeasible as reason:
            return PlacementRow(stand, BASE_IN_OBSTACLE, str(reason), reason.place)
        seeds = leading_seeds(problem, tuple(movable.seeds))
        result = plan(movable.load(stand, seeds) if seeds else problem, options)
    except TubePlannerError as error:
        return PlacementRow(stand, str(PlanStatus.BAD_INPUT), str(error))
    status, duration = str(result.status), result.shortest_duration
    return PlacementRow(stand, status, result.message, result.place, duration, seeds)


def grouped(
    rows: Sequence[PlacementRow], key: Callable[[PlacementRow], str]
) -> list[tuple[str, list[PlacementRow]]]:
    """Return rows by a key, the largest group first."""
    groups: dict[str, list[PlacementRow]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return sorted(groups.items(), key=lambda pair: -len(pair[1]))
