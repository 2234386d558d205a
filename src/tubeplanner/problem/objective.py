"""What an answer is to be beside short."""

from dataclasses import dataclass
from typing import Any

from tubeplanner.errors import ProblemError, TubePlannerError, unknown_name
from tubeplanner.options import in_figures, is_number

MINIMISED = ("smoothness",)
_MAX_SLACK = 10.0


@dataclass(frozen=True)
class Objective:
    """What an answer is to be beside short.

    Attributes:
        slack: It may take this share more time than the shortest motion; 0: it is that.
        minimise: What the time is used for: "smoothness", for efforts that change little and
            slowly and small jerks.

    Raises:
        ProblemError: On construction, for slack that is no number from 0 to 10, or another name.
    """

    slack: float = 0.005
    minimise: str = MINIMISED[0]

    def __post_init__(self) -> None:
        require_slack("objective.slack", self.slack)
        if self.minimise not in MINIMISED:
            message = unknown_name("objective", self.minimise, MINIMISED)
            raise ProblemError(f"objective.minimise: {message}")


def require_slack(what: str, slack: Any, error: type[TubePlannerError] = ProblemError) -> None:
    """Raise an error unless something is a share of time."""
    if not is_number(slack) or not 0 <= slack <= _MAX_SLACK:
        raise error(
            f"{what} is {in_figures(slack)}; give a share of the shortest duration from 0 (the "
            f"shortest motion) to {_MAX_SLACK:g}"
        )
