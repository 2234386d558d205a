"""plot_field_sweep: durations over one value; marks, scales and files of figures."""

from dataclasses import replace

import numpy as np
import pytest
from cases import simulated_sweep

from tubeplanner import OptionError, PlanOptions, plot_field_sweep, sweep_field
from tubeplanner.outcome import PlanStatus
from tubeplanner.views.figure_files import figure_file, new_figure, saved
from tubeplanner.views.palette import LINE_COLORS
from tubeplanner.views.status_marks import status_mark, status_words
from tubeplanner.views.value_scale import ValueScale, value_label

WITH_PLAN = {PlanStatus.SUCCESS, PlanStatus.INTERRUPTED}


def test_no_two_reasons_look_the_same():
    marks = [status_mark(status) for status in set(PlanStatus) - WITH_PLAN]
    for kind in ("color", "marker", "hatch"):
        drawn = [getattr(mark, kind) for mark in marks]
        assert len(set(drawn)) == len(drawn) == len(PlanStatus) - 2
        assert LINE_COLORS[0] not in drawn
    assert status_words(PlanStatus.TUBE_BLOCKED) == "tube blocked"


@pytest.mark.parametrize(
    ("values", "places", "is_scaled"),
    [
        ([0.2, 0, 3], [0.2, 0, 3], True),
        (["x0.5", "x2"], [0.5, 2], True),
        ([1, "x2"], [0, 1], False),
        ([[1], [2], [1]], [0, 1, 0], False),
        ([True, False], [0, 1], False),
        ([1.0, float("inf")], [0, 1], False),
        ([], [], False),
    ],
)
def test_numbers_and_factors_are_to_scale_others_in_a_row(values, places, is_scaled):
    scale = ValueScale.of("a.b", values)
    np.testing.assert_array_equal(scale.places, places)
    assert scale.is_scaled == is_scaled


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([0.01, 0.02, 0.05, 0.1, 0.2], True),
        (["x0.1", "x1", "x10"], True),
        ([1, 2, 4], False),
        ([0, 10, 100], False),
        ([1, 100], False),
        (["a", "b", "c"], False),
    ],
)
def test_values_that_are_even_by_ratio_are_on_a_logarithmic_axis(values, expected):
    scale = ValueScale.of("a.b", values)
    assert scale.is_logarithmic is expected
    axis = new_figure(4, 3).add_subplot()
    scale.draw(axis, "y")
    assert axis.get_yscale() == ("log" if expected else "linear")
    assert axis.get_ylabel() == scale.label


def test_values_in_a_row_have_labels_of_which_long_ones_keep_their_end():
    axis = new_figure(4, 3).add_subplot()
    ValueScale.of("problem", ["example:ur5/a", "example:ur5/b", "example:ur5/a"]).draw(axis)
    assert [label.get_text() for label in axis.get_xticklabels()] == ["ur5/a", "ur5/b"]
    assert axis.get_xlim() == (-0.5, 1.5)
    path = "folder/of/folders/problem.yaml"
    assert value_label(path) == "..." + path[-21:]
    assert value_label([0.6, 0]) == "[0.6, 0]"


PROBLEM = "example:two_link/paper_1_30mm"


def drawn(path, values):
    """Return the axes of a sweep, and the durations of its rows."""
    options = PlanOptions("stop-at-corners") if "objective" not in path else PlanOptions()
    result = sweep_field(PROBLEM, path, values, options=options)
    return plot_field_sweep(result).axes[0], [row.duration for row in result.rows]


def lines(axes):
    """Return what is drawn by its label: points, and places without a plan."""
    series = {line.get_label(): line.get_xydata() for line in axes.lines if len(line.get_xdata())}
    gaps = [xy[0, 0] for label, xy in series.items() if label.startswith("_")]
    return {label: xy for label, xy in series.items() if not label.startswith("_")}, gaps


@pytest.mark.parametrize(
    ("values", "places", "label"),
    [
        ([0.05, 0.02, -1], [0.05, 0.02, -1], "tube.radius"),
        (["x2", "x1", "x-1"], [2, 1, -1], "factor on tube.radius [-]"),
    ],
)
def test_numbers_and_factors_are_drawn_to_scale(values, places, label):
    axes, durations = drawn("tube.radius", values)
    series, gaps = lines(axes)
    expected = [[places[1], durations[1]], [places[0], durations[0]]]
    np.testing.assert_allclose(series["certified trajectory"], expected)
    assert gaps == [places[2]]
    assert axes.get_xlabel() == label
    assert "no plan: bad input" in axes.texts[0].get_text()


def test_other_values_stand_in_a_row_by_name():
    axes, _ = drawn("tube.radius", [0.02, "x1"])
    np.testing.assert_array_equal(axes.get_xticks(), [0, 1])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0.02", "x1"]
    assert axes.get_xlabel() == "tube.radius"


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
    said = {text.get_text(): text.xy for text in axes.texts}
    assert list(said) == ["0 of 200 failed", "3 of 200 failed", "200 of 200 failed"]
    np.testing.assert_array_equal(list(said.values()), points[[0, 1, 3]])
    none = replace(swept, rows=swept.rows[:1])
    assert list(lines(plot_field_sweep(none).axes[0])[0]) == ["certified trajectory"]


def labelled(label="duration of the motion"):
    figure = new_figure(4.0, 3.0)
    axis = figure.add_subplot()
    axis.barh(0, 1.0, hatch="//", label=label)
    axis.set_title(label)
    axis.legend()
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
    figure = saved(labelled(), path)
    content = path.read_bytes()
    assert content.startswith(begin)
    assert text in content
    assert content == figure_file(labelled(), path)
    assert b"Date" not in content
    if ending == ".svg":
        assert content == figure_file(figure, path)
        assert content != figure_file(labelled("another"), path)


def test_another_ending_is_refused_and_nothing_written(tmp_path):
    path, message = tmp_path / "a.jpg", r"a\.jpg: name a file that ends in \.png, \.pdf or \.svg"
    with pytest.raises(OptionError, match=message):
        saved(labelled(), path)
    assert not path.exists()
