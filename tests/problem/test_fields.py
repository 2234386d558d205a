"""What the fields of clearances and contacts mean."""

import pytest

from tubeplanner.errors import ProblemError
from tubeplanner.problem.clearance_fields import (
    ClearanceFields,
    ContactFields,
    clearances_of,
    contacts_of,
    segment_clearances,
)


def test_a_number_is_the_clearance_of_all():
    assert clearances_of(0.01) == {"clearance": 0.01}
    assert segment_clearances(0.01) is None


def test_a_map_has_a_default_pairs_and_segments():
    pairs = [{"links": ["hand", "wall"], "clearance": 0.03}]
    fields = ClearanceFields(default=0.01, pairs=pairs, segments=[None, 0.02])
    assert clearances_of(fields) == {
        "clearance": 0.01,
        "pair_clearances": {("hand", "wall"): 0.03},
    }
    assert segment_clearances(fields) == [None, 0.02]


def contact(segments):
    return [ContactFields(links=["hand", "wall"], within=0.1, segments=segments)]


@pytest.mark.parametrize(
    ("given", "count", "ends"),
    [
        (None, 3, ("start", "goal")),
        ([0], 3, ("start",)),
        ([-1], 3, ("goal",)),
        ([2], 3, ("goal",)),
        ([0, 2], 3, ("start", "goal")),
        ([0], 1, ("start", "goal")),
        ([-1], None, ("goal",)),
    ],
)
def test_segments_are_the_first_and_the_last(given, count, ends):
    (found,) = contacts_of(contact(given), count)
    assert (found.links, found.within, found.ends) == (("hand", "wall"), 0.1, ends)


@pytest.mark.parametrize(("count", "last"), [(3, "2 (or -1), the last"), (None, "-1, the last")])
def test_a_segment_between_is_refused(count, last):
    with pytest.raises(ProblemError, match=r"contacts\[0\].segments has 1; .* give 0") as error:
        contacts_of(contact([1]), count)
    assert last in str(error.value)
