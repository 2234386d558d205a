"""Problems that are asked about and changes of them; trials that plan nothing; what is found."""

from copy import deepcopy
from pathlib import Path

from tubeplanner import ProblemSpec
from tubeplanner.outcome import TimeLimitReached
from tubeplanner.studies.changes import Change, Proposal, Question
from tubeplanner.studies.remedies import Headroom, Remedy, Trial

POST = {"name": "post.1", "cylinder": [0.03, 0.3], "position": [0.4, 0.22, 0.0]}
POINTS = [[0.45, -0.3, 0.0], [0.45, 0.1, 0.0], [0.2, 0.1, 0.0], [0.2, 0.45, 0.0]]
# The two-link arm goes round two corners, past a post.
PLANAR = {
    "robot": {
        "urdf": "example:two_link",
        "tool_frame": "hand",
        "gravity": [0, 0, 0],
        "limits": {"velocity": {"joint1": float("inf"), "joint2": float("inf")}},
    },
    "tube": {"points": POINTS, "radius": [0.03, 0.05, 0.05], "joint_signs": {"joint2": "-"}},
    "start": {"seed": [0.0, -1.0]},
    "obstacles": [POST],
}
# Both have an infinite value somewhere.
REMEDY = Remedy(
    field="tube.rotation_tolerance.0",
    before=0.1,
    after=0.3,
    unit="rad",
    duration=1.5,
    text="wider",
    changes={"tube.rotation_tolerance": [[0.3, 0.3, float("inf")]]},
    cost=2.0,
    too_little=0.29,
    too_little_text="0.29 rad",
    is_smallest=True,
)
ROOM = Headroom(
    field="robot.limits.position.turn",
    before=[-float("inf"), 1.0],
    after=None,
    unit="rad",
    duration=None,
    text="not even so",
    too_much=[-float("inf"), 0.5],
    too_much_text="0.5 rad",
    is_exact=False,
)


def asked(changes=None, folder=Path(".")):
    """Return the question about the planar problem with other values by field path."""
    return Question.of(ProblemSpec(deepcopy(PLANAR), folder, "asked").changed(changes or {}))


def the(changes, field, about=""):
    """Return the one of some changes that is of a field, and whose text has a word."""
    found = [each for each in changes if each.field == field and about in text_of(each)]
    assert len(found) == 1, found
    return found[0]


def text_of(change, fraction=0.5):
    """Return what a change by a fraction of its scale says."""
    return change.propose(fraction * min(change.scale, change.most)).text


def made(question, change, size):
    """Return the problem that a change by a size makes, after a look at what else it touches."""
    proposal = change.propose(size)
    after = question.spec.changed(proposal.changes).document
    touched = {path.split(".")[0] for path in proposal.changes}
    assert {key for key in after if after[key] != question.spec.document.get(key)} <= touched
    return question.load(proposal.changes)


def simple_change(field="tube.radius", scale=1.0, most=100.0, **others):
    """Return a change of a number that is 0, by as much as one likes."""

    def propose(size):
        return Proposal(
            {field: size}, size, f"{field} to {size:g}", f"{size:g} {others.get('unit', 'm')}"
        )

    fields = {"kind": "radius", "before": 0.0, "unit": "m", "propose": propose} | others
    return Change(field=field, scale=scale, most=most, **fields)


class StubTrials:
    """Answers at once; sizes from a threshold by field on are enough, if there is one.

    Those of `quick`, by field, are the thresholds of what is not tried thoroughly.

    Attributes:
        thorough: As `asked`, but only of thorough trials.
        asked: Field and size of every trial, in order.
    """

    def __init__(self, thresholds, budget=1000, helps=True, stop=TimeLimitReached, quick=None):
        self._thresholds, self._helps = thresholds, helps
        self._quick = {**thresholds, **(quick or {})}
        self._budget, self._stop = budget, stop
        self.asked, self.thorough = [], []

    @property
    def count(self):
        return len(self.asked)

    def of(self, asked, is_thorough):
        thresholds = self._thresholds if is_thorough else self._quick
        for location, (change, size) in enumerate(asked):
            if len(self.asked) >= self._budget:
                raise self._stop
            self.asked.append((change.field, size))
            self.thorough += [(change.field, size)] * is_thorough
            is_beyond = size >= thresholds.get(change.field, float("inf"))
            duration = 1.5 if is_beyond == self._helps else None
            yield location, Trial(size, change.propose(size), duration, is_thorough)
