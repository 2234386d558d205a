"""verify: the table of conditions, and defects that each of them finds."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cases import PROBLEMS, SHORTEST, changed, rest_to_rest, with_bump, with_motors

from tubeplanner import (
    AttachedSolid,
    Certificate,
    JointTrajectory,
    JudgedCondition,
    Location,
    Obstacle,
    PlanningProblem,
    Tolerance,
    TrajectoryError,
    Tube,
    load_robot,
    placement_of,
    plan,
    verify,
)
from tubeplanner.certificate.judged_motion import FOR_ALL_TIMES
from tubeplanner.certificate.verification import CONDITION_NAMES
from tubeplanner.errors import ProblemError
from tubeplanner.trajectory.joint_trajectory import concatenate

DOCS = Path(__file__).parents[2] / "docs"
UR5, POST = "ur5/over_the_wall", "two_link/around_a_post"
SEARCH = "branch-and-bound"


# The table of conditions: complete, and the one that the pages show.


def documented(page):
    """Return the conditions that the table of a page lists."""
    table = (DOCS / page).read_text().split("| condition |")[1].split("\n\n")[0]
    cells = [row.split("|")[1] for row in table.splitlines()[2:]]
    return [name.strip(" `") for cell in cells for name in cell.split(",")]


def test_the_pages_list_and_explain_all_conditions():
    assert tuple(documented("reference/certificate.md")) == CONDITION_NAMES
    assert sorted(documented("concepts/certificate.md")) == sorted(CONDITION_NAMES)


@pytest.mark.parametrize("name", CONDITION_NAMES)
def test_no_certificate_leaves_a_condition_out(name):
    met = JudgedCondition(0.0, "m", Location(), FOR_ALL_TIMES)
    conditions = {other: met for other in CONDITION_NAMES if other != name}
    with pytest.raises(KeyError, match=name):
        Certificate(conditions, Tolerance())


# Planned trajectories pass; what is wrong with others is found at its place.


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_planned_trajectory_passes_and_a_little_faster_it_is_too_fast(name, stored):
    problem, trajectory = stored(name)
    certificate = verify(problem, trajectory)
    assert certificate.passed
    assert tuple(certificate.conditions) == CONDITION_NAMES
    required = [c for c in certificate.conditions.values() if c.margin is not None]
    assert {c.coverage for c in required} <= {"for all t", "tool at the reference point"}
    faster = trajectory.scaled(1 / 1.002)
    certificate = verify(problem, faster)
    failures = certificate.failures()
    assert set(failures) in ({"effort"}, {"velocity"}, {"effort", "velocity"})
    worst = min(certificate.conditions[failure].margin for failure in failures)
    assert -0.0045 < worst < -0.0015
    assert verify(problem, faster, Tolerance(1e-4, 1e-2)).passed


@pytest.mark.parametrize(("absolute", "relative"), [(-1e-9, 0), (0, 1), (np.nan, 0)])
def test_a_tolerance_must_be_small_and_not_negative(absolute, relative):
    with pytest.raises(Exception, match=r"tolerance: .* not in \[0, 1\)"):
        Tolerance(absolute, relative)


def test_joints_may_come_in_any_order_but_must_be_the_problems(stored):
    problem, trajectory = stored(UR5)
    other = verify(problem, trajectory.reordered(trajectory.joint_names[::-1]))
    assert other.passed
    assert other.braking == verify(problem, trajectory).braking
    alien = JointTrajectory(["x"], [0, 1], np.zeros((2, 1, 1)))
    with pytest.raises(TrajectoryError, match="the trajectory moves the joints x"):
        verify(problem, alien)


def test_position_and_signs_say_where_they_are_nearest_to_their_ends(stored):
    problem, trajectory = stored(POST, SEARCH)
    t = np.linspace(0, trajectory.duration, 40_001)
    q = trajectory.position(t)
    certificate = verify(problem, trajectory)
    limits = problem.robot.limits
    joint_margin = np.minimum(q - limits.lower_position, limits.upper_position - q)
    sample, joint = np.unravel_index(joint_margin.argmin(), joint_margin.shape)
    position = certificate.conditions["position"]
    assert position.margin == pytest.approx(joint_margin.min(), abs=1e-6)
    assert position.where.joint == problem.robot.joint_names[joint]
    assert position.where.time == pytest.approx(t[sample], abs=1e-3)
    signs = certificate.conditions["joint_signs"]
    assert signs.margin == pytest.approx((-q[:, 1]).min(), abs=1e-6)
    assert signs.where.time == pytest.approx(t[q[:, 1].argmax()], abs=1e-3)
    assert signs.where.joint == "joint2"


def test_the_time_of_a_sign_counts_from_the_beginning(stored):
    """The tightest range is that of the last segment, which is visited late."""
    problem, trajectory = stored(POST, SEARCH)
    t = np.linspace(0, trajectory.duration, 40_001)
    elbow = trajectory.position(t)[:, 1]
    highest = float(elbow[t > 0.8 * trajectory.duration].max())
    signs = [{"joint2": "-"}, {"joint2": "-"}, {"joint2": [-3.0, highest + 1e-4]}]
    tube = Tube(problem.tube.points, problem.tube.radius, joint_signs=signs)
    condition = verify(changed(problem, tube=tube), trajectory).conditions["joint_signs"]
    assert condition.margin <= 1e-4 + 1e-9
    assert condition.where.segment == 2
    near = np.flatnonzero(abs(t - condition.where.time) < 1e-4)
    assert elbow[near].max() == pytest.approx(highest + 1e-4 - condition.margin, abs=1e-6)


@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "jerk"])
def test_the_only_joint_with_a_limit_is_judged_and_named(quantity, stored):
    problem, trajectory = stored(POST)
    s = trajectory.per_piece(1000)
    values = {
        "velocity": s.velocity,
        "acceleration": s.acceleration,
        "jerk": trajectory.jerk_per_piece(1000),
    }
    limit = [np.inf, 0.9 * abs(values[quantity][:, 1]).max()]
    limits = {"effort": np.inf, "velocity": np.inf, quantity: limit}
    tight = with_motors(problem.robot, limits=limits)
    certificate = verify(changed(problem, robot=tight), trajectory)
    assert certificate.failures() == [quantity]
    condition = certificate.conditions[quantity]
    assert condition.margin == pytest.approx(1 - 1 / 0.9, abs=1e-4)
    assert (condition.where.joint, condition.coverage) == ("joint2", "for all t")


# An arm at rest: what holds and what is not asked.

REST = np.array([0.3, -1.0])


def judged_at_rest(robot, steps, radius, **tube):
    """Return the certificate of an arm that stays in a tube through its tool and steps from it."""
    still = JointTrajectory(robot.joint_names, [0, 1.0], REST[None, None])
    points = robot.tool_position(REST[None])[0] + np.array([[0, 0, 0], *steps])
    tube = Tube(points, radius, **tube)
    return verify(PlanningProblem(robot, tube, REST, REST, self_collision=False), still)


def test_a_trajectory_that_skips_a_segment_fails_ordered_and_passes_any(two_link):
    """A narrow U whose ends overlap: staying there is in the union, but the bend is left out."""
    steps = [[0, -0.3, 0], [0.03, -0.3, 0], [0.03, 0, 0]]
    condition = judged_at_rest(two_link, steps, 0.05).conditions["tube"]
    assert condition.margin == pytest.approx(0.05 - 0.3)
    assert condition.where.segment == 1
    assert "tube" not in judged_at_rest(two_link, steps, 0.05, visit="any").failures()


def test_what_is_not_asked_has_no_margin(two_link):
    conditions = judged_at_rest(two_link, [[0.05, 0, 0]], 0.1).conditions
    for name in ("velocity", "acceleration", "jerk", "joint_signs", "rotation"):
        assert conditions[name].margin is None
    for name in ("obstacles", "self_collision"):
        assert conditions[name].margin is None
        assert conditions[name].coverage.startswith("no ")


# What cannot be decided fails and says so.


def test_what_is_undecided_says_so_and_fails(two_link):
    """Nine thousand radians in ten nanoseconds: no bound on it is worth anything."""
    wild = JointTrajectory(two_link.joint_names, [0, 1e-8], [[[9e11, 9e11]], [[0.0, -1.0]]])
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 5.0)
    certificate = verify(PlanningProblem(two_link, tube, wild.position(0.0)), wild)
    for name in ("effort", "tube"):
        coverage = certificate.conditions[name].coverage
        assert name in certificate.failures()
        assert coverage.startswith("for all t, undecided: the margin found is ")


# A tube whose segments are divided asks the same.


def divided(tube, parts):
    """Return a tube with every segment divided."""
    locations = np.arange(tube.segment_count * parts + 1) / parts
    numbers = np.arange(tube.segment_count + 1)
    points = np.array([np.interp(locations, numbers, column) for column in tube.points.T]).T
    points[::parts] = tube.points
    signs = [row for row in tube.joint_signs for _ in range(parts)]
    return Tube(points, np.repeat(tube.radius, parts), joint_signs=signs)


def test_a_divided_tube_gets_the_same_certificate_in_its_own_numbers(stored):
    problem, trajectory = stored(UR5)
    parts = 16
    finer = changed(problem, tube=divided(problem.tube, parts))
    whole, other = (verify(each, trajectory).conditions for each in (problem, finer))
    for name in CONDITION_NAMES:
        assert other[name].margin == whole[name].margin
        assert other[name].where.time == whole[name].where.time
    for name in ("tube", "joint_signs"):
        where = other[name].where
        assert where.segment // parts == whole[name].where.segment
        tool = problem.robot.tool_position(trajectory.position([where.time]))
        distance = finer.tube.distance(tool)[0]
        # Where two segments meet, rounding says which is nearer.
        assert distance[where.segment] <= distance.min() + 1e-12


def test_a_divided_tube_gets_the_same_trajectory_to_the_last_digit(bundled):
    problem = bundled(POST)
    whole, other = (
        plan(each, SHORTEST) for each in (problem, changed(problem, tube=divided(problem.tube, 4)))
    )
    np.testing.assert_array_equal(other.trajectory.coefficients, whole.trajectory.coefficients)
    assert other.duration == whole.duration
    radii = [s for s in other.sensitivities if s.limit == "radius"]
    assert {(s.segment, s.last_segment) for s in radii} == {(0, 3), (4, 7), (8, 11)}
    assert str(radii[0]).startswith(f"radius of segments {radii[0].segment} to ")


# A defect that 2,000 samples do not see.


@pytest.mark.parametrize("free_by", [None, 1e-5])
def test_a_thin_plate_passed_between_two_samples(two_link, free_by):
    """A grain of 0.1 mm crosses a plate of 0.1 mm at 2.4 m/s; or passes beside it."""
    ball = Obstacle.sphere("grain", 5e-5, placement_of([0, 0, 0]))
    grain = AttachedSolid("grain", ball.shapes, touch_links=("link2",))
    trajectory = JointTrajectory(two_link.joint_names, [0, 0.25], [[[4.0, 0]], [[-0.5, -0.3]]])
    times = np.linspace(0, trajectory.duration, 2000)
    crossing = times[1000:1002].mean()
    tool = two_link.tool_position(trajectory.position(np.array([crossing, crossing + 1e-6])))
    angle = np.arctan2(*(tool[1] - tool[0])[[1, 0]])
    outwards = tool[0] / np.linalg.norm(tool[0])
    # The plate lies across the path; its inner edge just reaches the grain, or just does not.
    reach = 0.01 + 5e-5 + (free_by or -4e-5)
    placement = placement_of(tool[0] + reach * outwards, rpy=(0, 0, angle))
    problem = PlanningProblem(
        two_link,
        Tube(tool[0] + np.array([[-1, 0, 0], [1, 0, 0]]), 2.0),
        trajectory.position(0.0),
        obstacles=[Obstacle.box("plate", [1e-4, 0.02, 0.02], placement)],
        attached=[grain],
        ignore_collisions=[("link1", "plate"), ("link2", "plate")],
    )
    checker = problem.collision
    (pair,) = checker.obstacle_pairs
    assert checker.owners(pair)[0] == ("grain",)
    poses = zip(*two_link.body_poses(trajectory.position(times)), strict=True)
    assert min(checker.distances(*pose, np.array([pair]))[0] for pose in poses) > 0
    condition = verify(problem, trajectory).conditions["obstacles"]
    if free_by is None:
        assert condition.margin < -1e-5
        assert condition.where.links == ("grain",)
        assert condition.where.time == pytest.approx(crossing, abs=5e-5)
    else:
        assert 0 < condition.margin < 2e-5


# Tubes of boxes and compulsory points, against closed forms: motions along the axes of a gantry.


AXIS = """<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/><limit lower="-5" upper="5" effort="1000" velocity="100"/></joint>
<link name="{child}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
FLAT = {"box": [0.2, 0.04], "up": [0, 0, 1]}
SQUARE = {"box": [0.04, 0.04], "up": [0, 0, 1]}
NARROW = {"box": [0.04, 0.036], "up": [0, 0, 1]}
LINE = [[0, 0, 0], [1, 0, 0]]


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    """A gantry: the tool is at its three joints' positions."""
    axes = (("x", "base", "1 0 0"), ("y", "at_x", "0 1 0"), ("z", "at_y", "0 0 1"))
    parts = [AXIS.format(name=n, parent=p, child=f"at_{n}", axis=a) for n, p, a in axes]
    path = tmp_path_factory.mktemp("gantry") / "gantry.urdf"
    path.write_text(f'<robot name="gantry"><link name="base"/>{"".join(parts)}</robot>')
    return load_robot(path, "at_z", gravity=(0, 0, 0))


def straight(*locations):
    """Return a motion from place to place, from rest to rest in a second each."""
    return concatenate([rest_to_rest(tuple("xyz"), p, q, 1.0) for p, q in pairwise(locations)])


def beside(offset):
    return straight(np.add(LINE[0], offset), np.add(LINE[1], offset))


def judged_in(gantry, tube, trajectory):
    ends = (trajectory.position(0.0), trajectory.position(trajectory.duration))
    return verify(PlanningProblem(gantry, tube, *ends, self_collision=False), trajectory)


@pytest.mark.parametrize(
    ("offset", "tool_radius", "margin"),
    [
        ([0, 0.08, 0.005], 0.0, 0.015),
        ([0, -0.095, -0.018], 0.0, 0.002),
        ([0, 0.08, 0.005], 0.008, 0.007),
    ],
    ids=["below the top", "in a corner", "a tool with a radius"],
)
def test_a_straight_motion_is_as_far_inside_as_its_nearest_face(
    gantry, offset, tool_radius, margin
):
    tube = Tube(LINE, None, cross_section=FLAT, tool_radius=tool_radius)
    certificate = judged_in(gantry, tube, beside(offset))
    assert certificate.passed
    assert certificate.conditions["tube"].margin == pytest.approx(margin, abs=1e-9)


@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_in_the_corner_of_a_square_box_a_disc_is_left(gantry, visit):
    square, narrow = (Tube(LINE, None, cross_section=s, visit=visit) for s in (SQUARE, NARROW))
    box = judged_in(gantry, square, beside([0, 0.019, 0.019]))
    assert box.passed
    assert box.conditions["tube"].margin == pytest.approx(0.001, abs=1e-9)
    bent = straight([0, 0, 0], [0.5, 0.019, 0.019], [1, 0, 0])
    tubes = (square, narrow, Tube(LINE, 0.02, visit=visit))
    assert [judged_in(gantry, tube, bent).passed for tube in tubes] == [True, False, False]


@pytest.mark.parametrize("height", [0.012, 0.008])
def test_a_wall_met_for_a_ten_thousandth_of_a_second_is_found(gantry, height):
    """A bump of 12 mm in a motion 10 mm beside the wall; one of 8 mm is none of its business."""
    trajectory = with_bump(beside([0, 0.09, 0]), 1, 0.5037, 1e-4, height)
    found = judged_in(gantry, Tube(LINE, None, cross_section=FLAT), trajectory)
    assert found.conditions["tube"].margin == pytest.approx(0.01 - height, abs=1e-6)


def test_segments_are_changed_where_both_boxes_hold_the_tool(gantry):
    """The boxes of a corner overlap farther out than the discs in them."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    trajectory = straight([0, 0, 0], [0.92, 0.08, 0], [1, 1, 0])
    certificate = judged_in(gantry, Tube(points, None, cross_section=FLAT), trajectory)
    assert certificate.passed
    assert certificate.conditions["tube"].margin == pytest.approx(0.02, abs=1e-9)
    mixed = Tube(points, [0.02, None], cross_section=[None, FLAT])
    for tube in (Tube(points, 0.02), mixed):
        assert not judged_in(gantry, tube, trajectory).passed


@pytest.mark.parametrize(("short", "passes"), [(0.015, True), (0.03, False)])
def test_a_compulsory_point_is_passed_within_the_smaller_half_side(gantry, short, passes):
    tube = Tube([[0, 0, 0], [1, 0, 0], [0, 0, 0]], None, cross_section=FLAT)
    found = judged_in(gantry, tube, straight([0, 0, 0], [1 - short, 0, 0], [0, 0, 0]))
    assert found.conditions["tube"].margin >= 0
    assert found.passed is passes
    assert found.conditions["points"].margin == pytest.approx(0.02 - short, abs=1e-6)


def test_a_compulsory_point_that_is_left_out_is_found(gantry):
    """The tool turns round too soon: both capsules overlap all the way."""
    above, below, away = [0, 0, 0], [0, 0, -0.15], [0, 0.2, 0]
    points = [[0, -0.1, 0], above, above, below, above, away]
    short = straight(points[0], above, [0, 0, -0.05], above, away)
    certificate = judged_in(gantry, Tube(points, 0.02), short)
    assert certificate.failures() == ["points"]
    condition = certificate.conditions["points"]
    assert condition.where.point == 3  # as the file counts: it leaves out the one that repeats
    assert condition.margin == pytest.approx(0.02 - 0.1)
    assert "points: margin -0.08" in certificate.describe("points")
    assert "(point 3, t = 2.0000 s)" in certificate.describe("points")
    every = judged_in(gantry, Tube(points, 0.02, pass_through_points="all"), short)
    assert every.conditions["points"].where.point == 3
    nothing = judged_in(gantry, Tube(points, 0.02, pass_through_points="none"), short)
    assert nothing.conditions["points"].margin is None


def test_a_start_outside_a_box_is_refused(gantry):
    with pytest.raises(ProblemError, match=r"0.005 m outside the box of segment 0"):
        PlanningProblem(gantry, Tube(LINE, None, cross_section=FLAT), [0.0, 0.0, 0.025])
