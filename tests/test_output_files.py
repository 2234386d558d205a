import os

import pytest

from tubeplanner import OutputError
from tubeplanner.output_files import require_writable, write_files


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


def test_a_failure_leaves_all_files_as_they_were(tmp_path):
    """The second file cannot be staged: its folder vanished after it had been checked."""
    first, second = tmp_path / "first", tmp_path / "gone" / "second"
    first.write_text("precious")
    with pytest.raises(OutputError, match="second could not be written: No such file"):
        write_files({first: b"new", second: b"new"})
    assert first.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [first]


def test_places_that_cannot_be_written_to_are_named_before_work_begins(tmp_path):
    path, other = tmp_path / "t.json", tmp_path / "other.json"
    other.symlink_to(path)
    os.mkfifo(tmp_path / "pipe")
    for outputs, inputs, message in (
        ([tmp_path], [], "is no regular file; name one"),
        ([tmp_path / "pipe"], [], "is no regular file; name one"),
        ([tmp_path / "nowhere" / "t.json"], [], r"the folder .*nowhere does not exist"),
        ([path, other], [], r"other\.json is the same file as .*t\.json; choose another"),
        ([path], [other], r"t\.json is the same file as .*other\.json; choose another"),
    ):
        with pytest.raises(OutputError, match=message):
            require_writable(outputs, inputs)
    require_writable([path, tmp_path / "second.json"])
