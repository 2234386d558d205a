"""Which kind of file a document is: a problem or a cycle."""

from typing import Any, Final

from tubeplanner.errors import ProblemError

CYCLE_FORMAT: Final = "tubeplanner/cycle"


def is_cycle(document: Any) -> bool:
    """Return whether a document is meant as a cycle: its format says so, or it has moves."""
    if not isinstance(document, dict):
        return False
    return document.get("format") == CYCLE_FORMAT or "moves" in document


def require_problem(document: Any, source: str) -> None:
    """Raise ProblemError if a document, called so by messages, is a cycle."""
    if is_cycle(document):
        raise ProblemError(
            f"{source}: this is a cycle, where one problem is needed; plan, check, info, view, "
            "plot and simulate take cycles, and load_cycle in Python"
        )
