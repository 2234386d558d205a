"""Damaged files for every reader."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

# A minute of the fuzzer: damaged files are read or refused in one line, and harm nothing.


ROOT = Path(__file__).parents[2]
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


# The fuzzer notices what it is there for.


# Put in the place of a reader, in a process of its own: forks need one thread.
PROGRAM = """
import json, os, time, warnings
from dataclasses import replace
from pathlib import Path
import fuzz, fuzz_kinds
from tubeplanner import TubePlannerError
fuzz.TIME_LIMIT, fuzz.MEMORY_LIMIT = 4.0, 200_000_000
fuzz._COMMANDS = 0.0

def raises(error):
    def read(path):
        raise error
    return read

class Bare(TubePlannerError):  # ours are on one line whatever they are given
    def __init__(self, message):
        Exception.__init__(self, message)

reads = {
    "refuses": raises(TubePlannerError("one line")),
    "accepts": lambda path: None,
    "two lines": raises(Bare("one\\ntwo")),
    "escape": raises(Bare("\\x1b[31m")),
    "another error": raises(KeyError("name")),
    "warns": lambda path: warnings.warn("of numbers"),
    "hangs": lambda path: time.sleep(60),
    "memory": lambda path: bytearray(b"a" * 400_000_000),
    "dies": lambda path: os.abort(),
    "leaves a file": lambda path: Path("stray").touch(),
}
points = fuzz_kinds.KINDS["points"]
fuzz.KINDS = {name: replace(points, read=read) for name, read in reads.items()}
for name in reads:
    print(json.dumps(fuzz.run_case(name, 0, Path("faults")).as_dict()), flush=True)
"""
ENVIRONMENT = {
    **os.environ,
    "PYTHONPATH": os.pathsep.join(map(str, (ROOT / "src", ROOT / "benchmarks"))),
    "OPENBLAS_NUM_THREADS": "1",
}
EXPECTED = {
    "refuses": ("refused", "one line"),
    "accepts": ("accepted", ""),
    "two lines": ("fault", "a message with"),
    "escape": ("fault", "a message with"),
    "another error": ("fault", "KeyError"),
    "warns": ("fault", "warned: of numbers"),
    "hangs": ("fault", "not done after 4 s"),
    "memory": ("fault", "took "),
    "dies": ("fault", "the process ended with"),
    "leaves a file": ("fault", "left ['stray']"),
}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Return what came of every reader, and the folder that it was kept in."""
    folder = tmp_path_factory.mktemp("fuzzed")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        **{"env": ENVIRONMENT, "cwd": folder, "capture_output": True, "text": True},
    )
    assert done.returncode == 0, done.stderr
    return {row["kind"]: row for row in map(json.loads, done.stdout.splitlines())}, folder


@pytest.mark.parametrize("name", EXPECTED)
def test_what_a_reader_does_wrong_is_noticed(name, found):
    outcomes, folder = found
    status, message = EXPECTED[name]
    assert outcomes[name]["status"] == status
    assert message in outcomes[name]["message"]
    assert (folder / "faults" / f"{name}.0" / "outcome.json").exists() == (status == "fault")
