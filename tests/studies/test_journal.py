"""The journal: what is in it survives any end, and nothing that is none is touched."""

import json
import os
import resource
import subprocess
import sys

import pytest

from tubeplanner.errors import OutputError
from tubeplanner.studies import journal as journal_module
from tubeplanner.studies.journal import Journal

ANSWER = {"status": "success", "duration": 0.1 + 0.2}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "t.jsonl"


def add(path, *keys):
    with Journal(path) as journal:
        for number, key in enumerate(keys):
            journal.add(key, {"a.b": number}, {**ANSWER, "number": number})


def keys(path):
    return [json.loads(line)["key"] for line in path.read_text().splitlines()]


def test_answers_are_found_again_bit_by_bit(path):
    add(path, "p", "q")
    with Journal(path) as journal:
        assert "p" in journal
        assert "r" not in journal
        assert journal["q"] == {**ANSWER, "number": 1}
        assert journal["p"] == {**ANSWER, "number": 0}
        journal.add("r", {"a.b": float("inf")}, ANSWER)
        assert journal["r"] == ANSWER
        assert len(journal) == 3
    assert keys(path) == ["p", "q", "r"]
    assert json.loads(path.read_text().splitlines()[2])["values"] == {"a.b": ".inf"}


def test_a_line_is_in_the_file_as_soon_as_it_is_added(path):
    with Journal(path) as journal:
        journal.add("p", {}, ANSWER)
        assert keys(path) == ["p"]


@pytest.mark.parametrize("length", [1, 5, 9, 30, -1])
def test_a_torn_last_line_is_dropped(path, length):
    add(path, "p", "q")
    first, second = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + second[:length])
    with Journal(path) as journal:
        assert "p" in journal
        assert "q" not in journal
        assert path.read_bytes() == first
        journal.add("r", {}, ANSWER)
    assert keys(path) == ["p", "r"]
    path.write_bytes(first[:length])
    with Journal(path) as journal:
        assert len(journal) == 0
    assert path.read_bytes() == b""


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("hello\n", 1),
        ("hello", 1),
        ("{}\n", 1),
        ('{"key": 3, "row": {"status": "success"}}\n', 1),
        ('{"key": "p", "row": {"status": "success"}}\n\n', 2),
        ('{"key": "p", "row": {"status": "success"}}\n{"key": "q", "ro\n', 2),
        ('{"key": "p", "row": {"status": "success"}}\nhello', 2),
        ('{"key": "p", "row": []}\n', 1),
        ("\x00\xff\n", 1),
    ],
)
def test_what_is_no_journal_stays_as_it_is(path, text, line):
    path.write_text(text, "latin-1")
    with pytest.raises(OutputError, match=f"line {line} is none of a study's journal"):
        Journal(path)
    assert path.read_text("latin-1") == text


def test_two_processes_do_not_share_one(path):
    program = f"from tubeplanner.studies.journal import Journal; Journal({str(path)!r})"
    program = program.replace("Journal('", "Journal(__import__('pathlib').Path('") + ")"
    with Journal(path):
        other = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        with pytest.raises(OutputError, match="is in use by another process"):
            Journal(path)
    assert "OutputError" in other.stderr
    assert "is in use by another process" in other.stderr
    add(path, "p")


def test_a_folder_is_none(tmp_path):
    with pytest.raises(OutputError, match="cannot be opened: Is a directory; name another"):
        Journal(tmp_path)


def test_a_pipe_is_none_and_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match="pipe is no regular file; name one"):
        Journal(tmp_path / "pipe")


@pytest.mark.parametrize(
    "line", [b"[" * 100_000, b'{"key": "p", "row": []}', b'{"key": "p", "row": 1}', b"\xff"]
)
def test_a_line_that_is_none_is_refused_by_number(path, line):
    path.write_bytes(line + b"\n")
    with pytest.raises(OutputError, match="line 1 is none of a study's journal"):
        Journal(path)
    assert path.read_bytes() == line + b"\n"


def test_a_line_without_end_is_not_read_to_its_end(path, monkeypatch):
    monkeypatch.setattr(journal_module, "_MAX_LINE", 1000)
    path.write_bytes(b'{"key": "p", "row": {"status": "' + b"a" * 2000 + b'"}}\n')
    with pytest.raises(OutputError, match="line 1 is none of a study's journal"):
        Journal(path)


def test_an_answer_that_nothing_can_be_made_of_is_refused_by_key(path):
    add(path, "p")

    def make(answer):
        raise KeyError("where")

    with Journal(path) as journal:
        assert journal.made("p", dict) == {**ANSWER, "number": 0}
        with pytest.raises(OutputError, match=r"the line of key 'p' holds no answer .*where"):
            journal.made("p", make)


def test_a_full_disk_is_named_and_what_was_kept_stays(path):
    """Nothing is left in a buffer that would be written, and fail, once more in the end."""
    add(path, "p")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    message = r"journal .*t\.jsonl cannot be written: File too large; make room, or name a table"
    try:
        with pytest.raises(OutputError, match=message), Journal(path) as journal:
            resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 20, before[1]))
            journal.add("q", {}, ANSWER)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    add(path, "r")
    assert keys(path) == ["p", "r"]
