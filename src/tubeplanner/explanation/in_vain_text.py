"""What helps nothing, in few words: changes of one kind together, with how far they went."""

from collections.abc import Iterable, Sequence

_NAMED = 3  # at most, else how many there are

# How a path begins and ends, what it is in words, of several with what these are at the end, and
# how far it was changed. What stands between is a number or a name.
_KINDS = (
    ("tube.radius", "", "radius of the tube as a whole", "", "up to eleven times"),
    ("tube.radius.", "", "radius of segment", "radius of segments", "up to eleven times"),
    ("tube.cross_section.", ".box", "box of segment", "boxes of segments", "up to eleven times"),
    (
        *("tube.rotation_tolerance.", "", "rotation tolerance of segment"),
        *("rotation tolerance of segments", "up to 3 rad more"),
    ),
    ("tube.tool_radius", "", "tool_radius", "", "down to 0"),
    ("tube.points.", "", "reference point", "reference points", "moved by up to 1 m"),
    ("tube.joint_signs.", "", "sign of", "signs of joints", "any other"),
    ("tube.pass_through_points", "", "pass_through_points", "", "none"),
    ("robot.limits.effort.", "", "effort of", "effort of joints", "up to eleven times"),
    (
        *("robot.limits.position.", "", "position limits of", "position limits of joints"),
        "by up to a turn",
    ),
    ("robot.payload.mass", "", "payload", "", "down to nothing"),
    ("robot.attached.", ".position", "attached solid", "attached solids", "moved by up to 1 m"),
    ("obstacles.", ".position", "obstacle", "obstacles", "moved by up to 1 m"),
    ("clearance", "", "clearance", "", "down to 0"),
    ("clearance.default", "", "clearance", "", "down to 0"),
    ("clearance.pairs.", ".clearance", "clearance of pair", "clearance of pairs", "down to 0"),
    (
        *("clearance.segments.", "", "clearance of segment", "clearance of segments"),
        "down to 0",
    ),
    ("start", "", "start", "", "left to inverse kinematics"),
    ("goal", "", "goal", "", "left out"),
    ("start.joints", "", "start", "", "each joint by up to 1 rad or m"),
    ("goal.joints", "", "goal", "", "each joint by up to 1 rad or m"),
    ("goal.tolerance", "", "goal.tolerance", "", "up to 1 m more"),
    ("objective.duration", "", "objective.duration", "", "up to a hundred times more"),
)


def in_vain_text(paths: Iterable[str]) -> str:
    """Return what was changed in vain, by the paths of its fields."""
    groups: dict[int | str, list[str]] = {}
    for path in paths:
        kind = _kind_of(path)
        if kind is None:
            groups[path] = []
        else:
            groups.setdefault(kind, []).append(_between(path, kind))
    return "; ".join(_words(kind, names) for kind, names in groups.items())


def _kind_of(path: str) -> int | None:
    """Return which of the kinds a path is of."""
    for k, (begin, end, _, several, _) in enumerate(_KINDS):
        if path == begin if not several else path.startswith(begin) and path.endswith(end):
            return k
    return None


def _between(path: str, kind: int) -> str:
    begin, end = _KINDS[kind][:2]
    return path.removeprefix(begin).removesuffix(end)


def _words(kind: int | str, names: Sequence[str]) -> str:
    if isinstance(kind, str):  # a path by itself
        return kind
    *_, one, several, how_far = _KINDS[kind]
    if not several:
        return f"{one} ({how_far})"
    if len(names) == 1:
        return f"{one} {names[0]} ({how_far})"
    if all(name.isdecimal() for name in names):
        return f"{several} {_ranges(sorted(map(int, names)))} ({how_far})"
    if len(names) > _NAMED:
        *words, noun = several.split()
        return f"{' '.join([*words, str(len(names)), noun])} ({how_far})"
    return f"{several} {', '.join(names)} ({how_far})"


def _ranges(numbers: Sequence[int]) -> str:
    """Return whole numbers in order as "0-3, 5"."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(f"{one[0]}-{one[-1]}" if len(one) > 1 else f"{one[0]}" for one in parts)
