"""Writing that is stopped at every single line: by Ctrl-C, by SIGTERM, by SIGKILL."""

import os
import signal

import pytest

from stopped_writing import at_line
from tubeplanner.files.output_files import write_files

OLD, NEW = (b"old", b"old"), (b"new one", b"new two")
NAMES = ("one.json", "two.json")


@pytest.fixture
def folder(tmp_path):
    """Return a folder that is made ready again by a call, and has the files of `write`."""
    (tmp_path / "out").mkdir()

    def ready():
        for path in (tmp_path / "out").iterdir():
            path.unlink()
        for name, content in zip(NAMES, OLD, strict=True):
            (tmp_path / "out" / name).write_bytes(content)
        return tmp_path / "out"

    return ready


def write(folder):
    write_files({folder / name: content for name, content in zip(NAMES, NEW, strict=True)})


def contents(folder):
    return tuple((folder / name).read_bytes() for name in NAMES)


def count_of_lines(folder):
    with at_line(None, lambda: None) as lines:
        write(folder)
    return len(lines)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_any_line_leaves_the_old_files_or_the_new_ones(folder, number):
    def interrupt(*_):
        raise KeyboardInterrupt

    handlers = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    seen = set()
    try:
        for line in range(count_of_lines(folder())):
            for each in handlers:
                signal.signal(each, interrupt)
            out = folder()
            with (
                pytest.raises(KeyboardInterrupt),
                at_line(line, lambda: signal.raise_signal(number)),
            ):
                write(out)
            seen.add(contents(out))
            assert {path.name for path in out.iterdir()} == set(NAMES), line
            if number == signal.SIGINT:
                assert {signal.getsignal(each) for each in handlers} == {interrupt}, line
    finally:
        for each, handler in handlers.items():
            signal.signal(each, handler)
    assert seen == {OLD, NEW}


def test_a_kill_at_any_line_leaves_whole_files_and_what_the_next_write_removes(folder):
    left = set()
    for line in range(count_of_lines(folder())):
        out = folder()
        child = os.fork()
        if child == 0:
            with at_line(line, lambda: os.kill(os.getpid(), signal.SIGKILL)):
                write(out)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL
        for found, old, new in zip(contents(out), OLD, NEW, strict=True):
            assert found in (old, new), line
        names = {path.name for path in out.iterdir()} - set(NAMES)
        assert names <= {".one.json.tmp", ".two.json.tmp"}, line
        left |= names
        write(out)
        assert contents(out) == NEW
        assert {path.name for path in out.iterdir()} == set(NAMES)
    assert left == {".one.json.tmp", ".two.json.tmp"}
