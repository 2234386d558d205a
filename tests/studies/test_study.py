"""Study: its file, problems, axes, designs of points."""

from dataclasses import fields
from itertools import product
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from ruamel.yaml import YAML
from studied import MASS, RADIUS, between, small_study

from tubeplanner import PlanOptions, ProblemError, load_study
from tubeplanner.first_guess.suh_bishop import SuhBishopOptions
from tubeplanner.resources import bundled_studies
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.study import (
    MAX_POINTS,
    Interval,
    Latin,
    Levels,
    Study,
    StudyPoints,
    interval,
)
from tubeplanner.studies.study_file import OptionFields, check_study_fields, study_schema

SCHEMA = study_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
RANGE = {"from": 0, "to": "x2", "count": 3, "spacing": "log"}
VALUES = "it must be a list of values, or a map with from, to and count"
KEYS = "problem, vary, design, options"
POST = "example:two_link/around_a_post"
HEAD = f"format: tubeplanner/study\nstudy:\n  problem: {POST}\n"
VARY = "  vary: {tube.radius: [0.02, x2]}\n"
BETWEEN = "  vary: {clearance: {from: 0, to: 1, count: COUNT}}\n"


def fields_of(**study):
    given = {"problem": "p.yaml", "vary": {"tube.radius": [0.01, "x2"]}, **study}
    return {"format": "tubeplanner/study", "study": given}


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
        (fields_of(design="random"), "study.design is 'random'; it must be grid, or a map with"),
        (fields_of(design={"latin": 2.5}), "study.design.latin is 2.5; it must be a whole number"),
        (fields_of(options={"qualty": 1}), "study.options: unknown key 'qualty' (did you mean"),
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


def read(tmp_path, text):
    path = tmp_path / "s.yaml"
    path.write_text(text)
    return load_study("s.yaml", tmp_path)


def test_a_grid_has_the_values_as_they_are_written(tmp_path):
    text = HEAD + "  vary: {tube.radius: [0.02, x2], clearance: {from: 0, to: 0.1, count: 3}}\n"
    study = read(tmp_path, text)
    assert study.name == f"{tmp_path.name}/s"
    axes = {axis.path: tuple(axis.values) for axis in study.axes}
    assert axes == {"tube.radius": (0.02, "x2"), "clearance": (0, 0.05, 0.1)}
    assert (study.latin, study.options, len(study.points)) == (None, PlanOptions(), 6)
    assert study.spec(study.points[0]).document["clearance"] == 0
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
    assert (len(study.points), study.options.method) == (7, "suh-bishop")
    usual, given = SuhBishopOptions(), study.options.suh_bishop
    assert (given.doubled, given.modification.growth, given.min_gain) == (2, 2, usual.min_gain)


def test_several_problems_are_an_axis(tmp_path):
    Path(tmp_path / "p.yaml").write_text("include: example:two_link/around_a_post\n")
    text = "format: tubeplanner/study\nstudy: {problem: [p.yaml, example:ur5/over_the_wall]}\n"
    study = read(tmp_path, text)
    assert list(study.axes) == [Levels("problem", ("p.yaml", "example:ur5/over_the_wall"))]
    assert study.spec(study.points[1]).name == "ur5/over_the_wall"
    assert "post" in str(study.spec(study.points[0]).document["obstacles"])


def test_a_bundled_study_is_found_by_its_name():
    study = load_study("example:ur5/tolerance_and_payload")
    assert (study.name, len(study.points)) == ("ur5/tolerance_and_payload", 9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "  vary: {tube.raduis: [1]}", "study.vary: tube.raduis: unknown key 'raduis'"),
        (HEAD, "study.vary: nothing is varied"),
        (
            HEAD + VARY + "  options: {suh_bishop: {doubld: 1}}",
            "study.options: unknown option 'doubld' (did you mean 'doubled'?); there is: ",
        ),
        (HEAD + VARY + "  design: {latin: 0}", "study.design: latin is 0; it must be >= 1"),
        (HEAD + BETWEEN.replace("COUNT", "1"), "study.vary.clearance: count is 1; it must be >= 2"),
        (HEAD + BETWEEN.replace("COUNT", "2, spacing: log"), "clearance: from is 0 and"),
        (HEAD.replace("example:", "no/") + VARY, "study.problem: problem file"),
        (HEAD.replace(POST, "[]") + VARY, "study.problem: give at"),
        (HEAD.replace(POST, "s.yaml") + VARY, "s.yaml is a study"),
        ("moves: []", "this is a cycle, where a study is needed"),
    ],
)
def test_what_is_wrong_names_file_and_field(tmp_path, text, message):
    with pytest.raises(ProblemError) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(f"{tmp_path / 's.yaml'}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("ends", "log", "values"),
    [
        ((0.01, 0.02), False, (0.01, 0.012, 0.014, 0.016, 0.018, 0.02)),
        (("x0.5", "x1"), False, ("x0.5", "x0.6", "x0.7", "x0.8", "x0.9", "x1")),
        (("x1", "x32"), True, ("x1", "x2", "x4", "x8", "x16", "x32")),
    ],
)
def test_values_between_two_include_both(ends, log, values):
    axis = interval("tube.radius", *ends, is_logarithmic=log)
    levels = axis.levels(6)
    assert (tuple(levels.values), levels.values[1:3]) == (values, list(values[1:3]))
    assert tuple(axis.ends) == tuple(levels.ends) == (values[0], values[-1])
    assert list(map(type, levels.values)) == list(map(type, values))


def test_any_value_goes_by_its_share_of_the_way():
    assert interval("a", 2, 4, is_logarithmic=False).at(0.25) == 2.5
    assert interval("a", 1, 10_000, is_logarithmic=True).at(0.25) == 10
    assert interval("a", "x1", "x2", is_logarithmic=False).at(0.123456789) == "x1.123456789"
    levels = Levels("a", ("p", "q", "r"))
    assert [levels.at(fraction) for fraction in (0, 0.33, 0.34, 0.99)] == ["p", "p", "q", "r"]
    millions = interval("a", 0, 1, is_logarithmic=False).levels(10**7 + 1)  # made one by one
    assert (millions.values[10**6], millions.at(0.9999999)) == (0.1, 0.9999999)
    with pytest.raises(IndexError):
        millions.values[10**7 + 1]
    # One value without parts shows whether others can be set.
    values = (1, 2, "x0.5", "p", "x2", [1], None, [1], {"a": 1})
    assert Levels("a", values).ends == (1, "x0.5", [1], [1], {"a": 1})


@pytest.mark.parametrize(
    ("ends", "log", "message"),
    [
        ((0, "x2"), False, "from is 0 and to is 'x2'; give two numbers or two factors"),
        ((0, 2), True, "from is 0 and to is 2; with spacing log both must be > 0"),
        (("x2", "x2.0"), False, "from and to are both 'x2'; give a list of one value"),
    ],
)
def test_what_has_nothing_between_is_refused(ends, log, message):
    with pytest.raises(ProblemError) as caught:
        interval("a", *ends, is_logarithmic=log)
    assert str(caught.value) == message


def test_a_grid_has_all_pairs_the_last_field_first_made_one_by_one():
    first, second, third = (1, 2), ("a", "b", "c"), (None,)
    points = StudyPoints([Levels("p", first), Levels("q", second), Levels("r", third)], None)
    assert len(points) == 6
    expected = [dict(zip("pqr", each, strict=True)) for each in product(first, second, third)]
    assert [(point.index, point.values) for point in points] == list(enumerate(expected))
    many = StudyPoints([Levels("p", range(3000)), Levels("q", range(3000))], None)
    assert many[8_999_999].values == {"p": 2999, "q": 2999}
    with pytest.raises(IndexError):
        many[9_000_000]


def test_a_latin_hypercube_has_one_point_in_every_part_of_every_field():
    axes = [between("p", 0, 10), between("q", 1, 1024, log=True), Levels("r", ("a", "b"))]
    points = StudyPoints(axes, Latin(10, seed=3))
    values = [point.values for point in points]
    assert len(values) == len(points) == 10
    assert sorted(int(each["p"]) for each in values) == list(range(10))
    assert sorted(int(np.log2(each["q"])) for each in values) == list(range(10))
    assert [each["r"] for each in values].count("a") == 5
    again, other = StudyPoints(axes, Latin(10, seed=3)), StudyPoints(axes, Latin(10, seed=4))
    assert [point.values for point in again] == values
    assert [point.values for point in other] != values


def test_what_cannot_be_counted_is_refused():
    with pytest.raises(ProblemError, match="p: count is required in a grid"):
        StudyPoints([between("p", 0, 1)], None)
    with pytest.raises(ProblemError, match=f"{10**8} points; at most {MAX_POINTS}"):
        StudyPoints([Levels("p", range(10**4)), Levels("q", range(10**4))], None)
    for count in (0, MAX_POINTS + 1):
        with pytest.raises(ProblemError, match=f"latin is {count}; it must be >= 1"):
            Latin(count)
    with pytest.raises(ProblemError, match="seed is -1; it must be >= 0"):
        Latin(1, -1)


def test_a_point_poses_its_problem_with_its_values():
    names = ["two_link/paper_1_30mm", "two_link/around_a_post"]
    arm, post = (ProblemSpec.read(f"example:{name}") for name in names)
    problems, both = {"arm": arm, "post": post}, Levels("problem", ("arm", "post"))
    study = Study("two", problems, [both, Levels(RADIUS, ("x2", 0.01)), Levels(MASS, (3,))])
    spec = [study.spec(point) for point in study.points]
    assert [each.name for each in spec] == [names[0]] * 2 + [names[1]] * 2
    assert [each.document["tube"]["radius"] for each in spec[:2]] == [0.06, 0.01]
    assert {each.document["robot"]["payload"]["mass"] for each in spec} == {3}
    assert arm.document["tube"]["radius"] == 0.03
    with pytest.raises(ProblemError, match=r"^arm: obstacles\.post\.position: "):
        Study("two", problems, [both, Levels("obstacles.post.position", ([0, 0, 0],))])
    # Values that a later one builds upon are set in their order.
    study = small_study({"robot.payload": [{"mass": 2, "com": [0, 0, 0]}], MASS: ["x2"]})
    assert study.spec(study.points[0]).document["robot"]["payload"]["mass"] == 4


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({RADIUS: [1], MASS: []}, "robot.payload.mass: give at least one value"),
        ({RADIUS: [0.1, "x2", None], MASS: [1, "x2"]}, "robot.payload.mass: nothing is given"),
        ([between(MASS, 0.5, 2, factor=True).levels(3)], f"{MASS}: nothing is given there: x0.5"),
        ({"include": ["a.yaml"]}, "include: values are changed after files are included"),
    ],
)
def test_what_no_point_can_have_is_found_at_once(vary, message):
    with pytest.raises(ProblemError) as caught:
        small_study(vary)
    assert str(caught.value).startswith(message)
