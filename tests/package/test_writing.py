"""Files written whole or not at all: staged content, held signals, all files of a run at once."""

import errno
import os
import resource
import shutil
import signal
import threading
from contextlib import contextmanager

import pytest
from stopped_writing import at_line

from tubeplanner import OutputError
from tubeplanner import writing as staged_file
from tubeplanner.writing import (
    StagedFile,
    require_writable,
    signals_held,
    temporary_path,
    write_files,
)


@contextmanager
def handled(**handlers):
    """Replace handlers of signals, by name, for a while."""
    before = {name: signal.signal(getattr(signal, name), each) for name, each in handlers.items()}
    try:
        yield
    finally:
        for name, handler in before.items():
            signal.signal(getattr(signal, name), handler)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_comes_at_the_end(name):
    came = []
    with handled(**{name: lambda *_: came.append("came")}):
        with signals_held():
            signal.raise_signal(getattr(signal, name))
            came.append("went on")
        assert came == ["went on", "came"]
        signal.raise_signal(getattr(signal, name))
        assert came == ["went on", "came", "came"]


def test_ctrl_c_goes_before_what_went_wrong():
    with (
        handled(SIGINT=signal.default_int_handler),
        pytest.raises(KeyboardInterrupt),
        signals_held(),
    ):
        signal.raise_signal(signal.SIGINT)
        raise ValueError("a full disk")


def test_another_thread_holds_nothing_and_is_not_in_the_way():
    done = []

    def work():
        with signals_held():
            done.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done == [signal.getsignal(signal.SIGINT)]


def test_it_is_beside_its_target_until_it_is_put(tmp_path):
    target = tmp_path / "a.json"
    with StagedFile(target) as file:
        file.write(b"content", 0o640)
        assert [path.name for path in tmp_path.iterdir()] == [".a.json.tmp"]
        file.sync()
        file.put()
    assert list(tmp_path.iterdir()) == [target]
    assert target.read_bytes() == b"content"
    assert target.stat().st_mode & 0o777 == 0o640


def put(path, content):
    with StagedFile(path) as file:
        file.write(content)
        file.put()


def test_it_is_removed_unless_it_is_put(tmp_path):
    with pytest.raises(ValueError, match="no answer"), StagedFile(tmp_path / "a"):
        raise ValueError("no answer")
    assert list(tmp_path.iterdir()) == []


def test_content_comes_whole_in_pieces(tmp_path, monkeypatch):
    write = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:3]))
    put(tmp_path / "a", b"0123456789")
    assert (tmp_path / "a").read_bytes() == b"0123456789"


def test_what_a_killed_process_left_is_taken_over(tmp_path):
    staged = temporary_path(tmp_path / "a")
    staged.write_bytes(b"half of a long answ")
    staged.chmod(0o644)
    with StagedFile(tmp_path / "a") as file:
        assert staged.read_bytes() == b""
        assert staged.stat().st_mode & 0o777 == 0o600
        file.write(b"new")
        file.put()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"new"}


def test_who_writes_the_same_file_waits(tmp_path):
    target = tmp_path / "a"
    thread = threading.Thread(target=put, args=(target, b"second"))
    with StagedFile(target) as file:
        thread.start()
        thread.join(0.1)
        assert thread.is_alive()
        file.write(b"first")
        file.put()
    thread.join()
    assert target.read_bytes() == b"second"
    assert list(tmp_path.iterdir()) == [target]


def test_who_waits_too_long_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(staged_file, "_PATIENCE", 0.0)
    with StagedFile(tmp_path / "a") as file:
        with pytest.raises(OSError, match="another process"):
            StagedFile(tmp_path / "a")
        file.write(b"first")
        file.put()
    assert (tmp_path / "a").read_bytes() == b"first"


def test_a_link_in_its_way_is_not_followed(tmp_path):
    other = tmp_path / "other"
    other.write_text("precious")
    temporary_path(tmp_path / "a").symlink_to(other)
    with pytest.raises(OSError, match="symbolic links"):
        StagedFile(tmp_path / "a")
    assert other.read_text() == "precious"


def test_a_name_as_long_as_names_may_be_is_written(tmp_path):
    names = ["x" * 255, "x" * 254 + "y"]
    with StagedFile(tmp_path / names[0]) as one, StagedFile(tmp_path / names[1]) as two:
        one.put()
        two.put()
    assert sorted(path.name for path in tmp_path.iterdir()) == names


def test_files_are_written_with_the_usual_mode(tmp_path):
    path = tmp_path / "new.json"
    write_files({path: b"content"})
    assert path.read_bytes() == b"content"
    assert list(tmp_path.iterdir()) == [path]
    plain = tmp_path / "plain"
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode


def test_a_replaced_file_keeps_its_mode_and_a_link_its_target(tmp_path):
    path, link = tmp_path / "old.json", tmp_path / "link.json"
    path.write_text("old")
    path.chmod(0o600)
    link.symlink_to(path)
    write_files({link: b"new"})
    assert link.is_symlink()
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o600


@contextmanager
def file_sizes_up_to(most):
    """Limit the size [bytes] of files that this process writes, like a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_failure_leaves_all_files_as_they_were(tmp_path):
    """The second file does not fit; the first is already staged beside its target."""
    first, second, folder = tmp_path / "first", tmp_path / "second", tmp_path / "folder"
    first.write_text("precious")
    message = r"second could not be written: File too large; raise the limit .*ulimit"
    with pytest.raises(OutputError, match=message), file_sizes_up_to(4096):
        write_files({first: b"new", second: bytes(10_000), folder / "third": b"new"}, folder)
    assert first.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [first]


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "No space left on device; make room, or name a file on another disk"),
        (errno.EROFS, "Read-only file system; name a file in another folder"),
    ],
)
@pytest.mark.parametrize("call", ["write", "fsync", "open"])
def test_what_the_system_refuses_has_a_remedy(tmp_path, monkeypatch, number, remedy, call):
    path = tmp_path / "a.json"
    path.write_text("precious")

    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, call, refuse)
    with pytest.raises(OutputError, match=f"output .*a.json could not be written: {remedy}"):
        write_files({path: b"new"})
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "precious"


def test_a_folder_is_made_for_the_files_in_it(tmp_path):
    folder = tmp_path / "all"
    for content in (b"first", b"second"):
        write_files({folder / "a": content}, folder)
        assert (folder / "a").read_bytes() == content
    write_files({}, tmp_path / "empty")
    assert (tmp_path / "empty").is_dir()
    with pytest.raises(OutputError, match=r"folder .*b could not be made: .*; name a file in"):
        write_files({}, tmp_path / "nowhere" / "b")


def test_places_that_cannot_be_written_to_are_named_before_work_begins(tmp_path):
    path, other, circle = (tmp_path / name for name in ("t.json", "other.json", "circle.json"))
    other.symlink_to(path)
    circle.symlink_to(circle)
    os.mkfifo(tmp_path / "pipe")
    for outputs, inputs, message in (
        ([tmp_path], [], "is no regular file; name one"),
        ([tmp_path / ("x" * 300)], [], "File name too long"),
        ([tmp_path / "pipe"], [], "is no regular file; name one"),
        ([tmp_path / "nowhere" / "t.json"], [], r"the folder .*nowhere does not exist; make it"),
        ([path, other], [], r"other\.json is the same file as .*t\.json; choose another"),
        ([path], [circle], r"input .*circle\.json cannot be resolved"),
        ([path], [other], r"t\.json is the same file as .*other\.json; choose another"),
    ):
        with pytest.raises(OutputError, match=message):
            require_writable(outputs, inputs)
    require_writable([path, tmp_path / "second.json"])


def test_a_folder_that_is_locked_is_named_before_work_begins(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    message = r"output .*t\.json: the folder .* cannot be written to; name a file in another folder"
    with pytest.raises(OutputError, match=message):
        require_writable([tmp_path / "t.json"])


# Writing that is stopped at every single line: by Ctrl-C, by SIGTERM, by SIGKILL.
OLD, NEW = (b"old", b"old"), (b"new one", b"new two")
NAMES = ("one.json", "two.json")


def ready(folder):
    """Return a folder of old files alone."""
    shutil.rmtree(folder / "out", ignore_errors=True)
    (folder / "out").mkdir()
    for name, content in zip(NAMES, OLD, strict=True):
        (folder / "out" / name).write_bytes(content)
    return folder / "out"


def write(folder):
    write_files({folder / name: content for name, content in zip(NAMES, NEW, strict=True)})


def contents(folder):
    return tuple((folder / name).read_bytes() for name in NAMES)


def count_of_lines(folder):
    with at_line(None, lambda: None) as lines:
        write(ready(folder))
    return len(lines)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_any_line_leaves_the_old_files_or_the_new_ones(tmp_path, number):
    def interrupt(*_):
        raise KeyboardInterrupt

    seen = set()
    for line in range(count_of_lines(tmp_path)):
        out = ready(tmp_path)
        with handled(SIGINT=interrupt, SIGTERM=interrupt):
            with (
                pytest.raises(KeyboardInterrupt),
                at_line(line, lambda: signal.raise_signal(number)),
            ):
                write(out)
            after = {signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
            assert number == signal.SIGTERM or after == {interrupt}, line
        seen.add(contents(out))
        assert {path.name for path in out.iterdir()} == set(NAMES), line
    assert seen == {OLD, NEW}


@pytest.mark.slow  # a process is killed at each of some hundred lines
def test_a_kill_at_any_line_leaves_whole_files_and_what_the_next_write_removes(tmp_path):
    remaining = set()
    for line in range(count_of_lines(tmp_path)):
        out = ready(tmp_path)
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
        remaining |= names
        write(out)
        assert contents(out) == NEW
        assert {path.name for path in out.iterdir()} == set(NAMES)
    assert remaining == {".one.json.tmp", ".two.json.tmp"}
