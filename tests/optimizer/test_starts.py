"""First splines of a refinement: reference branch, coarser knots, last motion, period grid."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import LimitOverrides, PlanningProblem, Tube, load_robot
from tubeplanner.first_guess.branches import RedundancyRule, reference_branch
from tubeplanner.native.library import LIBRARY
from tubeplanner.optimizer.descent import Descent, DescentState, SequentialProgram
from tubeplanner.optimizer.phased_spline import PhasedSpline
from tubeplanner.optimizer.starts import (
    knot_grid,
    on_periodic_knots,
    slowed_beside_bands,
    starting_spline,
    subdivided,
    with_turn_knots,
)
from tubeplanner.optimizer.step_search import TrustRegion
from tubeplanner.outcome import Infeasible, PlanStatus


@pytest.fixture(scope="module")
def motion(planned):
    return planned("two_link/around_a_post", "refinement")[1].motion


def moved(problem, steps):
    return problem.with_tube(replace(problem.tube, points=problem.tube.points + np.array(steps)))


def test_where_nothing_changes_it_stays_and_goes_to_a_given_goal(motion):
    points, problem = motion.spline.control_points, motion.problem
    shifted = motion.shifted(problem)
    np.testing.assert_allclose(shifted.control_points, points, rtol=0, atol=1e-6)
    assert shifted.grid is motion.spline.grid
    goal = points[-1] + [0.02, -0.01]
    ends = motion.shifted(replace(problem, goal=goal)).control_points[-3:]
    np.testing.assert_allclose(ends, np.tile(goal, (3, 1)), atol=1e-12)


def test_its_tool_moves_with_the_reference_points_and_it_stays_at_rest(motion):
    steps = [[0.01, 0.0, 0.0], [-0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, -0.01, 0.0]]
    changed = moved(motion.problem, steps)
    spline = motion.shifted(changed)
    before, after = (
        changed.robot.tool_position(each.bspline()(spline.switching_times))
        for each in (motion.spline, spline)
    )
    np.testing.assert_allclose(after[[0, -1]], changed.tube.points[[0, -1]], atol=1e-8)
    # Control points near a corner follow it, but for what the spline makes of the others.
    np.testing.assert_allclose(after - before, steps, atol=2e-3)
    assert np.ptp(spline.control_points[:3], axis=0).max() == 0
    assert np.ptp(spline.control_points[-3:], axis=0).max() == 0


def test_a_goal_out_of_reach_is_none(motion):
    far = moved(motion.problem, [[0, 0, 0]] * 3 + [[0.0, 0.5, 0.0]])
    with pytest.raises(Infeasible, match="does not lead to reference point 3") as error:
        motion.shifted(far)
    assert error.value.status is PlanStatus.UNREACHABLE


def test_it_suits_problems_with_the_same_joints_and_segments(motion, slide):
    problem = motion.problem
    wider = problem.with_tube(problem.tube.scaled(1.2))
    assert motion.suited(wider) is wider
    points = problem.tube.points
    fewer = Tube(points[:-1], 0.03, joint_signs={"joint2": "-"})
    assert motion.suited(problem.with_tube(fewer)) is None
    tool = slide.tool_position(np.zeros((1, 3)))[0]
    other = Tube(tool + points - points[0], 0.05)
    assert motion.suited(PlanningProblem(slide, other, np.zeros(3))) is None


GROWN = (
    ("turn", "revolute", (0.1, 0, 0.3), "0 0 1"),
    ("lift", "revolute", (0.2, 0, 0.1), "0 1 0"),
    ("slide", "prismatic", (0.3, 0.1, 0), "1 0 0"),
    ("swing", "revolute", (0.2, 0, 0), "0 0 1"),
    ("tip", "fixed", (0.2, 0, 0), "1 0 0"),
)


def grown(tmp_path, size):
    """Return a problem of an arm that turns and slides, with all lengths times a size."""
    text, parent, limits = '<link name="base"/>', "base", {}
    for name, kind, at, axis in GROWN:
        unit = size if kind == "prismatic" else 1.0
        place = " ".join(str(size * x) for x in at)
        text += (
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" '
            f'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{name}" type="{kind}">'
            f'<parent link="{parent}"/><child link="{name}"/><origin xyz="{place}"/>'
            f'<axis xyz="{axis}"/><limit lower="{-2 * unit}" upper="{2 * unit}" effort="1e6" '
            f'velocity="{3 * unit}"/></joint>'
        )
        parent = name
        if kind != "fixed":
            limits[name] = 9.0 * unit
    path = tmp_path / f"arm_{size}.urdf"
    path.write_text(f'<robot name="grown">{text}</robot>')
    robot = load_robot(path, "tip", limits=LimitOverrides(acceleration=limits))
    start = np.array([0.1, -0.2, 0.3 * size, 0.4])
    steps = size * np.array([[0, 0, 0], [0.1, 0.3, 0], [0.2, 0.3, 0.2]])
    tube = Tube(robot.tool_position(start[None]) + steps, 0.03 * size)
    return PlanningProblem(robot, tube, start, self_collision=False)


def test_arms_of_every_size_begin_alike_and_take_the_same_steps(tmp_path):
    splines, durations = [], []
    for size in (1.0, 0.3, 10.0):
        problem = grown(tmp_path, size)
        branch = reference_branch(problem, RedundancyRule.AS_NEEDED)
        spline = starting_spline(problem, branch, 8)
        splines.append(spline.control_points / problem.robot.joint_units)
        program = SequentialProgram(problem, spline.grid)
        begun = DescentState((program.iterate(spline),), TrustRegion(0.2))
        ended = Descent((program,)).improved(begun, min_gain=1e-4, max_steps=3)
        durations.append((begun.iterate.duration, ended.iterate.duration))
    np.testing.assert_allclose(np.ptp(splines, axis=0), 0, atol=1e-9)
    first, last = np.transpose(durations)
    assert np.ptp(first) < 1e-9
    assert last.max() < 0.9 * first.max()
    if LIBRARY.functions is not None:  # PIQP's steps differ by its tolerances
        assert np.ptp(last) < 1e-4


SWITCHING_TIMES = np.array([0.0, 0.31, 0.33, 1.0])
CHAINS = (range(0, 2), range(2, 3), range(3, 4))
FINE, FEWER_THAN_KNOTS, FEWER_THAN_PHASES_NEED, FEWEST = 2000, 25, 7, 4


def spline():
    """Return a motion of two joints, control points at the means of their knots."""
    grid = knot_grid(SWITCHING_TIMES, 40, CHAINS)
    knots, count = grid.knots(SWITCHING_TIMES), grid.control_point_count
    x = np.mean([knots[k : k + count] for k in (1, 2, 3)], axis=0)[:, None]
    points = x**3 * (10 - 15 * x + 6 * x**2) * np.array([1.0, -0.4])
    points[:3], points[-3:] = points[0], points[-1]
    return PhasedSpline(grid, SWITCHING_TIMES, points)


@pytest.mark.parametrize("periods", [FINE, 60, FEWER_THAN_KNOTS, FEWER_THAN_PHASES_NEED, FEWEST])
def test_all_knots_are_multiples_and_every_phase_keeps_its_own(periods):
    """As many knots as before or as there is room for, no two the same; the segments stay."""
    before, regular = spline(), on_periodic_knots(spline(), periods)
    knots = regular.grid.breakpoints(regular.switching_times) * periods
    np.testing.assert_allclose(knots, knots.round(), atol=1e-9)
    widths = np.diff(knots.round())
    assert widths.min() >= 1
    assert (knots[0], knots[-1]) == (0.0, pytest.approx(periods))
    assert regular.grid.interval_count == min(before.grid.interval_count, periods)
    assert len(regular.control_points) == regular.grid.control_point_count
    assert regular.grid.runs == CHAINS
    for fraction in regular.grid.fractions:
        assert (fraction[0], fraction[-1]) == (0.0, 1.0)
        assert np.diff(fraction).min() > 0
    ends = np.cumsum([0, *(len(fraction) - 1 for fraction in regular.grid.fractions)])
    np.testing.assert_allclose(regular.switching_times * periods, knots[ends])
    # Switching times no longer move.
    assert regular.grid.is_fixed
    assert (before.grid.switch_count, regular.grid.switch_count) == (2, 0)
    if periods == 60:
        # Chebyshev's are closest at the ends: there every period has one. Knots that fall onto
        # one are made up for in the widest intervals.
        assert widths[0] == widths[-1] == 1
        assert widths.max() <= 2


@pytest.mark.parametrize(
    ("times", "periods", "expected"),
    [
        ([0, 0.31, 0.33, 1], 500, [0, 155, 165, 500]),
        ([0, 0.5, 0.501, 0.502, 1], 10, [0, 5, 6, 7, 10]),
        ([0, 0.98, 0.99, 1], 4, [0, 2, 3, 4]),
        ([0, 0.01, 0.99, 1], 5, [0, 1, 4, 5]),
    ],
)
def test_switching_times_stay_to_a_period_and_move_apart_if_they_are_closer(
    times, periods, expected
):
    grid = knot_grid(np.array(times), 40)
    before = PhasedSpline(grid, np.array(times), np.zeros((grid.control_point_count, 1)))
    regular = on_periodic_knots(before, periods)
    np.testing.assert_allclose(regular.switching_times * periods, expected, atol=1e-12)
    assert regular.grid.interval_count == min(grid.interval_count, periods)


@pytest.mark.parametrize(("periods", "apart"), [(FINE, 1e-4), (100, 1e-2)])
def test_it_is_nearly_the_same_motion_at_rest_at_both_ends(periods, apart):
    before, regular = spline(), on_periodic_knots(spline(), periods)
    x = np.linspace(0, 1, 500)
    assert abs(regular.bspline()(x) - before.bspline()(x)).max() < apart
    np.testing.assert_array_equal(regular.control_points[[0, 1, 2]], before.control_points[[0] * 3])
    np.testing.assert_array_equal(regular.control_points[-3:], before.control_points[[-1] * 3])


# ---- Knots of turns at a limited speed, and longer motions beside bands.

BAND = {"between": [0.2, 0.25]}


@pytest.fixture(scope="module")
def bead(motion):
    """A motion through the corners of a tube whose speed has a band between them."""
    tube = replace(motion.problem.tube, tool_speed=[0.25] * 3, least_tool_speed=[None, 0.2, None])
    return motion.problem.with_tube(tube), motion.spline


def test_turns_at_a_limited_speed_get_knots_and_the_motion_stays(bead):
    problem, spline = bead
    finer = with_turn_knots(problem, spline, 20.0)
    x = np.linspace(0, 1, 501)
    np.testing.assert_allclose(finer.bspline()(x), spline.bspline()(x), atol=1e-6)
    count = spline.grid.interval_count
    assert finer.grid.usual_count == count < finer.grid.interval_count <= count + 3 * 16
    knots = finer.grid.breakpoints(finer.switching_times)
    for corner in spline.switching_times[1:-1]:
        beside = np.diff(knots)[np.searchsorted(knots, corner) - 1 :][:2]
        assert beside.max() < 0.5 * np.diff(spline.grid.breakpoints(spline.switching_times)).max()
    free = problem.with_tube(replace(problem.tube, tool_speed=None, least_tool_speed=None))
    assert with_turn_knots(free, spline, 20.0) is spline


@pytest.mark.parametrize("longer", [1.2, 3.0])
def test_a_longer_motion_is_slowed_beside_its_stretch(bead, longer):
    problem, spline = bead[0], subdivided(bead[1], 4)
    slowed = slowed_beside_bands(problem, spline, longer)
    # The stretch takes as long as before, and both ends are at rest.
    before, after = (np.diff(each.switching_times)[1] for each in (spline, slowed))
    assert longer * after == pytest.approx(before, rel=1e-6)
    np.testing.assert_array_equal(slowed.control_points[[0, -1]], spline.control_points[[0, -1]])
    ends = spline.switching_times[1:3], slowed.switching_times[1:3]
    u = np.linspace(0.05, 0.95, 50)
    speeds = [
        each.bspline().derivative()(begin + u * (end - begin)) / scale
        for each, (begin, end), scale in zip((spline, slowed), ends, (1.0, longer), strict=True)
    ]
    np.testing.assert_allclose(*speeds, atol=2e-2 * abs(speeds[0]).max())
    assert slowed_beside_bands(problem, spline, 0.9) is spline
