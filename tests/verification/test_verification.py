"""verify: the list of conditions and the Certificate."""

from dataclasses import replace
from importlib import import_module
from inspect import getmembers, isfunction
from itertools import pairwise
from pathlib import Path
from pkgutil import iter_modules

import numpy as np
import pytest
from cases import PROBLEMS, SHORTEST, changed, unlimited

from tubeplanner import (
    AttachedSolid,
    Certificate,
    JointTrajectory,
    JudgedCondition,
    LimitOverrides,
    Obstacle,
    Place,
    PlanningProblem,
    Seed,
    Tolerance,
    TrajectoryError,
    Tube,
    load_problem,
    load_robot,
    placement_of,
    plan,
    verify,
)
from tubeplanner.errors import ProblemError
from tubeplanner.verification import judged
from tubeplanner.verification.conditions import CONDITION_NAMES, JUDGED
from tubeplanner.verification.judged_condition import FOR_ALL_TIMES

# The table of conditions: complete, and the one that the pages show.


DOCS = Path(__file__).parents[2] / "docs"


def documented(page):
    """Return the conditions that the table of a page lists."""
    table = (DOCS / page).read_text().split("| condition |")[1].split("\n\n")[0]
    cells = [row.split("|")[1] for row in table.splitlines()[2:]]
    return [name.strip(" `") for cell in cells for name in cell.split(",")]


def test_the_reference_lists_the_conditions_in_order():
    assert tuple(documented("reference/certificate.md")) == CONDITION_NAMES


def test_the_method_of_every_condition_is_explained():
    assert sorted(documented("concepts/certificate.md")) == sorted(CONDITION_NAMES)


def test_every_condition_that_can_be_judged_is():
    found = {
        function
        for module in iter_modules(judged.__path__, f"{judged.__name__}.")
        for name, function in getmembers(import_module(module.name), isfunction)
        if name.startswith("judge_")
    }
    assert found == set(JUDGED.values())
    assert len(found) == len(JUDGED)
    assert all(function.__name__ == f"judge_{name}" for name, function in JUDGED.items())


@pytest.mark.parametrize("name", CONDITION_NAMES)
def test_no_certificate_leaves_a_condition_out(name):
    met = JudgedCondition(0.0, "m", Place(), FOR_ALL_TIMES)
    conditions = {other: met for other in CONDITION_NAMES if other != name}
    with pytest.raises(KeyError, match=name):
        Certificate(conditions, Tolerance())


# Defects put into good trajectories: each is found by its own condition, at its place.


UR5 = "ur5/over_the_wall"


def with_radius(tube, radius):
    return Tube(tube.points, radius, joint_signs=tube.joint_ranges, visit=tube.visit)


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_planned_trajectory_passes(name, stored):
    problem, trajectory = stored(name)
    certificate = verify(problem, trajectory)
    assert certificate.passed
    assert tuple(certificate.conditions) == CONDITION_NAMES


@pytest.mark.parametrize("name", PROBLEMS)
def test_two_parts_in_a_thousand_faster_is_too_fast(name, stored):
    problem, trajectory = stored(name)
    certificate = verify(problem, trajectory.scaled(1 / 1.002))
    assert set(certificate.failures()) <= {"effort", "velocity"}
    assert certificate.failures()
    worst = min(certificate.conditions[name].margin for name in certificate.failures())
    assert -0.0045 < worst < -0.0015


def test_a_tool_pushed_out_of_the_tube_by_a_fraction_of_a_millimetre_is_found(stored):
    """A bump of the shoulder in mid-segment, and the radius that it exceeds by 0.2 mm."""
    problem, trajectory = stored(UR5)
    trajectory, when = bumped(trajectory, joint=0, size=0.02)
    near = trajectory.position(np.linspace(when - 0.05, when + 0.05, 4001))
    segment = 1
    off = problem.tube.distance(problem.robot.tool_position(near))[:, segment].max()
    radius = problem.tube.radius.copy()
    radius[segment] = off - 2e-4
    certificate = verify(changed(problem, tube=with_radius(problem.tube, radius)), trajectory)
    assert "tube" in certificate.failures()
    condition = certificate.conditions["tube"]
    assert condition.margin == pytest.approx(-2e-4, abs=5e-6)
    assert condition.where.segment == segment
    assert condition.where.time == pytest.approx(when, abs=0.02)
    assert "tube" not in verify(problem, trajectory).failures()


def bumped(trajectory, joint, size):
    """Return the trajectory with a smooth bump of one joint over its middle piece, and when."""
    piece = len(trajectory.widths) // 2
    width = trajectory.widths[piece]
    coefficients = np.concatenate(
        [np.zeros((1, *trajectory.coefficients.shape[1:])), trajectory.coefficients]
    )
    # 64 u^3 (1 - u)^3 has the value 1 at u = 1/2, and no slope or curvature at its ends.
    bump = 64 * size * np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
    coefficients[:, piece, joint] += bump
    bump_time = trajectory.breakpoints[piece] + width / 2
    return (
        JointTrajectory(trajectory.joint_names, trajectory.breakpoints, coefficients),
        float(bump_time),
    )


def test_a_trajectory_through_the_wall_is_found(stored):
    """The same trajectory with its lift left out: straight from pick to place."""
    problem, trajectory = stored(UR5)
    ends = trajectory.position(np.array([0.0, trajectory.duration]))
    shape = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    coefficients = shape[:, None, None] * (ends[1] - ends[0])
    coefficients[-1] = ends[0]
    straight = JointTrajectory(problem.robot.joint_names, [0, 1.0], coefficients).scaled(3.0)
    certificate = verify(problem, straight)
    condition = certificate.conditions["obstacles"]
    assert {"obstacles", "tube"} <= set(certificate.failures())
    assert condition.where.obstacle == "wall"
    assert condition.margin < -0.02
    assert condition.where.time == pytest.approx(1.5, abs=0.6)


def test_the_clearance_is_asked_for(stored):
    problem, trajectory = stored(UR5)
    kept = verify(problem, trajectory).conditions["obstacles"].margin
    wider = changed(problem, clearance=problem.clearance + kept + 2e-3)
    condition = verify(wider, trajectory).conditions["obstacles"]
    assert -3e-3 < condition.margin < -1e-3


def test_a_cart_that_would_drive_through_a_plate_is_refused(tmp_path):
    """Two metres in a second, through two millimetres: at no start, end or middle of a piece."""
    cart = """<robot name="cart"><link name="rail"/>
        <link name="cart"><inertial><mass value="2"/>
          <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
          <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
        <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/>
          <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="100" velocity="100"/></joint>
        </robot>"""
    (tmp_path / "cart.urdf").write_text(cart)
    robot = load_robot(tmp_path / "cart.urdf", "cart")
    drive = JointTrajectory(["slide"], [0, 1.0], [[[2.0]], [[-1.0]]])
    plate = Obstacle.box("plate", [2e-3, 1, 1], placement_of([0.4, 0, 0]))
    tube = Tube([[-1, 0, 0], [1, 0, 0]], 0.1)
    problem = PlanningProblem(robot, tube, np.array([-1.0]), obstacles=[plate])
    condition = verify(problem, drive).conditions["obstacles"]
    assert condition.margin == pytest.approx(-0.051, abs=2e-3)
    assert condition.where.time == pytest.approx(0.7, abs=0.01)
    assert condition.where.links == ("cart",)


def test_a_clearance_is_never_said_to_be_more_than_it_is(two_link):
    """The stretched arm passes a ball at a distance known in closed form, at no special instant."""
    ball = Obstacle.sphere("ball", 0.05, placement_of([0.95, 0, 0]))
    sweep = JointTrajectory(two_link.joint_names, [0, 1.0], [[[1.0, 0]], [[-0.3123, 0.0]]])
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 5.0)
    problem = PlanningProblem(two_link, tube, sweep.position(0.0), obstacles=[ball], clearance=0.01)
    corner = np.array([0.62, 0.02])  # of the stretched arm's end [m]
    exact = 0.95 - 0.05 - np.linalg.norm(corner) - 0.01
    condition = verify(problem, sweep).conditions["obstacles"]
    assert 0.975 * exact <= condition.margin <= exact + 1e-9
    assert condition.coverage == "for all t"


def test_links_that_meet_are_found(ur5):
    """The elbow folds until the wrist is in the upper arm."""
    q0, q1 = np.array([0, -1.2, 1.5, -1.5, -1.5, 0.0]), np.array([0, -1.2, 3.1, -1.5, -1.5, 0])
    shape = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])[:, None, None]
    coefficients = shape * (q1 - q0)
    coefficients[-1] = q0
    folding = JointTrajectory(ur5.joint_names, [0, 1.0], coefficients).scaled(4.0)
    tool = ur5.tool_position(np.array([q0, q1]))
    problem = PlanningProblem(ur5, Tube(tool, 2.0), q0, q1)
    certificate = verify(problem, folding)
    assert certificate.failures() == ["self_collision"]
    assert "upper_arm_link" in certificate.conditions["self_collision"].where.links


def test_a_flipped_sign_is_found(stored):
    problem, trajectory = stored("two_link/around_a_post")
    tube = problem.tube
    flipped = Tube(tube.points, tube.radius, joint_signs={"joint2": "+"})
    certificate = verify(changed(problem, tube=flipped), trajectory)
    assert "joint_signs" in certificate.failures()
    assert certificate.conditions["joint_signs"].where.joint == "joint2"


def test_a_range_broken_for_an_instant_between_samples_is_found(stored):
    """The joint's largest value, found exactly; a range that ends 1e-5 rad below it is broken."""
    problem, trajectory = stored("two_link/around_a_post")
    peak = trajectory.per_piece(400).position[:, 1].max()
    for slack, holds in ((-1e-5, False), (1e-5, True)):
        ranges = {"joint2": [-3.0, peak + slack]}
        tube = Tube(problem.tube.points, problem.tube.radius, joint_signs=ranges)
        certificate = verify(changed(problem, tube=tube), trajectory)
        assert ("joint_signs" not in certificate.failures()) is holds


def test_position_limits_are_judged_exactly(stored):
    problem, trajectory = stored("two_link/around_a_post")
    q = trajectory.per_piece(400).position
    for slack, holds in ((-1e-5, False), (1e-5, True)):
        ranges = {"joint1": (-3.0, q[:, 0].max() + slack)}
        limits = LimitOverrides(velocity=unlimited().velocity, position=ranges)
        robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
        certificate = verify(changed(problem, robot=robot), trajectory)
        assert ("position" not in certificate.failures()) is holds


def test_a_trajectory_that_skips_a_segment_fails_ordered_and_passes_any(two_link):
    """A narrow U whose ends overlap: staying there is in the union, but the bend is left out."""
    q = np.array([0.3, -1.0])
    still = JointTrajectory(two_link.joint_names, [0, 1.0], q[None, None])
    tool = two_link.tool_position(q[None])[0]
    points = tool + np.array([[0, 0, 0], [0, -0.3, 0], [0.03, -0.3, 0], [0.03, 0, 0]])
    ordered = Tube(points, 0.05)
    condition = verify(PlanningProblem(two_link, ordered, q, q), still).conditions["tube"]
    assert condition.margin == pytest.approx(0.05 - 0.3)
    assert condition.where.segment == 1
    anyhow = Tube(points, 0.05, visit="any")
    certificate = verify(PlanningProblem(two_link, anyhow, q, q), still)
    assert "tube" not in certificate.failures()


def test_degrees_for_radians_are_found(stored):
    problem, trajectory = stored(UR5)
    degrees = JointTrajectory(
        trajectory.joint_names,
        trajectory.breakpoints,
        np.degrees(trajectory.coefficients),
    )
    assert {"position", "start", "tube"} <= set(verify(problem, degrees).failures())


def test_joints_may_come_in_any_order_but_must_be_the_problems(stored):
    problem, trajectory = stored(UR5)
    names = trajectory.joint_names[::-1]
    assert verify(problem, trajectory.reordered(names)).passed
    alien = JointTrajectory(["x"], [0, 1], np.zeros((2, 1, 1)))
    with pytest.raises(TrajectoryError, match="the trajectory moves the joints x"):
        verify(problem, alien)


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "effort"])
def test_the_only_joint_with_a_limit_is_named(kind, stored):
    problem, trajectory = stored("two_link/around_a_post")
    wide, tight = {"joint1": 1e9, "joint2": 1e9}, {"joint1": np.inf, "joint2": 1e-3}
    limits = LimitOverrides(**{"velocity": wide, "effort": wide, kind: tight})
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    condition = verify(changed(problem, robot=robot), trajectory).conditions[kind]
    assert condition.margin < -1
    assert condition.where.joint == "joint2"


def test_limits_on_acceleration_and_jerk_are_judged(stored):
    problem, trajectory = stored("two_link/around_a_post")
    peaks = [
        abs(trajectory.per_piece(300).acceleration).max(),
        abs(trajectory.derivative_coefficients(3)[-1]).max(),
    ]
    for quantity, peak in zip(("acceleration", "jerk"), peaks, strict=True):
        values = {joint: 0.9 * peak for joint in problem.robot.joint_names}
        limits = LimitOverrides(velocity=unlimited().velocity, **{quantity: values})
        robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
        certificate = verify(changed(problem, robot=robot), trajectory)
        assert certificate.failures() == [quantity]
        assert certificate.conditions[quantity].coverage == "for all t"


def test_a_wider_tolerance_forgives(stored):
    problem, trajectory = stored(UR5)
    faster = trajectory.scaled(1 / 1.002)
    assert not verify(problem, faster).passed
    assert verify(problem, faster, Tolerance(1e-4, 1e-2)).passed


def test_what_is_not_asked_has_no_margin(two_link):
    q = np.array([0.3, -1.0])
    tool = two_link.tool_position(q[None])[0]
    tube = Tube(tool + np.array([[0, 0, 0], [0.05, 0, 0]]), 0.1)
    still = JointTrajectory(two_link.joint_names, [0, 1.0], q[None, None])
    problem = PlanningProblem(two_link, tube, q, q, self_collision=False)
    conditions = verify(problem, still).conditions
    for name in ("velocity", "acceleration", "jerk", "joint_signs", "rotation"):
        assert conditions[name].margin is None
    for name in ("obstacles", "self_collision"):
        assert conditions[name].margin is None
        assert conditions[name].coverage.startswith("no ")


def test_an_obstacle_is_found_whatever_its_shape(two_link):
    q = np.array([0.3, -1.0])
    tool = two_link.tool_position(q[None])[0]
    tube = Tube(tool + np.array([[0, 0, 0], [0.05, 0, 0]]), 0.1)
    still = JointTrajectory(two_link.joint_names, [0, 1.0], q[None, None])
    there = placement_of(tool)
    for obstacle in (
        Obstacle.box("thing", [0.02, 0.02, 0.02], there),
        Obstacle.sphere("thing", 0.02, there),
        Obstacle.cylinder("thing", 0.02, 0.05, there),
        Obstacle.capsule("thing", 0.02, 0.05, there),
    ):
        problem = PlanningProblem(two_link, tube, q, q, obstacles=[obstacle])
        condition = verify(problem, still).conditions["obstacles"]
        assert condition.margin < -0.005
        assert condition.where.obstacle == "thing"
        assert condition.where.links == ("link2",)


@pytest.mark.parametrize(("absolute", "relative"), [(-1e-9, 0), (0, 1), (np.nan, 0)])
def test_a_tolerance_must_be_small_and_not_negative(absolute, relative):
    with pytest.raises(Exception, match=r"tolerance: .* not in \[0, 1\)"):
        Tolerance(absolute, relative)


def test_what_is_undecided_says_so_and_fails(two_link):
    """Nine thousand radians in ten nanoseconds: no bound on it is worth anything."""
    wild = JointTrajectory(two_link.joint_names, [0, 1e-8], [[[9e11, 9e11]], [[0.0, -1.0]]])
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 5.0)
    problem = PlanningProblem(two_link, tube, wild.position(0.0))
    certificate = verify(problem, wild)
    for name in ("effort", "tube"):
        condition = certificate.conditions[name]
        assert name in certificate.failures()
        assert condition.coverage.startswith("for all t, undecided: the margin found is ")


def test_bounds_that_stay_apart_by_a_millimetre_are_undecided(two_link, monkeypatch):
    """Of a margin of a few millimetres, halving having ended too early."""
    monkeypatch.setattr("tubeplanner.verification.tube_visits._MAX_ROWS", 1)
    sweep = JointTrajectory(two_link.joint_names, [0, 1.0], [[[0.6, 0]], [[-0.3, -0.0]]])
    ends = two_link.tool_position(sweep.position(np.array([0.0, 1.0])))
    tube = Tube(ends, 0.6 - 0.6 * np.cos(0.3) + 1e-3)
    condition = verify(PlanningProblem(two_link, tube, sweep.position(0.0)), sweep)
    tube_condition = condition.conditions["tube"]
    assert tube_condition.margin < 0
    assert tube_condition.coverage.startswith("for all t, undecided: the margin found is ")


NAMES = ("two_link/around_a_post", "ur5/over_the_wall", "ur10/onto_a_conveyor")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("method", ["stop-at-corners", "branch-and-bound"])
def test_everything_is_decided_for_all_t(name, method, stored):
    problem, trajectory = stored(name, method)
    for condition in verify(problem, trajectory).conditions.values():
        if condition.margin is not None and condition.coverage != "tool at the reference point":
            assert condition.coverage == "for all t"


def test_position_and_signs_say_where_they_are_nearest_to_their_ends(stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
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


def test_the_error_of_the_tools_enclosure_is_taken_off_the_tubes_margin(stored, monkeypatch):
    """Where the bound is the tube's: polynomials that miss a tenth of a millimetre."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    exact = verify(problem, trajectory).conditions["tube"].margin
    monkeypatch.setattr("tubeplanner.verification.judged_motion._TOOL_ENCLOSURE", 1e-3)
    rough = verify(problem, trajectory).conditions["tube"].margin
    assert exact - 2e-3 < rough < exact - 1e-6


def test_the_time_of_a_sign_counts_from_the_beginning(stored):
    """The tightest range is that of the last segment, which is visited late."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    t = np.linspace(0, trajectory.duration, 40_001)
    elbow = trajectory.position(t)[:, 1]
    late = t > 0.8 * trajectory.duration
    highest = elbow[late].max()
    signs = [{"joint2": "-"}, {"joint2": "-"}, {"joint2": [-3.0, float(highest) + 1e-4]}]
    tube = Tube(problem.tube.points, problem.tube.radius, joint_signs=signs)
    condition = verify(changed(problem, tube=tube), trajectory).conditions["joint_signs"]
    assert condition.margin <= 1e-4 + 1e-9
    assert condition.where.segment == 2
    near = np.flatnonzero(abs(t - condition.where.time) < 1e-4)
    assert elbow[near].max() == pytest.approx(highest + 1e-4 - condition.margin, abs=1e-6)


def out_and_back(problem, radius=0.02, **options):
    """Return a problem whose tube goes down and up again before it goes on, without obstacles."""
    above, below, away = [0.45, -0.3, 0.35], [0.45, -0.3, 0.2], [0.45, -0.1, 0.35]
    points = [[0.45, -0.4, 0.35], above, above, below, above, away]
    tube = Tube(points, radius, **options)
    q = problem.start
    return changed(problem, tube=tube, start=Seed(q), goal=None, obstacles=())


def test_a_compulsory_point_that_is_left_out_is_found(stored):
    """Planned without it, the tool turns round at once: both capsules overlap all the way."""
    problem, _ = stored(UR5)
    trajectory = plan(out_and_back(problem, pass_through_points="none"), SHORTEST).trajectory
    certificate = verify(out_and_back(problem), trajectory)
    assert certificate.failures() == ["points"]
    condition = certificate.conditions["points"]
    place = condition.where
    tool = problem.robot.tool_position(trajectory.position([place.time]))[0]
    assert place.point == 3  # as the file counts: the point that repeats another one is left out
    assert condition.margin == pytest.approx(0.02 - np.linalg.norm(tool - [0.45, -0.3, 0.2]))
    assert "points: margin -0.1" in certificate.describe("points")
    assert "(point 3, t = " in certificate.describe("points")
    nothing = verify(out_and_back(problem, pass_through_points="none"), trajectory)
    assert nothing.conditions["points"].margin is None
    found = verify(out_and_back(problem, pass_through_points="all"), trajectory)
    assert found.conditions["points"].where.point == 3


@pytest.mark.parametrize("rule", ["corners", "all"])
def test_compulsory_points_are_passed_by_what_is_planned(stored, rule):
    problem = out_and_back(stored(UR5)[0], pass_through_points=rule)
    result = plan(problem, SHORTEST)
    assert result.succeeded
    assert "point 2 is the same as the one before" in result.notes[0]
    tool = problem.robot.tool_position(
        result.trajectory.position(np.linspace(0, 1, 5001) * result.duration)
    )
    for point in problem.tube.points[problem.tube.compulsory_points]:
        assert np.linalg.norm(tool - point, axis=1).min() < 0.02 + 1e-6


def divided(tube, parts):
    """Return a tube with every segment divided."""
    places = np.arange(tube.segment_count * parts + 1) / parts
    numbers = np.arange(tube.segment_count + 1)
    points = np.array([np.interp(places, numbers, column) for column in tube.points.T]).T
    points[::parts] = tube.points
    signs = [row for row in tube.joint_signs for _ in range(parts)]
    return Tube(points, np.repeat(tube.radius, parts), joint_signs=signs)


@pytest.mark.parametrize("parts", [2, 16])
def test_a_divided_tube_gets_the_same_certificate_in_its_own_numbers(stored, parts):
    problem, trajectory = stored(UR5)
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


def test_a_divided_tube_gets_the_same_trajectory_to_the_last_digit():
    problem = load_problem("example:two_link/around_a_post")
    finer = changed(problem, tube=divided(problem.tube, 4))
    whole, other = plan(problem, SHORTEST), plan(finer, SHORTEST)
    np.testing.assert_array_equal(other.trajectory.coefficients, whole.trajectory.coefficients)
    assert other.duration == whole.duration
    radii = [s for s in other.sensitivities if s.limit == "radius"]
    assert {(s.segment, s.last_segment) for s in radii} == {(0, 3), (4, 7), (8, 11)}
    assert str(radii[0]).startswith(f"radius of segments {radii[0].segment} to ")


# Defects that last a fraction of a millisecond, where 2,000 samples see nothing.


SAMPLES = 2000


def with_bump(trajectory, joint, begin, width, size):
    """Return the trajectory with a short smooth bump of one joint, of this size [rad]."""
    end = trajectory.duration
    cuts = [0.0, begin, begin + width, end]
    parts = [trajectory.between(low, high) for low, high in pairwise(cuts)]
    # 64 u^3 (1 - u)^3 has the value 1 at u = 1/2, and no slope or curvature at its ends.
    bump = 64 * size * np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
    coefficients = []
    for part in parts:
        zeros = np.zeros((7 - len(part.coefficients), *part.coefficients.shape[1:]))
        coefficients.append(np.concatenate([zeros, part.coefficients]))
    assert coefficients[1].shape[1] == 1, "the bump must lie within one piece"
    coefficients[1][:, 0, joint] += bump
    starts = [part.breakpoints[:-1] + low for part, low in zip(parts, cuts[:-1], strict=True)]
    breakpoints = np.append(np.concatenate(starts), end)
    return JointTrajectory(
        trajectory.joint_names, breakpoints, np.concatenate(coefficients, axis=1)
    )


def between_samples(trajectory, near, width):
    """Return a time after `near` at which samples of the trajectory miss what lasts so long."""
    spacing = trajectory.duration / (SAMPLES - 1)
    begin = (np.ceil(near / spacing) + 0.5) * spacing - width / 2
    inside = (trajectory.breakpoints > begin) & (trajectory.breakpoints < begin + width)
    assert width < spacing
    assert not inside.any()
    return begin


def sampled(trajectory):
    return trajectory.at(np.linspace(0, trajectory.duration, SAMPLES))


def test_an_effort_above_its_limit_for_a_tenth_of_a_millisecond(stored):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    slow = trajectory.scaled(1.5)
    begin = between_samples(slow, 0.9, 2e-4)
    spiked = with_bump(slow, 1, begin, 2e-4, 2.5e-7)
    samples = sampled(spiked)
    tau = problem.robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    assert (abs(tau) < 0.99 * problem.robot.limits.effort).all()
    certificate = verify(problem, spiked)
    assert certificate.failures() == ["effort"]
    condition = certificate.conditions["effort"]
    dense = spiked.at(np.linspace(begin, begin + 2e-4, 20_001))
    tau = problem.robot.inverse_dynamics(dense.position, dense.velocity, dense.acceleration)
    used = abs(tau) / problem.robot.limits.effort
    assert condition.margin == pytest.approx(1 - used.max(), abs=1e-6)
    assert begin <= condition.where.time <= begin + 2e-4
    joint = problem.robot.joint_names[int(used.max(axis=0).argmax())]
    assert condition.where.joint == joint
    assert condition.coverage == "for all t"


def test_a_tool_outside_the_tube_for_a_tenth_of_a_millisecond(stored):
    """A radius that the trajectory just keeps, and a spike of 0.6 mm at its worst place."""
    problem, trajectory = stored("two_link/paper_1_30mm", "branch-and-bound")
    least = verify(problem, trajectory).conditions["tube"]
    radius = problem.tube.radius - (least.margin - 1e-4)
    tube = Tube(problem.tube.points, radius, joint_signs=problem.tube.joint_ranges)
    tight = PlanningProblem(problem.robot, tube, problem.start)
    begin = between_samples(trajectory, least.where.time, 2e-4)
    spiked = with_bump(trajectory, 0, begin, 2e-4, 2e-3)
    other = with_bump(trajectory, 0, begin, 2e-4, -2e-3)
    failing = [verify(tight, trajectory).conditions["tube"] for trajectory in (spiked, other)]
    worst = min(failing, key=lambda condition: condition.margin)
    assert worst.margin < -2e-5
    assert begin <= worst.where.time <= begin + 2e-4
    assert worst.where.segment == least.where.segment
    for trajectory in (spiked, other):
        tool = problem.robot.tool_position(sampled(trajectory).position)
        assert tube.margin(tool).max(axis=1).min() > 0


@pytest.mark.parametrize("free_by", [None, 1e-5])
def test_a_thin_plate_passed_between_two_samples(two_link, free_by):
    """A grain of 0.1 mm crosses a plate of 0.1 mm at 2.4 m/s; or passes beside it."""
    ball = Obstacle.sphere("grain", 5e-5, placement_of([0, 0, 0]))
    grain = AttachedSolid("grain", ball.shapes, touch_links=("link2",))
    trajectory = JointTrajectory(two_link.joint_names, [0, 0.25], [[[4.0, 0]], [[-0.5, -0.3]]])
    crossing = between_samples(trajectory, 0.125, 0.0)
    tool = two_link.tool_position(trajectory.position(np.array([crossing, crossing + 1e-6])))
    along = (tool[1] - tool[0]) / np.linalg.norm(tool[1] - tool[0])
    angle = np.arctan2(along[1], along[0])
    outwards = tool[0] / np.linalg.norm(tool[0])
    # The plate lies across the way; its inner edge just reaches the grain, or just does not.
    reach = 0.01 + 5e-5 + (free_by or -4e-5)
    placement = placement_of(tool[0] + reach * outwards, rpy=(0, 0, angle))
    plate = Obstacle.box("plate", [1e-4, 0.02, 0.02], placement)
    tube = Tube(tool[0] + np.array([[-1, 0, 0], [1, 0, 0]]), 2.0)
    start = trajectory.position(0.0)
    problem = PlanningProblem(two_link, tube, start, obstacles=[plate], attached=[grain])
    checker = problem.collision
    grain_pair = [p for p in checker.obstacle_pairs if checker.owners(p)[0] == ("grain",)]
    rotation, position = two_link.body_poses(sampled(trajectory).position)
    seen = [
        checker.distances(r, p, np.array(grain_pair))[0]
        for r, p in zip(rotation, position, strict=True)
    ]
    assert min(seen) > 0
    others = [p for p in checker.obstacle_pairs if checker.owners(p)[0] != ("grain",)]
    apart = PlanningProblem(
        two_link,
        tube,
        start,
        obstacles=[plate],
        attached=[grain],
        ignore_collisions=[(checker.owners(p)[0][0], "plate") for p in others],
    )
    condition = verify(apart, trajectory).conditions["obstacles"]
    if free_by is None:
        assert condition.margin < -1e-5
        assert condition.where.links == ("grain",)
        assert condition.where.time == pytest.approx(crossing, abs=5e-5)
    else:
        assert 0 < condition.margin < 2e-5


def test_a_speed_above_its_limit_for_a_fraction_of_a_millisecond(stored):
    """A bump of a joint of some micrometres, where 2,000 samples of the tool see nothing."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")

    def speeds(of, time):
        at = of.at(time)
        return np.linalg.norm(problem.robot.tool_velocity(at.position, at.velocity)[0], axis=1)

    samples = np.linspace(0, trajectory.duration, 2000)
    speed = speeds(trajectory, samples)
    limit = 1.001 * speed.max()
    width = 1e-4
    begin = samples[speed.argmax()] + (samples[1] - width) / 2
    spiked = with_bump(trajectory, 0, begin, width, 1e-6)
    assert speeds(spiked, samples).max() < limit
    tube = replace(problem.tube, tool_speed=limit)
    before, after = (verify(problem.with_tube(tube), each) for each in (trajectory, spiked))
    assert before.passed
    assert "tool_speed" in after.failures()
    condition = after.conditions["tool_speed"]
    dense = speeds(spiked, np.linspace(begin, begin + width, 20_001)).max()
    assert condition.margin == pytest.approx(1 - dense / limit, rel=0.02)
    assert begin <= condition.where.time <= begin + width


# The judge of tubes of boxes, against closed forms: motions along the axes of a gantry.


AXIS = """<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/><limit lower="-5" upper="5" effort="1000" velocity="100"/></joint>
<link name="{child}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
REST_TO_REST = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
FLAT = {"box": [0.2, 0.04], "up": [0, 0, 1]}
SQUARE = {"box": [0.04, 0.04], "up": [0, 0, 1]}
LINE = [[0, 0, 0], [1, 0, 0]]


@pytest.fixture(scope="module")
def gantry(tmp_path_factory):
    """A gantry: the tool is at its three joints' positions."""
    axes = (("x", "base", "1 0 0"), ("y", "at_x", "0 1 0"), ("z", "at_y", "0 0 1"))
    parts = [AXIS.format(name=n, parent=p, child=f"at_{n}", axis=a) for n, p, a in axes]
    path = tmp_path_factory.mktemp("gantry") / "gantry.urdf"
    path.write_text(f'<robot name="gantry"><link name="base"/>{"".join(parts)}</robot>')
    return load_robot(path, "at_z", gravity=(0, 0, 0))


def straight(*places):
    """Return a motion from place to place, from rest to rest in a second each."""
    parts = [REST_TO_REST[:, None, None] * np.subtract(q, p) for p, q in pairwise(places)]
    for part, begin in zip(parts, places, strict=False):
        part[-1] += begin
    return JointTrajectory(
        tuple("xyz"), np.arange(len(places)) * 1.0, np.concatenate(parts, axis=1)
    )


def boxes_judged(gantry, tube, trajectory):
    ends = (trajectory.position(0.0), trajectory.position(trajectory.duration))
    problem = PlanningProblem(gantry, tube, *ends, self_collision=False)
    return verify(problem, trajectory)


@pytest.mark.parametrize(
    ("offset", "margin"),
    [
        ([0, 0.08, 0.005], 0.015),
        ([0, 0.095, 0.005], 0.005),
        ([0, -0.095, -0.018], 0.002),
        ([0, 0.0, 0.0], 0.02),
    ],
    ids=["below the top", "beside a wall", "in a corner", "on the axis"],
)
def test_a_straight_motion_is_as_far_inside_as_its_nearest_face(gantry, offset, margin):
    trajectory = straight(np.add(LINE[0], offset), np.add(LINE[1], offset))
    certificate = boxes_judged(gantry, Tube(LINE, None, cross_section=FLAT), trajectory)
    assert certificate.passed
    assert certificate.conditions["tube"].margin == pytest.approx(margin, abs=1e-9)


def test_the_tool_radius_is_taken_off(gantry):
    trajectory = straight([0, 0.08, 0.005], [1, 0.08, 0.005])
    tube = Tube(LINE, None, cross_section=FLAT, tool_radius=0.008)
    found = boxes_judged(gantry, tube, trajectory).conditions["tube"]
    assert found.margin == pytest.approx(0.007, abs=1e-9)


@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_in_the_corner_of_a_square_box_a_disc_is_left(gantry, visit):
    trajectory = straight([0, 0.019, 0.019], [1, 0.019, 0.019])
    box = boxes_judged(gantry, Tube(LINE, None, cross_section=SQUARE, visit=visit), trajectory)
    assert box.passed
    assert box.conditions["tube"].margin == pytest.approx(0.001, abs=1e-9)
    narrow = {"box": [0.04, 0.036], "up": [0, 0, 1]}
    start = [0, 0, 0]
    beside = straight(start, [0.5, 0.019, 0.019], [1, 0, 0])
    assert not boxes_judged(
        gantry, Tube(LINE, None, cross_section=narrow, visit=visit), beside
    ).passed
    assert not boxes_judged(gantry, Tube(LINE, 0.02, visit=visit), beside).passed
    assert boxes_judged(gantry, Tube(LINE, None, cross_section=SQUARE, visit=visit), beside).passed


def test_a_wall_met_for_a_ten_thousandth_of_a_second_is_found(gantry):
    """A bump of 12 mm in a motion 10 mm beside the wall; one of 8 mm is none of its business."""
    for peak in (0.012, 0.008):
        begin, width = 0.5037, 1e-4
        plain = straight([0, 0.09, 0], [1, 0.09, 0])
        cuts = [0.0, begin, begin + width, 1.0]
        parts = [plain.between(low, high).coefficients for low, high in pairwise(cuts)]
        parts = [np.concatenate([np.zeros((1, 1, 3)), part]) for part in parts]
        bump = 64 * peak * np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
        parts[1][:, 0, 1] += bump
        trajectory = JointTrajectory(tuple("xyz"), cuts, np.concatenate(parts, axis=1))
        found = boxes_judged(gantry, Tube(LINE, None, cross_section=FLAT), trajectory).conditions[
            "tube"
        ]
        assert found.margin == pytest.approx(0.01 - peak, abs=1e-6)


def test_segments_are_changed_where_both_boxes_hold_the_tool(gantry):
    """The boxes of a corner overlap farther out than the discs in them."""
    points = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    boxes = Tube(points, None, cross_section=FLAT)
    trajectory = straight([0, 0, 0], [0.92, 0.08, 0], [1, 1, 0])
    certificate = boxes_judged(gantry, boxes, trajectory)
    assert certificate.passed
    assert certificate.conditions["tube"].margin == pytest.approx(0.02, abs=1e-9)
    assert not boxes_judged(gantry, Tube(points, 0.02), trajectory).passed
    mixed = Tube(points, [0.02, None], cross_section=[None, FLAT])
    assert not boxes_judged(gantry, mixed, trajectory).passed


def test_a_compulsory_point_is_passed_within_the_smaller_half_side(gantry):
    points = [[0, 0, 0], [1, 0, 0], [0, 0, 0]]
    tube = Tube(points, None, cross_section=FLAT)
    for short, passes in ((0.015, True), (0.03, False)):
        trajectory = straight([0, 0, 0], [1 - short, 0, 0], [0, 0, 0])
        found = boxes_judged(gantry, tube, trajectory)
        assert found.conditions["tube"].margin >= 0
        assert found.passed is passes
        assert found.conditions["points"].margin == pytest.approx(0.02 - short, abs=1e-6)


def test_a_start_outside_a_box_is_refused(gantry):
    with pytest.raises(ProblemError, match=r"0.005 m outside the box of segment 0"):
        PlanningProblem(gantry, Tube(LINE, None, cross_section=FLAT), [0.0, 0.0, 0.025])
