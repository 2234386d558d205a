"""What binds when, of one motion and of several one after the other."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from tubeplanner.constraints.binding_limits import Span
from tubeplanner.views.binding_strip import BindingStrip, binding_strip, limited_motion
from tubeplanner.views.clearance_panel import draw_clearance
from tubeplanner.views.strip_panel import draw_strip, percent


@pytest.fixture(scope="module")
def motion(stored):
    """A fast motion over a wall, and what limits it."""
    return limited_motion(*stored("ur5/over_the_wall", "refinement"))


def test_a_fast_motion_is_at_some_limit_nearly_all_the_time(motion, stored):
    problem, trajectory = stored("ur5/over_the_wall", "refinement")
    strip = binding_strip([motion], motion.duration)
    assert list(strip.rows) == [*problem.robot.joint_names, "tool", "links"]
    assert strip.joint_count == problem.robot.joint_count
    assert 0.98 < strip.speed_share <= 1.0
    slow = limited_motion(problem, trajectory.scaled(2.0))
    assert slow.duration == pytest.approx(2 * motion.duration)
    assert binding_strip([slow], slow.duration).speed_share == 0.0


def test_motions_one_after_the_other_share_the_time(motion):
    duration = motion.duration
    once = binding_strip([motion], duration)
    twice = binding_strip([motion, replace(motion, begin=2 * duration)], 4 * duration)
    assert twice.speed_share == pytest.approx(once.speed_share / 2)
    for kind, share in once.shares.items():
        assert twice.shares[kind] == pytest.approx(share / 2)
    for name, spans in once.rows.items():
        later = [Span(s.kind, s.begin + 2 * duration, s.end + 2 * duration) for s in spans]
        assert twice.rows[name] == [*spans, *later]


def test_the_strip_has_a_bar_for_every_stretch_and_names_its_kind():
    rows = {"joint1": [Span("effort", 0.0, 0.5)], "tool": [Span("tube", 0.5, 0.502)], "links": []}
    strip = BindingStrip(rows, {"tube": 0.002, "effort": 0.5, "new": 0.01}, 0.5, 1.0, 1)
    draw_strip(axis := Figure().subplots(), strip)
    bars = [patch for patch in axis.patches if patch.get_zorder() == 2]
    spans = [(bar.get_x(), bar.get_width()) for bar in bars]
    assert spans == [(0.0, 0.5), (0.5, pytest.approx(0.002))]
    assert bars[0].get_facecolor() != bars[1].get_facecolor()
    said = [text.get_text() for text in axis.texts]
    assert "effort" in said and "tube" not in said  # in its bar; the other one is too short
    assert any("50 % of the time" in text for text in said)
    legend = [text.get_text() for text in axis.get_legend().get_texts()]
    assert legend == ["effort 50 %", "new 1 %", "tube 0.2 %"]  # "new": a kind that is not known
    low, high = axis.get_ylim()
    assert low > 2 > 0 > high  # the first row is on top


def test_shares_are_never_rounded_to_all_or_nothing():
    shown = [percent(share) for share in (0.0, 0.0003, 0.234, 0.985, 0.9996, 1.0)]
    assert shown == ["0 %", "0.1 %", "23 %", "98 %", "99.9 %", "100 %"]


def test_the_clearance_panel_names_the_nearest_pairs(motion):
    draw_clearance(axis := Figure().subplots(), [replace(motion, begin=1.0)])
    obstacles, links = motion.closest
    drawn = axis.lines[0]
    np.testing.assert_allclose(drawn.get_xdata(), 1.0 + obstacles.time)
    np.testing.assert_allclose(drawn.get_ydata(), 1000 * obstacles.distance)
    np.testing.assert_allclose(axis.lines[1].get_ydata(), 1000 * motion.problem.clearance)
    texts = [text.get_text() for text in axis.get_legend().get_texts()]
    for pairs, text in zip((obstacles, links), texts, strict=True):
        k = pairs.margin.argmin()
        assert " - ".join(pairs.names[k]) in text
        assert f"{1000 * pairs.distance[k]:.3g} mm" in text
