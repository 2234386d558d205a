import os
import tempfile

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


def test_a_failure_leaves_all_files_as_they_were(tmp_path, monkeypatch):
    """The disk is full when the second file is written beside its target."""
    first, second = tmp_path / "first", tmp_path / "second"
    first.write_text("precious")
    make = tempfile.mkstemp

    def full(*_, prefix, **more):
        if "second" in prefix:
            raise OSError(28, "No space left on device")
        return make(prefix=prefix, **more)

    monkeypatch.setattr(tempfile, "mkstemp", full)
    with pytest.raises(OutputError, match="second could not be written: No space left"):
        write_files({first: b"new", second: b"new"})
    assert first.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [first]


def test_places_that_cannot_be_written_to_are_named_before_work_begins(tmp_path):
    path, other = tmp_path / "t.json", tmp_path / "other.json"
    other.symlink_to(path)
    os.mkfifo(tmp_path / "pipe")
    for outputs, inputs, message in (
        ([tmp_path], [], "is no regular file; name one"),
        ([tmp_path / ("x" * 300)], [], "File name too long"),
        ([tmp_path / "pipe"], [], "is no regular file; name one"),
        ([tmp_path / "nowhere" / "t.json"], [], r"the folder .*nowhere does not exist"),
        ([path, other], [], r"other\.json is the same file as .*t\.json; choose another"),
        ([path], [other], r"t\.json is the same file as .*other\.json; choose another"),
    ):
        with pytest.raises(OutputError, match=message):
            require_writable(outputs, inputs)
    require_writable([path, tmp_path / "second.json"])
