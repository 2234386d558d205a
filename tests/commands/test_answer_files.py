"""What is written once there is an answer, and what is not."""

import signal
from contextlib import suppress

import pytest

from stored_trajectories import REFINEMENT, stored_path
from tubeplanner.commands.answer_files import write_answer
from tubeplanner.commands.interrupts import interrupts_remembered

PROBLEM = "example:two_link/around_a_post"
MOTION = stored_path("two_link/around_a_post", REFINEMENT)


def test_from_the_writing_on_an_interrupt_ends_nothing(tmp_path):
    with interrupts_remembered():
        write_answer({tmp_path / "a": b"new"})
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
    assert (tmp_path / "a").read_bytes() == b"new"


@pytest.mark.parametrize(
    ("words", "spoiled"),
    [
        ("view {motion} --html", "tubeplanner.views.viewer.page_html"),
        ("plot {motion} -o", "tubeplanner.views.figure_files.figure_file"),
        ("info --plot", "tubeplanner.views.figure_files.figure_file"),
    ],
)
def test_what_a_library_drew_that_swallowed_an_interrupt_is_not_written(
    run, tmp_path, monkeypatch, words, spoiled
):
    def draw(*_):
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return "half a page" if "page" in spoiled else b"half a figure"

    monkeypatch.setattr(spoiled, draw)
    command, *more = words.format(motion=MOTION).split()
    path = tmp_path / ("a.html" if "page" in spoiled else "a.png")
    path.write_text("precious")
    assert run(command, PROBLEM, *more, path)[0] == 130
    assert path.read_text() == "precious"


def test_an_answer_is_drawn_and_written_whole(run, tmp_path, monkeypatch):
    from tubeplanner.views import study_plots

    real = study_plots.plot_sweep

    def draw(result):
        signal.raise_signal(signal.SIGTERM)
        return real(result)

    monkeypatch.setattr(study_plots, "plot_sweep", draw)
    table, figure = tmp_path / "a.csv", tmp_path / "a.png"
    options = ("--radius-scale", "1", "--quality", "fast", "-o", table, "--plot", figure)
    assert run("sweep", PROBLEM, *options)[0] == 0
    assert table.exists()
    assert figure.read_bytes().startswith(b"\x89PNG")
