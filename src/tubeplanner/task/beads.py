"""Tubes of beads: from drawings and files of points, with approach, moves between, and retract."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import require_between
from tubeplanner.errors import OptionError, ProblemError, shown
from tubeplanner.geometry.solids import placement_of
from tubeplanner.orientation import matrix_of_quaternion, quaternion_of_matrix
from tubeplanner.task.drawings import BEAD, FREE, Drawing, Way, read_dxf
from tubeplanner.task.gcode import read_gcode
from tubeplanner.task.side_files import read_points

GCODE_ENDINGS: Final = (".gcode", ".nc", ".ngc")
DRAWING_ENDINGS: Final = (*GCODE_ENDINGS, ".dxf", ".csv")
_SAGITTA = 0.1  # of the radius of beads
_SAME = 1e-6  # [m]: nearer points are one
_ALONG = 0.999  # cosine from which on a way is along the tool's axis
_MAX_TOLERANCE = 0.9
_RAMP = 1.0  # [m/s^2]: change of speed along a bead
_DIGITS = 9
# The tool's z axis points into the drawing's plane.
_DOWN = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, eq=False)
class BeadOptions:
    """How beads of a drawing become a tube.

    Attributes:
        radius: Of beads, and of ways along the tool's axis [m].
        free_radius: Of other ways, at most [m]; they stay above the beads.
        speed: Along beads [m/s]; None: as the drawing has it.
        tolerance: Fraction of the speed by which the tool may be slower along beads; 0: any.
        lift: Length of approach and retract, and height of ways between beads [m].
        tilt: Bounds on the rotation about the tool's x and y axes [rad]; that about z is free.
        run_in: Length of the way before and after each bead at its speed [m].
        frame: Pose of the drawing in the base frame, shape (4, 4).
    """

    radius: float = 0.001
    free_radius: float = 0.01
    speed: float | None = None
    tolerance: float = 0.05
    lift: float = 0.02
    tilt: float = 0.1
    run_in: float = 0.0
    frame: FloatArray = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        require_between(self, 0, np.inf, "radius", "free_radius", "lift", unit="m")
        require_between(self, 0, np.pi, "tilt", unit="rad")
        if self.speed is not None:
            require_between(self, 0, np.inf, "speed", unit="m/s")
        for name, most in (("tolerance", _MAX_TOLERANCE), ("run_in", np.inf)):
            if not 0 <= getattr(self, name) <= most:
                bounds = ">= 0" if np.isinf(most) else f"from 0 to {most:g}"
                raise OptionError(f"{name} is {getattr(self, name):g}; it must be {bounds}")


def frame_of(text: str) -> FloatArray:
    """Return the pose (4, 4) of numbers with commas: x, y, z, then rpy or a quaternion x y z w."""
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6, 7):
        raise OptionError(
            f"--frame {shown(text)} must be X,Y,Z [m], then ROLL,PITCH,YAW [rad] or a quaternion "
            "QX,QY,QZ,QW or neither: 3, 6 or 7 numbers"
        )
    position, rest = numbers[:3], numbers[3:]
    try:
        return placement_of(
            position, rest if len(rest) == 3 else None, rest if len(rest) == 4 else None
        )
    except ProblemError as error:
        raise OptionError(f"--frame: {error}") from None


def read_drawing(path: Path, options: BeadOptions, layers: Sequence[str] = ()) -> Drawing:
    """Read the ways of a G-code, DXF or CSV file, by its ending; layers are those of DXF.

    Raises:
        ProblemError: The file cannot be read; file, line or entity are named.
    """
    ending, sagitta = path.suffix.lower(), _SAGITTA * options.radius
    if ending == ".dxf":
        return read_dxf(path, sagitta, options.speed, layers)
    if ending in GCODE_ENDINGS:
        return read_gcode(path, sagitta, options.speed)
    file = read_points(path)
    turned = file.orientations
    matrices = None if turned is None else matrix_of_quaternion(np.array(turned))
    radius = None if file.radius is None else np.array(file.radius)
    way = Way(np.array(file.points), BEAD, options.speed, matrices, radius)
    return Drawing((way,), ())


# ---- The tube of a drawing.


class _Segment(NamedTuple):
    """A segment of the tube, in the drawing's frame."""

    end: FloatArray  # its last point, shape (3,) [m]
    rotation: FloatArray  # of the tool there, shape (3, 3)
    kind: str
    radius: float | None = None  # [m]; None: that of the options
    # Least and largest speed [m/s], None where there is none.
    least: float | None = None
    largest: float | None = None


def bead_fields(drawing: Drawing, options: BeadOptions) -> tuple[dict[str, Any], list[str]]:
    """Return the fields of a problem's tube and start, and notes.

    The tube begins and ends with a segment without a band: along the tool's axis, unless the
    drawing has one.
    """
    begin, segments = _lifted(drawing.ways, options)
    segments, notes = _with_ramps(begin.end, segments)
    rows = [begin, *segments]
    points = np.array([row.end for row in rows])
    turn, shift = options.frame[:3, :3], options.frame[:3, 3]
    rotations = turn @ np.array([row.rotation for row in rows])
    orientations = quaternion_of_matrix(rotations).round(_DIGITS) + 0.0
    radii = _radii(points, segments, options)
    points = (points @ turn.T + shift).round(_DIGITS) + 0.0
    speeds = [_speed_field(row, options.tolerance) for row in segments]
    tube: dict[str, Any] = {
        "points": points.tolist(),
        "radius": radii,
        "orientations": orientations.tolist(),
        "rotation_tolerance": [[options.tilt, options.tilt, np.inf]],
    }
    if any(speed is not None for speed in speeds):
        tube["tool_speed"] = speeds
    else:
        notes.append("beads have no speed; --speed gives them one")
    if options.run_in and any(row.least is not None for row in segments):
        tube["process"] = {"run_in": options.run_in, "run_out": options.run_in}
    pose = {"position": points[0].tolist(), "quaternion": orientations[0].tolist()}
    return {"tube": tube, "start": {"pose": pose}}, [*drawing.notes, *notes]


def _lifted(ways: Sequence[Way], options: BeadOptions) -> tuple[_Segment, list[_Segment]]:
    """Return the first point and the segments of ways, with the moves between them."""
    corners: list[_Segment] = []

    def go(point: FloatArray, rotation: FloatArray, kind: str = FREE, **values: Any) -> None:
        if not corners or np.linalg.norm(point - corners[-1].end) > _SAME:
            corners.append(_Segment(point, rotation, kind, **values))

    def above(point: FloatArray, rotation: FloatArray) -> FloatArray:
        lifted: FloatArray = point - options.lift * rotation[:, 2]
        return lifted

    for way in ways:
        count = len(way.points)
        rotations = np.tile(_DOWN, (count, 1, 1)) if way.orientations is None else way.orientations
        first, turned = way.points[0], rotations[0]
        is_away = not corners or np.linalg.norm(first - corners[-1].end) > _SAME
        if corners and is_away:
            last = corners[-1]
            go(above(last.end, last.rotation), last.rotation)
        if is_away and (corners or way.kind == BEAD):
            go(above(first, turned), turned)
        go(first, turned)
        least = None
        if way.speed is not None and way.kind == BEAD and options.tolerance:
            least = way.speed * (1 - options.tolerance)
        for k in range(1, count):
            go(
                way.points[k],
                rotations[k],
                way.kind,
                radius=None if way.radius is None else float(way.radius[k - 1]),
                least=least,
                largest=way.speed,
            )
    last = corners[-1]
    if last.kind == BEAD:
        go(above(last.end, last.rotation), last.rotation)
    return corners[0], corners[1:]


def _with_ramps(
    begin: FloatArray, segments: Sequence[_Segment]
) -> tuple[list[_Segment], list[str]]:
    """Return segments whose speeds have one in common with those of the next, and a note.

    Where they have none, a part of one segment, beside the other, has the speeds of both. A plunge
    gives this part, or else the later segment.
    """
    result: list[_Segment] = []
    ramps = 0
    for row in segments:
        result.append(row)
        if len(result) < 2:
            continue
        before, here = result[-2], result[-2:]
        low, high = max(each.least or 0.0 for each in here), [each.largest for each in here]
        if None in high or low <= (least_high := min(each or 0.0 for each in high)):
            continue
        ramps += 1
        is_before = before.least is None
        given = before if is_before else row
        both = given._replace(largest=max(each or 0.0 for each in high))
        if given.least is not None and before.least is not None and row.least is not None:
            both = both._replace(least=min(before.least, row.least))
        start = (result[-3].end if len(result) > 2 else begin) if is_before else before.end
        way = given.end - start
        length = float(np.linalg.norm(way))
        ramp = (max(each or 0.0 for each in high) ** 2 - least_high**2) / (2 * _RAMP)
        parts = [both]
        if 2 * ramp < length and is_before:
            parts = [given._replace(end=given.end - ramp / length * way), both]
        elif 2 * ramp < length:
            parts = [both._replace(end=start + ramp / length * way), given]
        result[-2:] = [*parts, row] if is_before else [before, *parts]
    note = (
        f"speeds change at {ramps} points, beside each of which a segment has the speeds of both: "
        f"long enough for a change at {_RAMP:g} m/s^2"
    )
    return result, [note] * bool(ramps)


def _radii(points: FloatArray, segments: Sequence[_Segment], options: BeadOptions) -> list[float]:
    """Return the radii of segments between points (m+1, 3) in the drawing's frame [m]."""
    beads = [k for k, row in enumerate(segments) if row.kind == BEAD]
    top = max(points[[*beads, *(k + 1 for k in beads)], 2])
    radii = []
    for k, row in enumerate(segments):
        way = points[k + 1] - points[k]
        is_along = abs(way @ row.rotation[:, 2]) >= _ALONG * np.linalg.norm(way)
        height = min(points[k : k + 2, 2]) - top - options.radius
        wide = max(min(options.free_radius, float(height)), options.radius)
        radii.append(row.radius or (wide if row.kind == FREE and not is_along else options.radius))
    return [round(radius, _DIGITS) for radius in radii]


def _speed_field(row: _Segment, tolerance: float) -> Any:
    if row.least is None or row.largest is None:
        return row.largest
    if row.least == row.largest * (1 - tolerance):
        return {"speed": row.largest, "tolerance": tolerance}
    return {"between": [row.least, row.largest]}
