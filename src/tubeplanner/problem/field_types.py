"""Types of which the fields of files are made: strict, so that a text is no number."""

from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


class Section(BaseModel):
    """A map with known keys."""

    # Built once, as part of what is read, rather than each alone when it is imported.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def no_flag(value: object) -> object:
    """Refuse true and false where 1 and 0 are numbers: YAML and Python take them for equal."""
    if isinstance(value, bool):
        raise ValueError("true and false are no numbers")
    return value


Finite: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Number: TypeAlias = Annotated[float, Field(strict=True)]
Vector: TypeAlias = tuple[Finite, Finite, Finite]
Quaternion: TypeAlias = tuple[Finite, Finite, Finite, Finite]
Range: TypeAlias = tuple[Number, Number]
Flag: TypeAlias = Annotated[bool, Field(strict=True)]
Version: TypeAlias = Annotated[Literal[1], BeforeValidator(no_flag)]
