"""Studies read from files."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

from tubeplanner.arguments import given_path
from tubeplanner.errors import OptionError, ProblemError, unknown_name
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.problem.document_kind import is_study, require_study
from tubeplanner.problem.problem_format import read_document
from tubeplanner.resources import find_problem
from tubeplanner.studies.axes import Axis, Levels, interval
from tubeplanner.studies.study import PROBLEM, Study
from tubeplanner.studies.study_format import (
    LatinFields,
    OptionFields,
    RangeFields,
    StudiedFields,
    check_study_fields,
)
from tubeplanner.studies.study_points import MOST_POINTS, Latin
from tubeplanner.suh_bishop.suh_bishop import SuhBishopOptions

_Options = TypeVar("_Options")


def load_study(name: str | Path, directory: str | Path = ".") -> Study:
    """Read a study file and the files of its problems.

    Args:
        name: A path, or `example:ROBOT/NAME` for a bundled study.
        directory: Where a relative path starts.

    Raises:
        ProblemError: A file cannot be read or contradicts its format, or a field path leads
            nowhere. Values that a problem refuses are no fault of the study: their rows say so.
    """
    path = find_problem(name, given_path("directory", directory))
    document = read_document(path, "study file")
    require_study(document, str(path))
    given = check_study_fields(document, str(path)).study
    try:
        problems, latin = _problems(given, path.parent), _latin(given.design)
        axes, options = _axes(given, problems), _options(given.options)
    except (ProblemError, OptionError) as error:
        raise ProblemError(f"{path}: study.{error}") from None
    try:
        called = f"{path.resolve().parent.name}/{path.stem}"
        files = [path, *(find_problem(name, path.parent) for name in problems)]
        return Study(called, problems, axes, latin, options, files)
    except ProblemError as error:
        raise ProblemError(f"{path}: study.vary: {error}") from None


def _problems(given: StudiedFields, folder: Path) -> dict[str, PosedProblem]:
    names = given.problem if isinstance(given.problem, list) else [given.problem]
    if not names:
        raise ProblemError("problem: give at least one")
    return {name: _problem(name, folder) for name in names}


def _problem(name: str, folder: Path) -> PosedProblem:
    try:
        posed = PosedProblem.read(name, folder)
    except ProblemError as error:
        raise ProblemError(f"problem: {error}") from None
    if is_study(posed.document):
        raise ProblemError(f"problem: {name} is a study itself; name a problem or a cycle")
    return posed


def _axes(given: StudiedFields, problems: Mapping[str, PosedProblem]) -> list[Axis]:
    chosen = [Levels(PROBLEM, tuple(problems))] if isinstance(given.problem, list) else []
    return [*chosen, *(_axis(path, values) for path, values in given.vary.items())]


def _axis(path: str, values: Any) -> Axis:
    if not isinstance(values, RangeFields):
        return Levels(path, tuple(values))
    try:
        between = interval(path, values.from_, values.to, is_logarithmic=values.spacing == "log")
    except ProblemError as error:
        raise ProblemError(f"vary.{path}: {error}") from None
    if values.count is None:
        return between
    if not 2 <= values.count <= MOST_POINTS:
        raise ProblemError(
            f"vary.{path}: count is {values.count}; it must be >= 2 and <= {MOST_POINTS}"
        )
    return between.levels(values.count)


def _latin(design: Any) -> Latin | None:
    if not isinstance(design, LatinFields):
        return None
    try:
        return Latin(design.latin, design.seed)
    except ProblemError as error:
        raise ProblemError(f"design: {error}") from None


def _options(given: OptionFields) -> PlanOptions:
    try:
        others = {**given.model_dump(), "suh_bishop": _made(SuhBishopOptions, given.suh_bishop)}
        return PlanOptions(**others)
    except OptionError as error:
        raise OptionError(f"options: {error}") from None


def _made(kind: type[_Options], given: Mapping[str, Any]) -> _Options:
    """Return options by their names; those that are options themselves, of maps."""
    defaults = {each.name: getattr(kind(), each.name) for each in fields(kind)}  # type: ignore[arg-type]
    for name in given:
        if name not in defaults:
            raise OptionError(unknown_name("option", name, defaults))
    made = {
        name: _made(type(defaults[name]), value)
        if is_dataclass(defaults[name]) and isinstance(value, Mapping)
        else value
        for name, value in given.items()
    }
    return kind(**made)
