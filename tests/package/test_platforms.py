"""Platforms without fcntl and resource: files and journals there."""

import subprocess
import sys

# Windows as far as this machine can play it; fcntl.lockf locks the byte at the position.
PROGRAM = """
import fcntl, os, subprocess, sys
from types import ModuleType
def locking(descriptor, mode, count):
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB, count, 0, os.SEEK_CUR)
    except BlockingIOError:
        raise PermissionError(13, "Permission denied") from None
sys.modules["msvcrt"] = msvcrt = ModuleType("msvcrt")
msvcrt.locking, msvcrt.LK_NBLCK = locking, 2
sys.modules["fcntl"] = sys.modules["resource"] = None
from pathlib import Path
from tubeplanner import OutputError, writing
from tubeplanner.studies.journal import Journal
import tubeplanner.robot.ros_files
os.supports_fd.discard(os.chmod)
writing._IS_WINDOWS = True
path = Path(sys.argv[1])
try:
    with Journal(path) as journal:
        journal.add("key", {}, {"status": "success"})
        print(journal["key"], flush=True)
        sys.stdin.read()
    with Journal(path) as journal:
        assert "key" in journal
except OutputError as error:
    sys.exit(str(error))
table = path.with_name("t.csv")
writing.temporary_path(table).write_bytes(b"left by a killed process")
writing.write_files({table: b"a\\n"})
writing.write_files({table: b"b\\n"})
"""


def test_files_and_journals_need_neither_fcntl_nor_resource(tmp_path):
    command = [sys.executable, "-c", PROGRAM, str(tmp_path / "t.jsonl")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as first:
        assert first.stdout.readline() == b"{'status': 'success'}\n"
        second = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
        assert second.returncode == 1
        assert "is in use by another process" in second.stderr
    assert first.returncode == 0
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["t.csv", "t.jsonl"]
    assert (tmp_path / "t.csv").read_bytes() == b"b\n"
