"""Journal: one line of JSON per finished point, durable, checked on reading."""

import json
import os
import resource

import pytest

from tubeplanner.errors import OutputError
from tubeplanner.outcome import Location
from tubeplanner.studies import journal as journal_module
from tubeplanner.studies.journal import Journal, require_fields
from tubeplanner.studies.placement import PlacementRow
from tubeplanner.studies.study import StudyRow

KEPT = {"status": "success", "duration": 0.1 + 0.2}
PLACE = Location().as_dict()
ANSWER = {"status": "success", "where": PLACE, "notes": [], "duration": 1.5}
TRIED = {
    **{"position": [0.0, 0.0, 0.0], "yaw": 0.5, "status": "success", "message": ""},
    **{"where": PLACE, "duration": 1.5, "seeds": {"start": [0.1]}},
}
WRONG = [
    *(("duration", value) for value in ("1.5", float("nan"), float("inf"), True)),
    *(("where", value) for value in ({"segment": "first"}, {"nowhere": 1}, None)),
    *(("status", "fine"), ("notes", "one"), ("notes", [1]), ("message", 3), ("new", 1)),
]
WRONG_PLACES = [
    *(("duration", "1"), ("seeds", {"start": ["a"]}), ("yaw", None), ("position", [0, 0])),
    ("x", 1),
]
LINE = '{"key": "p", "row": {"status": "success"}}\n'


def test_answers_that_may_be_are_taken_and_others_refused():
    require_fields(Location, {"segment": 1, "links": ["a", "b"]})
    assert StudyRow.of(0, {}, "k", ANSWER).duration == 1.5
    assert PlacementRow.of_dict(TRIED).as_dict() == TRIED
    for name, value in WRONG:
        with pytest.raises((ValueError, TypeError, AttributeError)):
            StudyRow.of(0, {}, "k", {**ANSWER, name: value})
    for name, value in WRONG_PLACES:
        with pytest.raises(ValueError):
            PlacementRow.of_dict({**TRIED, name: value})


@pytest.fixture
def path(tmp_path):
    return tmp_path / "t.jsonl"


def add(path, *keys):
    with Journal(path) as journal:
        for number, key in enumerate(keys):
            journal.add(key, {"a.b": number}, {**KEPT, "number": number})


def keys(path):
    return [json.loads(line)["key"] for line in path.read_text().splitlines()]


def test_answers_are_found_again_bit_by_bit(path):
    add(path, "p", "q")
    with Journal(path) as journal:
        assert "p" in journal
        assert "r" not in journal
        assert journal["q"] == {**KEPT, "number": 1}
        assert journal["p"] == journal.made("p", dict) == {**KEPT, "number": 0}
        journal.add("r", {"a.b": float("inf")}, KEPT)
        assert keys(path) == ["p", "q", "r"]  # as soon as it is added
        assert journal["r"] == KEPT
        assert len(journal) == 3
        with pytest.raises(OutputError, match=r"the line of key 'p' holds no answer .*where"):
            journal.made("p", lambda answer: answer["where"])
    assert json.loads(path.read_text().splitlines()[2])["values"] == {"a.b": ".inf"}


@pytest.mark.parametrize("length", [1, 9, -1])
def test_a_torn_last_line_is_dropped(path, length):
    add(path, "p", "q")
    first, second = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + second[:length])
    with Journal(path) as journal:
        assert "p" in journal
        assert "q" not in journal
        assert path.read_bytes() == first
        journal.add("r", {}, KEPT)
    assert keys(path) == ["p", "r"]
    path.write_bytes(first[:length])
    with Journal(path) as journal:
        assert len(journal) == 0
    assert path.read_bytes() == b""


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('{"key": 3, "row": {"status": "success"}}\n', 1),
        (LINE + "\n", 2),
        (LINE + '{"key": "q", "ro\n', 2),
        ('{"key": "p", "row": []}\n', 1),
        ("\x00\xff\n", 1),
        ("[" * 100_000 + "\n", 1),
    ],
)
def test_what_is_no_journal_stays_as_it_is(path, text, line):
    path.write_text(text, "latin-1")
    with pytest.raises(OutputError, match=f"line {line} is none of a study's journal"):
        Journal(path)
    assert path.read_text("latin-1") == text


def test_one_that_is_in_use_is_not_shared(path):
    """By whoever opened the file, of this process or another: its lock is the file's."""
    with Journal(path), pytest.raises(OutputError, match="is in use by another process"):
        Journal(path)
    add(path, "p")


def test_folders_pipes_and_lines_without_end_are_refused_at_once(tmp_path, path, monkeypatch):
    with pytest.raises(OutputError, match="cannot be opened: Is a directory; name another"):
        Journal(tmp_path)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="pipe is no regular file; name one"):
        Journal(tmp_path / "pipe")
    monkeypatch.setattr(journal_module, "_MAX_LINE", 1000)
    path.write_bytes(b'{"key": "p", "row": {"status": "' + b"a" * 2000 + b'"}}\n')
    with pytest.raises(OutputError, match="line 1 is none of a study's journal"):
        Journal(path)


def test_a_full_disk_is_named_and_what_was_kept_stays(path):
    """Nothing is left in a buffer that would be written, and fail, once more in the end."""
    add(path, "p")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    message = r"journal .*t\.jsonl cannot be written: File too large; make room, or name a table"
    try:
        with pytest.raises(OutputError, match=message), Journal(path) as journal:
            resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 20, before[1]))
            journal.add("q", {}, KEPT)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    add(path, "r")
    assert keys(path) == ["p", "r"]
