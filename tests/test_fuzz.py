"""A minute of the fuzzer: damaged files are read or refused in one line, and harm nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CASES = 20  # of each kind
GROUPS = {
    "problems": ["problem-yaml", "problem-json", "include", "points", "cycle"],
    "questions": ["questions"],
    "robots": ["urdf", "srdf", "preset", "joint-limits"],
    "macros and meshes": ["xacro", "stl", "obj", "dae"],
    "motions and studies": [
        *("trajectory-json", "trajectory-csv", "trajectory-ros", "study", "journal"),
    ],
}


def fuzz(*arguments):
    return subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / "fuzz.py"), *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("group", GROUPS)
def test_every_reader_reads_or_refuses(group, tmp_path):
    kinds = [word for kind in GROUPS[group] for word in ("--only", kind)]
    done = fuzz("--cases", CASES, "--folder", tmp_path / "fuzzed", *kinds)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split("|")[1:6] for line in done.stdout.splitlines() if line.startswith("| ")]
    assert [row[0].strip() for row in rows[1:]] == GROUPS[group]
    for _, cases, refused, accepted, faults in rows[1:]:
        assert int(cases) == int(refused) + int(accepted) == CASES
        assert int(refused) > 0
        assert int(faults) == 0
