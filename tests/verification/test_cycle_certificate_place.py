"""Where a cycle's certificate says that something does not hold."""

from dataclasses import replace

import pytest

from small_cycle import planned_cycle, small_cycle
from tubeplanner import verify_cycle
from tubeplanner.outcome import Place


@pytest.fixture(scope="module")
def failing():
    """Return the certificate of a motion in a narrower tube, a seam and a refusal added."""
    motion = planned_cycle().motion
    narrow = small_cycle(moves__beside__tube__radius=0.01)
    judged = verify_cycle(narrow, replace(motion, cycle=narrow))
    stay = replace(judged.seams["closed"]["continuity"], margin=-1.0, where=Place(time=1.5))
    seams = {**judged.seams, "closed": {"continuity": stay}}
    return replace(judged, seams=seams, refused={"back": "it begins nowhere"})


def test_every_failure_has_its_place(failing):
    places = {failure: failing.place(failure) for failure in failing.failures()}
    assert places["back: start"] == Place(move="back")
    assert places["closed: continuity"] == Place(time=1.5)
    assert (places["beside: tube"].move, places["beside: tube"].segment) == ("beside", 0)
