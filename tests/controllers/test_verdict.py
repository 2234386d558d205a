"""What a controller says, as text and as JSON."""

import json

import pytest

from tubeplanner.controllers.controller_verdict import (
    ControllerFinding,
    ControllerVerdict,
    Effect,
)


def verdict(*effects):
    findings = tuple(ControllerFinding(effect, "an error", "a message") for effect in effects)
    return ControllerVerdict("fer", "an arm", "abort", findings)


@pytest.mark.parametrize(
    ("effects", "accepted", "summary"),
    [
        ((), True, "accepted"),
        ((Effect.NOTED,), True, "accepted"),
        ((Effect.ALTERED, Effect.NOTED), False, "would run otherwise"),
        ((Effect.ALTERED, Effect.REFUSED), False, "would abort"),
    ],
)
def test_the_gravest_finding_decides(effects, accepted, summary):
    found = verdict(*effects)
    assert (found.accepted, found.summary) == (accepted, summary)
    assert found.lines()[0] == f"fer (an arm): {summary}"
    assert len(found.lines()) == 1 + len(effects)


def test_json_has_the_findings():
    shown = json.loads(json.dumps(verdict(Effect.NOTED).as_dict()))
    assert shown["accepted"] is True
    assert shown["findings"][0]["effect"] == "noted"
    assert shown["findings"][0]["time"] is None
