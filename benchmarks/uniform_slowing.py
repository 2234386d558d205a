"""How much slower a whole motion has to run until its simulated runs keep all limits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

MOST = 3.0
# Surviving need not go on as a motion gets slower: the first of these that survives counts.
_FACTORS = (1.02, 1.05, 1.1, 1.2, 1.35, 1.6, 2.0, 2.5, MOST)
_NEAR = 1.005  # as close to the least factor as bisection goes


@dataclass(frozen=True)
class Arms:
    """How many arms judge a factor, one stage after the other until one of them fails.

    Attributes:
        search: While the least factor is sought.
        found: The one that was found.
    """

    search: Sequence[int] = (4, 50)
    found: Sequence[int] = (200,)


def least_factor(failed: Callable[[float, int], int], arms: Arms) -> float | None:
    """Return the least factor on a motion's times with which none of its runs fails.

    Args:
        failed: How many runs fail, of the motion with a factor on its times, by so many arms.
        arms: How many arms judge it.

    Returns:
        From 1 to 3, to half a percent; None if none of nine factors survives.
    """

    def survives(factor: float, counts: Sequence[int]) -> bool:
        return all(failed(factor, count) == 0 for count in counts)

    below = 1.0
    if survives(below, (*arms.search, *arms.found)):
        return below
    for factor in _FACTORS:
        if survives(factor, arms.search):
            least = _bisected(lambda between: survives(between, arms.search), below, factor)
            return _raised(lambda raised: survives(raised, arms.found), least)
        below = factor
    return None


def _bisected(survives: Callable[[float], bool], below: float, above: float) -> float:
    """Return the least factor between one that does not survive and one that does."""
    while above > _NEAR * below:
        between = (below * above) ** 0.5
        if survives(between):
            above = between
        else:
            below = between
    return above


def _raised(survives: Callable[[float], bool], factor: float) -> float | None:
    """Return the least factor, at least a given one, with which more arms survive too."""
    if survives(factor):
        return factor
    step = _NEAR
    while factor * step <= MOST:
        if survives(factor * step):
            return _bisected(survives, factor, factor * step)
        factor, step = factor * step, step**2
    return None
