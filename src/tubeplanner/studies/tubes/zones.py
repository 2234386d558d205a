"""Corner zones of robot controllers to tubes and back.

A controller leaves the line before corner R at a point A, at most the zone z away from R, blends,
and is on the next line again at a point B, at most z behind R. Between them it stays in the
triangle A R B, whatever its rule: a parabola and an arc tangent to both lines do, and so does a
weighted mean of both trajectories.

From zone to tube. Off the lines the tool may be anywhere in the ball of radius z about R, and only
there. Capsules of radius z - c about the pieces of length c on both sides of R reach exactly z far:
they stay in the ball and touch it, whatever the angle of the corner. Up to c = z/2 they hold every
blend: the ball on the diameter A R also holds the midpoint of A B, the angle there being right
(Thales). The shorter the pieces, the wider the corner, up to the whole ball; c = z/4 leaves pieces
that a planner can work with. Between the pieces, the tube is as wide as the lines are accurate.

From tube to zone. In coordinates R - a u + b w along both lines, blends up to z are the points with
g(a, b) <= z: a + b in the triangle, (sqrt(a) + sqrt(b))^2 under the parabola. The largest zone is
the least g where a ray from R leaves the capsules of both lines. For one radius r on both lines and
a turn by the angle t it is 2 r / sin(t) in the triangle, 4 r / sin(t) under the parabola.

The assumptions about each controller, and their sources: `CONTROLLERS`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import ProblemError, unknown_name
from tubeplanner.geometry.tube.points import JointSign, passing_radius
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.text import short_repr

Zone: TypeAlias = str | float

_PIECE = 0.25  # length of the pieces beside a corner, as a fraction of its zone
_STRAIGHT = 1e-6  # [rad]: a reference point with a smaller turn is no corner
_DIRECTIONS, _ZOOMS = 101, 4  # of rays from a corner, and how often the best are refined
_STEPS, _TOUCHING = 400, 1e-9  # of a march along a ray, and [m] from the tube's wall
_ROUNDING = 1e-9  # [m]
_SLACK = 1e-7  # [m]: marches end before the wall; a zone that just fits is not lost
_APART = 1e-6  # [m]: kept between a zone and the middle of a line where zones may not meet


@dataclass(frozen=True)
class Controller:
    """The rules by which a controller blends at corners."""

    title: str  # maker and the name of its zone
    source: str  # the assumptions, and their source
    unit: float | None  # of numbers, in metres; None where zones have names only
    half: bool  # True if a zone may not pass the middle of a line; else zones may not overlap
    # "parabola" where the maker says so, else only "triangle"
    blend: Literal["parabola", "triangle"] = "triangle"
    named: Mapping[str, float] = field(default_factory=dict)  # zones by name [m]
    prefix: str = ""  # letters before a number of millimetres
    # beginnings of names whose path the maker does not define, and the remedies
    undefined: Mapping[str, str] = field(default_factory=dict)


_ABB_SIZES = (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)
CONTROLLERS: dict[str, Controller] = {
    "abb": Controller(
        "ABB zonedata",
        "RAPID Reference Manual, zonedata: pzone_tcp is the radius of the zone; a parabola begins "
        "at its edge; at most half the distance to the next point (the robot reduces it)",
        unit=None,
        half=True,
        blend="parabola",
        named={"fine": 0.0, "z0": 0.0003, **{f"z{size}": size * 1e-3 for size in _ABB_SIZES}},
    ),
    "kuka": Controller(
        "KUKA $APO.CDIS",
        "PLC mxAutomation 1.0 manual, APO.CDIS: blending starts at this distance from the point at "
        "the earliest; users' notes on KSS 8.3: at most half of either line. No shape is stated",
        unit=1e-3,
        half=True,
    ),
    "fanuc": Controller(
        "Fanuc CR",
        "integrators' notes, no manual: CR is a distance from the corner at any speed, CNT a share "
        "of the speed; half of either line is taken as the most, to be safe. No shape is stated",
        unit=1e-3,
        half=True,
        named={"FINE": 0.0},
        prefix="CR",
        undefined={
            "CNT": "is a share of the speed and says nothing of the path; give CR, or the distance "
            "[mm] from the corner at which the path leaves the line at your speed"
        },
    ),
    "ur": Controller(
        "Universal Robots blend radius",
        "UR5 user manual 3.4, Waypoint, blend parameters: within the radius of the waypoint the "
        "robot may leave the path; blends may not overlap. The shape depends on the speeds",
        unit=1.0,
        half=False,
    ),
    "pilz": Controller(
        "Pilz blend_radius",
        "MoveIt 2, trajectory_blender_transition_window.cpp: in the ball about the point the mean "
        "of both trajectories, weighted by a quintic; command_list_manager.cpp: balls may not meet",
        unit=1.0,
        half=False,
    ),
}


@dataclass(frozen=True, eq=False)
class ZonedPath:
    """Points and zones of a controller's program.

    Attributes:
        points: Where the lines begin and end, shape (k+2, 3) [m].
        zones: One for each of the k inner points, as the controller takes it.
    """

    points: FloatArray
    zones: tuple[Zone, ...]

    __repr__ = short_repr


def tube_from_zones(
    points: Sequence[Sequence[float]] | FloatArray,
    zones: Sequence[Zone],
    controller: str,
    *,
    accuracy: float,
    joint_signs: Mapping[str, JointSign] | None = None,
) -> Tube:
    """Return the tube in which the tool leaves the lines only inside the zones.

    Args:
        points: Programmed points, shape (k+2, 3) [m].
        zones: Of the k inner points. "abb": "fine", "z0" to "z200"; "kuka": $APO.CDIS [mm];
            "fanuc": "FINE", "CR50" or 50 [mm]; "ur", "pilz": blend radius [m].
        controller: One of `CONTROLLERS`.
        accuracy: Largest distance off the lines elsewhere, and at points without a zone [m].
        joint_signs: As for `Tube`, in all segments.

    Returns:
        A tube with three reference points at every corner that has a zone z, the corner itself and
        one z/4 before and behind it. Beside the corner the radius is 3/4 z, elsewhere `accuracy`.
        Where the lines turn back by more than 150 degrees, the point is compulsory (see `Tube`):
        the tool passes it within 3/4 z, nearer than a controller might.

    Raises:
        ProblemError: A name, count or number is wrong, a zone does not fit on its lines, or the
            accuracy is coarser than a corner; the message says which.
    """
    rules = _rules(controller)
    if not accuracy > 0:
        raise ProblemError(f"accuracy is {accuracy:g} m; it must be > 0")
    corners = Tube(points, accuracy).points
    if len(zones) != len(corners) - 2:
        raise ProblemError(
            f"{len(zones)} zones for {len(corners) - 2} inner points; give one for each"
        )
    reach = [0.0, *(_reach(rules, k, zone) for k, zone in enumerate(zones, 1)), 0.0]
    _require_apart(rules, corners, reach)
    directions = _directions(corners)
    reference: list[FloatArray] = [corners[0]]
    radius: list[float] = []
    for k in range(1, len(corners)):
        size, piece = reach[k], _PIECE * reach[k]
        if size == 0:
            reference, radius = [*reference, corners[k]], [*radius, accuracy]
            continue
        if accuracy > size - piece:
            raise ProblemError(
                f"accuracy {accuracy:g} m is coarser than the corner at point {k}, "
                f"{size - piece:g} m (3/4 of its zone); choose a finer accuracy or a larger zone"
            )
        before, behind = corners[k] - piece * directions[k - 1], corners[k] + piece * directions[k]
        reference += [before, corners[k], behind]
        radius += [accuracy, size - piece, size - piece]
    return Tube(np.array(reference), radius, joint_signs=joint_signs)


def zones_of_tube(tube: Tube, controller: str) -> ZonedPath:
    """Return the largest zones with which a controller stays in the tube.

    Reference points without a turn are no points of the program. No zone passes the middle of a
    line. Only the capsules of both lines of a corner count. Points that the tool must pass are
    passed: where the tube turns back, the zone ends where the chord across it, or the parabola, is
    a radius away from the point; beside a point on a line, a radius beyond the point.

    Args:
        tube: Where the tool may be; rotation tolerances and joint signs do not matter here.
        controller: One of `CONTROLLERS`.

    Returns:
        Points and zones; a name or a multiple of 1 um (of 1 mm for Fanuc) at or below the largest.

    Raises:
        ProblemError: There is no such controller.
    """
    rules = _rules(controller)
    directions = _directions(tube.points)
    turns = np.linalg.norm(directions[1:] - directions[:-1], axis=1) > _STRAIGHT
    ends = [0, *(int(k) + 1 for k in np.flatnonzero(turns)), tube.segment_count]
    zones: list[Zone] = []
    for k in range(1, len(ends) - 1):
        first, corner, last = (tube.points[end] for end in ends[k - 1 : k + 2])
        lengths = np.linalg.norm([first - corner, last - corner], axis=1)
        available = 0.5 * float(lengths.min()) - (0.0 if rules.half else _APART)
        walls = slice(ends[k - 1], ends[k + 1])
        available = min(available, _passing(tube, walls, ends[k], rules.blend))
        size = _largest(tube, walls, ends[k], rules.blend, available) + _SLACK
        if rules.unit is None:
            named = [(reach, name) for name, reach in rules.named.items() if reach <= size]
            zones.append(max(named)[1])
        elif rules.prefix:
            zones.append(f"{rules.prefix}{math.floor(size * 1e3)}")
        else:
            zones.append(round(math.floor(size * 1e6) * 1e-6 / rules.unit, 6))
    return ZonedPath(read_only(tube.points[ends]), tuple(zones))


def _rules(controller: str) -> Controller:
    if controller not in CONTROLLERS:
        raise ProblemError(unknown_name("controller", controller, CONTROLLERS))
    return CONTROLLERS[controller]


def _reach(rules: Controller, k: int, zone: Zone) -> float:
    """Return the distance from point k to the edge of its zone [m]."""
    where = f"{rules.title} at point {k}"
    if isinstance(zone, str):
        for beginning, reason in rules.undefined.items():
            if zone.startswith(beginning):
                raise ProblemError(f"{where}: {zone} {reason}")
        number = zone.removeprefix(rules.prefix)
        if rules.prefix and zone != number and number.isdecimal():
            return int(number) * 1e-3
        if zone not in rules.named:
            names = [*rules.named, *([f"{rules.prefix}50"] if rules.prefix else [])]
            raise ProblemError(f"{where}: {unknown_name('zone', zone, names)}")
        return rules.named[zone]
    if rules.unit is None:
        raise ProblemError(f"{where}: {zone} is no name; there is: {', '.join(rules.named)}")
    if isinstance(zone, bool) or not 0 <= zone < math.inf:
        raise ProblemError(f"{where}: {zone} must be a finite number >= 0")
    return float(zone) * rules.unit


def _require_apart(rules: Controller, corners: FloatArray, reach: Sequence[float]) -> None:
    lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    for line, length in enumerate(lengths):
        ends = reach[line : line + 2]
        if rules.half and max(ends) > length / 2 + _ROUNDING:
            raise ProblemError(
                f"{rules.title} at point {line + int(np.argmax(ends))} reaches {max(ends):g} m, "
                f"beyond the middle of line {line}, which is {length:g} m long; choose "
                f"{length / 2:g} m or less"
            )
        if not rules.half and max(ends) > 0 and sum(ends) >= length - _ROUNDING:
            raise ProblemError(
                f"{rules.title}: the zones at points {line} and {line + 1} reach {ends[0]:g} and "
                f"{ends[1]:g} m and overlap on line {line}, which is {length:g} m long; make them "
                "smaller"
            )


def _directions(points: FloatArray) -> FloatArray:
    """Return the unit vectors along the lines between points (m+1, 3), shape (m, 3)."""
    directions = np.diff(points, axis=0)
    return directions / np.linalg.norm(directions, axis=1)[:, None]


def _passing(tube: Tube, walls: slice, corner: int, blend: str) -> float:
    """Return the largest zone [m] whose blends pass the compulsory points on a corner's lines.

    The chord of a zone z passes the corner at z cos(p/2), p being the angle between the lines; the
    parabola at half of that; no blend in the triangle with less to go on either side is farther
    away. Beside a point on a line, the zone ends at most a radius beyond the point.
    """
    here, passing = tube.points[corner], passing_radius(tube.effective_radius)
    most = np.inf
    for point in tube.compulsory_points:
        if not walls.start < point < walls.stop:
            continue
        radius = float(passing[point - 1])
        if point == corner:
            axes = tube.points[[walls.start, walls.stop]] - here
            axes /= np.linalg.norm(axes, axis=1)[:, None]
            fraction = np.linalg.norm(axes.sum(axis=0)) / (4 if blend == "parabola" else 2)
            most = min(most, radius / max(float(fraction), _ROUNDING))
        else:
            most = min(most, float(np.linalg.norm(tube.points[point] - here)) + radius)
    return most


def _largest(tube: Tube, walls: slice, corner: int, blend: str, available: float) -> float:
    """Return the largest zone [m] at a reference point with blends in some capsules of a tube."""
    here = tube.points[corner]
    axes = np.array([tube.points[k] - here for k in (walls.start, walls.stop)])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    low, high = 0.0, 1.0
    best = available
    for _ in range(_ZOOMS):
        fraction = np.linspace(low, high, _DIRECTIONS)
        ab = np.column_stack([1 - fraction, fraction])
        ab *= _exit_distance(tube, walls, here, ab @ axes, available)[:, None]
        root = np.sqrt(ab).sum(axis=1) ** 2
        size = root if blend == "parabola" else ab.sum(axis=1)  # g(a, b)
        least, step = int(size.argmin()), float(fraction[1] - fraction[0])
        best = min(best, float(size[least]))
        low, high = max(0.0, fraction[least] - step), min(1.0, fraction[least] + step)
    return best


def _exit_distance(
    tube: Tube, walls: slice, start: FloatArray, direction: FloatArray, most: float
) -> FloatArray:
    """Return the distances at which rays (N, 3) from a point leave a union of capsules, shape (N,).

    In units of the rays' directions and at most `most`. Every step is as long as the margin, which
    no ray can overstep: the answer is never outside.
    """
    length = np.linalg.norm(direction, axis=1)
    distance = np.zeros(len(direction))
    for _ in range(_STEPS):
        margin = tube.margin(start + distance[:, None] * direction, walls).max(axis=1)
        step = np.where(margin > _TOUCHING, margin, 0.0)
        step = np.divide(step, length, out=np.full_like(distance, most), where=length > _ROUNDING)
        distance = np.minimum(distance + step, most)
        if not (step[distance < most] > 0).any():
            break
    return distance
