"""Which changes may help where a plan ended: these are tried first."""

from collections.abc import Iterable

from tubeplanner.explanation.change import Change
from tubeplanner.outcome import Place, PlanStatus

# By how planning ended: the kinds that help against what is said, then others that may.
_HELPFUL = {
    PlanStatus.TUBE_BLOCKED: (
        ("clearance", "obstacle", "radii", "sign"),
        ("radius", "rotation_tolerance", "start", "goal", "point", "attached"),
    ),
    PlanStatus.GRAVITY_EXCEEDS_EFFORT: (("effort", "payload", "sign"), ()),
    PlanStatus.UNREACHABLE: (
        ("position", "sign", "rotation_tolerance", "radius", "radii"),
        ("point", "start", "goal"),
    ),
    PlanStatus.BAD_INPUT: (("position", "start", "goal"), ("radius", "sign", "point")),
}
# Of these every one helps against what is said, wherever it is.
_EVERYWHERE = ("payload", "sign", "radii", "duration")


def in_order(
    changes: Iterable[Change], status: PlanStatus, place: Place
) -> list[list[list[Change]]]:
    """Return changes in tiers: about the place, elsewhere, and of kinds that are unlikely to help.

    The first has two groups, the likelier kinds first; others have one.

    Args:
        changes: All of them.
        status: How planning ended.
        place: Where.
    """
    about = _named(place)
    first: list[Change] = []
    second: list[Change] = []
    elsewhere: list[Change] = []
    unlikely: list[Change] = []
    likelier, others = _HELPFUL.get(status, ((), ()))
    kinds = (*likelier, *others)
    rank = {kind: k for k, kind in enumerate(kinds)}
    for change in sorted(changes, key=lambda change: rank.get(change.kind, len(kinds))):
        is_helpful = not kinds or change.kind in kinds
        is_there = bool(about & change.about) or change.kind in _EVERYWHERE or not change.about
        if not is_helpful:
            unlikely.append(change)
        elif not is_there:
            elsewhere.append(change)
        else:
            (second if change.kind in others else first).append(change)
    return [[first, second], [elsewhere], [unlikely]]


def _named(place: Place) -> frozenset[str]:
    """Return what a place names, as changes say what they are about."""
    named = set()
    if place.joint is not None:
        named.add(place.joint)
    if place.segment is not None:
        named |= {f"segment {place.segment}"}
    if place.point is not None:
        named |= {f"point {place.point}", f"segment {place.point - 1}", f"segment {place.point}"}
    named |= {f"link {name}" for name in place.links or ()}
    if place.obstacle is not None:
        named |= {f"obstacle {place.obstacle}"}
    return frozenset(named)
