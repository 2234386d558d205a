"""The study file's format; load_study."""

from dataclasses import fields
from pathlib import Path

import jsonschema
import pytest
from ruamel.yaml import YAML

from tubeplanner import PlanOptions, ProblemError, load_study
from tubeplanner.resources import bundled_studies
from tubeplanner.studies.axes import Interval, Levels
from tubeplanner.studies.study_format import OptionFields, check_study_fields, study_schema
from tubeplanner.studies.study_points import Latin
from tubeplanner.suh_bishop.suh_bishop import SuhBishopOptions

SCHEMA = study_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def fields_of(**study):
    given = {"problem": "p.yaml", "vary": {"tube.radius": [0.01, "x2"]}, **study}
    return {"format": "tubeplanner/study", "study": given}


RANGE = {"from": 0, "to": "x2", "count": 3, "spacing": "log"}


def test_these_are_studies():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    for document in (
        fields_of(),
        fields_of(problem=["a.yaml", "b.yaml"], vary={}),
        fields_of(vary={"tube.radius": RANGE, "goal": [None, {"joints": [0]}]}),
        fields_of(design={"latin": 10, "seed": 1}, options={"quality": "fast", "slack": 0}),
        {**fields_of(), "version": 1},
    ):
        VALIDATOR.validate(document)
        check_study_fields(document, "s.yaml")
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


def test_options_are_those_of_plan_and_every_field_has_a_description():
    names = [each.name for each in fields(PlanOptions)]
    assert list(OptionFields.model_fields) == names
    given, usual = OptionFields().model_dump(), PlanOptions()
    values = {name: getattr(usual, name) for name in names}
    assert {**given, "suh_bishop": usual.suh_bishop} == values
    for section in (SCHEMA, *SCHEMA["$defs"].values()):
        assert section["description"]
        for name, field in section["properties"].items():
            assert field["description"], name


POST = "example:two_link/around_a_post"
HEAD = f"format: tubeplanner/study\nstudy:\n  problem: {POST}\n"
VARY = "  vary: {tube.radius: [0.02, x2]}\n"
BETWEEN = "  vary: {clearance: {from: 0, to: 1, count: COUNT}}\n"


def read(tmp_path, text):
    path = tmp_path / "s.yaml"
    path.write_text(text)
    return load_study("s.yaml", tmp_path)


def test_a_grid_has_the_values_as_they_are_written(tmp_path):
    text = HEAD + "  vary: {tube.radius: [0.02, x2], clearance: {from: 0, to: 0.1, count: 3}}\n"
    study = read(tmp_path, text)
    assert study.name == f"{tmp_path.name}/s"
    assert [(axis.path, tuple(axis.values)) for axis in study.axes] == [
        ("tube.radius", (0.02, "x2")),
        ("clearance", (0, 0.05, 0.1)),
    ]
    assert (study.latin, study.options, len(study.points)) == (None, PlanOptions(), 6)
    assert study.posed(study.points[0]).document["clearance"] == 0
    assert [path.name for path in study.files] == ["s.yaml", "around_a_post.yaml"]


def test_a_latin_hypercube_may_leave_counts_out(tmp_path):
    text = HEAD + (
        "  vary: {tube.radius: {from: x0.5, to: x2, spacing: log}, clearance: [0, 0.01]}\n"
        "  design: {latin: 7, seed: 2}\n"
        "  options: {method: suh-bishop, suh_bishop: {doubled: 2, modification: {growth: 2}}}\n"
    )
    study = read(tmp_path, text)
    assert study.axes[0] == Interval("tube.radius", 0.5, 2.0, True, True)
    assert study.latin == Latin(7, 2)
    assert len(study.points) == 7
    assert study.options.method == "suh-bishop"
    assert study.options.suh_bishop.doubled == 2
    assert study.options.suh_bishop.modification.growth == 2
    assert study.options.suh_bishop.min_gain == SuhBishopOptions().min_gain


def test_several_problems_are_an_axis(tmp_path):
    Path(tmp_path / "p.yaml").write_text("include: example:two_link/around_a_post\n")
    text = "format: tubeplanner/study\nstudy: {problem: [p.yaml, example:ur5/over_the_wall]}\n"
    study = read(tmp_path, text)
    assert list(study.axes) == [Levels("problem", ("p.yaml", "example:ur5/over_the_wall"))]
    assert study.posed(study.points[1]).name == "ur5/over_the_wall"
    assert "post" in str(study.posed(study.points[0]).document["obstacles"])


def test_a_bundled_study_is_found_by_its_name():
    study = load_study("example:ur5/tolerance_and_payload")
    assert (study.name, len(study.points)) == ("ur5/tolerance_and_payload", 9)
    with pytest.raises(ProblemError, match=r"nowhere\.yaml does not exist"):
        load_study("nowhere.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "  vary: {tube.raduis: [1]}", "study.vary: tube.raduis: unknown key 'raduis'"),
        (HEAD, "study.vary: nothing is varied"),
        (HEAD + VARY + "  options: {quality: good}", "study.options: unknown quality 'good'"),
        (HEAD + VARY + "  options: {node_budget: 0}", "study.options: node_budget is 0; it must"),
        (
            HEAD + VARY + "  options: {suh_bishop: {doubld: 1}}",
            "study.options: unknown option 'doubld' (did you mean 'doubled'?); there is: ",
        ),
        (HEAD + VARY + "  design: {latin: 0}", "study.design: latin is 0; it must be >= 1"),
        (HEAD + BETWEEN.replace("COUNT", "1"), "study.vary.clearance: count is 1; it must be >= 2"),
        (HEAD + BETWEEN.replace("COUNT", "10000001"), "it must be >= 2 and <= 10000000"),
        (HEAD.replace("example:", "no/") + VARY, "study.problem: problem file"),
        (HEAD.replace(POST, "[]") + VARY, "study.problem: give at"),
        (HEAD.replace(POST, "s.yaml") + VARY, "s.yaml is a study"),
        ("tube: {}", "this is a problem, where a study is needed"),
        ("moves: []", "this is a cycle, where a study is needed"),
    ],
)
def test_what_is_wrong_names_file_and_field(tmp_path, text, message):
    with pytest.raises(ProblemError) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 's.yaml'}: ")
    assert message in str(caught.value)
