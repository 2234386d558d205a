"""Tube: points, radii, rotation, joint signs; narrowed tubes, merged segments.

Segment k joins reference points k and k+1; its capsule is all points within the path tolerance of
the segment (Suh & Bishop 1988, section on the tube model; digest: F_j). All positions are in the
base frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.checks import WHOLE_NUMBER, in_figures, is_number
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.geometry.tube.bands import (
    NO_PROCESS,
    REQUIRED,
    Gate,
    Process,
    Stretch,
    TubeEvent,
    events_of,
    gates,
    has_bands,
    process_of,
    run_ins,
    speeds_of,
    stretches,
)
from tubeplanner.geometry.tube.points import (
    MAX_EXTENT,
    MIN_LENGTH,
    PASS_THROUGH,
    SEGMENT_NUMBERS,
    JointRange,
    JointSign,
    arc_lengths,
    compulsory_points,
    distinct_points,
    given_points,
    given_radii,
    given_route,
    joint_ranges,
    segment_values,
    sign_maps,
)
from tubeplanner.geometry.tube.regions import (
    BoxRegions,
    Capsules,
    SegmentRegions,
    box_sections,
    radii_of_boxes,
)
from tubeplanner.geometry.tube.rotation import RotationalTube, RotationBound, given_rotation
from tubeplanner.orientation import rotation_matrix, rotation_vector
from tubeplanner.robot.model import RobotModel

_ALL = slice(None)
_MAX_NUMBER = 10**9  # of a point
# Fields with an entry for each point, and for each segment.
_BY_POINT = ("points", "orientations", "numbers")
_BY_SEGMENT = ("radius", "joint_signs", "rotation_tolerance", "cross_section", *SEGMENT_NUMBERS)
_BLOCK = 100_000  # distances computed at once, which a processor's cache holds
VISITS = ("ordered", "any")


@dataclass(frozen=True, eq=False, init=False)
class Tube:
    """Reference points, a tolerance per segment, and joint ranges per segment.

    Attributes:
        points: Reference points, shape (m+1, 3) [m].
        radius: Path tolerances, shape (m,) [m].
        tool_radius: The tool as a sphere [m]; every effective radius is smaller by it.
        joint_signs: Per segment, by joint name: the user's sign or range.
        visit: "ordered": segments one after the other, with switching times in both capsules;
            "any": the union of all capsules. (Of segments with a box, it replaces the capsule.)
        orientations: Of the tool at the reference points, unit quaternions x y z w, shape (m+1, 4);
            None: any orientation is allowed.
        rotation_tolerance: Per segment an angle, or bounds on the three components of log(R_ref^T
            R) [rad]; None: as above.
        pass_through_points: Inner points that the tool must pass within the smaller radius beside
            them: "all", "corners" (where the tube turns back by more than 150 degrees) or "none".
        numbers: The points' numbers in messages, shape (m+1,): 0 to m, unless points were left out.
        tool_speed: Limits on the tool's speed, shape (m,) [m/s], inf where free; None: free.
        least_tool_speed: Lower ends of speed bands, whose upper ends are limits on the tool's
            speed, likewise; inf where there is no band.
        process: Of the stretches with a band; its run-ins and run-outs are segments of the tube.
        events: While the tool moves, at places of the reference path; no conditions.
        tool_acceleration: Limits on the tool's acceleration, likewise [m/s^2].
        clearance: Of links from obstacles, (m,) [m], inf for the problem's; None: the problem's.
        route: Configurations (P, n) from start to goal [rad or m]: a first guess of the motion, not
            a condition; None: none.
        cross_section: Boxes about segments, shape (m, 5), as `box_sections`; None: discs alone.
        joint_ranges: Per segment, by joint name: [lower, upper], the meaning of the signs [rad or
            m].
        rotation: The rotation tolerance as geometry; None: as above.
        notes: Points that were left out.
        parts: The tube whose segments were joined to this tube's; None if none were.
        part_points: Indices of this tube's points among those of `parts`, shape (m+1,).
    """

    points: FloatArray
    radius: FloatArray
    tool_radius: float
    joint_signs: tuple[Mapping[str, JointSign], ...]
    visit: Literal["ordered", "any"]
    orientations: FloatArray | None
    rotation_tolerance: tuple[RotationBound, ...] | None
    pass_through_points: Literal["all", "corners", "none"]
    numbers: IntArray
    tool_speed: FloatArray | None = None
    least_tool_speed: FloatArray | None = None
    process: Process = NO_PROCESS
    events: tuple[TubeEvent, ...] = ()
    tool_acceleration: FloatArray | None = None
    cross_section: FloatArray | None = None
    clearance: FloatArray | None = None
    route: FloatArray | None = None
    joint_ranges: tuple[Mapping[str, JointRange], ...] = field(init=False)
    rotation: RotationalTube | None = field(init=False)
    notes: tuple[str, ...] = field(init=False)
    parts: "Tube | None" = field(init=False)
    part_points: IntArray = field(init=False)

    def __init__(
        self,
        points: Sequence[Sequence[float]] | FloatArray,
        radius: float | Sequence[float | None] | FloatArray | None,
        *,
        tool_radius: float = 0.0,
        joint_signs: Mapping[str, JointSign] | Sequence[Mapping[str, JointSign]] | None = None,
        visit: Literal["ordered", "any"] = "ordered",
        orientations: Sequence[Sequence[float]] | FloatArray | None = None,
        rotation_tolerance: float | Sequence[float | Sequence[float]] | None = None,
        pass_through_points: Literal["all", "corners", "none"] = "corners",
        numbers: Sequence[int] | IntArray | None = None,
        tool_speed: float
        | Mapping[str, Any]
        | Sequence[float | Mapping[str, Any] | None]
        | FloatArray
        | None = None,
        least_tool_speed: float | Sequence[float | None] | FloatArray | None = None,
        process: Process | Mapping[str, Any] | None = None,
        events: Sequence[TubeEvent | Mapping[str, Any]] = (),
        tool_acceleration: float | Sequence[float | None] | FloatArray | None = None,
        cross_section: Mapping[str, Any] | Sequence[Any] | FloatArray | None = None,
        clearance: float | Sequence[float | None] | FloatArray | None = None,
        route: Sequence[Sequence[float]] | FloatArray | None = None,
    ) -> None:
        """Check and store the tube; points that repeat their predecessor are left out, with a note.

        Args:
            points: m+1 reference points, shape (m+1, 3) [m].
            radius: A tolerance for all segments, or m of them, None where there is a box [m].
            tool_radius: The tool as a sphere [m].
            joint_signs: A map for all segments, or m maps, from joint name to "+" (>= 0), "-" (<=
                0), "0" (free), the numbers 1, -1, 0, or a range [lower, upper] [rad or m].
            visit: "ordered" or "any".
            orientations: m+1 quaternions x y z w of the tool centre point frame at the reference
                points; between them it turns about a fixed axis, the short way round.
            rotation_tolerance: m entries, each an angle by which the tool may deviate, or bounds on
                the components of the rotation vector log(R_ref^T R), infinite where free; a number,
                or a list of bounds, serves for all segments. Three numbers for three segments are
                an angle each [rad].
            pass_through_points: "all", "corners" or "none".
            numbers: The points' numbers in messages, m+1 ascending numbers; default: 0 to m.
            tool_speed: A limit for all segments, or m of them, None where it is free [m/s]; or
                bands: {"speed": v, "tolerance": p}, from v (1 - p) to v, or {"between": [lower,
                upper]}.
            least_tool_speed: Lower ends of bands, where `tool_speed` has their upper ends [m/s].
            process: Run-ins and run-outs, which become segments where `tool_speed` has bands, and
                what holds where joints cannot keep a band.
            events: With name, segment and optionally distance [m] and lead [s]; where segments are
                visited in order.
            tool_acceleration: Likewise, gravity not counted [m/s^2].
            cross_section: {"box": [width, height], "up": [x, y, z]} for all segments, or m of them,
                None for a disc [m].
            clearance: A clearance for all segments, or m of them, None for the problem's [m].
            route: At least two configurations from start to goal, free on the lines between them
                [rad or m].

        Raises:
            ProblemError: A count, a number or a sign is wrong; the message names it.
        """
        corners = given_points(points)
        segments = len(corners) - 1
        sections = box_sections(cross_section, np.diff(corners, axis=0))
        radii = given_radii(radii_of_boxes(radius, sections), segments)
        signs = sign_maps({} if joint_signs is None else joint_signs, segments)
        ranges = joint_ranges(signs, visit)
        quaternions, bounds, rotation = given_rotation(corners, orientations, rotation_tolerance)
        _require_named("visit", visit, VISITS)
        _require_named("pass_through_points", pass_through_points, PASS_THROUGH)
        if not is_number(tool_radius) or not 0 <= tool_radius <= radii.min() - MIN_LENGTH:
            raise ProblemError(
                f"tube.tool_radius {in_figures(tool_radius)} m must be >= 0 and below the smallest "
                f"radius, {radii.min():g} m, by at least {MIN_LENGTH:g} m"
            )
        labels = np.arange(segments + 1) if numbers is None else _numbers(numbers, segments)
        largest, least = speeds_of(tool_speed, least_tool_speed, segments)
        numbers_of = {
            "tool_speed": largest,
            "least_tool_speed": least,
            "tool_acceleration": tool_acceleration,
            "clearance": clearance,
        }
        vars(self).update(
            points=corners,
            radius=radii,
            tool_radius=float(tool_radius),
            joint_signs=signs,
            visit=visit,
            orientations=quaternions,
            rotation_tolerance=bounds,
            pass_through_points=pass_through_points,
            numbers=labels,
            cross_section=sections,
            process=process_of(process),
            events=events_of(events),
            joint_ranges=ranges,
            rotation=rotation,
            route=None if route is None else given_route(route),
            notes=(),
            parts=None,
            part_points=np.arange(segments + 1),
            **{name: segment_values(each, segments, name) for name, each in numbers_of.items()},
        )
        by_segment = list(zip(radii.tolist(), self.conditions, strict=True))
        whole = None if rotation is None else rotation.angles
        distinct = distinct_points(corners, by_segment, whole)
        if len(distinct.dropped):
            less = self.with_points(distinct.points, distinct.segments)
            notes = tuple(
                f"tube.points: point {labels[k]} is the same as the one before within "
                f"{MIN_LENGTH:g} m; it is left out, with segment {labels[k] - 1}"
                for k in distinct.dropped
            )
            vars(self).clear()
            vars(self).update(vars(less), notes=notes)
        if has_bands(tool_speed):
            self._lay_run_ins()
        if self.events and visit == "any":
            raise ProblemError(
                "tube.events does not go with visit: any; leave visit out, so that segments are "
                "visited in order"
            )
        for event in self.events:
            self.event_length(event)

    def _lay_run_ins(self) -> None:
        """Add the segments of run-ins and run-outs, with a note."""
        done, added = (
            replace(self.process, run_in=0.0, run_out=0.0),
            run_ins(self.points, self.stretches, self.process),
        )
        # Of every point of the longer tube: its position, its number, the point whose orientation
        # it has; of the segment before it, the segments whose region and whose conditions it has.
        rows = [(self.points[0], self.numbers[0], 0, 0, 0)]
        for k in range(self.segment_count):
            number, region = self.numbers[k + 1], k
            for way in added:
                if way.beside == k and way.point == k:  # of a stretch that ends here
                    rows.append((way.end, number, k, way.own, k))
            for way in added:
                if way.beside == k and way.point == k + 1:  # of a stretch that begins here
                    rows.append((way.end, number, k + 1, k, k))
                    region = way.own
            rows.append((self.points[k + 1], number, k + 1, region, k))
        positions, numbers, points, regions, others = zip(*rows, strict=True)
        changes: dict[str, Any] = {"points": np.array(positions), "numbers": np.array(numbers)}
        if self.orientations is not None:
            changes["orientations"] = self.orientations[list(points)]
        for name in _BY_SEGMENT:
            if (values := getattr(self, name)) is not None:
                rows_of = regions if name in ("radius", "cross_section") else others
                changes[name] = [values[k] for k in rows_of[1:]]
        notes = list(self.notes)
        if added:
            where = ", ".join(
                f"{np.linalg.norm(way.end - self.points[way.point]):g} m at point "
                f"{self.numbers[way.point]}"
                for way in added
            )
            notes.append(f"tube.process: ways with the stretch's own radius are added: {where}")
        longer = replace(self, **changes, process=done)
        vars(self).clear()
        vars(self).update(vars(longer), notes=tuple(notes))

    def __repr__(self) -> str:
        length = float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())
        radii = f"{self.radius.min():g} to {self.radius.max():g} m"
        return f"<Tube of {self.segment_count} segments, {length:.4g} m long, radii {radii}>"

    @classmethod
    def anywhere(cls, begin: FloatArray, end: FloatArray, **conditions: Any) -> "Tube":
        """Return a tube between two tool positions (3,) that excludes no tool position.

        Where both are the same, the second is moved a little: a tube has a direction. Conditions
        are other arguments of a tube.
        """
        is_still = np.linalg.norm(end - begin) < MIN_LENGTH
        aside = np.array([0.0, 0.0, 1e3 * MIN_LENGTH * is_still])
        return cls(np.vstack([begin, end + aside]), MAX_EXTENT, **conditions)

    @property
    def is_anywhere(self) -> bool:
        """True for a tube that excludes no tool position."""
        return bool((self.radius == MAX_EXTENT).all())

    def with_radius(self, radius: float | Sequence[float] | FloatArray) -> "Tube":
        """Return the tube with another tolerance, or m others [m].

        Raises:
            ProblemError: A radius is not positive, or not above the tool radius, or a segment has a
                box.
        """
        self.require_discs("other radii", "scale all (Tube.scaled), or leave cross_section out")
        return replace(self, radius=radius)  # type: ignore[arg-type]  # as `__init__` takes it

    def scaled(self, factor: float) -> "Tube":
        """Return the tube with all radii and all sides of boxes multiplied by a factor.

        Raises:
            ProblemError: A radius or a side is too small or too large.
        """
        if self.cross_section is None:
            return self.with_radius(factor * self.radius)  # which refuses a route
        sections = self.cross_section * [factor, factor, 1.0, 1.0, 1.0]
        is_box = sections[:, 0] > 0
        radii = np.where(is_box, sections[:, :2].min(axis=1) / 2, factor * self.radius)
        return replace(self, radius=radii, cross_section=sections)

    def require_discs(self, what: str, remedy: str) -> None:
        """Raise ProblemError, with the request, if a segment has a box or the tube has a route."""
        if self.route is not None:
            raise ProblemError(
                f"tube.route leaves the tool free and does not go with {what}; give points and "
                "radii, or the tube of `tubeplanner route --measured`"
            )
        for k in np.flatnonzero(self.is_box)[:1]:
            raise ProblemError(
                f"tube.cross_section: segment {self.segment_number(int(k))} has a box, which does "
                f"not go with {what}; {remedy}"
            )

    def with_points(
        self, points: Sequence[int] | IntArray, segments: Sequence[int] | IntArray
    ) -> "Tube":
        """Return the tube with some of its points, which keep their numbers.

        Args:
            points: Their indices, ascending, at least two.
            segments: The segments whose radius and conditions hold between the points, one fewer.
        """
        changes: dict[str, Any] = {name: getattr(self, name) for name in _BY_POINT}
        changes = {name: None if v is None else v[list(points)] for name, v in changes.items()}
        for name in _BY_SEGMENT:
            values = getattr(self, name)
            changes[name] = None if values is None else [values[k] for k in segments]
        return replace(self, **changes)

    @cached_property
    def conditions(self) -> tuple[tuple[object, ...], ...]:
        """Conditions of each of m segments beside the tool's position, to be compared."""
        names = ("joint_ranges", *(name for name in _BY_SEGMENT[2:]))
        columns = [getattr(self, name) for name in names]
        rows = [each.tolist() if isinstance(each, np.ndarray) else each for each in columns]
        nothing = [None] * self.segment_count
        return tuple(zip(*(row or nothing for row in rows), strict=True))

    @property
    def segment_count(self) -> int:
        """Number m of segments."""
        return len(self.radius)

    @property
    def effective_radius(self) -> FloatArray:
        """Accepted deviation of the tool centre point, shape (m,) [m]."""
        return self.radius - self.tool_radius

    @property
    def is_box(self) -> BoolArray:
        """True for segments with a box, shape (m,)."""
        if self.cross_section is None:
            return np.zeros(self.segment_count, dtype=bool)
        is_box: BoolArray = self.cross_section[:, 0] > 0
        return is_box

    @property
    def reach(self) -> FloatArray:
        """The effective radii, of boxes the larger effective half sides, shape (m,) [m]."""
        if self.cross_section is None:
            return self.effective_radius
        longer = self.cross_section[:, :2].max(axis=1) / 2 - self.tool_radius
        return np.maximum(self.effective_radius, longer)

    @cached_property
    def regions(self) -> SegmentRegions:
        """The regions about the segments in which the tool centre point must be."""
        return self.regions_of(self.effective_radius)

    def regions_of(self, radius: FloatArray) -> SegmentRegions:
        """Return the regions for other effective radii, (m,) [m]."""
        # Copies: read-only arrays take longer to be passed to native functions.
        axes = (self.points[:-1].copy(), self.points[1:].copy())
        if self.cross_section is None:
            return Capsules(*axes, radius)
        return BoxRegions(*axes, radius, self.cross_section, self.tool_radius)

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The stretches with a speed band, in order."""
        return stretches(self.least_tool_speed)

    @cached_property
    def gates(self) -> tuple[Gate, ...]:
        """The ends of stretches whose band is required, in order."""
        is_required = self.process.steady == REQUIRED
        return gates(self.points, self.stretches) if is_required else ()

    @cached_property
    def compulsory_points(self) -> IntArray:
        """Indices of the inner points that the tool must pass within the smaller radius beside."""
        return compulsory_points(self.points, self.effective_radius, self.pass_through_points)

    def segment_number(self, k: int, tool: FloatArray | None = None) -> int:
        """Return the number of a segment in messages.

        Args:
            k: Its index.
            tool: A position (3,) [m] in it: of joined segments the nearest is meant, not the first.
        """
        if self.parts is None:
            return int(self.numbers[k + 1]) - 1
        first, end = self.part_points[k : k + 2].tolist()
        away = 0 if tool is None else self.parts.distance(tool[None], slice(first, end)).argmin()
        return self.parts.segment_number(int(first + away))

    def segment_index(self, number: int) -> int:
        """Return the index of the segment with a number in messages."""
        return int(np.searchsorted(self.numbers[1:], number + 1))

    def event_length(self, event: TubeEvent) -> float:
        """Return the length of the reference path up to an event [m].

        Raises:
            ProblemError: The tube has no such segment, or ends before the distance.
        """
        if event.segment >= self.numbers[-1]:
            raise ProblemError(
                f"tube.events: event '{event.name}': there is no segment {event.segment}; the "
                f"last one is segment {self.numbers[-1] - 1}"
            )
        # A run-in or a run-out has the same number at both ends, the stretch on one side.
        number = self.numbers[self.numbers <= event.segment][-1]
        points = np.flatnonzero(self.numbers == number)
        is_banded = self.least_tool_speed is not None and np.isfinite(
            self.least_tool_speed[points[-1]]
        )
        lengths = arc_lengths(self.points)
        length = float(lengths[points[-1] if is_banded else points[0]] + event.distance)
        if length > lengths[-1] * (1 + 1e-9):
            raise ProblemError(
                f"tube.events: event '{event.name}' is {event.distance:g} m from the begin of "
                f"segment {event.segment}, and the reference path ends after "
                f"{lengths[-1] - length + event.distance:g} m; give a shorter distance"
            )
        return length

    def distance(self, p: FloatArray, segments: slice = _ALL) -> FloatArray:
        """Return distances of points (N, 3) to some segments (of m, all), shape (N, m) [m]."""
        start, axis = self.points[:-1][segments], np.diff(self.points, axis=0)[segments]
        rows = max(_BLOCK // len(start), 1)
        blocks = [p[first : first + rows] for first in range(0, max(len(p), 1), rows)]
        return np.concatenate([_distances(block, start, axis) for block in blocks])

    def tool_pose(
        self, robot: RobotModel, q: FloatArray, time: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return rotation (N, 3, 3) and position (N, 3) [m] of the tool in the tube's frame.

        Planner, judge and simulation compare this pose with the tube. The tube rests, so that its
        frame is the base's at every time.

        Args:
            robot: The arm.
            q: Configurations, shape (N, n).
            time: Their times, shape (N,) [s]; None on a path whose times are not known yet.
        """
        return robot.tool_pose(q)

    def margin(self, p: FloatArray, segments: slice = _ALL) -> FloatArray:
        """Return the margins of points (N, 3) inside some regions (of m, all), shape (N, m) [m]."""
        if self.cross_section is None:
            return self.effective_radius[segments] - self.distance(p, segments)
        return self.regions.margin(p[:, None], np.arange(self.segment_count)[segments])

    def nearest(self, p: FloatArray, segments: slice = _ALL) -> FloatArray:
        """Return the points of some segments (of m, all) nearest to points (N, 3): (N, m, 3)."""
        start, axis = self.points[:-1][segments], np.diff(self.points, axis=0)[segments]
        squared = np.einsum("mi,mi->m", axis, axis)
        projection = np.einsum("nmi,mi->nm", p[:, None] - start, axis)
        fraction = np.clip(projection / squared, 0.0, 1.0)
        return start + fraction[:, :, None] * axis

    def rotation_margin(
        self, rotation: FloatArray, p: FloatArray, segments: slice = _ALL
    ) -> FloatArray:
        """Return the margins of tools in the rotation tolerances of some segments (of m, all).

        Args:
            rotation: Orientations of the tool, shape (N, 3, 3).
            p: Its positions, shape (N, 3) [m].
            segments: The segments.

        Returns:
            Shape (N, m) [rad], infinite where a segment leaves the rotation free.
        """
        rows = range(self.segment_count)[segments]
        margin = np.full((len(p), len(rows)), np.inf)
        for column, k in enumerate(rows):
            if self.rotation is not None and np.isfinite(self.rotation.bounds[k]).any():
                margin[:, column] = self.rotation.margin(rotation, p, k)
        return margin

    def ranges_of(self, joint_names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Return lower and upper joint ranges of all segments, each (m, n) [rad or m]."""
        free = (-np.inf, np.inf)
        rows = [[ranges.get(name, free) for name in joint_names] for ranges in self.joint_ranges]
        table = np.array(rows).reshape(self.segment_count, len(joint_names), 2)
        return table[:, :, 0], table[:, :, 1]


def _distances(p: FloatArray, start: FloatArray, axis: FloatArray) -> FloatArray:
    """Return distances of points (N, 3) to segments from `start` along `axis`, (m, 3): (N, m).

    Coordinate by coordinate: three quick operations on (N, m) for a slow one on (N, m, 3).
    """
    away = [p[:, i, None] - start[:, i] for i in range(3)]
    projection = away[0] * axis[:, 0] + away[1] * axis[:, 1] + away[2] * axis[:, 2]
    fraction = np.clip(projection / np.einsum("mi,mi->m", axis, axis), 0.0, 1.0)
    x, y, z = (from_start - fraction * axis[:, i] for i, from_start in enumerate(away))
    distances: FloatArray = np.sqrt(x * x + y * y + z * z)
    return distances


def _numbers(numbers: object, segments: int) -> IntArray:
    """Return the numbers of the points.

    Raises:
        ProblemError: The count is wrong, or the numbers are not whole or do not ascend.
    """
    is_array = isinstance(numbers, np.ndarray) and numbers.ndim == 1
    row: Any = numbers if is_array or isinstance(numbers, list | tuple) else ()
    are_whole = all(isinstance(n, WHOLE_NUMBER) and 0 <= n <= _MAX_NUMBER for n in row)
    if not are_whole or len(row) != segments + 1 or not (np.diff(row) >= 0).all():
        raise ProblemError(
            f"tube.numbers is {shown(numbers)}; give {segments + 1} ascending whole numbers"
        )
    return np.array(row, dtype=np.int64)


def _require_named(key: str, value: object, known: Sequence[str]) -> None:
    if not isinstance(value, str) or value not in known:
        raise ProblemError(f"tube.{key}: {unknown_name('value', value, known)}")


def narrowed_tube(tube: Tube, by: FloatArray, by_angle: FloatArray) -> Tube:
    """Return a tube whose every tool position is inside another tube by some distances.

    Args:
        tube: The other tube.
        by: Subtracted from radii, and from boxes at every side, shape (m,) [m].
        by_angle: Subtracted from rotation tolerances, shape (m,) [rad].

    Raises:
        ProblemError: A radius or a tolerance would not stay positive.
    """
    tolerance, sections = tube.rotation_tolerance, tube.cross_section
    if tolerance is not None:
        bounds: list[RotationBound] = []
        for bound, angle in zip(tolerance, by_angle.tolist(), strict=False):
            if isinstance(bound, int | float):
                bounds.append(bound - angle)
            else:
                x, y, z = bound
                bounds.append((x - angle, y - angle, z - angle))
        tolerance = tuple(bounds)
    if sections is None:
        return replace(tube, radius=tube.radius - by, rotation_tolerance=tolerance)
    reduction = np.zeros_like(sections)
    reduction[:, :2] = 2 * by[:, None]
    sections = np.where(tube.is_box[:, None], sections - reduction, sections)
    sides = sections[:, :2].min(axis=1)
    radius = np.where(tube.is_box, sides / 2, tube.radius - by)
    return replace(tube, radius=radius, rotation_tolerance=tolerance, cross_section=sections)


# ---- Joined segments: on one line, with the same conditions.
#
# A point between joined segments has no condition, so that a tube is the same however its straight
# parts are divided. Visited one after the other, the segments would require more: the tool would
# have to come near every point between them.

_ON_LINE = 1e-9  # [m], [rad]
_HALF_TURN = np.pi - 1e-6  # [rad]: beyond it the short way round would be another


def joined_segments(tube: Tube) -> Tube:
    """Return a tube with its segments joined where possible; the same tube if none are.

    Points keep their numbers, and `Tube.parts` is the original tube.
    """
    if tube.pass_through_points == "all":
        return tube
    firsts = [0]
    for k in range(1, tube.segment_count):
        if not _are_one(tube, firsts[-1], k):
            firsts.append(k)
    if len(firsts) == tube.segment_count:
        return tube
    points = [*firsts, tube.segment_count]
    joined = tube.with_points(points, firsts)
    vars(joined).update(parts=tube, part_points=np.array(points))
    return joined


def _are_one(tube: Tube, first: int, last: int) -> bool:
    """Return True if a segment can be joined with the joinable segments from `first` on.

    They are on one line, and turn at the same rate about the same axis.
    """
    if tube.radius[last] != tube.radius[first] or tube.conditions[last] != tube.conditions[first]:
        return False
    points = tube.points[first : last + 2]
    axis = points[-1] - points[0]
    square = float(axis @ axis)
    if square <= _ON_LINE**2:
        return False
    fractions = (points - points[0]) @ axis / square
    off = np.linalg.norm(points - points[0] - fractions[:, None] * axis, axis=1)
    # A point may be off the line, or behind its predecessor.
    if not (off.max() <= _ON_LINE and (np.diff(fractions) > 0).all()):
        return False
    rotation = tube.rotation
    if rotation is None:
        return True
    part = slice(first, last + 1)
    if np.linalg.norm(rotation.rotation_change[part], axis=1).sum() >= _HALF_TURN:
        return False
    end = rotation.begin[last] @ rotation_matrix(rotation.rotation_change[last])
    whole = rotation_vector(rotation.begin[first].T @ end)
    even = rotation.begin[first] @ rotation_matrix(fractions[:-1, None] * whole)
    off = rotation_vector(even.transpose(0, 2, 1) @ rotation.begin[part])
    return bool(np.linalg.norm(off, axis=1).max() <= _ON_LINE)
