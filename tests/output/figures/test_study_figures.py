"""Figures of sweeps, studies and comparisons; marks, scales and files of figures."""

from dataclasses import replace

import numpy as np
import pytest
from cases import simulated_sweep
from studied import EFFORT, MASS, RADIUS, between, small_study, some_result

from tubeplanner import OptionError, PlanOptions, compare, plot_field_sweep, plot_study, sweep_field
from tubeplanner.outcome import PlanStatus
from tubeplanner.output.drawing import LINE_COLORS
from tubeplanner.output.figures.figure_files import figure_file, new_figure, saved
from tubeplanner.output.figures.study_figures import plot_comparison
from tubeplanner.output.figures.sweep_figures import (
    ValueScale,
    status_mark,
    status_words,
    value_label,
)
from tubeplanner.studies.study import Latin, Levels, StudyResult

WITH_PLAN = {PlanStatus.SUCCESS, PlanStatus.INTERRUPTED}
PROBLEM = "example:two_link/paper_1_30mm"
METHODS = ("stop-at-corners", "bang-bang", "smoothed-bang-bang")


def test_no_two_reasons_look_the_same():
    marks = [status_mark(status) for status in set(PlanStatus) - WITH_PLAN]
    for kind in ("color", "marker", "hatch"):
        drawn = [getattr(mark, kind) for mark in marks]
        assert len(set(drawn)) == len(drawn) == len(PlanStatus) - 2
        assert LINE_COLORS[0] not in drawn
    assert status_words(PlanStatus.TUBE_BLOCKED) == "tube blocked"


@pytest.mark.parametrize(
    ("values", "positions", "is_scaled"),
    [
        ([0.2, 0, 3], [0.2, 0, 3], True),
        (["x0.5", "x2"], [0.5, 2], True),
        ([[1], [2], [1]], [0, 1, 0], False),
        ([True, False], [0, 1], False),
        ([1.0, float("inf")], [0, 1], False),
    ],
)
def test_numbers_and_factors_are_to_scale_others_in_a_row(values, positions, is_scaled):
    scale = ValueScale.of("a.b", values)
    np.testing.assert_array_equal(scale.positions, positions)
    assert scale.is_scaled == is_scaled


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.01, 0.02, 0.05, 0.1, 0.2], True),
        ([1, 2, 4], False),
        ([0, 10, 100], False),
        ([1, 100], False),
    ],
)
def test_values_that_are_even_by_ratio_are_on_a_logarithmic_axis(values, expected):
    scale = ValueScale.of("a.b", values)
    assert scale.is_logarithmic is expected


def test_values_in_a_row_have_labels_of_which_long_ones_keep_their_end():
    axis = new_figure(4, 3).add_subplot()
    ValueScale.of("problem", ["example:ur5/a", "example:ur5/b", "example:ur5/a"]).draw(axis)
    assert [label.get_text() for label in axis.get_xticklabels()] == ["ur5/a", "ur5/b"]
    path = "folder/of/folders/problem.yaml"
    assert value_label(path) == "..." + path[-21:]
    assert value_label([0.6, 0]) == "[0.6, 0]"


def drawn(path, values):
    """Return the axes of a sweep, and the durations of its rows."""
    options = PlanOptions("stop-at-corners") if "objective" not in path else PlanOptions()
    result = sweep_field(PROBLEM, path, values, options=options)
    return plot_field_sweep(result).axes[0], [row.duration for row in result.rows]


def lines(axes):
    """Return the drawn points by label, with values without a plan."""
    series = {line.get_label(): line.get_xydata() for line in axes.lines if len(line.get_xdata())}
    gaps = [xy[0, 0] for label, xy in series.items() if label.startswith("_")]
    return {label: xy for label, xy in series.items() if not label.startswith("_")}, gaps


def test_factors_are_drawn_to_scale():
    axes, durations = drawn("tube.radius", ["x2", "x1", "x-1"])
    series, gaps = lines(axes)
    expected = [[1, durations[1]], [2, durations[0]]]
    np.testing.assert_allclose(series["certified trajectory"], expected)
    assert gaps == [-1]
    assert axes.get_xlabel() == "factor on tube.radius [-]"
    assert "no plan: bad input" in axes.texts[0].get_text()


def test_the_shortest_is_drawn_beside_what_the_objective_makes_of_it():
    axes, durations = drawn("objective.slack", [0, 0.1])
    series, _ = lines(axes)
    np.testing.assert_allclose(series["certified trajectory"][:, 1], durations)
    np.testing.assert_allclose(series["shortest that was found"][:, 1], durations[0])
    assert durations[1] > 1.05 * durations[0]


def test_answers_of_which_runs_failed_are_marked():
    swept = simulated_sweep([0, 3, None, 200])
    axes = plot_field_sweep(swept).axes[0]
    series, _ = lines(axes)
    points = series["certified trajectory"]
    np.testing.assert_array_equal(series["some of its runs failed"], points[[1, 3]])
    texts = {text.get_text(): text.xy for text in axes.texts}
    assert list(texts) == ["0 of 200 failed", "3 of 200 failed", "200 of 200 failed"]
    np.testing.assert_array_equal(list(texts.values()), points[[0, 1, 3]])


def labelled():
    figure = new_figure(4.0, 3.0)
    figure.add_subplot().barh(0, 1.0, hatch="//")
    figure.suptitle("duration of the motion")
    return figure


@pytest.mark.dear("embeds a font")
@pytest.mark.parametrize(
    ("ending", "begin", "text"),
    [
        (".png", b"\x89PNG", b""),
        (".PDF", b"%PDF", b"/FontFile2"),  # TrueType, not outlines
        (".svg", b"<?xml", b">duration of the motion</text>"),
    ],
)
def test_the_ending_says_what_is_written_and_equal_figures_are_equal_files(
    ending, begin, text, tmp_path
):
    path = tmp_path / f"first{ending}"
    saved(labelled(), path)
    content = path.read_bytes()
    assert content.startswith(begin)
    assert text in content
    assert content == figure_file(labelled(), path)
    assert b"Date" not in content


def test_another_ending_is_refused_and_nothing_written(tmp_path):
    path, message = tmp_path / "a.jpg", r"a\.jpg: name a file that ends in \.png, \.pdf or \.svg"
    with pytest.raises(OptionError, match=message):
        saved(labelled(), path)
    assert not path.exists()


def marks(axis):
    """Return the drawn lines by label."""
    return {line.get_label(): line.get_xydata() for line in axis.lines}


def narrow(values):
    return values[RADIUS] < 0.02


def test_one_field_is_a_line_with_its_gaps():
    result = some_result({RADIUS: [0.03, 0.01, 0.02], MASS: [1]}, blocked=narrow)
    (axis,) = plot_study(result).axes
    np.testing.assert_allclose(marks(axis)["certified trajectory"], [[0.02, 3], [0.03, 1]])
    assert [text.get_text() for text in axis.texts] == [" no plan: tube blocked"]
    assert "shortest that was found" not in marks(axis)
    (axis,) = plot_study(some_result({"objective.slack": [0, 0.1]})).axes
    np.testing.assert_allclose(marks(axis)["shortest that was found"], [[0, 0.5], [0.1, 0.5]])
    with pytest.raises(OptionError, match="no point of the study was done"):
        plot_study(StudyResult(small_study(), ()))
    radii = [0.001 * k for k in range(1, 60)]  # many gaps are marks with a legend
    (axis,) = plot_study(some_result({RADIUS: radii}, blocked=narrow)).axes
    np.testing.assert_allclose(marks(axis)["no plan: tube blocked (19)"][:, 0], radii[:19])


def test_two_fields_of_a_grid_are_a_map():
    result = some_result({RADIUS: [0.03, 0.01, 0.02], MASS: [5, 0]}, blocked=narrow)
    axis, _ = plot_study(result).axes
    (image,) = axis.images
    np.testing.assert_array_equal(
        image.get_array().filled(np.nan), [[np.nan, 6, 2], [np.nan, 5, 1]]
    )
    written = {text.get_text(): text.get_position() for text in axis.texts}
    assert written == {"1.000": (2, 1), "2.000": (2, 0), "5.000": (1, 1), "6.000": (1, 0)}
    assert [patch.get_xy() for patch in axis.patches] == [(-0.5, 0.5), (-0.5, -0.5)]
    (label,) = [text.get_text() for text in axis.get_legend().get_texts()]
    assert label == "no plan: tube blocked (2)"


def test_a_map_without_any_plan_has_no_bar():
    figure = plot_study(some_result({RADIUS: [1, 2], MASS: [1, 2]}, blocked=lambda _: True))
    assert [len(axis.patches) for axis in figure.axes] == [4]


def test_two_fields_of_a_hypercube_are_points():
    axes = [between(RADIUS, 0.001, 1, log=True), between(MASS, 0, 10)]
    result = some_result(axes, Latin(30), blocked=narrow)
    axis, _ = plot_study(result).axes
    planned = [row for row in result.rows if row.duration is not None]
    (points,) = axis.collections
    np.testing.assert_allclose(
        points.get_offsets(), [(row.values[RADIUS], row.values[MASS]) for row in planned]
    )
    np.testing.assert_allclose(points.get_array(), [row.duration for row in planned])
    assert list(marks(axis)) == [f"no plan: tube blocked ({30 - len(planned)})"]
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "linear")


def test_more_fields_have_a_panel_each():
    paths = [RADIUS, MASS, EFFORT]
    axes = [Levels(path, (0.01, 0.02, 0.03)) for path in paths]
    figure = plot_study(some_result(axes, Latin(9), blocked=narrow))
    assert [axis.get_xlabel() for axis in figure.axes] == paths
    assert figure.get_suptitle() == "small: duration against 3 fields"
    for axis in figure.axes:
        assert [len(line.get_xdata()) for line in axis.lines] == [6, 3]  # planned, and gaps


@pytest.fixture(scope="module")
def compared(bundled, shared):
    problem = bundled("two_link/paper_1_30mm")
    result = shared("comparison.of_switching", lambda: compare(problem, METHODS))
    lost = replace(
        result.rows[0],
        method="lost",
        status=PlanStatus.UNREACHABLE,
        message=f"the wrist is $0.1 m short{' of it' * 30}",
        **dict.fromkeys(("trajectory", "certificate", "measures")),
    )
    return replace(result, rows=(lost, *result.rows))


@pytest.fixture(scope="module")
def panels(compared):
    figure = plot_comparison(compared)
    figure.draw_without_rendering()
    return figure.axes


def test_rows_are_sorted_by_duration_and_what_fails_is_hatched_and_named(compared, panels):
    """Those without a motion come last."""
    rows = sorted(compared.rows[1:], key=lambda row: row.duration)
    names = [label.get_text() for label in panels[0].get_yticklabels()]
    assert names == [*(row.method for row in rows), "lost"]
    assert [bar.get_width() for bar in panels[0].patches] == [row.duration for row in rows]
    texts = [text.get_text().replace("\n", " ") for text in panels[0].texts]
    for row, bar, text in zip(rows, panels[0].patches, texts, strict=False):
        assert bool(bar.get_hatch()) == (not row.certified)
        assert all(name in text for name in row.failures)
        assert ("certified" in text) == row.certified
    fastest = next(k for k, row in enumerate(rows) if row.certified)
    assert fastest > 0  # a faster one fails
    assert [k for k, text in enumerate(texts) if "the fastest" in text] == [fastest]
    assert texts[-1].startswith("no motion: the wrist is $0.1 m short")
    assert texts[-1].endswith("...")


def test_each_speed_stands_beside_its_bar_over_the_fastest_in_grey(compared, panels):
    bars, *speeds = panels
    assert len(speeds) == len(compared.rows)
    assert [len(axis.lines) for axis in speeds] == [1, 1, 1, 0]
    for number, axis in enumerate(speeds):
        box = axis.get_window_extent()
        _, middle = bars.transData.transform((0.0, number))
        assert box.y0 < middle < box.y1
    ends = [float(axis.lines[0].get_xdata()[-1]) for axis in speeds[:3]]
    np.testing.assert_allclose(ends, sorted(row.duration for row in compared.rows[1:]))
