"""What happens when in the motion of a cycle, as bands and ticks of a time line."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import Any

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.step_text import step_text
from tubeplanner.cycle.steps import Move
from tubeplanner.views.palette import segment_color

# Nearer to an end of the line than this share of it, a name is not in the middle of its room.
_EDGE = 0.1


@dataclass(frozen=True)
class Band:
    """A move on a time line.

    Attributes:
        name: Of the move.
        begin: [s].
        end: [s].
        color: That of its tube.
        tube: Name of its surface.
    """

    name: str
    begin: float
    end: float
    color: str
    tube: str


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

    def as_dict(self, duration: float) -> dict[str, Any]:
        """Return the time line as JSON values, with the room that the text of each rest has.

        Args:
            duration: That the whole width stands for [s].
        """
        rooms = _rooms([(stop.begin + stop.end) / 2 for stop in self.stops], duration)
        return {
            "bands": [vars(band) for band in self.bands],
            "rests": [
                {**vars(stop), "text": stop.text, "room": room}
                for stop, room in zip(self.stops, rooms, strict=True)
            ],
        }


def cycle_timeline(motion: CycleMotion) -> Timeline:
    """Return the time line of a motion."""
    spans = motion.move_times.items()
    bands = [
        Band(name, *times, segment_color(k), tube_name(k)) for k, (name, times) in enumerate(spans)
    ]
    return Timeline(tuple(bands), tuple(_stops(motion)))


def tube_name(move: int) -> str:
    """Return what the surface of a move's tube is called in the scene."""
    return f"move_{move}"


def _stops(motion: CycleMotion) -> list[Stop]:
    steps = zip(motion.cycle.steps, motion.marks, strict=True)
    runs = [list(run) for _, run in groupby(steps, lambda each: isinstance(each[0], Move))]
    ends = [run[0][1].time for run in runs[1:]] + [motion.trajectory.duration]
    return [
        Stop(
            run[0][1].time,
            end,
            tuple((mark.time, step_text(step)) for step, mark in run if not isinstance(step, Move)),
        )
        for run, end in zip(runs, ends, strict=True)
        if not isinstance(run[0][0], Move)
    ]


def _rooms(middles: Sequence[float], duration: float) -> list[dict[str, Any]]:
    """Return the room of texts around times [s], so that none is drawn over another.

    A room reaches at most half way to the next text, and as far on both sides; the first and the
    last text, at an end of the line, have all that is left to that end.
    """
    borders = [0.0, *(sum(pair) / 2 for pair in pairwise(middles)), duration]
    rooms = []
    for k, (middle, (low, high)) in enumerate(zip(middles, pairwise(borders), strict=True)):
        even = min(middle - low, high - middle)
        room = {"begin": middle - even, "end": middle + even, "align": "center"}
        if k == 0 and middle < _EDGE * duration:
            room = {"begin": low, "end": high, "align": "left"}
        elif k == len(middles) - 1 and middle > (1 - _EDGE) * duration:
            room = {"begin": low, "end": high, "align": "right"}
        rooms.append(room)
    return rooms
