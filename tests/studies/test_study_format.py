"""The study file's shape: what editors complete it with, and what messages say of it."""

from dataclasses import fields

import jsonschema
import pytest
from ruamel.yaml import YAML

from tubeplanner import PlanOptions, ProblemError
from tubeplanner.resources import bundled_studies
from tubeplanner.studies.study_format import OptionFields, check_study_fields, study_schema

SCHEMA = study_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def fields_of(**study):
    given = {"problem": "p.yaml", "vary": {"tube.radius": [0.01, "x2"]}, **study}
    return {"format": "tubeplanner/study", "study": given}


RANGE = {"from": 0, "to": "x2", "count": 3, "spacing": "log"}


@pytest.mark.parametrize(
    "given",
    [
        fields_of(),
        fields_of(problem=["a.yaml", "b.yaml"], vary={}),
        fields_of(vary={"tube.radius": RANGE, "goal": [None, {"joints": [0]}]}),
        fields_of(design={"latin": 10, "seed": 1}, options={"quality": "fast", "slack": 0}),
        {**fields_of(), "version": 1},
    ],
)
def test_these_are_studies(given):
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    VALIDATOR.validate(given)
    check_study_fields(given, "s.yaml")


def test_bundled_studies_are_valid():
    assert bundled_studies()
    for path in bundled_studies().values():
        VALIDATOR.validate(YAML(typ="safe", pure=True).load(path.read_text()))


VALUES = "it must be a list of values, or a map with from, to and count"
KEYS = "problem, vary, design, options"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (fields_of(vary={"a.b": 1}), f"study.vary.a.b is 1; {VALUES}"),
        (fields_of(vary={"a.b": {"from": 1}}), "study.vary.a.b.to is required"),
        (
            fields_of(vary={"a.b": {"from": "2x", "to": 1}}),
            "study.vary.a.b.from is '2x'; it must be a number, or a factor such as x0.5",
        ),
        (fields_of(vary={"a.b": {**RANGE, "count": True}}), "study.vary.a.b.count is True"),
        (fields_of(vary={"a.b": {**RANGE, "spacing": "cubic"}}), "study.vary.a.b.spacing is"),
        (fields_of(design="random"), "study.design is 'random'; it must be grid, or a map with"),
        (fields_of(design={"latin": 2.5}), "study.design.latin is 2.5; it must be a whole number"),
        (fields_of(options={"qualty": 1}), "study.options: unknown key 'qualty' (did you mean"),
        (fields_of(options={"slack": "0"}), "study.options.slack is '0'; it must be a number"),
        (fields_of(problems="a"), f"'problems' (did you mean 'problem'?); there is: {KEYS}"),
        ({"format": "tubeplanner/study"}, "study is required"),
        ({"study": {"problem": "a"}}, "format is required"),
        ([], "a study is a map"),
    ],
)
def test_what_is_wrong_is_named(given, message):
    with pytest.raises(ProblemError) as caught:
        check_study_fields(given, "s.yaml")
    assert str(caught.value).startswith("s.yaml: ")
    assert message in str(caught.value)


def test_options_are_those_of_plan():
    assert list(OptionFields.model_fields) == [each.name for each in fields(PlanOptions)]
    given, usual = OptionFields().model_dump(), PlanOptions()
    assert {**given, "suh_bishop": usual.suh_bishop} == {
        each.name: getattr(usual, each.name) for each in fields(PlanOptions)
    }


def test_every_field_has_a_description():
    for section in (SCHEMA, *SCHEMA["$defs"].values()):
        assert section["description"]
        for name, field in section["properties"].items():
            assert field["description"], name
