import errno
import os
import resource
from contextlib import contextmanager

import pytest

from tubeplanner import OutputError
from tubeplanner.files.output_files import require_writable, write_files


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
    """Let this process write no file beyond some size [bytes], as a full disk does."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_failure_leaves_all_files_as_they_were(tmp_path):
    """The second file does not fit, when the first is there already, beside its target."""
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
    path, other = tmp_path / "t.json", tmp_path / "other.json"
    other.symlink_to(path)
    os.mkfifo(tmp_path / "pipe")
    for outputs, inputs, message in (
        ([tmp_path], [], "is no regular file; name one"),
        ([tmp_path / ("x" * 300)], [], "File name too long"),
        ([tmp_path / "pipe"], [], "is no regular file; name one"),
        ([tmp_path / "nowhere" / "t.json"], [], r"the folder .*nowhere does not exist; make it"),
        ([path, other], [], r"other\.json is the same file as .*t\.json; choose another"),
        ([path], [other], r"t\.json is the same file as .*other\.json; choose another"),
    ):
        with pytest.raises(OutputError, match=message):
            require_writable(outputs, inputs)
    require_writable([path, tmp_path / "second.json"])


def test_an_input_that_is_a_link_to_itself_is_refused(tmp_path):
    circle = tmp_path / "circle.json"
    circle.symlink_to(circle)
    with pytest.raises(OutputError, match=r"input .*circle\.json cannot be resolved"):
        require_writable([tmp_path / "page.html"], [circle])


def test_a_folder_that_is_locked_is_named_before_work_begins(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    message = r"output .*t\.json: the folder .* cannot be written to; name a file in another folder"
    with pytest.raises(OutputError, match=message):
        require_writable([tmp_path / "t.json"])
