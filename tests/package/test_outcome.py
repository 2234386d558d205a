"""What is announced of nested work, and what of it reaches a terminal."""

import os
import pty
import subprocess
import sys

import pytest

from tubeplanner.outcome import PlanningClock, Progress, TimeLimitReached


def test_stages_are_announced_as_parts_of_what_they_are_in():
    stages = []
    clock = PlanningClock(None, lambda progress: stages.append(str(progress)))
    with clock.within("route 2 of 3"):
        clock.enter("planning")
        with clock.within("tube 1 of 4"):
            clock.announce(Progress("measuring", best_duration=0.5))
    clock.enter("certificate")
    assert stages == [
        "route 2 of 3, planning",
        "route 2 of 3, tube 1 of 4, measuring, best 0.5000 s",
        "certificate",
    ]


def test_a_part_that_ends_early_is_over():
    stages = []
    clock = PlanningClock(None, lambda progress: stages.append(progress.stage))
    with pytest.raises(TimeLimitReached), clock.within("route 1 of 3"):
        raise TimeLimitReached
    clock.enter("certificate")
    assert stages == ["certificate"]


CODE = """
from tubeplanner.cli.console import shown_progress
with shown_progress() as enter:
    enter("part 1 of 2 [red]")
"""


def test_a_terminal_shows_stage_and_time():
    reader, writer = pty.openpty()
    subprocess.run([sys.executable, "-c", CODE], stderr=writer, check=True)
    os.close(writer)
    output = os.read(reader, 10_000).decode()
    os.close(reader)
    assert "part 1 of 2 [red] ..." in output
    assert "0:00:0" in output


def test_a_pipe_gets_nothing():
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")
