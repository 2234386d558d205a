"""What a cycle's certificate says of what holds and what does not."""

import json

import pytest

from cycles import HOME, PICK, PLACE, pick_and_place, slow_motion
from tubeplanner import CycleCertificate, JudgedCondition, Place, Tolerance, verify_cycle

CYCLE = pick_and_place()
SOUND = verify_cycle(CYCLE, slow_motion(CYCLE))


def certificate(margin=0.0, unit="rad", refused=None, tolerance=None):
    """Return the sound certificate with one seam alone."""
    condition = JudgedCondition(margin, unit, Place(time=1.0), "for all t")
    seams = {"a - b": {"continuity": condition}}
    return CycleCertificate(SOUND.moves, seams, refused or {}, tolerance or Tolerance())


def test_a_seam_holds_within_the_tolerance_of_its_unit():
    for unit in ("rad", "s"):
        assert certificate(-0.5, unit, tolerance=Tolerance(0.6, 0.1)).passed
        assert not certificate(-0.5, unit, tolerance=Tolerance(0.1, 0.6)).passed
    assert certificate(-0.5, "relative", tolerance=Tolerance(0.1, 0.6)).passed
    assert certificate(None).passed
    found = certificate(-0.1)
    assert found.failures() == ["a - b: continuity"]
    assert found.describe("a - b: continuity") == "a - b: continuity: margin -0.1 rad (for all t)"


def test_a_refused_move_fails_and_says_why():
    found = certificate(refused={"on": "start: no place"})
    assert found.failures() == ["on: start"]
    assert found.describe("on: start") == "on: start: no place"
    fields = found.as_dict()
    assert fields["passed"] is False
    assert fields["moves"]["on"] == {
        "passed": False,
        "refused": "start: no place",
        "conditions": {},
    }
    assert repr(found) == "<CycleCertificate fails on: start: 3 moves, 1 seams>"


def test_a_move_that_fails_is_described_as_its_certificate_does():
    away = verify_cycle(CYCLE, slow_motion(CYCLE, (HOME, PICK, PLACE, HOME + 0.01)))
    assert away.failures() == ["back: goal", "closed: continuity"]
    expected = away.moves["back"].describe("goal")
    assert away.describe("back: goal") == f"back: {expected}"


def test_it_is_written_as_json():
    fields = json.loads(json.dumps(SOUND.as_dict(), allow_nan=False))
    assert fields["passed"] is True
    assert fields["tolerance"] == {"absolute": 1e-6, "relative": 1e-6}
    assert list(fields["moves"]) == ["to_pick", "to_place", "back"]
    assert fields["moves"]["back"]["conditions"]["tube"]["satisfied"] is True
    seam = fields["seams"]["to_pick - to_place"]
    assert list(seam) == ["continuity", "dwell", "effort"]
    assert set(seam["dwell"]) == {"margin", "unit", "satisfied", "where", "coverage"}
    assert seam["dwell"]["margin"] == pytest.approx(0.0, abs=1e-12)
    assert seam["dwell"]["where"]["time"] == 2.0
    failed = certificate(-0.1).as_dict()
    assert failed["seams"]["a - b"]["continuity"]["satisfied"] is False
    assert repr(SOUND) == "<CycleCertificate passed: 3 moves, 5 seams>"
