"""Where a change begins to matter: between a size that was seen to be enough and one that was not.

What is possible is taken to stay possible as a remedy grows, and the impossible to stay impossible
as a change for the worse does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from tubeplanner.explanation.change import Change, rounded
from tubeplanner.explanation.trials import Trial, Trials

CLOSE = 1.05  # the ratio of sizes at which the search ends
_STEP = 10.0  # where one of the sizes is not known
_SMALLEST = 1e-3  # of the scale: below that nobody asks


@dataclass
class SizeBracket:
    """Two sizes of one change on either side of where it begins to matter.

    Attributes:
        change: The change.
        helps: Whether it makes possible what is not; else it makes impossible what is.
        smaller: The largest size that does not do so; None: none is known.
        larger: The smallest size that does; None: none is known.
    """

    change: Change
    helps: bool
    smaller: Trial | None = None
    larger: Trial | None = None

    @property
    def possible(self) -> Trial | None:
        """The trial nearest to where it begins to matter that was certified; None if none was."""
        return self.larger if self.helps else self.smaller

    @property
    def impossible(self) -> Trial | None:
        """The trial nearest to it that was not; None if all were."""
        return self.smaller if self.helps else self.larger

    @property
    def is_close(self) -> bool:
        """Whether nothing is left to be found out."""
        if self.smaller is None or self.larger is None:
            return False
        return self.larger.size <= CLOSE * self.smaller.size

    @property
    def is_done(self) -> bool:
        """Whether it is close, or there are no sizes left to try."""
        if self.is_close or (self.change.is_switch and (self.smaller or self.larger)):
            return True
        if self.smaller is None:
            least = _SMALLEST * self.change.scale
            return self.larger is not None and self.larger.size <= least
        return self.larger is None and self.smaller.size >= rounded(self.change.most)

    @property
    def cost(self) -> float:
        """The smallest size that matters over its scale; infinite while none is known."""
        return float("inf") if self.larger is None else self.larger.size / self.change.scale

    def keep(self, trial: Trial) -> None:
        """Keep what a trial shows."""
        if trial.succeeded == self.helps:
            self.larger = trial
        else:
            self.smaller = trial

    @property
    def next_size(self) -> float:
        """The size to try next: the geometric mean, or beyond the one that is known."""
        most = self.change.most
        if self.smaller is None and self.larger is None:
            return rounded(min(self.change.scale / 3, most))
        if self.smaller is None:
            assert self.larger is not None
            return rounded(self.larger.size / _STEP)
        if self.larger is None:
            return rounded(min(self.smaller.size * _STEP, most))
        return rounded((self.smaller.size * self.larger.size) ** 0.5)


def try_sizes(trials: Trials, asked: Sequence[tuple[SizeBracket, float]]) -> None:
    """Try the changes of brackets by sizes; each bracket keeps what that shows, once it is known.

    Raises:
        TimeLimitReached: There is no time left.
        KeyboardInterrupt: Ctrl-C.
    """
    for place, trial in trials.of([(bracket.change, size) for bracket, size in asked]):
        asked[place][0].keep(trial)
