"""Commands that write files, interrupted at lines of the code that writes them.

What they compute is kept from a first run: `benchmarks/interruptions.py` does the same for all
commands at hundreds of moments, and with SIGKILL.
"""

import json
import signal

import click
import pytest
from stopped_writing import at_line
from stored_trajectories import REFINEMENT, stored_path

from interruption_cases import CASES, MOTION, TEXTS, TRAIL, Kept
from interruption_runs import Location
from tubeplanner import load_problem, read_trajectory
from tubeplanner.cli.main import cli
from tubeplanner.output.files.trajectory_writer import trajectory_csv

BY_NAME = {case.name: case for case in CASES}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    for name, text in TEXTS.items():
        (folder / name).write_text(text)
    (folder / MOTION).write_bytes(stored_path("two_link/around_a_post", REFINEMENT).read_bytes())
    motion = read_trajectory(folder / MOTION)
    names = load_problem("example:two_link/around_a_post").robot.joint_names
    (folder / TRAIL).write_text(trajectory_csv(names, motion.sample(500)))
    return folder


@pytest.fixture
def command(run, inputs, tmp_path):
    """Return a function from a case to one from a line and a signal to place and exit status."""

    def prepare(case):
        kept = Kept(case)
        first = Location.new(tmp_path / "place", case)
        with kept.recorded():
            assert run(*case.arguments(inputs, first.out))[0] == 0

        def call(line=None, number=signal.SIGINT):
            place = Location.new(tmp_path / "place", case)
            words = case.arguments(inputs, place.out)
            with (
                kept.given_back(lambda _: None),
                at_line(line, lambda: signal.raise_signal(number)) as lines,
            ):
                status, out, err = run(*words, "--json")
            assert err.strip() == ""
            json.loads(out)
            return place.found(), status, len(lines)

        return call

    return prepare


def test_every_command_that_writes_files_is_among_them():
    writing = {
        name
        for name, command in cli.commands.items()
        for option in command.params
        if isinstance(option, click.Option) and isinstance(option.type, click.Path)
    }
    assert {case.words.split()[0] for case in CASES} == writing


@pytest.mark.slow  # it runs a study: 2 s
@pytest.mark.study
def test_what_is_computed_several_times_is_given_back_by_numbers(run, inputs, tmp_path):
    case = BY_NAME["study"]
    kept, numbers = Kept(case), []
    for replaced in (kept.recorded(), kept.given_back(numbers.append)):
        words = case.arguments(inputs, Location.new(tmp_path / "place", case).out)
        with replaced:
            assert run(*words)[0] == 0
    assert numbers == list(range(4)) and kept.count == 4


@pytest.mark.parametrize(
    "name",
    [
        "init",
        # Studies and comparisons plan several times before: 3 s each.
        pytest.param("study", marks=pytest.mark.slow),
        pytest.param("compare", marks=[pytest.mark.slow, pytest.mark.study]),
    ],
)
def test_files_are_all_new_with_the_answer_or_as_they_were(command, name, tmp_path):
    case = BY_NAME[name]
    call, old = command(case), Location.new(tmp_path / "old", case).found()
    new, status, count = call()
    assert status == 0
    assert set(new) == {*case.files, *[case.journal] * (case.journal is not None)}
    # The first lines are those that look whether files can be written, before there is an answer.
    assert call(0, signal.SIGINT)[:2] == (old, 130)
    assert call(count - 1, signal.SIGTERM)[:2] == (new, 0)
