"""Which kind of file a document is: a problem, a cycle or a study."""

from typing import Any, Final

from tubeplanner.errors import ProblemError

CYCLE_FORMAT: Final = "tubeplanner/cycle"
STUDY_FORMAT: Final = "tubeplanner/study"


def is_cycle(document: Any) -> bool:
    """Return whether a document is meant as a cycle: its format says so, or it has moves."""
    return _is_of(document, CYCLE_FORMAT, "moves")


def is_study(document: Any) -> bool:
    """Return whether a document is meant as a study: its format says so, or it has study."""
    return _is_of(document, STUDY_FORMAT, "study")


def require_problem(document: Any, source: str) -> None:
    """Raise ProblemError if a document, called so by messages, is a cycle or a study."""
    if is_cycle(document):
        raise ProblemError(
            f"{source}: this is a cycle, where one problem is needed; plan, check, info, view, "
            "plot and simulate take cycles, and load_cycle in Python"
        )
    if is_study(document):
        raise ProblemError(
            f"{source}: this is a study, where one problem is needed; study takes it, and "
            "load_study in Python"
        )


def require_study(document: Any, source: str) -> None:
    """Raise ProblemError if a document, called so by messages, is a problem or a cycle."""
    if isinstance(document, dict) and not is_study(document):
        kind = "a cycle" if is_cycle(document) else "a problem"
        raise ProblemError(
            f"{source}: this is {kind}, where a study is needed: a file with format: "
            f"{STUDY_FORMAT} and study: {{problem: ..., vary: ...}}; plan takes {kind}"
        )


def _is_of(document: Any, format_: str, key: str) -> bool:
    if not isinstance(document, dict):
        return False
    given = document.get("format")
    return key in document or (isinstance(given, str) and given == format_)
