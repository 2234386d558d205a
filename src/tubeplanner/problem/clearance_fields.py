"""The fields of clearances and contacts in problem files, and what they mean."""

from typing import Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field

from tubeplanner.errors import ProblemError
from tubeplanner.problem.contact import ENDS, GOAL, START, Contact
from tubeplanner.problem.field_types import Finite, Section, no_flag


class PairClearanceFields(Section):
    """A clearance of two solids."""

    links: tuple[str, str] = Field(description="links, attached solids or obstacles")
    clearance: Finite = Field(description="least distance between them [m]")


class ClearanceFields(Section):
    """Clearances; the more specific holds: of a pair, else of a segment, else the default."""

    default: Finite = Field(0.0, description="least distance of links to obstacles [m]")
    pairs: list[PairClearanceFields] = Field(
        [], description="of single pairs, also of links from each other"
    )
    segments: list[Finite | None] | None = Field(
        None, description="m distances of links to obstacles, null where it is the default [m]"
    )


def _number_or_map(value: object) -> object:
    """Report what a clearance may be, rather than the fault of each alternative."""
    no_flag(value)
    if not isinstance(value, int | float | dict | ClearanceFields):
        raise ValueError("it must be a number, or a map with default, pairs, segments")
    return value


Clearance: TypeAlias = Annotated[Finite | ClearanceFields, BeforeValidator(_number_or_map)]


class ContactFields(Section):
    """Two solids that may be nearer than their clearance where the motion begins or ends."""

    links: tuple[str, str] = Field(description="links, attached solids or obstacles")
    segments: list[Annotated[int, Field(strict=True)]] | None = Field(
        None,
        description="0, the first, where it begins, or the last (also -1), where it ends; left "
        "out: both",
    )
    within: Finite = Field(description="distance of the tool from where it is there [m]")


def clearances_of(fields: float | ClearanceFields) -> dict[str, Any]:
    """Return `clearance` and `pair_clearances` of a problem."""
    if not isinstance(fields, ClearanceFields):
        return {"clearance": fields}
    pairs = {pair.links: pair.clearance for pair in fields.pairs}
    return {"clearance": fields.default, "pair_clearances": pairs}


def segment_clearances(fields: float | ClearanceFields) -> list[float | None] | None:
    """Return the `clearance` of a tube [m]."""
    return fields.segments if isinstance(fields, ClearanceFields) else None


def contacts_of(fields: list[ContactFields], segments: int | None) -> tuple[Contact, ...]:
    """Return the contacts of a problem.

    Args:
        fields: As a file has them.
        segments: Of the tube as the file has it; None: its segments are not known yet.

    Raises:
        ProblemError: A segment is neither the first nor the last.
    """
    return tuple(
        Contact(each.links, each.within, _ends(k, each.segments, segments))
        for k, each in enumerate(fields)
    )


def _ends(k: int, given: list[int] | None, segments: int | None) -> tuple[str, ...]:
    """Return at which ends the solids of contact k touch."""
    if given is None:
        return ENDS
    last = [-1] if segments is None else [-1, segments - 1]
    for segment in given:
        if segment != 0 and segment not in last:
            which = "-1, the last" if segments is None else f"{segments - 1} (or -1), the last"
            raise ProblemError(
                f"contacts[{k}].segments has {segment}; solids may touch where the motion begins "
                f"or ends: give 0, the first, or {which}"
            )
    ends = ((START, 0 in given), (GOAL, any(segment in last for segment in given)))
    return tuple(end for end, is_given in ends if is_given)
