"""Every reason for no plan has a mark of its own."""

import pytest

from tubeplanner.outcome import PlanStatus
from tubeplanner.views.palette import LINE_COLORS
from tubeplanner.views.status_marks import status_mark, status_words

WITH_PLAN = {PlanStatus.SUCCESS, PlanStatus.INTERRUPTED}


@pytest.mark.parametrize("kind", ["color", "marker", "hatch"])
def test_no_two_reasons_look_the_same(kind):
    drawn = [getattr(status_mark(status), kind) for status in set(PlanStatus) - WITH_PLAN]
    assert len(set(drawn)) == len(drawn) == len(PlanStatus) - 2
    assert LINE_COLORS[0] not in drawn


def test_a_status_in_words():
    assert status_words(PlanStatus.TUBE_BLOCKED) == "tube blocked"
