"""Hashes of cycles: is a motion that of this cycle, and if not, in what do they differ?

They are those of its moves' problems, each as it is before it is known where it begins, and of what
happens between them.
"""

from collections.abc import Mapping

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.steps import Event
from tubeplanner.files.fingerprint import hash_of, problem_hash
from tubeplanner.files.part_hashes import part_hashes

_DIGITS, _PART_DIGITS = 32, 8
_STEPS = "order of steps or dwells"
_OF_MOVE = " of move "


def cycle_hash(cycle: Cycle) -> str:
    """Return a hash of all that the certificate of a cycle's motion depends on."""
    problems = [problem_hash(cycle.problem_from_anywhere(k)) for k in range(len(cycle.legs))]
    return hash_of([*_step_parts(cycle), *problems], _DIGITS)


def cycle_part_hashes(cycle: Cycle) -> dict[str, str]:
    """Return a hash of each part of a cycle, by what messages call it."""
    parts = {_STEPS: hash_of(_step_parts(cycle), _PART_DIGITS)}
    for k, leg in enumerate(cycle.legs):
        of_leg = part_hashes(cycle.problem_from_anywhere(k))
        parts |= {f"{part}{_OF_MOVE}'{leg.name}'": value for part, value in of_leg.items()}
    return parts


def differing_cycle_parts(cycle: Cycle, stated: Mapping[str, str]) -> list[str]:
    """Return the parts in which a cycle is not the one with the stated hashes.

    What differs in every move is named once.
    """
    own = cycle_part_hashes(cycle)
    differing = [name for name, value in own.items() if stated.get(name, value) != value]
    moves: dict[str, list[str]] = {}
    for name in differing:
        part, _, move = name.partition(_OF_MOVE)
        moves.setdefault(part, []).append(move)
    return [
        _OF_MOVE.join(filter(None, (part, name)))
        for part, names in moves.items()
        for name in ([""] if len(names) == len(cycle.legs) else names)
    ]


def _step_parts(cycle: Cycle) -> list[object]:
    """Return which steps follow each other, and what of them is in no move's problem."""
    parts: list[object] = ["cycle", "closed" if cycle.closed else "open"]
    for step in cycle.steps:
        parts += [type(step).__name__, step.name]
        if isinstance(step, Event):
            parts.append(step.dwell)
    return parts
