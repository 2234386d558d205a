"""The period of a controller, of which durations and breakpoints are multiples."""

from tubeplanner.errors import ProblemError
from tubeplanner.options import in_figures, is_number
from tubeplanner.problem.objective import is_multiple

_LEAST, _MOST = 1e-5, 1.0  # [s]


def require_period(period: float, duration: float | None) -> None:
    """Raise unless a period is one.

    Args:
        period: The controller's [s].
        duration: That the answer is to have [s]; None: any.

    Raises:
        ProblemError: It is out of its bounds, or the duration is no multiple of it.
    """
    if not is_number(period) or not _LEAST <= period <= _MOST:
        raise ProblemError(
            f"period is {in_figures(period)} s; give the controller's, {_LEAST:g} to {_MOST:g} s, "
            "or leave it out"
        )
    if duration is not None and not is_multiple(duration, period):
        raise ProblemError(
            f"objective.duration is {in_figures(duration)} s, no multiple of the period, "
            f"{period:g} s; give one, or leave one of them out"
        )
