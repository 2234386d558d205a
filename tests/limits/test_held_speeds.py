"""Speeds that can be held in bends: by a point mass, on arcs of many chords, along lines."""

import numpy as np
import pytest
from gantry import gantry

from tubeplanner import load_problem
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.held_speeds import held_speed, largest_speed, sharpest_bends, widest_arc

A, RADIUS = 4.0, 0.002  # [m/s^2], [m]


def _corner(folder, limits=(), **changes):
    limits = {"effort": np.inf, "velocity": 3.0, "acceleration": A, **dict(limits)}
    robot = {"urdf": "gantry.urdf", "tool_frame": "head", "limits": limits}
    points = [[0.0, 0.3, 0.0], [0.1, 0.2, 0.0], [0.3, 0.0, 0.0], [0.5, 0.2, 0.0], [0.6, 0.3, 0.0]]
    tube = {"points": points, "radius": RADIUS, **changes}
    return load_problem(gantry(folder, robot=robot, tube=tube, start={"joints": [0.0, 0.3]}))


def _bend(problem, angle=np.pi / 2):
    (bend,) = [each for each in sharpest_bends(problem.tube) if abs(each.angle - angle) < 1e-9]
    return bend


def test_a_point_mass_holds_the_root_of_acceleration_times_the_widest_arc(tmp_path):
    """The bisector is along one axis, on which there is least: both add up at the arc's ends."""
    problem = _corner(tmp_path)
    bend = _bend(problem)
    held = held_speed(problem, bend, np.array([0.3, 0.0]))
    arc = 2 * RADIUS / (1 - np.cos(np.pi / 4))
    assert bend.arc == pytest.approx(arc)
    assert held.acceleration == pytest.approx(A)
    assert held.speed == pytest.approx(np.sqrt(A * arc))
    assert (held.kind, held.joint) == ("acceleration", "across")
    assert bend.radius_for(held.speed, held.acceleration) == pytest.approx(RADIUS)


def test_the_slower_axis_leaves_nothing_across(tmp_path):
    problem = _corner(tmp_path, {"acceleration": {"along": A, "across": A / 4}})
    held = held_speed(problem, _bend(problem), np.array([0.3, 0.0]))
    assert held.acceleration == pytest.approx(A / 4)
    assert held.joint == "across"


def test_the_acceleration_of_the_tool_counts(tmp_path):
    problem = _corner(tmp_path, tool_acceleration=A / 2)
    held = held_speed(problem, _bend(problem), np.array([0.3, 0.0]))
    assert held.acceleration == pytest.approx(A / 2)
    assert (held.kind, held.name, held.joint) == ("tool_acceleration", "tool", None)


def test_efforts_count(tmp_path):
    """The bridge carries 3 kg, the head 1 kg."""
    problem = _corner(tmp_path, {"effort": {"along": 6.0, "across": 100.0}})
    held = held_speed(problem, _bend(problem), np.array([0.3, 0.0]))
    assert held.acceleration == pytest.approx(2 * np.sqrt(2))  # 45 degrees from the axis
    assert (held.kind, held.joint) == ("effort", "along")


def test_velocities_bound_the_speed_along_a_line(tmp_path):
    held = largest_speed(_corner(tmp_path), 1, np.array([3.0, 1.0, 0.0]), np.array([0.2, 0.0]))
    assert held.speed == pytest.approx(np.hypot(3, 1))
    assert (held.kind, held.joint) == ("velocity", "along")


def test_a_straight_path_holds_any_speed():
    tube = Tube([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.3, 0.0, 0.0]], RADIUS)
    (bend,) = sharpest_bends(tube)
    assert bend.arc == np.inf and bend.radius_for(1.0, 1.0) == 0


@pytest.mark.parametrize("count", [12, 40, 150])
def test_an_arc_of_many_chords_turns_as_a_whole(count):
    """A half circle of 50 mm in a tube of 1 mm: as wide as itself, and twice the tube's radius."""
    angle = np.linspace(0, np.pi, count + 1)
    arc = 0.05 * np.column_stack([np.sin(angle), 1 - np.cos(angle), 0 * angle])
    points = np.vstack([[-0.1, 0.0, 0.0], arc, [-0.1, 0.1, 0.0]])
    narrowest = min(bend.arc for bend in sharpest_bends(Tube(points, 0.001)))
    assert narrowest == pytest.approx(0.052, rel=1.4 / count)


def test_noise_does_not_turn():
    """A path that turns back at once is as good as straight: in a tube wider than its noise."""
    x = np.linspace(0, 0.2, 201)
    y = 2e-5 * (np.arange(201) % 2)
    points = np.column_stack([x, y, 0 * x])
    assert min(bend.arc for bend in sharpest_bends(Tube(points, 0.002))) > 1.0


def test_the_widest_arc_of_an_evenly_bent_strip():
    assert widest_arc(0.001, np.pi / 2) == pytest.approx(6.828e-3, rel=1e-3)
    assert widest_arc(0.001, np.pi / 2, 0.05) == pytest.approx(6.828e-3 + 0.1 / np.pi, rel=1e-3)
