"""The study file's shape: fields, units, defaults. Other tools read it, so names never change."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, Tag

from tubeplanner.options import is_number
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.problem.checked_fields import check_fields
from tubeplanner.problem.field_paths import factor_of
from tubeplanner.problem.field_types import Finite, Flag, Section, Version, no_flag

Count: TypeAlias = Annotated[int, BeforeValidator(no_flag), Field(strict=True)]


def _number_or_factor(value: object) -> object:
    if not is_number(value) and factor_of(value) is None:
        raise ValueError("it must be a number, or a factor such as x0.5")
    return value


End: TypeAlias = Annotated[Finite | str, BeforeValidator(_number_or_factor)]


class RangeFields(Section):
    """Values from one to another, both included."""

    from_: End = Field(alias="from", description="the first: a number, or a factor such as x0.5")
    to: End = Field(description="the last, likewise")
    count: Count | None = Field(
        None, description="how many; left out, in a Latin hypercube alone: any between the two"
    )
    spacing: Literal["linear", "log"] = Field(
        "linear", description="what is the same between neighbours: the difference or the ratio"
    )


class LatinFields(Section):
    """A Latin hypercube: random points, spread evenly over the values of each field."""

    latin: Count = Field(description="how many points")
    seed: Count = Field(0, description="the same seed, the same points")


class OptionFields(Section):
    """How every point is planned: as by `plan` with these options."""

    method: str = Field(PlanOptions.method, description="refinement, or another of `plan`")
    quality: str = Field(PlanOptions.quality, description="fast, balanced or best")
    candidate_points: Count = Field(
        PlanOptions.candidate_points, description="from which branch-and-bound chooses"
    )
    node_budget: Count = Field(
        PlanOptions.node_budget, description="after how many nodes branch-and-bound ends"
    )
    suh_bishop: dict[str, Any] = Field(
        {}, description="of phase 2 of suh-bishop, by the names of `SuhBishopOptions`"
    )
    time_limit: Finite | None = Field(
        PlanOptions.time_limit, description="of every point [s]; left out: none"
    )
    slack: Finite | None = Field(
        PlanOptions.slack,
        description="share that answers may take longer, to be smooth; 0: the shortest; left out: "
        "what the problem's objective says",
    )
    robust: Flag = Field(
        PlanOptions.robust, description="whether the problem's field robustness counts"
    )
    persistent: Flag = Field(
        PlanOptions.persistent,
        description="whether planning goes on where refinement's first start leads to no answer",
    )


def _kind_of_values(value: object) -> str | None:
    if isinstance(value, dict | RangeFields):
        return "RangeFields"
    return "list" if isinstance(value, list) else None


def _kind_of_design(value: object) -> str | None:
    if isinstance(value, dict | LatinFields):
        return "LatinFields"
    return "grid" if value == "grid" else None


Values: TypeAlias = Annotated[
    Annotated[list[Any], Tag("list")] | Annotated[RangeFields, Tag("RangeFields")],
    Discriminator(
        _kind_of_values,
        custom_error_type="values",
        custom_error_message="it must be a list of values, or a map with from, to and count",
    ),
]
Design: TypeAlias = Annotated[
    Annotated[Literal["grid"], Tag("grid")] | Annotated[LatinFields, Tag("LatinFields")],
    Discriminator(
        _kind_of_design,
        custom_error_type="design",
        custom_error_message="it must be grid, or a map with latin and seed",
    ),
]


class StudiedFields(Section):
    """What is varied, how points are chosen, and how they are planned."""

    problem: str | list[str] = Field(
        description="a problem or cycle file, relative to this file, or example:ROBOT/NAME; a list "
        "of them is one more axis, called `problem`"
    )
    vary: dict[str, Values] = Field(
        {}, description="by field path: its values; x0.5 scales every number there"
    )
    design: Design = Field(
        "grid", description="grid: every value of each with every value of the others"
    )
    options: OptionFields = Field(OptionFields(), description="how every point is planned")


class StudyFields(Section):
    """Many plans: of one or several problems, with other values of some fields."""

    model_config = ConfigDict(title="tubeplanner study")

    format: Literal["tubeplanner/study"] = Field(description="what this file is")
    version: Version = Field(1, description="of the format")
    study: StudiedFields = Field(description="what is planned")


def study_schema() -> dict[str, Any]:
    """Return the JSON schema of the study file."""
    return StudyFields.model_json_schema(by_alias=True)


def check_study_fields(data: object, source: str) -> StudyFields:
    """Check the shape of a study given as nested dictionaries.

    Args:
        data: What a study file holds.
        source: What messages call it.

    Raises:
        ProblemError: A key is unknown, a value has the wrong type. The message names the field.
    """
    return check_fields(StudyFields, data, "a study is a map", source, None)
