import os
import threading

import pytest

from tubeplanner import staged_file
from tubeplanner.staged_file import StagedFile, temporary_path


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


def test_it_is_removed_unless_it_is_put(tmp_path):
    with pytest.raises(ValueError, match="no answer"), StagedFile(tmp_path / "a"):
        raise ValueError("no answer")
    assert list(tmp_path.iterdir()) == []


def test_content_comes_whole_in_pieces(tmp_path, monkeypatch):
    write = os.write
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:3]))
    with StagedFile(tmp_path / "a") as file:
        file.write(b"0123456789")
        file.put()
    assert (tmp_path / "a").read_bytes() == b"0123456789"


def test_what_a_killed_process_left_is_taken_over(tmp_path):
    left = temporary_path(tmp_path / "a")
    left.write_bytes(b"half of a long answ")
    left.chmod(0o644)
    with StagedFile(tmp_path / "a") as file:
        assert left.read_bytes() == b""
        assert left.stat().st_mode & 0o777 == 0o600
        file.write(b"new")
        file.put()
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a": b"new"}


def test_who_writes_the_same_file_waits(tmp_path):
    target, order = tmp_path / "a", []

    def second():
        with StagedFile(target) as file:
            order.append("second")
            file.write(b"second")
            file.put()

    with StagedFile(target) as file:
        thread = threading.Thread(target=second)
        thread.start()
        thread.join(0.1)
        file.write(b"first")
        order.append("first")
        file.put()
    thread.join()
    assert order == ["first", "second"]
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
