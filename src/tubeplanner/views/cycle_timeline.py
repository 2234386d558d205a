"""What happens when in the motion of a cycle, as bands and ticks of a time line."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.trajectory.marks import EVENT, MOVE, Mark
from tubeplanner.views.palette import segment_color

_MAX_SETTING = 24  # characters; a setting may be anything that a file holds


@dataclass(frozen=True)
class Band:
    """A move on a time line.

    Attributes:
        name: Of the move.
        begin: [s].
        end: [s].
        color: That of its tube.
    """

    name: str
    begin: float
    end: float
    color: str


@dataclass(frozen=True)
class Stop:
    """A rest on a time line.

    Attributes:
        begin: [s].
        end: [s]; the same as begin if all that happens takes no time.
        ticks: When each thing begins that happens [s], and what it is.
    """

    begin: float
    end: float
    ticks: tuple[tuple[float, str], ...]

    @property
    def text(self) -> str:
        """All that happens, on one line."""
        return ", ".join(text for _, text in self.ticks)


@dataclass(frozen=True)
class Timeline:
    """What happens when.

    Attributes:
        bands: Moves.
        stops: Rests at which something happens.
    """

    bands: tuple[Band, ...]
    stops: tuple[Stop, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the time line as JSON values."""
        return {
            "moves": [vars(band) for band in self.bands],
            "rests": [{**vars(stop), "text": stop.text} for stop in self.stops],
        }


def cycle_timeline(motion: CycleMotion) -> Timeline:
    """Return the time line of a motion."""
    spans = motion.move_times.items()
    bands = [Band(name, *times, segment_color(k)) for k, (name, times) in enumerate(spans)]
    return Timeline(tuple(bands), tuple(_stops(motion.marks, motion.trajectory.duration)))


def _stops(marks: Sequence[Mark], duration: float) -> list[Stop]:
    runs = [(kind, list(run)) for kind, run in groupby(marks, lambda mark: mark.kind == MOVE)]
    ends = [run[0].time for _, run in runs[1:]] + [duration]
    return [
        Stop(run[0].time, end, tuple((mark.time, _called(mark)) for mark in run))
        for (is_move, run), end in zip(runs, ends, strict=True)
        if not is_move
    ]


def _called(mark: Mark) -> str:
    """Return what is said of a step at rest."""
    if mark.kind != EVENT:
        return f"{mark.kind} {mark.name}"
    setting = "" if mark.setting is None else str(mark.setting)
    short = setting if len(setting) <= _MAX_SETTING else f"{setting[:_MAX_SETTING]}..."
    return f"{mark.name} {short}".strip()
