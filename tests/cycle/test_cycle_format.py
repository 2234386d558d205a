"""The cycle file's shape: what editors complete it with, and what messages say of it."""

import copy
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from cycles import cycle_fields
from tubeplanner import ProblemError, load_cycle, parse_cycle
from tubeplanner.cycle.cycle_format import cycle_schema

SCHEMA = cycle_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
SAMPLE = Path(__file__).parent.parent / "cases" / "every_cycle_field.yaml"
MOVE = "name, tube, goal, limits, clearance, contacts, objective, collision, pass_through"
KIND = r"it must be a map with name \(of a move\), event, attach or detach"
TOP = (
    "format, version, include, robot, start, obstacles, clearance, collision, objective, "
    "period, closed, moves"
)


def changed(k, **changes):
    """Return the fields of a cycle of which one step has others; None: without."""
    fields = cycle_fields()
    for name, value in changes.items():
        fields["moves"][k][name] = value
        if value is None:
            del fields["moves"][k][name]
    return fields


def with_step(step):
    fields = cycle_fields()
    fields["moves"].insert(1, step)
    return fields


def sample():
    return YAML(typ="safe", pure=True).load(SAMPLE.read_text())


def test_cycles_are_valid():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    VALIDATOR.validate(cycle_fields())
    VALIDATOR.validate(sample())


def test_the_sample_has_every_field_and_is_a_cycle():
    fields = sample()
    assert list(fields) == TOP.split(", ")
    by_kind = {"name": "Move", "event": "Event", "attach": "Attach", "detach": "Detach"}
    for key, kind in by_kind.items():
        names = {name for step in fields["moves"] if key in step for name in step}
        assert names == set(SCHEMA["$defs"][f"{kind}Fields"]["properties"])
    cycle = load_cycle(SAMPLE)
    assert [len(leg.moves) for leg in cycle.legs] == [2, 1, 1]


@pytest.mark.parametrize(
    "fields",
    [
        changed(1, dwel=1),
        changed(1, dwell="1"),
        changed(0, tube=None),
        changed(0, goall={}),
        changed(2, payload={"mas": 1}),
        changed(2, shape={"name": "a", "box": [1, 1, 1]}),
        changed(1, event=None),
        changed(1, attach="part"),
        changed(0, collision={"self": True}),
        with_step(None),
        with_step("to_pick"),
        with_step({}),
        {**cycle_fields(), "moves": {"to_pick": {}}},
        {**cycle_fields(), "format": "tubeplanner/problem"},
        {**cycle_fields(), "tube": {"points": [[0, 0, 0], [1, 0, 0]], "radius": 1}},
        {name: value for name, value in cycle_fields().items() if name != "start"},
    ],
)
def test_wrong_ones_are_not(fields):
    assert list(VALIDATOR.iter_errors(fields))
    with pytest.raises(ProblemError):
        parse_cycle(fields)


def test_every_field_has_a_description_and_durations_their_unit():
    assert SCHEMA["title"] == "tubeplanner cycle"
    for section in (SCHEMA, *SCHEMA["$defs"].values()):
        assert section["description"]
        assert all(field.get("description") for field in section["properties"].values())
    assert "[s]" in SCHEMA["$defs"]["EventFields"]["properties"]["dwell"]["description"]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            changed(1, dwel=1),
            r"moves\[1\]: unknown key 'dwel' \(did you mean 'dwell'\?\); there is: event, set, d",
        ),
        (
            changed(2, paylod=1),
            r"moves\[2\]: unknown key 'paylod' .*; there is: attach, payload, shape$",
        ),
        (
            changed(5, leave=1),
            r"moves\[5\]: unknown key 'leave'.*; there is: detach, leave_as_obstacle$",
        ),
        (changed(0, goall=1), rf"moves\[0\]: unknown key 'goall' .*; there is: {MOVE}$"),
        (
            changed(1, attach="part"),
            r"moves\[1\]: unknown key 'attach'; there is: event, set, dwell",
        ),
        (
            changed(2, payload={"mas": 1}),
            r"moves\[2\]\.payload: unknown key 'mas' .*: mass, com, in",
        ),
        (
            changed(2, shape={"bx": 1}),
            r"moves\[2\]\.shape: unknown key 'bx' .*; there is: box, sph",
        ),
        (
            changed(0, collision={"self": True}),
            r"moves\[0\]\.collision: unknown key 'self'; there is: ig",
        ),
        (changed(0, tube={"radius": 1}), r"moves\[0\]\.tube\.points is required"),
        (changed(0, name=None), r"moves\[0\]\.name is required"),
        (changed(0, tube=None), r"moves\[0\]\.tube is required"),
        (changed(1, dwell="yes"), r"moves\[1\]\.dwell is 'yes'; it must be a number"),
        (changed(1, dwell=True), r"moves\[1\]\.dwell is True; it must be a number"),
        (changed(1, event=3), r"moves\[1\]\.event is 3; it must be text"),
        (
            changed(1, set=[1]),
            r"moves\[1\]\.set is \[1\]; it must be a text, a number, true or fal",
        ),
        (changed(3, pass_through="no"), r"moves\[3\]\.pass_through is 'no'; it must be true or f"),
        (with_step(None), rf"moves\[1\] is empty; {KIND}"),
        (with_step("go"), rf"moves\[1\] is 'go'; {KIND}"),
        (with_step({"payload": 1}), rf"moves\[1\] is \{{'payload': 1\}}; {KIND}"),
        ({**cycle_fields(), "moves": {"a": 1}}, r"moves is \{'a': 1\}; it must be a list"),
        ({**cycle_fields(), "moves": None}, "moves is empty; it must be a list"),
        ({**cycle_fields(), "robustness": {}}, f"top level: unknown key 'robustness' .*: {TOP}$"),
        ({**cycle_fields(), "closed": "y"}, "closed is 'y'; it must be true or false"),
    ],
)
def test_messages_name_the_step_and_its_field(fields, message):
    with pytest.raises(ProblemError, match=f"^my cycle: {message}"):
        parse_cycle(fields, name="my cycle")


@pytest.mark.parametrize("value", ["close", 0.4, 3, True, False, None])
def test_an_event_sets_what_it_is_given(value):
    fields = copy.deepcopy(cycle_fields())
    fields["moves"][1]["set"] = value
    VALIDATOR.validate(fields)
    setting = parse_cycle(fields).steps[1].setting
    assert setting == value
    assert type(setting) is (float if value == 3 and value is not True else type(value))
