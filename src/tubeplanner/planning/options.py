"""PlanOptions: method, quality, budgets."""

from dataclasses import dataclass, field, replace

from tubeplanner.checks import require_between, require_count, require_kind
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.first_guess.suh_bishop import SuhBishopOptions
from tubeplanner.task.demands import require_slack

REFINEMENT, BRANCH_AND_BOUND = "refinement", "branch-and-bound"
STOP_AT_CORNERS, SUH_BISHOP = "stop-at-corners", "suh-bishop"
METHODS = (REFINEMENT, BRANCH_AND_BOUND, STOP_AT_CORNERS, SUH_BISHOP)


@dataclass(frozen=True)
class Quality:
    """Thoroughness of refinement."""

    # about the number of knot intervals in which refinement along a free route ends
    free_knots: int
    # first number of knot intervals, about, and numbers of parts of their successive divisions; one
    # run per pair, from the most natural start
    knots: tuple[tuple[int, tuple[int, ...]], ...]
    # the same for tubes that the first of these knots are too coarse to follow, and for paths of
    # many points, whose segments form chains
    narrow_knots: tuple[tuple[int, tuple[int, ...]], ...]
    # the same for another attempt on a branch that led nearly to an answer, or to one that may be
    # faster
    other_knots: tuple[tuple[int, tuple[int, ...]], ...] = ()
    every_start: bool = False  # whether other starts are tried even after a certified trajectory


_FEW, _FINER = (8, (4,)), (8, (3, 4))
QUALITIES = {
    "fast": Quality(32, (_FEW,), (_FEW,), (_FINER,)),
    "balanced": Quality(96, ((18, (4,)),), ((8, (3, 3)),), (_FINER,)),
    # the knots of all qualities, so that none has a faster answer
    "best": Quality(96, ((18, (4,)), _FINER, _FEW), ((8, (3, 3)), _FINER, _FEW), every_start=True),
}


@dataclass(frozen=True)
class PlanOptions:
    """Options of planning.

    Attributes:
        method: "refinement": path and speed optimised together; the next one where that is not
            certified. "branch-and-bound": the fastest trajectory through points of the reference
            path that cuts its corners inside the tube; the next one where it finds nothing faster.
            "stop-at-corners": along the reference path, resting at every reference point.
            "suh-bishop": both phases as published in 1988; no other method where they find nothing.
        quality: Of refinement. "fast": few knots, half to three quarters of the time, trajectories
            about 1 % slower. "balanced". "best": also with more knots and from every start there
            is, no slower than either, three to eight times the time.
        candidate_points: Number of points on the reference path, start and goal included, among
            which branch and bound chooses. More take longer, exponentially in the worst case, and
            give other trajectories, not always faster ones.
        node_budget: Number of nodes after which branch and bound ends with its best; the result
            says so.
        suh_bishop: Options of phase 2 of "suh-bishop".
        time_limit: Wall time after which planning ends with its best [s]; None: never.
        slack: Fraction by which refinement's answer may exceed the shortest duration, to be smooth
            or efficient; 0: the shortest. None: the slack of the problem's objective.
        robust: Whether the problem's field robustness counts.
        persistent: Whether "refinement" goes on after its first start without an answer, or where
            some sample of the reference path has no configuration: with other starts, narrower
            tubes, branch and bound. Without, a refusal takes a quarter of the time or less, and
            answers are the same, but that of a pose the first configuration with an answer is
            taken, not the fastest.
    """

    method: str = METHODS[0]
    quality: str = "balanced"
    candidate_points: int = 30
    node_budget: int = 10_000
    suh_bishop: SuhBishopOptions = field(default_factory=SuhBishopOptions)
    time_limit: float | None = None
    slack: float | None = None
    robust: bool = True
    persistent: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.method, str) or self.method not in METHODS:
            raise OptionError(unknown_name("method", self.method, METHODS))
        if not isinstance(self.quality, str) or self.quality not in QUALITIES:
            raise OptionError(unknown_name("quality", self.quality, QUALITIES))
        require_count(self, 2, "candidate_points", most=1000)
        require_count(self, 1, "node_budget")
        require_kind(self, "suh_bishop", SuhBishopOptions)
        if self.time_limit is not None:
            require_between(self, 0, None, "time_limit", unit="s")
        if self.slack is not None:
            require_slack("slack", self.slack, OptionError)

    @property
    def shortest(self) -> "PlanOptions":
        """Options with slack 0 unless given, as marks are of shortest motions."""
        return replace(self, slack=0.0) if self.slack is None else self
