"""Small studies, and an executor that plans them in this process."""

from concurrent.futures import Executor, Future

from tubeplanner import PlanOptions
from tubeplanner.outcome import PlanStatus
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.study import Interval, Levels, Study, StudyResult, StudyRow

PROBLEM = "example:two_link/paper_1_30mm"
QUICK = PlanOptions("stop-at-corners")
RADIUS, MASS, EFFORT = "tube.radius", "robot.payload.mass", "robot.limits.scale.effort"


class Here(Executor):
    """Makes every call at once, in this process; counts them."""

    def __init__(self):
        self.calls = 0

    def submit(self, fn, /, *args, **kwargs):
        self.calls += 1
        future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Together(Here):
    """Makes its calls when it has a number of them."""

    def __init__(self, count):
        super().__init__()
        self.count, self.waiting = count, []

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        self.waiting.append((future, super().submit(fn, *args, **kwargs)))
        if len(self.waiting) == self.count:
            for promised, done in self.waiting:
                promised.set_result(done.result())
        return future


def small_study(vary=None, latin=None, options=QUICK):
    """Return a study of the two-link arm: values by path, or axes."""
    vary = {RADIUS: [0.02, 0.03]} if vary is None else vary
    axes = vary if isinstance(vary, list) else [Levels(p, tuple(v)) for p, v in vary.items()]
    problems = {"arm": ProblemSpec.read(PROBLEM)}
    return Study("small", problems, axes, latin, options)


def some_result(vary, latin=None, blocked=lambda values: False, fields=None):
    """Return a result that was not planned: durations count from 1, but where it is blocked."""
    study = small_study(vary, latin)
    rows = []
    for point in study.points:
        if blocked(point.values):
            row = StudyRow(point.index, point.values, PlanStatus.TUBE_BLOCKED, message="no way")
        else:
            given = {"duration": 1.0 + point.index, "shortest_duration": 0.5, **(fields or {})}
            row = StudyRow(point.index, point.values, PlanStatus.SUCCESS, **given)
        rows.append(row)
    return StudyResult(study, tuple(rows))


def between(path, first, last, *, log=False, factor=False):
    """Return an axis of any value between two."""
    return Interval(path, first, last, log, factor)
