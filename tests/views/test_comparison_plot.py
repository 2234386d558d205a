"""The figure of a comparison: a row per method that says how long it takes and whether it holds."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import compare, load_problem
from tubeplanner.outcome import PlanStatus
from tubeplanner.views.comparison_plot import plot_comparison

METHODS = ("stop-at-corners", "bang-bang", "smoothed-bang-bang")


@pytest.fixture(scope="module")
def compared():
    result = compare(load_problem("example:two_link/paper_1_30mm"), METHODS)
    none = {"trajectory": None, "certificate": None, "measures": None}
    lost = replace(
        result.rows[0],
        method="lost",
        status=PlanStatus.UNREACHABLE,
        message=f"the wrist is $0.1 m short{' of it' * 30}",
        **none,
    )
    return replace(result, rows=(lost, *result.rows))


@pytest.fixture(scope="module")
def panels(compared):
    figure = plot_comparison(compared)
    figure.draw_without_rendering()
    return figure.axes


def test_rows_are_sorted_by_duration_and_those_without_a_motion_come_last(compared, panels):
    rows = sorted(compared.rows[1:], key=lambda row: row.duration)
    names = [label.get_text() for label in panels[0].get_yticklabels()]
    assert names == [*(row.method for row in rows), "lost"]
    assert [bar.get_width() for bar in panels[0].patches] == [row.duration for row in rows]


def test_what_fails_is_hatched_and_named(compared, panels):
    rows = sorted(compared.rows[1:], key=lambda row: row.duration)
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
