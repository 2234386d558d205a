"""What a journal holds is checked before it is used."""

import pytest

from tubeplanner.outcome import Place
from tubeplanner.studies.answer_fields import require_fields
from tubeplanner.studies.placement_row import PlacementRow
from tubeplanner.studies.study_row import StudyRow

PLACE = Place().as_dict()
ANSWER = {"status": "success", "where": PLACE, "notes": [], "duration": 1.5}
TRIED = {
    **{"position": [0.0, 0.0, 0.0], "yaw": 0.5, "status": "success", "message": ""},
    **{"where": PLACE, "duration": 1.5, "seeds": {"start": [0.1]}},
}
WRONG = {
    "duration": ("1.5", float("nan"), float("inf"), [], True),
    "status": ("fine", 3, None),
    "where": ({"segment": "first"}, {"nowhere": 1}, [], None),
    "notes": ("one", [1], None),
    "message": (3, None),
    "new": (1,),
}


def test_what_may_be_is():
    require_fields(Place, {"segment": 1, "links": ["a", "b"]})
    assert StudyRow.of(0, {}, "k", ANSWER).duration == 1.5
    assert PlacementRow.of_dict(TRIED).as_dict() == TRIED


@pytest.mark.parametrize("name, value", [(n, v) for n, values in WRONG.items() for v in values])
def test_what_may_not_be_is_refused(name, value):
    with pytest.raises((ValueError, TypeError, AttributeError)):
        StudyRow.of(0, {}, "k", {**ANSWER, name: value})


@pytest.mark.parametrize(
    "name, value",
    [("duration", "1"), ("seeds", {"start": ["a"]}), ("yaw", None), ("position", [0, 0]), ("x", 1)],
)
def test_nor_of_a_place(name, value):
    with pytest.raises(ValueError):
        PlacementRow.of_dict({**TRIED, name: value})
