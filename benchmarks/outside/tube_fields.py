"""A problem's tube as the outside judge reads it: points, radii or boxes, ranges and bounds.

A point that repeats the one before is left out with the segment to it. Segments on one line that
ask the same are one. A point where the tube turns back must be passed.
"""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from outside.files import BadInput, require_known

TUBE = {"points", "radius", "tool_radius", "joint_signs", "orientations", "rotation_tolerance"}
OF_TOOL = ("tool_speed", "tool_acceleration")  # [m/s], [m/s^2]
TUBE |= {*OF_TOOL, "visit", "pass_through_points", "cross_section", "process"}
TUBE |= {"events"}  # marks of instants, no condition
PROCESS = {"run_in", "run_out", "steady", "lead_on", "lead_off"}
SIGNS = {"+": (0.0, math.inf), "-": (-math.inf, 0.0), "0": (-math.inf, math.inf)}
SIGNS_BY_NUMBER = {1: "+", -1: "-", 0: "0"}
REPEATED = 1e-6  # [m]
ON_LINE = 1e-9  # [m] and [rad]
SAME_ROTATION = 1e-6  # [rad]
BACK = math.cos(math.radians(150.0))
NEAR_FRACTION = 0.1  # of the radius: points that near are skipped when a turn is measured
RULES = ("all", "corners", "none")
Section = tuple[float, ...]  # width, height [m], and the upward direction
PARALLEL = 1e-6  # sine of the least angle between a segment and what is upward there
NO_LENGTH = 1e-6  # [m]: a segment as short is left out
POSITION, QUATERNION, RADIUS = ["x", "y", "z"], ["qx", "qy", "qz", "qw"], ["radius"]
UNNAMED = {
    3: POSITION,
    4: POSITION + RADIUS,
    7: POSITION + QUATERNION,
    8: POSITION + QUATERNION + RADIUS,
}


@dataclass(frozen=True, eq=False)
class TubeFields:
    """What a problem asks of the tool between start and goal.

    Attributes:
        points: Reference points, base frame, shape (m+1, 3) [m].
        radius: What the tool centre point may be off each segment, shape (m,) [m]; in a box, half
            of the smaller side.
        ranges: Per segment: joint name to (lower, upper) [rad or m].
        orientations: At the points, quaternions x y z w, shape (m+1, 4), or None.
        bounds: On the components and the length of log(R_ref^T R), shape (m, 4) [rad], or None.
        speed: What the tool's speed must not exceed in each segment, infinite where it is free:
            shape (m,) [m/s]. The robot's own limit is not in it.
        clearance: Of links from obstacles in each segment, shape (m,) [m].
        is_ordered: Whether segments are visited one after the other.
        passing: Indices of inner points that must be passed within the smaller radius beside them.
        numbers: What the file calls the points: those on straight lines and repeated ones are left
            out.
        sections: Width and height [m] and what is upward, None for a disc, for each segment; None:
            discs alone.
        tool_radius: What is taken off the radii, and to be taken off the boxes [m].
        acceleration: As `speed`, of the tool's acceleration [m/s^2], or None.
        floor: What the tool's speed must not be below in each segment, zero where it is free:
            shape (m,) [m/s], or None.
    """

    points: np.ndarray
    radius: np.ndarray
    ranges: list[dict[str, tuple[float, float]]]
    orientations: np.ndarray | None
    bounds: np.ndarray | None
    speed: np.ndarray
    clearance: np.ndarray
    is_ordered: bool
    passing: list[int]
    numbers: list[int]
    sections: list[Section | None] | None = None
    tool_radius: float = 0.0
    acceleration: np.ndarray | None = None
    floor: np.ndarray | None = None

    def some(self, kept: list[int]) -> "TubeFields":
        """Return the tube with some of its points; each segment is the one that ends there."""
        # Of segments that are one, any will do; of a repeated point, the segment to it goes.
        segments = [k - 1 for k in kept[1:]]
        return TubeFields(
            self.points[kept],
            self.radius[segments],
            [self.ranges[k] for k in segments],
            None if self.orientations is None else self.orientations[kept],
            None if self.bounds is None else self.bounds[segments],
            self.speed[segments],
            self.clearance[segments],
            self.is_ordered,
            [],
            [self.numbers[k] for k in kept],
            None if self.sections is None else [self.sections[k] for k in segments],
            self.tool_radius,
            None if self.acceleration is None else self.acceleration[segments],
            None if self.floor is None else self.floor[segments],
        )

    def gates(self, position: np.ndarray) -> np.ndarray:
        """Return how far positions (N, 3) are where each segment may be entered, (N, m) [m].

        The first segment of a stretch with floors is entered behind the plane through its first
        point, the segment after it beyond the plane through its last one; infinite elsewhere.
        """
        margin = np.full((len(position), len(self.radius)), math.inf)
        for first, last in _stretches(self.floor):
            for point, segment, sign in ((first, first, -1), (last + 1, last, 1)):
                if 0 < point < len(self.radius):
                    along = self.points[segment + 1] - self.points[segment]
                    out = sign * along / np.linalg.norm(along)
                    margin[:, point] = (position - self.points[point]) @ out
        return margin

    def same(self, one: int, other: int) -> bool:
        """Return whether two segments ask the same."""
        bounds = self.bounds
        return bool(
            self.radius[one] == self.radius[other]
            and (self.sections is None or self.sections[one] == self.sections[other])
            and self.ranges[one] == self.ranges[other]
            and self.speed[one] == self.speed[other]
            and (self.acceleration is None or self.acceleration[one] == self.acceleration[other])
            and (self.floor is None or self.floor[one] == self.floor[other])
            and self.clearance[one] == self.clearance[other]
            and (bounds is None or (bounds[one] == bounds[other]).all())
        )


def with_points(fields: Any, folder: Path) -> Any:
    """Return a tube's fields with those of its file of points, if it names one."""
    if not isinstance(fields.get("points"), str):
        return fields
    read = read_points(folder / fields["points"])
    if twice := [key for key in read if key != "points" and fields.get(key) is not None]:
        raise BadInput(f"tube.{twice[0]} is given twice: here and in {fields['points']}")
    return fields | read


def bounds_of(tolerance: Any, count: int) -> np.ndarray:
    """Return what `rotation_tolerance` bounds in so many segments, as `TubeFields.bounds`."""
    entries = tolerance if isinstance(tolerance, list) else [tolerance] * count
    if count != 3 and len(entries) == 3 and not any(isinstance(entry, list) for entry in entries):
        entries = [entries]  # one triple for all; of three segments, each has its angle
    if len(entries) == 1 and isinstance(entries[0], list):
        entries = entries * count
    if len(entries) != count:
        raise BadInput(f"tube.rotation_tolerance has {len(entries)} entries for {count} segments")
    bounds = np.full((count, 4), math.inf)
    for row, entry in zip(bounds, entries, strict=True):
        if isinstance(entry, list):
            row[:3] = entry
        else:
            row[3] = entry
    return bounds


def limit_of(value: Any, name: str) -> float:
    """Return a limit on the tool's speed or acceleration, infinite if there is none.

    Raises:
        BadInput: It is no positive number.
    """
    if value is None:
        return math.inf
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise BadInput(f"{name} is {value}")
    return float(value)


def distinct(
    points: np.ndarray, same: Callable[[int, int], bool], orientations: np.ndarray | None
) -> list[int]:
    """Return which points are apart from the one before.

    Args:
        points: Shape (m+1, 3) [m].
        same: Whether two segments ask the same.
        orientations: Quaternions at the points, if the rotation is bounded.

    Raises:
        BadInput: A segment of no length asks what none beside it does.
    """
    kept = [0]
    for k in range(1, len(points)):
        if math.dist(points[k], points[kept[-1]]) >= REPEATED:
            kept.append(k)
    if len(kept) < 2:
        raise BadInput("tube.points are all the same")
    for k in set(range(len(points))) - set(kept):
        before = [p - 1 for p in kept[1:] if p < k][-1:]
        after = [p - 1 for p in kept[1:] if p > k][:1]
        if not any(same(k - 1, other) for other in before + after):
            raise BadInput(f"tube.points: segment {k - 1} has no length and asks for more")
        if orientations is not None:
            one, other = Rotation.from_quat(orientations[k - 1 : k + 1])
            if (one.inv() * other).magnitude() > SAME_ROTATION:
                raise BadInput(f"tube.orientations turn in segment {k - 1}, which has no length")
    return kept


def joined(
    points: np.ndarray, same: Callable[[int, int], bool], orientations: np.ndarray | None
) -> list[int]:
    """Return which points are left when segments on one line that ask the same are one."""
    kept = [0]
    for k in range(1, len(points) - 1):
        line = range(kept[-1], k + 2)
        if not same(k - 1, k) or not _is_line(points, line, orientations):
            kept.append(k)
    return [*kept, len(points) - 1]


def passing(points: np.ndarray, radius: np.ndarray, rule: Any) -> list[int]:
    """Return which inner points must be passed within the smaller radius beside them."""
    if rule not in RULES:
        raise BadInput(f"tube.pass_through_points {rule} is not known here")
    inner = range(1, len(points) - 1)
    if rule != "corners":
        return list(inner) if rule == "all" else []
    corners: list[int] = []
    last = 0
    for k in inner:
        near = NEAR_FRACTION * min(radius[k - 1 : k + 1])
        if _straightness(points, k, near) >= BACK:
            continue
        if last == k - 1 and corners and math.dist(points[k - 1], points[k]) <= near:
            # A corner that is divided is one, where it is sharpest.
            if _straightness(points, k, 0.0) < _straightness(points, corners[-1], 0.0):
                corners[-1] = k
        else:
            corners.append(k)
        last = k
    return corners


def read_sections(given: Any, count: int) -> list[Section | None]:
    """Return width and height [m] and the upward direction of each segment, None for a disc.

    Args:
        given: As the file has it: one map for all segments, or one or null for each.
        count: Of segments.
    """
    entries = given if isinstance(given, list) else [given] * count
    if len(entries) != count:
        raise BadInput(f"tube.cross_section has {len(entries)} entries for {count} segments")
    return [None if entry is None else _section(entry) for entry in entries]


def radii(given: Any, sections: list[Section | None]) -> np.ndarray:
    """Return the radii (m,) [m]: half of the smaller side where there is a box."""
    entries = given if isinstance(given, list) else [given] * len(sections)
    if len(entries) != len(sections):
        raise BadInput(f"tube.radius has {len(entries)} values for {len(sections)} segments")
    found = []
    for k, (radius, section) in enumerate(zip(entries, sections, strict=True)):
        if section is not None:
            half = min(section[:2]) / 2
            if isinstance(given, list) and radius is not None and abs(radius - half) > 1e-12:
                raise BadInput(f"tube.radius: segment {k} has a box")
            found.append(half)
        elif radius is None:
            raise BadInput(f"tube.radius: segment {k} has neither a radius nor a box")
        else:
            found.append(float(radius))
    return np.array(found)


def box_margin(
    begin: np.ndarray, end: np.ndarray, section: Section, off: float, position: np.ndarray
) -> np.ndarray:
    """Return how far positions (N, 3) are behind the nearest of six faces, shape (N,) [m].

    Args:
        begin: Where the segment begins, shape (3,) [m].
        end: Where it ends.
        section: From `read_sections`.
        off: The tool's radius: all faces are moved inwards by it [m].
        position: Of the tool centre point.
    """
    width, height, *up = section
    beyond = min(width, height) / 2
    length = float(np.linalg.norm(end - begin))
    along = (end - begin) / length if length >= NO_LENGTH else np.zeros(3)
    upward = np.cross(np.cross(along, up), along) if length >= NO_LENGTH else np.array(up)
    if np.linalg.norm(upward) <= PARALLEL * np.linalg.norm(up):
        raise BadInput("tube.cross_section: up is parallel to its segment")
    upward = upward / np.linalg.norm(upward)
    across = np.cross(along, upward)
    walls = [(begin + side * width / 2 * across, side * across) for side in (-1, 1)]
    walls += [(begin + side * height / 2 * upward, side * upward) for side in (-1, 1)]
    walls += [(begin - beyond * along, -along), (end + beyond * along, along)]
    margins: np.ndarray = np.min([(on - position) @ normal for on, normal in walls], axis=0) - off
    return margins


def read_points(path: Path) -> dict[str, Any]:
    """Return the fields of a tube that a file of points has.

    The radius in a line is that of the segment that begins there; the last one says nothing.

    Raises:
        BadInput: It cannot be read.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            cells = csv.reader(file, skipinitialspace=True)
            rows = [r for r in cells if any(c.strip() for c in r) and not r[0].startswith("#")]
        names = _column_names(rows)
        body = rows[1:] if _is_named(rows) else rows
        columns = dict(zip(names, zip(*body, strict=True), strict=True))
        fields: dict[str, Any] = {"points": _table(columns, POSITION)}
        if "qx" in columns:
            fields["orientations"] = _table(columns, QUATERNION)
        if "radius" in columns:
            *radius, last = columns["radius"]
            fields["radius"] = [float(cell) for cell in radius]
            if last.strip() and float(last) != fields["radius"][-1]:
                raise BadInput(f"{path}: the last radius belongs to no segment")
    except (OSError, ValueError, KeyError, IndexError, csv.Error) as error:
        raise BadInput(f"{path} cannot be read: {error}") from error
    return fields


def tube_of(fields: Any, clearance: np.ndarray) -> TubeFields:
    """Return the tube of a problem's section `tube`, with the clearance of each segment [m].

    Raises:
        BadInput: A field is not known here, or is not what it must be.
    """
    require_known(fields, TUBE, "tube.")
    points = np.array(fields["points"], dtype=float)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
        raise BadInput("tube.points must be two or more positions")
    count = len(points) - 1
    sections = read_sections(fields.get("cross_section"), count)
    radius = radii(fields.get("radius"), sections)
    tool_radius = float(fields.get("tool_radius", 0.0))
    signs = fields.get("joint_signs") or {}
    maps = [signs] * count if isinstance(signs, dict) else signs
    if len(maps) != count:
        raise BadInput(f"tube.joint_signs has {len(maps)} maps for {count} segments")
    visit = fields.get("visit", "ordered")
    if visit not in ("ordered", "any"):
        raise BadInput(f"tube.visit {visit} is not known here")
    orientations = fields.get("orientations")
    if orientations is not None and np.shape(orientations) != (count + 1, 4):
        raise BadInput("tube.orientations must be one quaternion per point")
    tolerance = fields.get("rotation_tolerance")
    floor, speed = _bands(fields.get("tool_speed"), count)
    tube = TubeFields(
        points,
        radius - tool_radius,
        [{name: _range(sign) for name, sign in (row or {}).items()} for row in maps],
        None if orientations is None else np.array(orientations, dtype=float),
        None if tolerance is None else bounds_of(tolerance, count),
        speed,
        clearance,
        visit == "ordered",
        [],
        list(range(count + 1)),
        sections,
        tool_radius,
        _limits(fields, "tool_acceleration", count),
        floor if floor.any() else None,
    )
    process = fields.get("process") or {}
    require_known(process, PROCESS, "tube.process.")
    tube = _with_ways(tube, process)
    if process.get("steady", "required") != "required":
        tube = replace(tube, floor=None)
    return _reduced(tube, fields.get("pass_through_points", "corners"))


def _reduced(tube: TubeFields, rule: Any) -> TubeFields:
    """Return what of a tube counts, with the points that must be passed."""

    def turned() -> np.ndarray | None:
        is_free = tube.bounds is None or not np.isfinite(tube.bounds).any()
        return None if is_free else tube.orientations

    tube = tube.some(distinct(tube.points, tube.same, turned()))
    if rule != "all":
        tube = tube.some(joined(tube.points, tube.same, turned()))
    return replace(tube, passing=passing(tube.points, tube.radius, rule))


def _range(sign: Any) -> tuple[float, float]:
    if isinstance(sign, list):
        lower, upper = sign
        return float(lower), float(upper)
    return SIGNS[SIGNS_BY_NUMBER.get(sign, sign)]


def _limits(fields: Any, name: str, count: int) -> np.ndarray:
    given = fields.get(name)
    entries = given if isinstance(given, list) else [given] * count
    if len(entries) != count:
        raise BadInput(f"tube.{name} has {len(entries)} entries for {count} segments")
    return np.array([limit_of(value, f"tube.{name}") for value in entries])


def _bands(given: Any, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the least speeds, zero where there is none, and the largest ones, (m,) each [m/s]."""
    entries = given if isinstance(given, list) else [given] * count
    floors, tops = [0.0] * len(entries), list(entries)
    for k, entry in enumerate(entries):
        if not isinstance(entry, dict):
            continue
        if set(entry) == {"between"}:
            floors[k], tops[k] = (float(end) for end in entry["between"])
        elif set(entry) == {"speed", "tolerance"}:
            tops[k] = float(entry["speed"])
            floors[k] = tops[k] * (1 - float(entry["tolerance"]))
        else:
            raise BadInput("tube.tool_speed: a band has speed and tolerance, or between")
        if not 0 < floors[k] < tops[k]:
            raise BadInput(f"tube.tool_speed: a band from {floors[k]:g} to {tops[k]:g} m/s")
    return np.array(floors), _limits({"tool_speed": tops}, "tool_speed", count)


def _stretches(floor: np.ndarray | None) -> list[tuple[int, int]]:
    """Return the first and the last segment of each run of segments with a floor."""
    banded = [] if floor is None else np.flatnonzero(floor > 0).tolist()
    firsts = [k for k in banded if k - 1 not in banded]
    return list(zip(firsts, [k for k in banded if k + 1 not in banded], strict=True))


def _with_ways(tube: TubeFields, process: dict[str, Any]) -> TubeFields:
    """Return a tube with a straight way before and after each stretch, as wide as the stretch."""
    run_in, run_out = (float(process.get(name, 0.0)) for name in ("run_in", "run_out"))
    places = []  # index of the point before which it comes, position, orientation's point, region
    for first, last in _stretches(tube.floor):
        begin, end = (tube.points[k + 1] - tube.points[k] for k in (first, last))
        if run_in:
            there = tube.points[first] - run_in * begin / np.linalg.norm(begin)
            places.append((first, 1, there, first, first))
        if run_out:
            there = tube.points[last + 1] + run_out * end / np.linalg.norm(end)
            places.append((last + 2, 0, there, last + 1, last))
    for at, is_before, there, point, region in sorted(places, key=lambda p: p[:2], reverse=True):
        # The way is the segment after the new point, or before it; the neighbour is cut in two.
        rows = [*range(at), point, *range(at, len(tube.points))]
        beside = at - 1
        segments = [*range(beside), beside, beside, *range(beside + 1, len(tube.radius))]
        own = list(segments)
        own[beside + 1 if is_before else beside] = region
        points = tube.points[rows]
        points[at] = there
        tube = TubeFields(
            points,
            tube.radius[own],
            [tube.ranges[k] for k in segments],
            None if tube.orientations is None else tube.orientations[rows],
            None if tube.bounds is None else tube.bounds[segments],
            tube.speed[segments],
            tube.clearance[segments],
            tube.is_ordered,
            [],
            [tube.numbers[k] for k in rows],
            None if tube.sections is None else [tube.sections[k] for k in own],
            tube.tool_radius,
            None if tube.acceleration is None else tube.acceleration[segments],
            None if tube.floor is None else tube.floor[segments],
        )
    return tube


def _straightness(points: np.ndarray, k: int, near: float) -> float:
    """Return the cosine of the turn at a point, measured to points that are not near."""
    before = _towards(points[k] - points[:k][::-1], near)
    after = _towards(points[k + 1 :] - points[k], near)
    return float(before @ after)


def _towards(ways: np.ndarray, near: float) -> np.ndarray:
    """Return the direction of the first way (P, 3) that is longer than a length, or the last."""
    lengths = np.linalg.norm(ways, axis=1)
    far = np.flatnonzero(lengths > near)
    there = np.flatnonzero(lengths > 0)
    one = far[0] if len(far) else there[-1]
    direction: np.ndarray = ways[one] / lengths[one]
    return direction


def _is_line(points: np.ndarray, line: range, orientations: np.ndarray | None) -> bool:
    """Return whether points go straight on, and orientations evenly, from the first to the last."""
    first, last = points[line[0]], points[line[-1]]
    length = math.dist(first, last)
    if length <= ON_LINE:
        return False
    along = (last - first) / length
    ways = points[list(line)] - first
    travel = ways @ along
    if np.linalg.norm(ways - travel[:, None] * along, axis=1).max() > ON_LINE:
        return False
    if (np.diff(travel) <= 0).any():
        return False
    if orientations is None:
        return True
    turned = Rotation.from_quat(orientations[list(line)])
    steps = (turned[:-1].inv() * turned[1:]).magnitude()
    if steps.sum() >= math.pi - SAME_ROTATION:
        return False
    turn = (turned[0].inv() * turned[-1]).as_rotvec()
    even = turned[0] * Rotation.from_rotvec(travel[:, None] / length * turn)
    return bool((even.inv() * turned).magnitude().max() <= ON_LINE)


def _section(entry: Any) -> Section:
    if not isinstance(entry, dict) or set(entry) != {"box", "up"}:
        raise BadInput("tube.cross_section: an entry has box and up, and no more")
    width, height = (float(side) for side in entry["box"])
    x, y, z = (float(value) for value in entry["up"])
    if not (width > 0 and height > 0):
        raise BadInput("tube.cross_section.box must be two lengths")
    return width, height, x, y, z


def _is_named(rows: list[list[str]]) -> bool:
    try:
        float(rows[0][0])
    except ValueError:
        return True
    return False


def _column_names(rows: list[list[str]]) -> list[str]:
    if not _is_named(rows):
        return UNNAMED[len(rows[0])]
    names = [cell.strip() for cell in rows[0]]
    if unknown := set(names) - set(UNNAMED[8]):
        raise ValueError(f"column {unknown.pop()} is not known here")
    return names


def _table(columns: dict[str, Any], names: list[str]) -> list[list[float]]:
    return [[float(cell) for cell in row] for row in zip(*(columns[n] for n in names), strict=True)]
