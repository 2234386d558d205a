"""The binding limit at each time; the closest pair of solids."""

from dataclasses import replace

import numpy as np
import pytest
from cases import anywhere, changed, rest_to_rest
from lifting_arm import CASES, HALF, POST, lifting
from scipy.interpolate import PPoly

from tubeplanner import (
    JointTrajectory,
    LimitOverrides,
    Obstacle,
    PointSpeed,
    load_robot,
    placement_of,
)
from tubeplanner.limits.binding_limits import (
    ClosestPairs,
    LimitUse,
    binding_rows,
    bound_fraction,
    clearance_use,
    closest_pairs,
    limit_uses,
)

BALL = """<robot name="ball"><link name="base"/><link name="arm">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="5" velocity="4"/></joint></robot>"""


@pytest.mark.parametrize("name", ["ur5/level_tray", "panda/between_shelves"])
def test_they_are_the_closest_of_all_wherever_the_arm_is(name, bundled):
    problem, random, clearance = bundled(name), np.random.default_rng(3), 0.02
    problem = changed(problem, clearance=clearance)
    lower, upper = problem.robot.limits.lower_position, problem.robot.limits.upper_position
    ends = random.uniform(lower, upper, (2, len(lower)))
    motion = rest_to_rest(problem.robot.joint_names, *ends, 1.0)
    time = np.linspace(0, 1, 50)
    checker, poses = problem.collision, problem.robot.body_poses(motion.position(time))
    obstacles, links = closest_pairs(problem, motion, time)
    assert (obstacles.kind, links.kind) == ("obstacles", "self_collision")
    for closest, pairs, required in (
        (obstacles, checker.obstacle_pairs, clearance),
        (links, checker.link_pairs, 0),
    ):
        every = np.array([checker.distances(*each, pairs) for each in zip(*poses, strict=True)])
        np.testing.assert_allclose(closest.distance, every.min(axis=1), atol=1e-9)
        np.testing.assert_allclose(closest.margin, every.min(axis=1) - required, atol=1e-9)
        apart = np.linalg.norm(closest.points[:, 1] - closest.points[:, 0], axis=1)
        free = closest.distance > 0
        np.testing.assert_allclose(apart[free], closest.distance[free], atol=1e-4)
        owners = [shape.owner for shape in checker.shapes]
        first = pairs[every.argmin(axis=1)]
        assert closest.names == tuple((owners[i], owners[j]) for i, j in first)


@pytest.fixture
def ball(tmp_path):
    """A ball on an arm that turns from the x-axis to the y-axis, between two others."""
    (tmp_path / "ball.urdf").write_text(BALL)
    robot = load_robot("ball.urdf", "arm", directory=tmp_path)
    near = Obstacle.sphere("near", 0.05, placement_of([0.9, 0, 0]))
    far = Obstacle.sphere("far", 0.05, placement_of([0, 1.0, 0]))
    return changed(anywhere(robot), obstacles=[near, far])


def test_points_are_on_the_surfaces(ball):
    motion = rest_to_rest(["turn"], 0.0, np.pi / 2, 1.0)
    (closest,) = closest_pairs(ball, motion, np.array([0.0, 1.0]))
    assert closest.names == (("arm", "near"), ("arm", "far"))
    np.testing.assert_allclose(closest.distance, [0.25, 0.35], atol=1e-9)
    np.testing.assert_allclose(closest.points[0], [[0.6, 0, 0], [0.85, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(closest.points[1], [[0, 0.6, 0], [0, 0.95, 0]], atol=1e-6)
    assert closest_pairs(changed(ball, obstacles=[]), motion, np.zeros(1)) == []


def test_what_must_be_farther_apart_is_closer(ball):
    problem = changed(ball, pair_clearances={("arm", "far"): 0.5})
    motion = rest_to_rest(["turn"], 0.0, np.pi / 4, 1.0)
    (result,) = closest_pairs(problem, motion, np.array([1.0]))
    assert result.names == (("arm", "far"),)
    place = 0.5 * np.sqrt(0.5)
    distance = np.hypot(place, 1.0 - place) - 0.15
    assert result.distance == pytest.approx([distance])
    assert result.margin == pytest.approx([distance - 0.5])


def test_what_may_touch_is_left_out_while_it_may(tmp_path):
    """Lifted off the table by 20 cm, with 1 cm of clearance."""
    problem, motion = lifting(tmp_path, CASES["a lift"])
    obstacles, links = closest_pairs(problem, motion, np.array([0.0, 1.0]))
    assert obstacles.margin[0] == obstacles.distance[0] == np.inf
    assert obstacles.distance[1] == pytest.approx(0.2)
    assert obstacles.margin[1] == pytest.approx(0.19)
    np.testing.assert_allclose(links.distance, -HALF - POST, atol=1e-9)


EFFORT, MASS = 10.0, 2.0  # of the slider on its rail [N], [kg]


def bang_bang(cruise=0.0):
    """Return a move of the slider at full effort, then for a time at full speed, then braked."""
    widths, signs = np.array([[0.2, cruise, 0.2], [1.0, 0.0, -1.0]])
    rows = widths > 0
    time = np.append(0.0, np.cumsum(widths[rows]))
    position = PPoly(EFFORT / MASS * signs[None, rows], time).antiderivative(2)
    return JointTrajectory(["slide"], time, position.c[:, :, None])


def rows_of(problem, trajectory, closest=()):
    uses = limit_uses(problem, trajectory)
    return binding_rows(problem.robot.joint_names, uses, closest), uses


def test_effort_binds_all_along_a_bang_bang_move_from_98_percent_on(slider):
    (slide, tool), uses = rows_of(slider, bang_bang())
    (span,) = slide.spans
    assert (slide.name, span.kind, span.begin, span.end) == ("slide", "effort", 0.0, 0.4)
    assert (tool.name, tool.spans) == ("tool", [])
    assert bound_fraction(uses) == 1.0
    assert bound_fraction(limit_uses(slider, bang_bang().scaled(1.005))) == 1.0
    assert bound_fraction(limit_uses(slider, bang_bang().scaled(1.02))) == 0.0


def test_where_the_speed_is_full_the_velocity_binds(slider):
    robot = slider.robot
    limits = replace(robot.limits, velocity=np.array([0.2 * EFFORT / MASS]))
    problem = replace(slider, robot=robot.with_limits(limits, robot.motors))
    (slide, _), uses = rows_of(problem, bang_bang(cruise=0.6))
    assert [span.kind for span in slide.spans] == ["effort", "velocity", "effort"]
    begins = [span.begin for span in slide.spans]
    np.testing.assert_allclose(begins, [0.0, 0.2, 0.8], atol=0.005)
    assert [span.end for span in slide.spans] == [*begins[1:], 1.0]
    assert bound_fraction(uses, uses.of("velocity")) == pytest.approx(0.6, abs=0.01)
    assert bound_fraction(uses, uses.of("effort")) == pytest.approx(0.4, abs=0.01)


def test_at_the_edge_of_the_tube_the_way_binds_and_not_the_speed(slider):
    """The tube ends at 0.6 m and is 0.1 m wide: the slider goes as far, and slowly."""
    trajectory = rest_to_rest(["slide"], 0.0, 0.7, 10.0)
    (slide, tool), uses = rows_of(slider, trajectory)
    assert slide.spans == []
    assert {span.kind for span in tool.spans} == {"tube"}
    assert tool.spans[-1].end == 10.0
    assert bound_fraction(uses) == 0.0
    assert bound_fraction(uses, uses.of("tube")) > 0.0


@pytest.mark.parametrize(("end", "binds"), [(0.997, False), (0.9985, True)])
def test_a_position_binds_near_the_end_of_its_range_alone(slider, end, binds):
    problem = anywhere(slider.robot)
    (slide, *_), _ = rows_of(problem, rest_to_rest(["slide"], 0.0, end, 10.0))
    assert [span.kind for span in slide.spans] == ["position"] * binds


def pairs(time, margin, kind="obstacles"):
    count = len(time)
    names, points = (("cart", "wall"),) * count, np.zeros((count, 2, 3))
    return ClosestPairs(kind, time, margin + 0.01, margin, names, points)


def test_links_bind_where_less_than_a_millimetre_is_left(slider):
    """Of several that bind the most used is shown."""
    time = limit_uses(slider, bang_bang()).samples.time
    margin = np.where(time < 0.1, 0.0009, np.where(time > 0.3, 0.0011, 0.2))
    (*_, links), _ = rows_of(slider, bang_bang(), [pairs(time, margin)])
    (span,) = links.spans
    assert (links.name, span.kind, span.begin) == ("links", "obstacles", 0.0)
    assert span.end == pytest.approx(0.1, abs=0.005)
    nearer = pairs(time, np.where(time < 0.2, 0.0001, 0.0008), "self_collision")
    closest = [pairs(time, np.full(len(time), 0.0005)), nearer]
    (*_, links), _ = rows_of(slider, bang_bang(), closest)
    assert [span.kind for span in links.spans] == ["self_collision", "obstacles"]


def test_what_does_not_bind_is_not_shown_though_more_of_it_is_used(slider):
    """99 % of a range leave much of it; 98.5 % of an effort do not."""
    uses = limit_uses(slider, bang_bang())
    count, fractions = len(uses.samples.time), {"position": 0.99, "effort": 0.985}
    own = tuple(LimitUse(kind, "slide", np.full(count, x), 0) for kind, x in fractions.items())
    (slide,) = binding_rows(["slide"], replace(uses, uses=own), ())
    assert [span.kind for span in slide.spans] == ["effort"]


def test_a_required_distance_is_used_from_five_centimetres_on():
    margin = np.array([0.1, 0.05, 0.025, 0.0, -0.01, np.inf])
    use = clearance_use(pairs(np.arange(6.0), margin))
    np.testing.assert_allclose(use.fraction, [0, 0, 0.5, 1, 1.2, 0], atol=1e-12)


def test_points_of_links_belong_to_the_links():
    points = [PointSpeed("link1", [0.5, 0, 0], 0.9)]
    robot = load_robot("example:two_link", "hand", limits=LimitOverrides(point_speed=points))
    rows, _ = rows_of(anywhere(robot), rest_to_rest(robot.joint_names, [0, 0.5], [1, 0.5], 1.0))
    assert [row.name for row in rows] == ["joint1", "joint2", "tool", "links"]
    assert {span.kind for span in rows[-1].spans} == {"point_speed"}
