"""Change of one quantity by any size; the explained problem; order of likely remedies."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.fields import check_fields
from tubeplanner.outcome import Location, PlanStatus
from tubeplanner.robot.model import RobotModel
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import ProblemFields, require_problem
from tubeplanner.task.problem_reader import points_of, robot_of

# ---- Changes of one quantity by any size.

FIGURES = 3  # of a size, so that the certified size is the printed one
_SHOWN = 2 * FIGURES  # of a value that a size is added to

_MILLI = {"m": "mm", "s": "ms"}
MAX_GROWTH, _MAX_LOSS = 10.0, 0.99  # of a number, relative


def rounded(size: float) -> float:
    """Return a number rounded to the figures of texts."""
    return float(f"{size:.{FIGURES}g}")


def exact(value: float) -> float:
    """Return a number without the rounding error of a sum of rounded numbers."""
    return float(f"{value:.10g}")


def figures(value: float, unit: str = "") -> str:
    """Return a number in the figures of texts, with its unit; metres as millimetres."""
    if unit in _MILLI and abs(value) < 1:
        value, unit = 1000 * value, _MILLI[unit]
    return f"{value:.{_SHOWN}g} {unit}".rstrip()


def from_to(before: float, after: float, unit: str) -> str:
    """Return "30 -> 42 mm"."""
    both = (before, after)
    if unit in _MILLI and max(map(abs, both)) < 1:
        both, unit = (1000 * before, 1000 * after), _MILLI[unit]
    first, then = (f"{value:.{_SHOWN}g}" for value in both)
    return f"{first} -> {then} {unit}".rstrip()


@dataclass(frozen=True)
class Proposal:
    """A change by a certain size."""

    changes: Mapping[str, Any]  # values by field path, as `load_problem` takes them
    after: Any  # the quantity after the change, as JSON values
    text: str  # the change in words
    brief: str = ""  # its size, or the new value, for texts that name the rest; empty: it has none


@dataclass(frozen=True)
class Change:
    """A change of one quantity in one direction."""

    kind: str  # kind of the quantity, such as "radius" or "effort"
    field: str  # path of the quantity in the problem file
    before: Any  # the quantity before the change, as JSON values
    unit: str  # unit of the quantity and of sizes; empty: none
    scale: float  # the size that counts as one: the quantity itself, 0.1 m or 0.1 rad
    most: float  # the largest sensible size
    propose: Callable[[float], Proposal]  # function from a size to the change by that size
    about: frozenset[str] = frozenset()  # concerned names: "segment 3", a joint, an obstacle
    is_switch: bool = False  # True if the only size is 1
    # True if sizes are subtracted from the quantity: then the remainder counts as well
    is_loss: bool = False
    # True if a motion may need a middle size: a solid or a point may go too far
    is_move: bool = False
    # True if another robot is needed: its own limits, or the shape of its tool
    is_of_robot: bool = False
    # size that should be enough, and little less not, tried first; None: not known
    estimate: float | None = None

    @property
    def first_sizes(self) -> tuple[float, ...]:
        """The sizes tried first: the estimate or scale, of a move a middle size, the largest."""
        ends = (min(self.estimate or self.scale, self.most), self.most)
        return (ends[0], (ends[0] * ends[1]) ** 0.5, ends[1]) if self.is_move else ends

    @classmethod
    def switch(
        cls,
        kind: str,
        field: str,
        before: Any,
        proposal: Proposal,
        about: frozenset[str] = frozenset(),
    ) -> "Change":
        """Return a change of size 1 alone: the proposal."""
        return cls(kind, field, before, "", 1.0, 1.0, lambda size: proposal, about, is_switch=True)

    @classmethod
    def of_number(
        cls,
        kind: str,
        field: str,
        before: float,
        unit: str,
        sign: int,
        name: str,
        *,
        changes: Callable[[float], Mapping[str, Any]] | None = None,
        after: Callable[[float], float] = exact,
        says_more: bool = False,
        **others: Any,
    ) -> "Change":
        """Return a change of one number, up (sign 1) or down (-1), which is a loss.

        `name` is for texts such as "NAME 30 -> 42 mm", or "NAME 12 mm more (30 -> 42 mm)". `after`
        rounds the sum of number and size. `changes` has the values by field path; None: that of the
        field. By default the scale is the number, and the largest size ten times that, or nearly
        all of a loss.
        """

        def propose(size: float) -> Proposal:
            new = after(before + sign * size)
            text = from_to(before, new, unit)
            if says_more:
                text = f"{figures(size, unit)} more ({text})"
            values = {field: new} if changes is None else changes(new)
            return Proposal(values, new, f"{name} {text}", figures(new, unit))

        most = (MAX_GROWTH if sign > 0 else _MAX_LOSS) * before
        sizes = {"scale": before, "most": most, "is_loss": sign < 0}
        return cls(kind, field, before, unit, propose=propose, **{**sizes, **others})

    def __repr__(self) -> str:
        return f"<Change of {self.field}, up to {self.most:g} {self.unit}>"


# ---- The explained problem: its file's contents, and the geometry that changes need.


@dataclass(frozen=True, eq=False)
class Question:
    """An explained problem; it may be invalid."""

    spec: ProblemSpec  # the contents of its file
    fields: ProblemFields  # the contents, checked against the format
    robot: RobotModel  # its arm

    def __repr__(self) -> str:
        return f"<Question about {self.spec.name}>"

    @classmethod
    def of(cls, spec: ProblemSpec) -> "Question":
        """Return the question about a problem.

        Raises:
            ProblemError: It is a cycle or a study, contradicts its format, or has no tube.
            RobotError: Its robot cannot be planned with.
        """
        require_problem(spec.document, spec.name)
        fields = check_fields(ProblemFields, spec.document, spec.name)
        if fields.tube is None:
            raise ProblemError(
                f"{spec.name}: tube is required; `tubeplanner route` finds one from start, goal "
                "and obstacles"
            )
        if fields.tube.route is not None:
            raise ProblemError(
                f"{spec.name}: tube.route has no points and radii, which are what explain changes; "
                "`plan` names what is in the way"
            )
        return cls(spec, fields, robot_of(fields, spec.folder))

    @cached_property
    def tube_fields(self) -> Mapping[str, Any]:
        """Points, radius and orientations, from the problem file or its file of points."""
        assert self.fields.tube is not None
        return points_of(self.fields.tube, self.spec.folder)

    @cached_property
    def points(self) -> FloatArray:
        """The reference points, shape (m + 1, 3) [m]."""
        return np.array(self.tube_fields["points"], dtype=float)

    @property
    def has_point_file(self) -> bool:
        """True if the reference points are in a file of their own."""
        return isinstance(self.spec.document["tube"]["points"], str)

    @property
    def segment_count(self) -> int:
        """Number m of segments."""
        return len(self.points) - 1

    def segment_near(self, position: FloatArray) -> int:
        """Return the segment whose line is nearest to a point (3,) [m]."""
        begin, along = self.points[:-1], np.diff(self.points, axis=0)
        square = np.maximum(np.einsum("mi,mi->m", along, along), np.finfo(float).tiny)
        fraction = np.einsum("mi,mi->m", position - begin, along) / square
        nearest = begin + np.clip(fraction, 0, 1)[:, None] * along
        return int(np.linalg.norm(position - nearest, axis=1).argmin())

    def per_segment(self, value: Any) -> list[Any]:
        """Return a value for all segments, or for each, as a list of m."""
        return list(value) if isinstance(value, list | tuple) else [value] * self.segment_count

    def load(self, changes: Mapping[str, Any] | None = None) -> PlanningProblem:
        """Return the problem with other values by field path.

        Raises:
            ProblemError: It contradicts itself with these values.
            RobotError: The robot cannot be planned with.
        """
        loaded = self.spec.changed(changes).load()
        assert isinstance(loaded, PlanningProblem)
        return loaded


# By the status of the plan: the kinds that remove the reported cause, then others that may help.
_HELPFUL = {
    PlanStatus.TUBE_BLOCKED: (
        ("clearance", "obstacle", "radii", "sign"),
        ("radius", "rotation_tolerance", "start", "goal", "point"),
    ),
    PlanStatus.GRAVITY_EXCEEDS_EFFORT: (("effort", "payload", "sign"), ()),
    PlanStatus.UNREACHABLE: (
        ("position", "sign", "rotation_tolerance", "radius", "radii"),
        ("point", "start", "goal"),
    ),
    PlanStatus.BAD_INPUT: (
        ("position", "start", "goal", "duration", "holding"),
        ("radius", "sign", "point"),
    ),
}
# Of a band that joints cannot hold.
_STEADIES = ("band", "bend", "radii", "rotation_tolerance"), ("radius", "payload", "point")
# Of a part that is lost, whatever the status.
_HOLDS = ("holding", "rotation_tolerance"), ("radius", "start", "goal", "point")
# The kinds that are tried only if nothing else helps, whatever the cause.
_LAST = ("points", "ends", "attached")
# The kinds that remove the reported cause wherever it is.
_EVERYWHERE = ("payload", "sign", "radii", "duration")


def in_order(
    changes: Iterable[Change], status: PlanStatus, location: Location
) -> list[list[list[Change]]]:
    """Return changes in tiers: about the place, elsewhere, and of kinds that are unlikely to help.

    The first tier has two groups, the likelier kinds first; others have one.
    """
    names = {location.joint, *(f"link {name}" for name in location.links or ())}
    if location.segment is not None:
        names.add(f"segment {location.segment}")
    if location.point is not None:
        names |= {
            f"point {location.point}",
            f"segment {location.point - 1}",
            f"segment {location.point}",
        }
    if location.obstacle is not None:
        names.add(f"obstacle {location.obstacle}")
    groups: tuple[list[Change], ...] = ([], [], [], [])
    first, second, elsewhere, unlikely = groups
    likelier, others = _HELPFUL.get(status, ((), ()))
    if location.contact is not None:
        likelier, others = _HOLDS
    changes = list(changes)
    if status is PlanStatus.NO_TRAJECTORY and any(each.kind == "band" for each in changes):
        likelier, others = _STEADIES
    kinds = (*likelier, *others)
    rank = {kind: k for k, kind in enumerate(kinds)}
    for change in sorted(changes, key=lambda change: rank.get(change.kind, len(kinds))):
        is_helpful = (not kinds or change.kind in kinds) and change.kind not in _LAST
        is_there = bool(names & change.about) or change.kind in _EVERYWHERE or not change.about
        if not is_helpful:
            unlikely.append(change)
        elif not is_there:
            elsewhere.append(change)
        else:
            (second if change.kind in others else first).append(change)
    return [[first, second], [elsewhere], [unlikely]]
