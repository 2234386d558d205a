import numpy as np
import pytest

from conftest import PROBLEMS
from tubeplanner import OutputError, plot_trajectory


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_figure_shows_every_joint_against_its_limits(name, planned, tmp_path):
    problem, result = planned(name)
    path = tmp_path / "figure.png"
    figure = plot_trajectory(problem, result.trajectory, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    position, velocity, effort, hand, use = figure.axes
    n = problem.robot.joint_count
    labels = [text.get_text() for text in position.get_legend().get_texts()]
    assert labels == list(problem.robot.joint_names)
    assert len(effort.lines) == n + 2
    shares = np.array([line.get_ydata() for line in effort.lines[:n]])
    assert abs(shares).max() == pytest.approx(100, abs=3)
    limited = np.isfinite(problem.robot.limits.velocity).all()
    assert len(velocity.lines) == n + 2 * limited
    for axis in (position, velocity, effort, use):
        assert "[" in axis.get_ylabel()
    drawn = np.array(hand.lines[1].get_data_3d()).T
    inside = problem.tube.margin(drawn).max(axis=1)
    assert (inside > -1e-9).all()
    assert use.lines[0].get_ydata().max() <= 1000 * problem.tube.radius.max()


def test_a_figure_that_cannot_be_written_is_an_error_of_ours(planned, tmp_path):
    problem, result = planned("two_link/around_a_post")
    with pytest.raises(OutputError, match=r"the folder .*nowhere does not exist"):
        plot_trajectory(problem, result.trajectory, tmp_path / "nowhere" / "figure.png")


def test_the_distance_is_that_to_the_segment_the_hand_is_in(planned):
    """Round a corner, the segment left behind may be the nearer one; its radius holds no more."""
    problem, result = planned("ur5/over_the_wall", "branch-and-bound")
    use = plot_trajectory(problem, result.trajectory).axes[-1]
    distance, radius = (line.get_ydata() for line in use.lines)
    assert (distance <= radius + 1e-3).all()
    assert sorted(set(radius)) == pytest.approx([30, 80])
