"""Documents from outside: what they mean, and what bounds their time and memory."""

import json
import os
import tracemalloc

import pytest
import yaml
from ruamel.yaml import YAML

from tubeplanner.documents import (
    MAX_ALIASED,
    MAX_NESTING,
    DocumentError,
    parse_json,
    parse_yaml,
    read_bytes,
    read_text,
    require_shallow,
)
from tubeplanner.resources import bundled_cycles, bundled_problems

BUNDLED = bundled_problems() | bundled_cycles()


@pytest.mark.parametrize("name", sorted(BUNDLED))
def test_bundled_files_mean_what_another_reader_takes_them_for(name):
    text = BUNDLED[name].read_text()
    assert parse_yaml(text) == YAML(typ="safe", pure=True).load(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *(("", None), ("~", None), ("True", True), ("yes", "yes"), ("'1'", "1"), ("!!str 1", "1")),
        *(("!!float 1", 1), ("0x10", 16), ("0o10", 8), ("012", 12), ("-1_000", -1000)),
        *(("1e3", 1000.0), ("1.", 1.0), ("-.inf", float("-inf")), ("9" * 400, float("inf"))),
        *(("2001-01-01", "2001-01-01"), ("_1", "_1")),
        ("{a: 1, b: [x, null]}", {"a": 1, "b": ["x", None]}),
        ("a: &x {u: 1, v: 2}\nb: {<<: *x, v: 3}", {"a": {"u": 1, "v": 2}, "b": {"u": 1, "v": 3}}),
        ("{<<: [{a: 1}, {a: 2, b: 3}]}", {"a": 1, "b": 3}),
        ("'<<': 1", {"<<": 1}),
    ],
)
def test_yaml_means_what_its_core_schema_says(text, value):
    found = parse_yaml(text)
    assert found == value
    assert type(found) is type(value)


def test_a_second_document_is_refused_unless_it_is_left_out():
    assert parse_yaml("a: 1\n---\nb: 2\n", first_of_many=True) == {"a": 1}
    with pytest.raises(DocumentError, match="line 2, column 1: a second document begins"):
        parse_yaml("a: 1\n---\nb: 2\n")


def test_deep_nesting_is_refused_and_shallow_is_not():
    for opening in ("[", "{a: ", "- ", "? "):
        with pytest.raises(DocumentError, match=f"nested more than {MAX_NESTING} deep"):
            parse_yaml(opening * 50_000)
    assert parse_yaml("[" * MAX_NESTING + "]" * MAX_NESTING) is not None


def bomb(links, depth=9):
    rows = ["a0: &a0 {x: 1, y: 2}"]
    for k in range(1, depth + 1):
        rows.append(f"a{k}: &a{k} " + links.format(", ".join([f"*a{k - 1}"] * 10)))
    return "\n".join(rows)


@pytest.mark.parametrize("links", ["[{}]", "{{<<: [{}]}}"])
def test_aliases_of_aliases_end_at_once(links):
    with pytest.raises(DocumentError, match=f"stand for more than {MAX_ALIASED} values; write"):
        parse_yaml(bomb(links))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &x [*x]", "line 1, column 8: the alias 'x' holds itself"),
        ("a: *x", "the alias 'x' is not known"),
        ("<<: 1", "<< takes a map or a list of maps"),
        ("[1]: 2", "a list or map cannot be a key"),
        ("{a: 1, a: 2}", 'line 1, column 8: found duplicate key "a"'),
        ("a: !!python/name:os.system {}", "could not determine what the tag"),
        ("a: !!set {x}", "could not determine what the tag"),
        ("a: [1,", "line 1, at its end: did not find expected node content"),
        ("a:\n\tb: 1", "line 2, column 1: .* use spaces"),
        ("a: \x00", "control characters are not allowed"),
    ],
)
def test_a_malformed_text_is_refused_with_its_place(text, message):
    with pytest.raises(DocumentError, match=message) as caught:
        parse_yaml(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, f"nested more than {MAX_NESTING} deep"),
        ("[" * 101 + "]" * 101, f"nested more than {MAX_NESTING} deep"),
        ('{"a": 1, "a": 2}', "the key 'a' is given twice"),
        ("9" * 5000, "more than 4300 digits"),
        ("{", "line 1 column 2"),
    ],
)
def test_malformed_json_is_refused(text, message):
    with pytest.raises(DocumentError, match=message):
        parse_json(text)


def test_json_nested_up_to_the_limit_is_read_and_a_circle_is_refused():
    text = "[" * MAX_NESTING + "]" * MAX_NESTING
    assert json.dumps(parse_json(text)) == text
    circle = {"a": [1]}
    circle["a"].append((circle, circle))
    with pytest.raises(DocumentError, match=f"nested more than {MAX_NESTING} deep"):
        require_shallow(circle)


@pytest.mark.parametrize("row", ["- [0.1234567, 0.1234567, 0.1234567]\n", "- {a: 1, b: 2.5}\n"])
def test_a_document_takes_at_most_twenty_times_its_size(row):
    text = row * 1000
    parse_yaml(yaml.safe_dump([1]))  # what is imported does not count
    tracemalloc.start()
    parse_yaml(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * len(text)


def test_a_pipe_and_a_device_are_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path / "/dev/zero", tmp_path):
        with pytest.raises(DocumentError, match="it is no regular file; name one"):
            read_bytes(path, 100)


@pytest.mark.parametrize("name", ["\ud800", "a\0b"])
def test_a_name_that_no_file_can_have_is_refused(tmp_path, name):
    with pytest.raises(DocumentError, match="a character that no file's name can have"):
        read_bytes(tmp_path / name, 99)


def test_a_large_file_and_one_that_is_no_text_are_refused(tmp_path):
    (tmp_path / "a").write_bytes(b"\xff" * 100)
    with pytest.raises(DocumentError, match=r"it is larger than 9\.9e-05 MB"):
        read_bytes(tmp_path / "a", 99)
    with pytest.raises(DocumentError, match=r"it is no text: .* byte 0xff in position 0"):
        read_text(tmp_path / "a", 100)
