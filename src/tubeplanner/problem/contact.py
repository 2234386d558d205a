"""Solids that may be near each other where the motion begins or ends, or must be farther apart."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.obstacle import MAX_SIZE
from tubeplanner.errors import ProblemError, shown, unknown_name
from tubeplanner.options import in_figures, is_number

START, GOAL = "start", "goal"
ENDS = (START, GOAL)
_LEAST = 1e-6  # [m]

Names = tuple[str, str]


@dataclass(frozen=True)
class Contact:
    """Two solids that touch, or nearly do, at start or goal.

    While the tool is within a distance of where it is there, in the tube's first or last segment,
    they must be as far apart as they are at that end, or as their clearance asks, if that is less.
    At a goal that is left open they must not overlap.

    Attributes:
        links: Names of links, attached solids or obstacles.
        within: Distance of the tool from its place at that end [m].
        ends: "start", "goal" or both.

    Raises:
        ProblemError: On construction, if the distance is not positive or an end is unknown.
    """

    links: Names
    within: float
    ends: tuple[str, ...] = ENDS

    def __post_init__(self) -> None:
        object.__setattr__(self, "links", _names("contacts", self.links))
        if not is_number(self.within) or not _LEAST <= self.within <= MAX_SIZE:
            raise ProblemError(
                f"contacts: within is {in_figures(self.within)} m for {_called(self.links)}; "
                f"{_LEAST:g} to {MAX_SIZE:g} m are accepted"
            )
        ends = (self.ends,) if isinstance(self.ends, str) else self.ends
        if not isinstance(ends, list | tuple):
            raise ProblemError(f"contacts: ends is {shown(ends)}; give a list of {', '.join(ENDS)}")
        ends = tuple(ends)
        for end in ends:
            if not isinstance(end, str) or end not in ENDS:
                raise ProblemError(f"contacts: {unknown_name('end', end, ENDS)}")
        object.__setattr__(self, "ends", ends)


def pair_distances(given: Mapping[Names, float]) -> Mapping[Names, float]:
    """Return clearances [m] by pairs of names, once they are what they must be.

    Raises:
        ProblemError: A number is negative or too large, or a key is no pair of names.
    """
    if not isinstance(given, Mapping):
        raise ProblemError(
            f"clearance.pairs is {shown(given)}; give a map from pairs of names to distances [m]"
        )
    for links, clearance in given.items():
        names = _names("clearance.pairs", links)
        if not is_number(clearance) or not 0 <= clearance <= MAX_SIZE:
            raise ProblemError(
                f"clearance.pairs: clearance is {in_figures(clearance)} m for {_called(names)}; "
                f"0 to {MAX_SIZE:g} m are accepted"
            )
    return {_names("", links): float(value) for links, value in given.items()}


def require_checked(checker: CollisionChecker, field: str, pairs: Iterable[Names]) -> None:
    """Raise ProblemError unless the solids of some pairs are checked against each other.

    Args:
        checker: The geometry.
        field: What messages call the pairs.
        pairs: Of names.
    """
    owners = list(dict.fromkeys(shape.owner for shape in checker.shapes))
    for names in pairs:
        for name in names:
            if name not in owners:
                kind = "link with collision geometry or obstacle"
                raise ProblemError(f"{field}: {unknown_name(kind, name, owners)}")
        if not checker.between(*names).any():
            left_out = {frozenset(pair.links): pair.reason for pair in checker.left_out}
            why = left_out.get(frozenset(names), "no joint moves one against the other")
            raise ProblemError(
                f"{field}: {_called(names)} are not checked against each other ({why}): remove "
                "the pair"
            )


def _names(field: str, given: object) -> Names:
    if isinstance(given, list | tuple) and len(given) == 2:
        first, second = given
        if isinstance(first, str) and isinstance(second, str) and first != second:
            return first, second
    raise ProblemError(
        f"{field}: {shown(given)} is no pair of names of different links or obstacles"
    )


def _called(names: Names) -> str:
    return f"'{names[0]}' and '{names[1]}'"
