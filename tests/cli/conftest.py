"""What tests of commands share: answers as JSON, a cycle, figures not drawn, no other processes."""

import json
from contextlib import nullcontext

import pytest
from small_cycle import SMALL
from studied import Here

from tubeplanner.cli import compare as comparison_report
from tubeplanner.cli import console, contents
from tubeplanner.cli import place as place_command
from tubeplanner.cli import plan as plan_outputs
from tubeplanner.cli import reproduce as reproduce_command
from tubeplanner.cli import simulate as simulate_command
from tubeplanner.cli import study as study_command
from tubeplanner.cli import sweep as study_commands
from tubeplanner.cli import view as view_command
from tubeplanner.output.figures import figure_files

PNG = b"\x89PNG"
DRAWING = (
    *(comparison_report, contents, place_command, plan_outputs, reproduce_command),
    *(simulate_command, study_command, study_commands, view_command),
)


@pytest.fixture(autouse=True, scope="module")
def real_figures():
    """Figures are not drawn, and those of motions empty: the tests of views look at them.

    The real functions, by module and name.
    """
    from matplotlib.figure import Figure

    from tubeplanner.output.figures import execution_figures, trajectory_figures

    def figure_file(figure, path):
        assert isinstance(figure, Figure)
        return PNG + bytes(2000)

    instead = {
        (figure_files, "figure_file"): figure_file,
        (trajectory_figures, "plot_motion"): lambda motion: Figure(),
        (execution_figures, "plot_executed_motion"): lambda motion, runs, judged: Figure(),
    }
    instead = {
        (module, name): function
        for (home, name), function in instead.items()
        for module in (home, *DRAWING)
        if hasattr(module, name)
    }
    with pytest.MonkeyPatch.context() as patch:
        real = {location: getattr(*location) for location in instead}
        for location, function in instead.items():
            patch.setattr(*location, function)
        yield real


@pytest.fixture
def drawn(real_figures, monkeypatch):
    """Figures are drawn after all, with few pixels."""
    monkeypatch.setattr(figure_files, "_DPI", 40)
    for location, function in real_figures.items():
        monkeypatch.setattr(*location, function)


@pytest.fixture
def here(monkeypatch):
    """Commands plan in this process; the list has what their workers were to be."""
    calls = []

    def workers(*arguments):
        calls.append(arguments)
        return nullcontext(Here())

    monkeypatch.setattr(console, "workers_of", workers)
    return calls


@pytest.fixture
def run_json(run):
    """Return a function from arguments to the exit status and the object that is printed."""

    def call(*arguments):
        status, out, _ = run(*arguments, "--json")
        return status, json.loads(out)

    return call


@pytest.fixture
def cycle_path(tmp_path):
    """The file of the small cycle."""
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path
