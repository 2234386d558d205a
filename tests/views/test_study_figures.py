"""plot_study, plot_comparison: lines and maps over one or two fields; bars per method."""

from dataclasses import replace

import numpy as np
import pytest
from studied import EFFORT, MASS, RADIUS, between, small_study, some_result

from tubeplanner import OptionError, compare, plot_study
from tubeplanner.outcome import PlanStatus
from tubeplanner.studies.axes import Levels
from tubeplanner.studies.study_points import Latin
from tubeplanner.studies.study_result import StudyResult
from tubeplanner.views.comparison_plot import plot_comparison


def marks(axis):
    """Return what lines are drawn, by label."""
    return {line.get_label(): line.get_xydata() for line in axis.lines}


def narrow(values):
    return values[RADIUS] < 0.02


def test_one_field_is_a_line_with_its_gaps():
    figure = plot_study(some_result({RADIUS: [0.03, 0.01, 0.02], MASS: [1]}, blocked=narrow))
    (axis,) = figure.axes
    np.testing.assert_allclose(marks(axis)["certified trajectory"], [[0.02, 3], [0.03, 1]])
    assert [text.get_text() for text in axis.texts] == [" no plan: tube blocked"]
    assert axis.get_xlabel() == RADIUS
    assert figure.get_suptitle() == "small: duration against tube.radius"
    assert "shortest that was found" not in marks(axis)
    (axis,) = plot_study(some_result({"objective.slack": [0, 0.1]})).axes
    np.testing.assert_allclose(marks(axis)["shortest that was found"], [[0, 0.5], [0.1, 0.5]])
    with pytest.raises(OptionError, match="no point of the study was done"):
        plot_study(StudyResult(small_study(), ()))
    radii = [0.001 * k for k in range(1, 60)]  # many gaps are marks with a legend
    (axis,) = plot_study(some_result({RADIUS: radii}, blocked=narrow)).axes
    gaps = marks(axis)["no plan: tube blocked (19)"]
    np.testing.assert_allclose(gaps[:, 0], radii[:19])
    assert not axis.texts


def test_two_fields_of_a_grid_are_a_map():
    result = some_result({RADIUS: [0.03, 0.01, 0.02], MASS: [5, 0]}, blocked=narrow)
    axis, bar = plot_study(result).axes
    (image,) = axis.images
    np.testing.assert_array_equal(
        image.get_array().filled(np.nan), [[np.nan, 6, 2], [np.nan, 5, 1]]
    )
    assert [label.get_text() for label in axis.get_xticklabels()] == ["0.01", "0.02", "0.03"]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["0", "5"]
    written = {text.get_text(): text.get_position() for text in axis.texts}
    assert written == {"1.000": (2, 1), "2.000": (2, 0), "5.000": (1, 1), "6.000": (1, 0)}
    assert [patch.get_xy() for patch in axis.patches] == [(-0.5, 0.5), (-0.5, -0.5)]
    assert len({patch.get_hatch() for patch in axis.patches}) == 1
    (label,) = [text.get_text() for text in axis.get_legend().get_texts()]
    assert label == "no plan: tube blocked (2)"
    assert bar.get_ylabel() == "duration [s]"


def test_a_large_map_is_legible_and_one_without_any_plan_has_no_bar():
    values = {RADIUS: np.linspace(0.02, 0.1, 30).tolist(), MASS: list(range(22))}
    axis, _ = plot_study(some_result(values)).axes
    assert not axis.texts
    assert len(axis.get_xticks()) <= 20
    figure = plot_study(some_result({RADIUS: [1, 2], MASS: [1, 2]}, blocked=lambda _: True))
    assert len(figure.axes) == 1
    assert len(figure.axes[0].patches) == 4


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
    (label,) = marks(axis)
    assert label == f"no plan: tube blocked ({30 - len(planned)})"
    assert (axis.get_xscale(), axis.get_yscale()) == ("log", "linear")


@pytest.mark.parametrize("count", [3, 4])
def test_more_fields_have_a_panel_each(count):
    paths = [RADIUS, MASS, EFFORT, "clearance"][:count]
    axes = [Levels(path, (0.01, 0.02, 0.03)) for path in paths]
    figure = plot_study(some_result(axes, Latin(9), blocked=narrow))
    assert [axis.get_xlabel() for axis in figure.axes] == paths
    assert figure.get_suptitle() == f"small: duration against {count} fields"
    for axis in figure.axes:
        assert [len(line.get_xdata()) for line in axis.lines] == [6, 3]  # planned, and gaps


METHODS = ("stop-at-corners", "bang-bang", "smoothed-bang-bang")


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
        assert text.startswith(f"{row.duration:.4f} s, ")
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
        assert len(axis.collections) == 1
    assert len({axis.get_xlim() for axis in speeds} | {speeds[0].get_xlim()}) == 1
    ends = [float(axis.lines[0].get_xdata()[-1]) for axis in speeds[:3]]
    np.testing.assert_allclose(ends, sorted(row.duration for row in compared.rows[1:]))


def test_nothing_is_cut_off(panels):
    figure = panels[0].figure
    whole = figure.bbox.padded(-3)  # [pixels] free at the borders
    titled = [*figure.axes, *figure.texts]
    assert len(titled) == len(figure.axes) + 1
    for part in titled:
        drawn = part.get_tightbbox()
        assert whole.x0 < drawn.x0 < drawn.x1 < whole.x1
        assert whole.y0 < drawn.y0 < drawn.y1 < whole.y1
    title = figure.texts[0].get_tightbbox()
    assert not any(title.overlaps(axis.get_tightbbox()) for axis in figure.axes)
