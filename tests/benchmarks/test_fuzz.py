"""Damaged files of every kind are read or refused in one line, and the fuzzer notices faults."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz_kinds import KINDS

# Damaged files of every kind are read in processes.
pytestmark = [pytest.mark.slow, pytest.mark.study]

ROOT = Path(__file__).parents[2]
CASES = 1  # of each kind; `benchmarks/fuzz.py` does as many as there is time for
# In a process of its own, as forks need one thread: first the fuzzer as it is, then others in the
# place of readers. Only what hangs is not waited for.
PROGRAM = """
import json, os, sys, time, warnings
from dataclasses import replace
from pathlib import Path
import fuzz, fuzz_kinds
from tubeplanner import TubePlannerError

fuzz.TIME_LIMIT = 600.0
sys.argv = ["fuzz.py", "--seed", "1", "--cases", CASES, "--folder", "fuzzed"]
print(json.dumps({"status": fuzz.main()}), flush=True)

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
    "hangs": lambda path: time.sleep(600),
    "memory": lambda path: bytearray(b"a" * 100_000_000),
    "dies": lambda path: os.abort(),
    "leaves a file": lambda path: Path("stray").touch(),
}
points = fuzz_kinds.KINDS["points"]
fuzz.KINDS = {name: replace(points, read=read) for name, read in reads.items()}
fuzz.MEMORY_LIMIT, fuzz._COMMANDS = 50_000_000, 0.0
for name in reads:
    fuzz.TIME_LIMIT = 0.5 if name == "hangs" else 600.0
    print(json.dumps(fuzz.run_case(name, 0, Path("faults")).as_dict()), flush=True)
"""
EXPECTED = {
    "refuses": ("refused", "one line"),
    "accepts": ("accepted", ""),
    "two lines": ("fault", "a message with"),
    "escape": ("fault", "a message with"),
    "another error": ("fault", "KeyError"),
    "warns": ("fault", "warned: of numbers"),
    "hangs": ("fault", "not done after 0.5 s"),
    "memory": ("fault", "took "),
    "dies": ("fault", "the process ended with"),
    "leaves a file": ("fault", "left ['stray']"),
}


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory):
    """Return what a run of the fuzzer printed, and the folder in which it ran."""
    folder = tmp_path_factory.mktemp("fuzzed")
    paths = os.pathsep.join(map(str, (ROOT / "src", ROOT / "benchmarks")))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.replace("CASES", repr(str(CASES)))],
        env={**os.environ, "PYTHONPATH": paths, "OPENBLAS_NUM_THREADS": "1"},
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines(), folder


def test_every_reader_reads_or_refuses(fuzzed):
    lines, _ = fuzzed
    assert '{"status": 0}' in lines, "\n".join(lines)
    rows = [line.split("|")[1:6] for line in lines if line.startswith("| ")][1:]
    assert [row[0].strip() for row in rows] == list(KINDS)
    for _, cases, refused, accepted, faults in rows:
        assert int(cases) == int(refused) + int(accepted) == CASES
        assert int(faults) == 0
    assert sum(int(row[2]) for row in rows) > len(rows) / 2


@pytest.mark.parametrize("name", EXPECTED)
def test_what_a_reader_does_wrong_is_noticed(name, fuzzed):
    lines, folder = fuzzed
    outcomes = [json.loads(line) for line in lines if line.startswith("{")][1:]
    outcome = next(each for each in outcomes if each["kind"] == name)
    status, message = EXPECTED[name]
    assert outcome["status"] == status
    assert message in outcome["message"]
    assert (folder / "faults" / f"{name}.0" / "outcome.json").exists() == (status == "fault")
