"""The program from its first import to its end: Ctrl-C and SIGTERM are answered all along."""

import json
import signal
import subprocess
import sys
import textwrap
import time

import pytest

ARGUMENTS = ["plan", "example:two_link/around_a_post", "--json"]


def program(before="", after="", arguments=ARGUMENTS):
    """Return a command that runs the program, with code around it."""
    code = f"""
import os, signal, sys
from tubeplanner.cli import start
{textwrap.dedent(before)}
try:
    start.run()
finally:
    {after or "pass"}
"""
    return [sys.executable, "-c", code, *arguments]


def ended(*arguments, **named):
    """Return how the program ended."""
    return subprocess.run(program(*arguments, **named), capture_output=True, text=True)


def pressed_at(imported, number):
    """Return code that sends a signal when a module begins to be imported."""
    return f"""
class Presser:
    def find_spec(self, name, path=None, target=None):
        if name == {imported!r}:
            os.kill(os.getpid(), {int(number)})

sys.meta_path.insert(0, Presser())
"""


# NumPy's own library imports numpy.exceptions, and does not load twice.
@pytest.mark.parametrize(
    ("imported", "number"),
    [
        ("click", signal.SIGINT),
        ("numpy.exceptions", signal.SIGINT),
        pytest.param(
            "pinocchio", signal.SIGTERM, marks=pytest.mark.dear("a process loads the libraries")
        ),
    ],
)
def test_an_interrupt_during_an_import_is_one_object_and_no_traceback(imported, number):
    done = ended(pressed_at(imported, number))
    assert done.returncode == 130
    assert json.loads(done.stdout)["status"] == "interrupted"
    assert "Traceback" not in done.stderr


@pytest.mark.dear("a process loads the libraries")
def test_an_interrupt_of_a_finalizer_prints_nothing_and_still_counts():
    """Python prints what a finalizer raises, and goes on."""
    done = ended(
        """
from tubeplanner.task import cycle_file as problem_or_cycle

class Finalized:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)

def loading(*names, load=problem_or_cycle.load_problem_or_cycle, **options):
    Finalized()
    return load(*names, **options)

problem_or_cycle.load_problem_or_cycle = loading
"""
    )
    assert done.returncode == 130
    assert json.loads(done.stdout)["status"] == "interrupted"
    assert done.stderr.strip() == ""


def test_what_else_a_finalizer_raises_is_printed():
    before = """
class Finalized:
    def __del__(self):
        raise ValueError("of a library")

def silence(callbacks=start._silence_callbacks):
    callbacks()
    Finalized()

start._silence_callbacks = silence
"""
    assert "ValueError: of a library" in ended(before, arguments=["--help"]).stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_after_all_is_written_changes_nothing(number):
    done = ended(after=f"os.kill(os.getpid(), {int(number)})", arguments=["--help"])
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("Usage: ")


@pytest.mark.parametrize(
    ("delay", "number"),
    [
        (0.0, signal.SIGTERM),
        pytest.param(0.4, signal.SIGINT, marks=pytest.mark.slow),  # libraries are loaded
    ],
)
def test_an_interrupt_at_any_time_is_one_object(delay, number):
    # Starting Python itself is not in our hands: the program says when it begins.
    command = program("print('begun', file=sys.stderr, flush=True); start.interrupts_noted()")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline() == "begun\n"
    time.sleep(delay + 0.02)
    process.send_signal(number)
    out, err = process.communicate(timeout=120)
    assert "Traceback" not in err
    assert process.returncode == (130 if json.loads(out)["status"] == "interrupted" else 0)


@pytest.mark.dear("a process starts a process")
def test_worker_processes_of_a_command_do_not_warn_either():
    code = """
import warnings
from tubeplanner.cli.start import _silence_libraries
from tubeplanner import WorkerProcesses

_silence_libraries()
with WorkerProcesses(1) as workers:
    workers.submit(warnings.warn, "loud").result()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
