"""The study file: its format, and `load_study`."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import BeforeValidator, ConfigDict, Discriminator, Field, Tag

from tubeplanner.checks import checked_path, is_number
from tubeplanner.errors import OptionError, ProblemError, unknown_name
from tubeplanner.fields import Finite, Flag, Section, Version, check_fields, no_flag
from tubeplanner.first_guess.suh_bishop import SuhBishopOptions
from tubeplanner.planning.options import PlanOptions
from tubeplanner.resources import find_problem
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.study import MAX_POINTS, PROBLEM, Axis, Latin, Levels, Study, interval
from tubeplanner.task.field_changes import factor_of
from tubeplanner.task.problem_format import is_study, read_document, require_study

# ---- The format: fields, units, defaults. Other tools read it, so names never change.

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
    options: OptionFields = Field(
        OptionFields.model_construct(), description="how every point is planned"
    )


class StudyFields(Section):
    """Many plans: of one or several problems, with other values of some fields."""

    what = "a study is a map"
    model_config = ConfigDict(title="tubeplanner study")

    format: Literal["tubeplanner/study"] = Field(description="what this file is")
    version: Version = Field(1, description="of the format")
    study: StudiedFields = Field(description="what is planned")


def study_schema() -> dict[str, Any]:
    """Return the JSON schema of the study file."""
    return StudyFields.model_json_schema(by_alias=True)


def check_study_fields(data: object, source: str) -> StudyFields:
    """Check the format of a study given as nested dictionaries.

    Raises:
        ProblemError: A key is unknown, a value has the wrong type. The message names the field.
    """
    return check_fields(StudyFields, data, source)


# ---- Reading.

_Options = TypeVar("_Options")


def load_study(name: str | Path, directory: str | Path = ".") -> Study:
    """Read a study file and the files of its problems.

    Args:
        name: A path, or `example:ROBOT/NAME` for a bundled study.
        directory: Folder of a relative path.

    Raises:
        ProblemError: A file cannot be read or contradicts its format, or a field path leads
            nowhere. Values that make a problem invalid do not raise: the reason is in their rows.
    """
    path = find_problem(name, checked_path("directory", directory))
    document = read_document(path, "study file")
    require_study(document, str(path))
    fields = check_study_fields(document, str(path)).study
    try:
        problems, latin = _problems(fields, path.parent), None
        with _within("design"):
            if isinstance(fields.design, LatinFields):
                latin = Latin(fields.design.latin, fields.design.seed)
        axes: list[Axis] = [_axis(field, values) for field, values in fields.vary.items()]
        if isinstance(fields.problem, list):
            axes.insert(0, Levels(PROBLEM, tuple(problems)))
        with _within("options"):
            suh_bishop = _build(SuhBishopOptions, fields.options.suh_bishop)
            options = PlanOptions(**{**fields.options.model_dump(), "suh_bishop": suh_bishop})
    except ProblemError as error:
        raise ProblemError(f"{path}: study.{error}") from None
    try:
        title = f"{path.resolve().parent.name}/{path.stem}"
        files = [path, *(find_problem(name, path.parent) for name in problems)]
        return Study(title, problems, axes, latin, options, files)
    except ProblemError as error:
        raise ProblemError(f"{path}: study.vary: {error}") from None


def _problems(fields: StudiedFields, folder: Path) -> dict[str, ProblemSpec]:
    names = fields.problem if isinstance(fields.problem, list) else [fields.problem]
    if not names:
        raise ProblemError("problem: give at least one")
    problems = {}
    for name in names:
        with _within("problem"):
            problems[name] = ProblemSpec.read(name, folder)
            if is_study(problems[name].document):
                raise ProblemError(f"{name} is a study itself; name a problem or a cycle")
    return problems


def _axis(path: str, values: Any) -> Axis:
    if not isinstance(values, RangeFields):
        return Levels(path, tuple(values))
    with _within(f"vary.{path}"):
        between = interval(path, values.from_, values.to, is_logarithmic=values.spacing == "log")
        if values.count is None:
            return between
        if not 2 <= values.count <= MAX_POINTS:
            raise ProblemError(f"count is {values.count}; it must be >= 2 and <= {MAX_POINTS}")
    return between.levels(values.count)


@contextmanager
def _within(field: str) -> Iterator[None]:
    """Put the path of a field before the message of an error."""
    try:
        yield
    except (ProblemError, OptionError) as error:
        raise ProblemError(f"{field}: {error}") from None


def _build(kind: type[_Options], values: Mapping[str, Any]) -> _Options:
    """Return options of values by name; a map becomes the options of its name."""
    defaults = {each.name: getattr(kind(), each.name) for each in fields(kind)}  # type: ignore[arg-type]
    for name in values:
        if name not in defaults:
            raise OptionError(unknown_name("option", name, defaults))
    converted = {
        name: _build(type(defaults[name]), value)
        if is_dataclass(defaults[name]) and isinstance(value, Mapping)
        else value
        for name, value in values.items()
    }
    return kind(**converted)
