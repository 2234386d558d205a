"""Speed bands: least and largest tool speeds of segments, for processes at a constant speed.

Neighbouring segments with a band are one stretch, along which the process is on. The tool enters a
stretch behind the plane through its first point, across its direction there, and leaves it beyond
the plane through its last point: at both ends it is in the stretch's own region and in the band.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import WHOLE_NUMBER, are_numbers, is_number
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.fields import Finite, declaration, declared
from tubeplanner.geometry.tube.points import SEGMENT_NUMBERS, segment_values
from tubeplanner.text import require_name

REQUIRED, BEST = STEADY = ("required", "best")
_MAX_RUN = 10.0  # [m]
_MAX_TOLERANCE = 0.9
_MAX_LEAD = 60.0  # [s]
# A neighbour is on the line of a run-in from this cosine of their angle on.
_ON_LINE = 0.99

Speeds: TypeAlias = tuple[FloatArray | None, FloatArray | None]


@dataclass(frozen=True)
class Process:
    """The process along stretches of constant speed.

    Attributes:
        run_in: Length of the straight way before each stretch in the stretch's own region [m].
        run_out: Length of the straight way after each stretch, likewise [m].
        steady: "required": the band holds for all t; "best": where the joints cannot hold it, as
            near to it as they can.
        lead_on: Time by which the mark `process_on` comes before the stretch [s].
        lead_off: Time by which the mark `process_off` comes before the end of the stretch [s].

    Raises:
        ProblemError: On construction, for a negative length or time, or an unknown word.
    """

    run_in: float = declared(
        0.0, "straight way before each stretch, in the stretch's own radius [m]", Finite
    )
    run_out: float = declared(
        0.0, "straight way after each stretch, in the stretch's own radius [m]", Finite
    )
    steady: Literal["required", "best"] = declared(
        REQUIRED,
        "required: the band holds for all t; best: as near to it as the joints can",
        Literal["required", "best"],
    )
    lead_on: float = declared(0.0, "time by which process_on comes before a stretch [s]", Finite)
    lead_off: float = declared(
        0.0, "time by which process_off comes before the end of a stretch [s]", Finite
    )

    def __post_init__(self) -> None:
        for name in ("run_in", "run_out"):
            length = getattr(self, name)
            if not is_number(length) or not 0 <= length <= _MAX_RUN:
                raise ProblemError(
                    f"tube.process.{name} is {shown(length)}; it must be from 0 to {_MAX_RUN:g} m"
                )
        if not isinstance(self.steady, str) or self.steady not in STEADY:
            raise ProblemError(f"tube.process.steady: {unknown_name('value', self.steady, STEADY)}")
        for name in ("lead_on", "lead_off"):
            _require_lead(f"tube.process.{name}", getattr(self, name))


@dataclass(frozen=True)
class TubeEvent:
    """An event while the tool moves: at a place of the reference path.

    Attributes:
        name: In marks; unique in its tube.
        segment: Number of the segment from whose begin the distance is counted.
        distance: Along the reference path [m].
        lead: Time by which the mark comes before the tool is there [s].

    Raises:
        ProblemError: On construction, for a value out of its bounds.
    """

    name: str = field(metadata=declaration("in marks; unique in the tube"))
    segment: int = field(
        metadata=declaration("number of a segment, which begins at the point of this number")
    )
    distance: float = declared(0.0, "along the reference path from there [m]", Finite)
    lead: float = declared(0.0, "time by which the mark comes before the tool [s]", Finite)

    def __post_init__(self) -> None:
        require_name("the name of an event of tube.events", self.name, ProblemError)
        here = f"tube.events: event '{self.name}': "
        if not isinstance(self.segment, WHOLE_NUMBER) or self.segment < 0:
            raise ProblemError(f"{here}segment is {shown(self.segment)}; give a segment's number")
        if not is_number(self.distance) or not self.distance >= 0:
            raise ProblemError(f"{here}distance is {shown(self.distance)}; it must be >= 0 m")
        _require_lead(f"{here}lead", self.lead)


def _require_lead(what: str, lead: Any) -> None:
    if not is_number(lead) or not 0 <= lead <= _MAX_LEAD:
        raise ProblemError(f"{what} is {shown(lead)}; it must be from 0 to {_MAX_LEAD:g} s")


def events_of(value: Any) -> tuple[TubeEvent, ...]:
    """Return the events of a list of maps or of `TubeEvent`.

    Raises:
        ProblemError: It is none, a field is unknown or wrong, or two have the same name.
    """
    if not isinstance(value, list | tuple):
        raise ProblemError(
            f"tube.events is {shown(value)}; give a list such as [{{name: camera, segment: 2}}]"
        )
    known = [each.name for each in fields(TubeEvent)]
    events: list[TubeEvent] = []
    for k, each in enumerate(value):
        if isinstance(each, Mapping):
            for name in each.keys() - set(known):
                raise ProblemError(f"tube.events[{k}]: {unknown_name('field', name, known)}")
            for name in {"name", "segment"} - each.keys():
                raise ProblemError(f"tube.events[{k}].{name} is required")
            each = TubeEvent(**each)
        if not isinstance(each, TubeEvent):
            raise ProblemError(f"tube.events[{k}] is {shown(each)}; give a map or a TubeEvent")
        if each.name in (other.name for other in events):
            raise ProblemError(f"tube.events[{k}]: there are two events '{each.name}'")
        events.append(each)
    return tuple(events)


NO_PROCESS = Process()


class Gate(NamedTuple):
    """The end of a stretch, where the tool passes from one segment to the next."""

    point: int  # index of the reference point at the end
    position: FloatArray  # of that point, shape (3,) [m]
    normal: FloatArray  # unit vector out of the stretch, along it, shape (3,)

    def margin(self, p: FloatArray) -> FloatArray:
        """Return the distances of tool positions (N, 3) outside the stretch, shape (N,) [m]."""
        margin: FloatArray = (p - self.position) @ self.normal
        return margin


class Stretch(NamedTuple):
    """Neighbouring segments with a speed band."""

    first: int  # index of its first segment
    last: int  # index of its last segment


class RunIn(NamedTuple):
    """A straight way beside a stretch: a run-in or a run-out."""

    point: int  # index of the point at the end of the stretch
    end: FloatArray  # the other end, shape (3,)
    own: int  # the segment of the stretch, whose region the way has
    beside: int  # the segment that it shortens, whose other conditions it has


def process_of(value: Any) -> Process:
    """Return the process of a map or of a `Process`.

    Raises:
        ProblemError: It is neither, or a field is unknown or wrong.
    """
    if value is None or isinstance(value, Process):
        return value or Process()
    if not isinstance(value, Mapping):
        raise ProblemError(
            f"tube.process is {shown(value)}; give a map such as {{run_in: 0.005, steady: best}}"
        )
    known = [each.name for each in fields(Process)]
    for name in value.keys() - set(known):
        raise ProblemError(f"tube.process: {unknown_name('field', name, known)}")
    return Process(**value)


def has_bands(tool_speed: Any) -> bool:
    """Return True if speeds of segments, as in files, contain a band."""
    is_list = isinstance(tool_speed, list | tuple)
    return any(isinstance(each, Mapping) for each in (tool_speed if is_list else [tool_speed]))


def speeds_of(tool_speed: Any, least: Any, segments: int) -> Speeds:
    """Return the largest and the least tool speeds of all segments, (m,) each [m/s].

    Infinite where there is none; None if all have none.

    Args:
        tool_speed: A number, a band or None for all segments, or one each. A band is {"speed": v,
            "tolerance": p}, from v (1 - p) to v, or {"between": [lower, upper]}.
        least: The least speeds as numbers, if the bands are not in `tool_speed`.
        segments: Number m of segments.

    Raises:
        ProblemError: A band or a number is wrong, or the bands of neighbouring segments have no
            speed in common.
    """
    if has_bands(tool_speed):
        is_list = isinstance(tool_speed, list | tuple)
        entries = list(tool_speed) if is_list else [tool_speed] * segments
        places = [f"tube.tool_speed{f'[{k}]' * is_list}" for k in range(len(entries))]
        pairs = [_pair(each, place) for each, place in zip(entries, places, strict=True)]
        tool_speed, least = ([pair[side] for pair in pairs] for side in (1, 0))
    largest = segment_values(tool_speed, segments, "tool_speed")
    lower = segment_values(least, segments, "least_tool_speed")
    if lower is not None:
        upper = np.full(segments, np.inf) if largest is None else largest
        banded = np.isfinite(lower)
        for k in np.flatnonzero(banded & (lower >= upper)):
            raise ProblemError(
                f"tube.tool_speed: the band of segment {k} is from {lower[k]:g} to {upper[k]:g} "
                "m/s; its lower end must be below the upper one"
            )
        floor = np.where(banded, lower, 0.0)
        for k in np.flatnonzero(banded[:-1] | banded[1:]):
            low, high = max(floor[k : k + 2]), min(upper[k : k + 2])
            if low > high:
                raise ProblemError(
                    f"tube.tool_speed: segments {k} and {k + 1} have no speed in common, which the "
                    f"tool has where it passes from one to the other: one begins at {low:g} m/s, "
                    f"the other ends at {high:g} m/s; give them speeds that overlap, or a free "
                    "segment between them (null)"
                )
    return largest, lower


def _pair(entry: Any, place: str) -> tuple[float | None, float | None]:
    """Return the least and the largest speed of a segment's entry [m/s]."""
    if not isinstance(entry, Mapping):
        return None, entry
    values = {name: value for name, value in entry.items() if value is not None}
    for name in values.keys() - {"speed", "tolerance", "between"}:
        raise ProblemError(
            f"{place}: {unknown_name('field', name, ('speed', 'tolerance', 'between'))}"
        )
    what = SEGMENT_NUMBERS["tool_speed"]
    if values.keys() == {"between"}:
        between = values["between"]
        if not are_numbers(between, 2) or not what.least <= between[0] < between[1] <= what.most:
            raise ProblemError(
                f"{place}.between is {shown(between)}; give [lower, upper], ascending, from "
                f"{what.least:g} to {what.most:g} m/s"
            )
        return float(between[0]), float(between[1])
    if values.keys() != {"speed", "tolerance"}:
        raise ProblemError(
            f"{place} is {shown(values)}; a band is {{speed: 0.25, tolerance: 0.05}} or "
            "{between: [0.2375, 0.25]} [m/s]"
        )
    speed, tolerance = values["speed"], values["tolerance"]
    if not is_number(speed) or not what.least <= speed <= what.most:
        raise ProblemError(
            f"{place}.speed is {shown(speed)}; it must be from {what.least:g} to {what.most:g} m/s"
        )
    if not is_number(tolerance) or not 1e-4 <= tolerance <= _MAX_TOLERANCE:
        raise ProblemError(
            f"{place}.tolerance is {shown(tolerance)}; it must be from 0.0001 to "
            f"{_MAX_TOLERANCE:g} of the speed"
        )
    return speed * (1 - tolerance), float(speed)


def stretches(least: FloatArray | None) -> tuple[Stretch, ...]:
    """Return the stretches of least speeds (m,) [m/s], infinite where there is none."""
    if least is None:
        return ()
    banded = np.concatenate([[False], np.isfinite(least), [False]])
    firsts = np.flatnonzero(~banded[:-1] & banded[1:]).tolist()
    ends = np.flatnonzero(banded[:-1] & ~banded[1:]).tolist()
    return tuple(Stretch(first, end - 1) for first, end in zip(firsts, ends, strict=True))


def gates(points: FloatArray, each: Iterable[Stretch]) -> tuple[Gate, ...]:
    """Return the ends of stretches at inner points (m+1, 3) of a tube, in order."""
    ends, last = [], len(points) - 1
    for stretch in each:
        for point, segment, sign in (
            (stretch.first, stretch.first, -1.0),
            (stretch.last + 1, stretch.last, 1.0),
        ):
            if 0 < point < last:
                along = points[segment + 1] - points[segment]
                ends.append(Gate(point, points[point], sign * along / np.linalg.norm(along)))
    return tuple(ends)


def run_ins(points: FloatArray, each: Iterable[Stretch], process: Process) -> list[RunIn]:
    """Return the run-ins and run-outs of stretches along points (m+1, 3), in order.

    Raises:
        ProblemError: A stretch has no segment beside it, or one on its line that is too short.
    """
    added = []
    for first, last in each:
        ends = (("run_in", first, first, first - 1), ("run_out", last + 1, last, last + 1))
        for name, point, own, beside in ends:
            if not (length := getattr(process, name)):
                continue
            if not 0 <= beside < len(points) - 1:
                raise ProblemError(
                    f"tube.process.{name}: segment {own} is at an end of the tube; give it a "
                    "neighbour, in which the tool may be at rest"
                )
            sign = -1.0 if name == "run_in" else 1.0
            along = sign * (points[own + 1] - points[own])
            way = sign * (points[beside + 1] - points[beside])
            direction, size = along / np.linalg.norm(along), float(np.linalg.norm(way))
            if way @ direction > _ON_LINE * size and size <= length:
                raise ProblemError(
                    f"tube.process.{name} is {length:g} m, but segment {beside} beside the stretch "
                    f"is {size:g} m long; give a shorter {name} or a longer segment"
                )
            added.append(RunIn(point, points[point] + length * direction, own, beside))
    return added
