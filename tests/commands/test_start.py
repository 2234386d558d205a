"""The program from its first import to its end: Ctrl-C is answered in order all along."""

import json
import signal
import subprocess
import sys
import textwrap
import time

import pytest

ARGUMENTS = ["plan", "example:two_link/around_a_post", "--json"]


def program(before="", after=""):
    """Return a command that runs the program, with code around it."""
    code = f"""
import os, signal, sys
from tubeplanner.commands import start
{textwrap.dedent(before)}
try:
    start.run()
finally:
    {after or "pass"}
"""
    return [sys.executable, "-c", code, *ARGUMENTS]


def pressed_at(imported):
    """Return code that presses Ctrl-C when a module begins to be imported."""
    return f"""
class Presser:
    def find_spec(self, name, path=None, target=None):
        if name == {imported!r}:
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Presser())
"""


@pytest.mark.parametrize("imported", ["click", "tubeplanner.commands.cli", "numpy", "pinocchio"])
def test_an_interrupt_during_an_import_is_one_object_and_no_traceback(imported):
    done = subprocess.run(program(pressed_at(imported)), capture_output=True, text=True)
    assert done.returncode == 130
    assert json.loads(done.stdout)["status"] == "interrupted"
    assert "Traceback" not in done.stderr


def test_an_interrupt_after_all_is_written_changes_nothing():
    command = program(after="os.kill(os.getpid(), signal.SIGINT)")
    command[-3:] = ["schema"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0
    assert json.loads(done.stdout)["title"] == "tubeplanner problem"
    assert done.stderr == ""


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.2, 0.6])
def test_an_interrupt_at_any_time_is_one_object(delay):
    # Starting Python itself is not in our hands: the program says when it begins.
    command = program("print('begun', file=sys.stderr, flush=True); start.interrupts_noted()")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline() == "begun\n"
    time.sleep(delay + 0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert "Traceback" not in err
    assert process.returncode == (130 if json.loads(out)["status"] == "interrupted" else 0)
