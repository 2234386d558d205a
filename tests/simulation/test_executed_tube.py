from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cases import PROBLEMS
from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import PlanningProblem, Seed, Tube, load_problem, load_robot, verify
from tubeplanner.constraints.tube_membership import current_segments
from tubeplanner.simulation.executed_tube import tube_excursions, tube_margins

CORNER = [[0.1, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.3, 0.0]]
BACK = [[0.4, -0.2, 0.0], [0.4, 0.2, 0.0], [0.4, -0.2, 0.0]]


def two_link(points, radius=0.05, **tube):
    robot = load_robot("example:two_link", "hand")
    return PlanningProblem(robot, Tube(points, radius, **tube), Seed(np.array([0.0, -1.0])))


def excursions(problem, tool, q=(0.0, -1.0), angles=0.0):
    count = len(tool)
    joints = np.broadcast_to(np.array(q, dtype=float), (count, 2))
    turned = Rotation.from_rotvec(np.outer(np.full(count, angles), [0, 0, 1])).as_matrix()
    return tube_excursions(problem, np.arange(count) / 10, joints, turned, np.array(tool))


@pytest.mark.parametrize("name", PROBLEMS)
def test_of_the_plan_itself_they_are_the_certificates_margins(name):
    problem = load_problem(f"example:{name}")
    motion = stored_trajectory(name, REFINEMENT).trajectory.reordered(problem.robot.joint_names)
    time = np.linspace(0.0, motion.duration, 2000)
    q = motion.position(time)
    found = tube_excursions(problem, time, q, *problem.robot.tool_pose(q))
    judged = verify(problem, motion).conditions
    assert found.tube.value == pytest.approx(-judged["tube"].margin, abs=3e-5)
    if judged["rotation"].margin is None:
        assert found.rotation is None
    else:
        assert found.rotation.value == pytest.approx(-judged["rotation"].margin, abs=3e-4)
    assert (found.points is None) == (len(problem.tube.compulsory_points) == 0)


def test_the_farthest_out_counts_and_when_and_where():
    tool = [[0.1, 0, 0], [0.2, 0, 0.08], [0.4, 0, 0], [0.4, 0.2, 0.06], [0.4, 0.3, 0]]
    found = excursions(two_link(CORNER), tool).tube
    assert found.value == pytest.approx(0.03)
    assert (found.place.time, found.place.segment) == (0.1, 0)
    found = excursions(two_link(CORNER), [*tool[2:], [0.4, 0.3, 0.07]]).tube
    assert found.value == pytest.approx(0.02)
    assert (found.place.time, found.place.segment) == (pytest.approx(0.3), 1)


def test_every_segment_has_its_own_worst_while_it_is_current():
    tool = [[0.1, 0, 0], [0.2, 0, 0.08], [0.4, 0, 0], [0.4, 0.2, 0.06], [0.4, 0.3, 0]]
    found = excursions(two_link(CORNER), tool)
    np.testing.assert_allclose(found.tube_by_segment, [0.03, 0.01], atol=1e-12)
    assert found.rotation is None
    assert found.rotation_by_segment.tolist() == [-1e3, -1e3]
    bounded = two_link(CORNER, orientations=[[0, 0, 0, 1]] * 3, rotation_tolerance=[0.1, 0.2])
    turned = excursions(bounded, tool, angles=[0.0, -0.13, 0.02, 0.15, 0.1])
    assert turned.rotation.value == pytest.approx(0.03)
    assert (turned.rotation.place.time, turned.rotation.place.segment) == (0.1, 0)
    np.testing.assert_allclose(turned.rotation_by_segment, [0.03, -0.05], atol=1e-9)


def test_a_motion_that_ends_before_the_last_segment_is_outside_of_it():
    assert excursions(two_link(CORNER), [[0.1, 0, 0], [0.3, 0, 0]]).tube.value == pytest.approx(
        0.05
    )


def test_segments_and_points_have_the_numbers_of_the_problem():
    """The first two segments are joined to one."""
    divided = two_link([CORNER[0], [0.25, 0.0, 0.0], *CORNER[1:]])
    tool = [[0.1, 0, 0], [0.4, 0, 0], [0.4, 0.2, 0.06], [0.4, 0.3, 0]]
    assert excursions(divided, tool).tube.place.segment == 2
    back = two_link([BACK[0], [0.4, 0.0, 0.0], *BACK[1:]])
    found = excursions(back, [[0.4, y, 0] for y in (-0.2, 0.13, -0.2)])
    assert found.points.place.point == 2


def test_a_hand_over_may_lie_between_samples():
    """No sample is in both segments; the straight line between two of them passes through."""
    tool = [[0.1, 0, 0], [0.34, 0, 0], [0.4, 0.06, 0], [0.4, 0.3, 0]]
    assert excursions(two_link(CORNER), tool).tube.value <= 0
    far = [[0.1, 0, 0], [0.3, 0, 0], [0.4, 0.1, 0], [0.4, 0.3, 0]]
    assert excursions(two_link(CORNER), far).tube.value == pytest.approx(0.0, abs=1e-9)
    farther = [[0.1, 0, 0], [0.28, 0, 0], [0.4, 0.12, 0], [0.4, 0.3, 0]]
    assert excursions(two_link(CORNER), farther).tube.value == pytest.approx(0.01)


def test_segments_come_in_order_unless_any_may():
    tool = [[0.4, 0.3, 0], [0.4, 0.0, 0], [0.1, 0.0, 0]]
    assert excursions(two_link(CORNER), tool).tube.value > 0.2
    free = excursions(two_link(CORNER, visit="any"), tool)
    assert free.tube.value == pytest.approx(-0.05)


def test_turning_back_too_early_misses_the_point():
    problem = two_link(BACK)
    whole = [[0.4, y, 0] for y in (-0.2, 0.0, 0.2, 0.0, -0.2)]
    early = [[0.4, y, 0] for y in (-0.2, 0.0, 0.13, 0.0, -0.2)]
    assert excursions(problem, whole).points.value == pytest.approx(-0.05)
    missed = excursions(problem, early)
    assert missed.tube.value <= 0 < missed.points.value
    assert missed.points.value == pytest.approx(0.02)
    assert (missed.points.place.point, missed.points.place.time) == (1, 0.2)


@pytest.mark.parametrize("radius", [[0.08, 0.05], [0.05, 0.08]])
def test_points_are_passed_within_the_smaller_radius_beside_them(radius):
    tool = [[0.4, y, 0] for y in (-0.2, 0.0, 0.13, 0.0, -0.2)]
    assert excursions(two_link(BACK, radius), tool).points.value == pytest.approx(0.02)


def test_every_point_has_its_own_radius_and_the_farthest_passed_counts():
    line = [[x, 0.0, 0.0] for x in (0.1, 0.2, 0.3, 0.4)]
    problem = two_link(line, [0.05, 0.04, 0.03], pass_through_points="all")
    found = excursions(problem, [[x, 0.035, 0] for x in (0.1, 0.2, 0.3, 0.4)]).points
    assert found.value == pytest.approx(0.005)
    assert found.place.point == 2


@pytest.mark.parametrize("backwards", [False, True])
def test_a_point_counts_while_a_segment_beside_it_is_current(backwards):
    """It is passed once more, at the far end of the tube."""
    way = slice(None, None, -1 if backwards else 1)
    corners = [*BACK, [0.1, -0.2, 0.0], [0.4, 0.2, 0.0]]
    tool = [BACK[0], [0.4, 0.13, 0.0], *corners[2:]]
    found = excursions(two_link(corners[way]), tool[way])
    assert found.tube.value == pytest.approx(-0.05)
    assert found.points.value == pytest.approx(0.02)
    assert found.points.place.point == (3 if backwards else 1)


def test_where_any_segment_may_be_current_a_point_is_passed_at_any_time():
    points = [[0.4, -0.2, 0.0], [0.4, 0.2, 0.0], [0.4, -0.2, 0.0], [0.42, 0.3, 0.0]]
    tool = [[0.4, -0.2, 0], [0.4, 0.13, 0], [0.4, -0.2, 0], [0.416, 0.2, 0], [0.42, 0.3, 0]]
    found = excursions(two_link(points, visit="any"), tool).points
    assert found.value == pytest.approx(0.016 - 0.05)


def test_a_hand_over_waits_for_the_signs_that_the_next_segment_asks():
    problem = two_link(CORNER, joint_signs=[{"joint2": "-"}, {"joint2": "+"}])
    tool = np.array([[0.1, 0, 0], [0.4, 0, 0], [0.4, 0.01, 0], [0.4, 0.2, 0], [0.4, 0.3, 0]])
    turned = np.tile(np.eye(3), (5, 1, 1))
    found = {}
    for late in (2, 3):
        q = np.zeros((5, 2))
        q[:, 1] = np.where(np.arange(5) < late, -1.0, 1.0)
        found[late] = tube_excursions(problem, np.arange(5.0), q, turned, tool).tube.value
    assert found[2] <= 0 < found[3]


def margins_of(problem, tool, time=None):
    count = len(tool)
    joints, turned = np.zeros((count, 2)), np.tile(np.eye(3), (count, 1, 1))
    time = np.arange(count) / 10 if time is None else time
    return tube_margins(problem, time, joints, turned, np.array(tool))


def test_the_margin_over_time_is_that_of_the_segment_the_tool_is_in():
    tool = [[0.1, 0, 0.02], [0.2, 0, 0.08], [0.36, 0, 0], [0.4, 0.03, 0], [0.4, 0.2, 0.01]]
    found = margins_of(two_link(CORNER), tool)
    # Half way from the third to the fourth both axes are 0.02 and 0.015 m away.
    assert found.tube == pytest.approx([0.03, -0.03, 0.05, 0.05, 0.04], abs=0.02)
    assert found.tube[[0, 1, 4]] == pytest.approx([0.03, -0.03, 0.04])
    assert found.rotation is None


def test_what_is_cut_off_between_samples_counts_with_the_later():
    """Where the segments hand over, neither sample is; it lies 0.01 m outside both."""
    tool = [[0.1, 0, 0], [0.28, 0, 0], [0.4, 0.12, 0], [0.4, 0.3, 0]]
    found = margins_of(two_link(CORNER), tool)
    assert found.tube == pytest.approx([0.05, 0.05, -0.01, 0.05])


@pytest.mark.parametrize("name", ["ur5/over_the_wall", "ur5/level_tray"])
def test_the_margin_over_time_of_a_plan_is_the_tubes(name):
    """Far from hand-overs, whose instants are the judge's, one segment alone counts."""
    problem = load_problem(f"example:{name}")
    motion = stored_trajectory(name, REFINEMENT).trajectory.reordered(problem.robot.joint_names)
    time = np.linspace(0.0, motion.duration, 1500)
    q = motion.position(time)
    rotation, tool = problem.robot.tool_pose(q)
    found = tube_margins(problem, time, q, rotation, tool)
    whole = tube_excursions(problem, time, q, rotation, tool)
    assert found.tube.min() == -whole.tube.value
    begins = [0.0, *_switching_times(problem, motion), motion.duration]
    for k, (begin, end) in enumerate(pairwise(begins)):
        inner = (time > begin + 2e-3) & (time < end - 2e-3)
        assert found.tube[inner] == pytest.approx(problem.tube.margin(tool[inner])[:, k])
        if problem.tube.rotation is not None:
            asked = problem.tube.rotation.margin(rotation[inner], tool[inner], k)
            assert found.rotation[inner] == pytest.approx(asked)
    if found.rotation is not None:
        assert found.rotation.min() == -whole.rotation.value


def _switching_times(problem, motion):
    samples = motion.per_piece(200)
    segment = current_segments(problem, motion, samples)
    return samples.time[1:][np.diff(segment) > 0]


def test_where_the_rotation_is_free_its_margin_has_no_end():
    turns = [[0, 0, 0, 1]] * 3
    problem = two_link(
        CORNER, orientations=turns, rotation_tolerance=[0.1, [np.inf, np.inf, np.inf]]
    )
    tool = [[0.1, 0, 0], [0.2, 0, 0], [0.4, 0, 0], [0.4, 0.1, 0], [0.4, 0.3, 0]]
    found = margins_of(problem, tool)
    assert found.rotation[:2] == pytest.approx([0.1, 0.1])
    assert (found.rotation[-2:] == np.inf).all()
