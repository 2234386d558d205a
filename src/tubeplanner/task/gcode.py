"""G-code of beads: lines, arcs, rapids and feeds as ways of the tool.

Read are G0, G1, G2, G3 (centres by I, J, K, or radii by R) in the planes G17, G18, G19, lengths in
mm or inch (G21, G20), positions absolute or relative (G90, G91), feeds F per minute, comments, line
numbers. Words for the machine (M, S, T and others) are noted; what would move the tool in another
way is refused.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.documents import DocumentError, read_text
from tubeplanner.errors import ProblemError, shown
from tubeplanner.task.drawings import BEAD, FREE, LIMITED, Drawing, Way

_MAX_BYTES = 10_000_000
_MAX_POINTS = 20_000
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_WORD = re.compile(r"([A-Z])([+-]?(?:\d+\.?\d*|\.\d+))")
_AXES = "XYZ"
_CENTRES = "IJK"
# First, second and normal axis: from the first to the second is anticlockwise.
_PLANES = {"17": (0, 1, 2), "18": (2, 0, 1), "19": (1, 2, 0)}
_UNITS = {"20": 0.0254, "21": 0.001}  # [m]
_MOTIONS = ("0", "1", "2", "3")
# Codes that ask for what is so anyway.
_USUAL = ("40", "49", "61", "64", "80", "91.1", "94")
# Codes of the machine, which change no way that is drawn.
_NOTED = {
    "4": "a dwell",
    "43": "length of the tool",
    "43.1": "length of the tool",
    **dict.fromkeys(("54", "55", "56", "57", "58", "59"), "--frame has the place of the drawing"),
}
_OF_MACHINE = "MSTHDEP"
_END = ("2", "30")  # of the program, as M words
_MAX_NAMED = 4  # lines in a note
# Accepted difference of an arc's radii at its ends: a length [m], or a fraction of the radius.
_ROUNDING, _ROUNDING_FRACTION = 5e-6, 5e-3
_SAME = 1e-9  # [m]
_MAX_STEP = np.pi / 3  # of an arc [rad]

_Words: TypeAlias = list[tuple[str, str]]


def read_gcode(path: Path, sagitta: float, speed: float | None = None) -> Drawing:
    """Read the ways of a G-code file [m].

    Args:
        path: The file.
        sagitta: Largest distance of an arc from its chords [m].
        speed: In place of all feeds [m/s].

    Raises:
        ProblemError: A line is malformed, or has a word that is not read; file, line and word are
            named.
    """
    try:
        text = read_text(path, _MAX_BYTES)
    except DocumentError as error:
        raise ProblemError(f"{path} cannot be read: {error}") from None
    program = _Program(str(path), sagitta, speed)
    lines = enumerate(text.splitlines(), 1)
    for number, line in lines:
        program.number = number
        program.follow(_words(line, program.place))
        if program.has_ended:
            break
    rest = [number for number, line in lines if _COMMENT.sub("", line).strip(" \t%")]
    if rest:
        program.remarks.append(
            f"{path}: not read: {len(rest)} lines from line {rest[0]} on, after the end of the "
            f"program in line {program.number}"
        )
    if not any(way.kind == BEAD for way in program.ways):
        raise ProblemError(f"{path} has no bead: no G1, G2 or G3 moves across the z axis")
    return Drawing(tuple(program.ways), tuple(program.notes()))


def _words(line: str, place: str) -> _Words:
    """Return the letters and numbers of a line without comments and line number."""
    code = re.sub(r"\s", "", _COMMENT.sub("", line)).upper()
    if code.startswith("%"):
        return []
    words = _WORD.findall(code)
    rest = _WORD.sub("", code)
    if rest:
        raise ProblemError(
            f"{place}: {shown(rest)} is not read; a line has words of a letter and a number, "
            "comments in ( ) or after ; and no parameters, expressions or checksums"
        )
    return [(letter, number) for letter, number in words if letter != "N"]


class _Program:
    """The state of a machine that follows a program.

    Attributes:
        number: Of the current line, from 1.
        ways: What the tool did.
        remarks: Notes on single lines.
        has_ended: True from M2 or M30 on.
    """

    def __init__(self, source: str, sagitta: float, speed: float | None) -> None:
        self.number = 0
        self.ways: list[Way] = []
        self.remarks: list[str] = []
        self.has_ended = False
        self._source, self._sagitta, self._speed = source, sagitta, speed
        self._position = np.zeros(3)
        self._known: set[int] = set()  # axes whose position the program has set
        self._unit, self._plane = _UNITS["21"], "17"
        self._is_relative = False
        self._motion: str | None = None
        self._feed: float | None = None  # [m/s]
        self._unused: dict[str, list[int]] = {}  # lines by word

    @property
    def place(self) -> str:
        """The file and the line, for messages."""
        return f"{self._source}, line {self.number}"

    def notes(self) -> Iterator[str]:
        """Yield notes on what was not used, and on single lines."""
        yield from self.remarks
        unused = []
        for word, lines in self._unused.items():
            named = ", ".join(map(str, lines[:_MAX_NAMED]))
            more = f" and {len(lines) - _MAX_NAMED} more" * (len(lines) > _MAX_NAMED)
            unused.append(f"{word} (line {named}{more})")
        if unused:
            yield f"{self._source}: not used: {', '.join(unused)}"

    def follow(self, words: _Words) -> None:
        """Follow the words of a line."""
        values: dict[str, float] = {}
        motions = []
        for letter, number in words:
            code = f"{float(number):g}"
            if letter == "G":
                if code in _MOTIONS:
                    motions.append(code)
                else:
                    self._set_mode(code)
            elif letter in _OF_MACHINE:
                what = f"{letter}{code}" if letter in "MT" else letter
                self._unused.setdefault(what, []).append(self.number)
                self.has_ended |= letter == "M" and code in _END
            elif letter in values:
                raise ProblemError(f"{self.place}: {letter} is given twice")
            elif letter not in (*_AXES, *_CENTRES, "R", "F"):
                raise ProblemError(
                    f"{self.place}: {letter}{number} is not read; the tool is moved by X, Y, Z, "
                    "with I, J, K or R in an arc, and F: leave out other axes and cycles"
                )
            else:
                values[letter] = float(number)
        if len(motions) > 1:
            raise ProblemError(f"{self.place}: G{' and G'.join(motions)} are in one line; give one")
        self._motion = motions[0] if motions else self._motion
        if "F" in values:
            feed = values.pop("F")
            if feed <= 0:
                raise ProblemError(f"{self.place}: F is {feed:g}; a feed must be > 0 per minute")
            self._feed = feed * self._unit / 60
        if values:
            self._move({key: value * self._unit for key, value in values.items()})

    def _set_mode(self, code: str) -> None:
        if code in _UNITS:
            self._unit = _UNITS[code]
        elif code in _PLANES:
            self._plane = code
        elif code in ("90", "91"):
            self._is_relative = code == "91"
        elif code in _NOTED:
            self._unused.setdefault(f"G{code}, {_NOTED[code]}", []).append(self.number)
        elif code not in _USUAL:
            raise ProblemError(
                f"{self.place}: G{code} is not read; lines and arcs are G0, G1, G2, G3: have the "
                "postprocessor write these, or leave the line out"
            )
        if code == "80":
            self._motion = None

    def _move(self, values: dict[str, float]) -> None:
        """Move by words [m]."""
        motion, begin = self._motion, self._position
        if motion is None:
            raise ProblemError(
                f"{self.place}: {next(iter(values))} is given, but neither here nor before G0, G1, "
                "G2 or G3"
            )
        of_arc = [key for key in values if key not in _AXES]
        if bool(of_arc) != (motion in "23"):
            reason = f"{of_arc[0]} is for arcs" if of_arc else "an arc takes I, J, K or R"
            raise ProblemError(f"{self.place}: {reason}, and the motion is G{motion}")
        end, was_known = begin.copy(), len(self._known) == 3
        for axis, name in enumerate(_AXES):
            if name in values:
                end[axis] = values[name] + begin[axis] * self._is_relative
                self._known.add(axis)
        self._position = end
        if motion == "0" and not was_known:
            return  # the way to the first place, from anywhere
        if len(self._known) < 3:
            unknown = ", ".join(name for k, name in enumerate(_AXES) if k not in self._known)
            self.remarks.append(
                f"{self.place}: the position has no {unknown} yet; 0 is taken, in the drawing's "
                "frame"
            )
            self._known |= {0, 1, 2}
        points = self._arc(begin, end, values) if of_arc else np.array([begin, end])
        if len(points) == 2 and np.linalg.norm(end - begin) < _SAME:
            return
        if motion == "0":
            self.ways.append(Way(points, FREE))
            return
        speed = self._speed or self._feed
        if speed is None:
            raise ProblemError(
                f"{self.place}: G{motion} has no feed, neither here nor before; give F or --speed"
            )
        is_plunge = motion == "1" and np.linalg.norm((end - begin)[:2]) < _SAME
        self.ways.append(Way(points, LIMITED if is_plunge else BEAD, speed))
        if sum(len(way.points) for way in self.ways) > _MAX_POINTS:
            raise ProblemError(
                f"{self.place}: up to here there are {_MAX_POINTS} points; cut the program into "
                "parts, or give a larger --radius, in which arcs have fewer chords"
            )

    def _arc(self, begin: FloatArray, end: FloatArray, values: dict[str, float]) -> FloatArray:
        """Return the corners (k+1, 3) of the chords of an arc or helix [m]."""
        axes = _PLANES[self._plane]
        first, second, normal = axes
        start, chord = begin[[first, second]], (end - begin)[[first, second]]
        turn = -1.0 if self._motion == "2" else 1.0
        centres = [values.get(_CENTRES[k]) for k in axes]
        if centres[2] is not None:
            raise ProblemError(
                f"{self.place}: {_CENTRES[normal]} is along the normal of the plane G{self._plane}"
            )
        if "R" in values:
            if centres != [None, None, None]:
                raise ProblemError(f"{self.place}: an arc takes R or I, J, K; it has both")
            centre = start + self._offset(chord, values["R"], turn)
        else:
            centre = start + [value or 0.0 for value in centres[:2]]
        radii = np.linalg.norm([start - centre, start + chord - centre], axis=1)
        if radii.min() < _SAME or abs(radii[1] - radii[0]) > max(
            _ROUNDING, _ROUNDING_FRACTION * radii[0]
        ):
            raise ProblemError(
                f"{self.place}: the arc's radius is {1000 * radii[0]:.4g} mm at its begin and "
                f"{1000 * radii[1]:.4g} mm at its end; both must be the same and > 0 (I, J, K are "
                "taken from the begin)"
            )
        angle = np.arctan2(*(start - centre)[::-1])
        sweep = (turn * (np.arctan2(*(start + chord - centre)[::-1]) - angle)) % (2 * np.pi)
        if np.linalg.norm(chord) < _SAME:
            sweep = 2 * np.pi
        step = min(2 * np.arccos(max(1 - self._sagitta / radii.max(), -1.0)), _MAX_STEP)
        fraction = np.linspace(0, 1, int(np.ceil(sweep / step - _SAME)) + 1)
        angles, radius = (
            angle + turn * sweep * fraction,
            radii[0] + fraction * (radii[1] - radii[0]),
        )
        points = begin + fraction[:, None] * (end - begin)
        points[:, first] = centre[0] + radius * np.cos(angles)
        points[:, second] = centre[1] + radius * np.sin(angles)
        points[[0, -1]] = begin, end
        return points

    def _offset(self, chord: FloatArray, radius: float, turn: float) -> FloatArray:
        """Return the vector (2,) from an arc's begin to its centre, by chord and radius [m]."""
        length = float(np.linalg.norm(chord))
        height = radius**2 - length**2 / 4
        if length < _SAME or height < -(_ROUNDING_FRACTION * radius**2):
            raise ProblemError(
                f"{self.place}: R is {1000 * radius:.4g} mm, and the ends of the arc are "
                f"{1000 * length:.4g} mm apart; they must be apart, by at most 2 R (a circle takes "
                "I, J, K)"
            )
        left = np.array([-chord[1], chord[0]]) / length
        # The shorter arc has its centre on the side to which it turns.
        offset: FloatArray = chord / 2 + turn * np.sign(radius) * np.sqrt(max(height, 0.0)) * left
        return offset
