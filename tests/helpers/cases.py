"""Problems, robots, moves and runs that tests of several folders use, and looks at them."""

from dataclasses import fields as dataclass_fields
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from tubeplanner import (
    JointTrajectory,
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    Seed,
    ToolPose,
    Tube,
    load_problem,
    load_robot,
    sweep_field,
)
from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.run_verdict import JudgedRun, RunVerdict
from tubeplanner.execution.simulation import AFTERWARDS, Execution
from tubeplanner.first_guess.branches import redundancy_rules, reference_branch
from tubeplanner.first_guess.knot_modification import ModificationOptions
from tubeplanner.first_guess.suh_bishop import SuhBishopOptions
from tubeplanner.first_guess.waypoints import candidate_waypoints
from tubeplanner.optimizer.link_constraints import LinkConstraints
from tubeplanner.optimizer.spline_constraints import SplineConstraints
from tubeplanner.optimizer.starts import starting_spline
from tubeplanner.outcome import Location
from tubeplanner.planning.tightening import Survival, Tightening
from tubeplanner.robot.joint_limits import EffortRange
from tubeplanner.robot.motors import JointMotors
from tubeplanner.studies.sweeps import FieldSweep
from tubeplanner.task.demands import Robustness
from tubeplanner.trajectory.joint_trajectory import concatenate

# Of tests that compare durations, or that plan and look at something else: quicker.
SHORTEST = PlanOptions(slack=0.0)
# The method of 1988 with a small budget.
BRIEF = SuhBishopOptions(ModificationOptions(halvings=1), 0, 1, 1, max_knots=11, node_budget=100)

PROBLEMS = (
    "two_link/around_a_post",
    "ur5/over_the_wall",
    "ur5/level_tray",
    "ur10/onto_a_conveyor",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
)
# Of the level tray with a tool that points down.
TOOL_DOWN = {
    "tube.points": [[0.45, -0.3, 0.2], [0.45, -0.3, 0.525], [0.45, 0.3, 0.525], [0.45, 0.3, 0.2]],
    "tube.orientations": [[0.7071068, -0.7071068, 0.0, 0.0]] * 4,
    "start.joints": [-0.791217, -1.311999, 1.900383, -2.159181, -1.570796, 0.0],
}
# It turns, extends and lifts; the boxes of its links do not reach each other.
SLIDE = """<robot name="slide"><link name="base"/>
<link name="carriage"><inertial><origin xyz="0.1 0 0"/><mass value="3"/>
  <inertia ixx="0.1" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.1 0 -0.1"/><geometry><box size="0.3 0.2 0.1"/></geometry></collision>
  </link>
<link name="boom"><inertial><origin xyz="0.3 0.1 0"/><mass value="2"/>
  <inertia ixx="0.02" iyy="0.2" izz="0.3" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.06 0.06"/></geometry></collision>
  </link>
<link name="tip"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0 0 -0.1" rpy="0.2 0.1 0.3"/>
    <geometry><box size="0.05 0.1 0.2"/></geometry></collision>
  </link>
<joint name="turn" type="revolute"><parent link="base"/><child link="carriage"/>
  <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="60" velocity="3"/></joint>
<joint name="extend" type="prismatic"><parent link="carriage"/><child link="boom"/>
  <origin xyz="0.2 0 0"/><axis xyz="1 0 0"/>
  <limit lower="-1" upper="1" effort="80" velocity="1"/></joint>
<joint name="lift" type="revolute"><parent link="boom"/><child link="tip"/>
  <origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="20" velocity="3"/></joint></robot>"""
INERTIA, ANGLE = 0.7, 1.3  # [kg m^2], [rad]
# Peaks of the quintic rest-to-rest move of one radian in one second.
PEAK_VELOCITY, PEAK_ACCELERATION, PEAK_JERK = 1.875, 10 / np.sqrt(3), 60.0


def slow_but(quick, cases):
    """Return cases for `parametrize`: those that are not among the quick ones are slow."""

    def slow(case):
        values = case if isinstance(case, tuple) else (case,)
        return pytest.param(*values, marks=pytest.mark.slow)

    return [case if case in quick else slow(case) for case in cases]


def study_but(pushed, cases):
    """Return cases for `parametrize`, all slow: those not to run at every push wait for a study."""
    marks = [pytest.mark.slow, pytest.mark.study]
    return [
        pytest.param(
            *(case if isinstance(case, tuple) else (case,)), marks=marks[: 1 + (case not in pushed)]
        )
        for case in cases
    ]


def one_joint(tmp_path, mass=0.0, **limits):
    """A bar that turns about z with a known inertia; gravity acts only if it has a mass lever."""
    (tmp_path / "bar.urdf").write_text(
        f"""<robot name="bar"><link name="base"/>
        <link name="bar"><inertial><origin xyz="{0.5 if mass else 0} 0 0"/>
          <mass value="{mass or 1}"/>
          <inertia ixx="1" iyy="1" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="bar"/>
          <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="5" velocity="4"/></joint>
        </robot>"""
    )
    overrides = {name: {"turn": value} for name, value in limits.items()}
    gravity = (0, -9.81, 0)
    return load_robot(
        "bar.urdf", "bar", gravity=gravity, limits=LimitOverrides(**overrides), directory=tmp_path
    )


def anywhere(robot):
    """A problem that asks nothing of a robot but its limits."""
    tool = robot.tool_position(np.zeros((1, robot.joint_count)))[0]
    tube = Tube([tool, tool + np.array([1.0, 0.0, 0.0])], 1000.0)
    return PlanningProblem(robot, tube, np.zeros(robot.joint_count), self_collision=False)


def limited_tool(tube_value=None, robot_value=None, count=3, quantity="tool_speed"):
    """A problem of the two-link arm in a bent tube, with limits on a quantity of the tool."""
    free = {"joint1": np.inf, "joint2": np.inf}
    limits = LimitOverrides(velocity=free, **{quantity: robot_value})
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.3, 0], [0.1, 0.4, 0]][: count + 1]
    tube = Tube(points, 0.05, joint_signs={"joint2": "-"}, **{quantity: tube_value})
    return PlanningProblem(robot, tube, Seed(np.array([0.0, -1.0])))


def quintic(angle=ANGLE, duration=1.0, joint="turn"):
    shape = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0]) * angle
    return JointTrajectory([joint], [0, 1.0], shape[:, None, None]).scaled(duration)


def changed(problem, **fields):
    """Return a problem with some fields replaced."""
    given = {field.name: getattr(problem, field.name) for field in dataclass_fields(problem)}
    given = {name: value for name, value in given.items() if not name.startswith("joint_")}
    return PlanningProblem(**{**given, **fields})


def unlimited():
    """Return limits of the two-link arm without any on velocity."""
    return LimitOverrides(velocity={"joint1": np.inf, "joint2": np.inf})


def with_motors(robot, effort_ranges=(), limits=None, friction_uncertainty=0.0, **motors):
    """Return a robot with motors and other limits; values by field, of all joints or each."""
    count = robot.joint_count
    own = {name: np.broadcast_to(value, count).astype(float) for name, value in motors.items()}
    ideal = JointMotors.ideal(count)
    values = {name: np.broadcast_to(value, count) for name, value in (limits or {}).items()}
    effort = values.get("effort", robot.limits.effort).copy()
    for each in effort_ranges:
        effort[each.joint] = max(each.backwards.max(), each.forwards.max())
    values |= {"effort": effort, "effort_ranges": tuple(effort_ranges)}
    again, _ = robot.__reduce__()
    limits = replace(robot.limits, **values)
    return again(
        limits=limits, motors=replace(ideal, friction_uncertainty=friction_uncertainty, **own)
    )


def rest_to_rest(joint_names, start, end, duration):
    """A quintic in every joint."""
    start, end = np.atleast_1d(start), np.atleast_1d(end)
    shape = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])[:, None] * (end - start)
    shape[-1] = start
    return JointTrajectory(joint_names, [0, 1.0], shape[:, None]).scaled(duration)


def falling_arm(tmp_path):
    """A bar that its motor does not hold about the horizontal, and a fall through there.

    At q = 0 gravity takes 1.2 of what the motor has.
    """
    gravity = 0.5 * 9.81
    limit = gravity / 1.2
    robot = one_joint(tmp_path, mass=1.0, effort=limit)
    inertia = INERTIA + 0.5**2
    return robot, rest_to_rest(["turn"], 0.7, -2.2, np.sqrt(13.2 * inertia / limit))


def followed(problem, motion, bases, period=0.004):
    """Return an execution in which all joints follow the plan, by arms that stand elsewhere [m]."""
    time = np.arange(0.0, motion.duration + AFTERWARDS, period)
    ordered = motion.reordered(problem.robot.joint_names)
    q = np.array([ordered.position(np.minimum(time, motion.duration))] * len(bases))
    exact = drawn_plants(problem.robot, Robustness.exact(), Draw(len(bases)))
    plants = [
        replace(plant, base=np.array(base, dtype=float))
        for plant, base in zip(exact, bases, strict=True)
    ]
    return Execution(plants, time, q, np.zeros_like(q), np.zeros_like(q), q > np.inf)


def simulated_sweep(failed):
    """Return a sweep over radii; so many of 200 runs of each answer failed, None: none were run."""
    name, radii = "example:two_link/paper_1_30mm", [0.01 * (k + 1) for k in range(len(failed))]
    swept = sweep_field(name, "tube.radius", radii, options=PlanOptions("stop-at-corners"))
    nothing = Tightening.nothing(load_problem(name))
    rows = []
    for row, count in zip(swept.rows, failed, strict=True):
        survival = None
        if count is not None:
            verdict = RunVerdict(200, count, {"tube": count}, None, 0.0)
            survival = Survival(Robustness(), verdict, count == 0, nothing, row.duration, None, {})
        rows.append(replace(row, result=replace(row.result, survival=survival)))
    return FieldSweep(swept.name, swept.path, tuple(rows))


def pose_at(problem, q, seed=None):
    """Return the pose that the tool has in a configuration."""
    rotation, position = problem.robot.tool_pose(np.array([q]))
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation[0], position[0]
    return ToolPose(placement, seed)


def refusal(kind, call, *arguments, **named):
    """Return the message of the error of this kind that the call raises."""
    with pytest.raises(kind) as caught:
        call(*arguments, **named)
    return str(caught.value)


def outside(shapes, points):
    """Return how far points (N, 3) are outside of all shapes; inside of one it is negative [m]."""
    found = []
    for shape in shapes:
        planes = ConvexHull(shape.vertices).equations
        found.append((points @ planes[:, :3].T + planes[:, 3]).max(axis=1) - shape.radius)
    return np.min(found, axis=0)


def with_bump(trajectory, joint, begin, width, size):
    """Return the trajectory with a bump of one joint, as high as `size` [rad or m].

    64 u^3 (1 - u)^3 is 1 at u = 1/2 and has neither slope nor curvature at its ends.
    """
    cuts = [0.0, begin, begin + width, trajectory.duration]
    parts = [trajectory.between(low, high) for low, high in pairwise(cuts)]
    rows = [np.zeros((7, *part.coefficients.shape[1:])) for part in parts]
    for row, part in zip(rows, parts, strict=True):
        row[7 - len(part.coefficients) :] = part.coefficients
    assert rows[1].shape[1] == 1, "the bump must lie within one piece"
    bump = np.array([-1.0, 3, -3, 1, 0, 0, 0]) / width ** np.arange(6, -1, -1)
    rows[1][:, 0, joint] += 64 * size * bump
    names = trajectory.joint_names
    return concatenate(
        [JointTrajectory(names, p.breakpoints, row) for p, row in zip(parts, rows, strict=True)]
    )


def judged_run(**given: Any) -> JudgedRun:
    """Return a run that keeps everything at its bounds, but for what is given."""
    bounds = Extreme(0.0, Location())
    usual = {
        "tube": bounds,
        "rotation": None,
        "points": None,
        "tracking": bounds,
        "tool_tracking": bounds,
        "position": bounds,
        "velocity": None,
        "saturated": 0.0,
        "obstacles": None,
        "self_collision": None,
        "clearance": 0.0,
        "stops": {"velocity": 1.05, "tracking": 0.05},
        "tube_by_segment": np.zeros(1),
        "rotation_by_segment": np.array([-1e3]),
        "position_by_joint": np.array([[-1e3], [0.0]]),
        "velocity_by_joint": np.zeros(1),
        "tracking_by_joint": np.zeros(1),
    }
    return JudgedRun(**(usual | given))


def begun(problem, intervals):
    """Return the spline on the branch by the first rule for redundant joints."""
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    return starting_spline(problem, branch, intervals)


def constraints_of(problem, grid, **more):
    """Return the constraints of a problem on a knot grid."""
    radius = problem.tube.effective_radius
    return SplineConstraints(problem, grid, LinkConstraints(problem), radius, **more)


def waypoints_of(problem, count):
    """Return so many configurations, equally spaced along the path, start and goal included."""
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    return candidate_waypoints(problem, branch, count)


def wandering(robot, seed, pieces=4, width=0.1):
    """Return pieces of a width [s] that begin within a radian of zero, within the limits."""
    rng = np.random.default_rng(seed)
    n = robot.joint_count
    first = np.clip(rng.uniform(-1, 1, n), robot.limits.lower_position, robot.limits.upper_position)
    knots = first + np.cumsum(rng.uniform(-0.3, 0.35, (pieces + 1, n)), axis=0)
    bend = rng.uniform(-3, 3, (pieces, n))
    slope = np.diff(knots, axis=0) / width - bend * width
    coefficients = np.stack([bend, slope, knots[:-1]])
    return JointTrajectory(robot.joint_names, width * np.arange(pieces + 1), coefficients)


def random_motors(robot, rng):
    """Return the robot with motors of all kinds, some of its joints with tables and pairs."""
    n, effort = robot.joint_count, robot.limits.effort
    tables = [
        EffortRange(0, np.sort(rng.uniform(-2, 2, 4)), *(effort[0] * rng.uniform(1, 5, (2, 4)))),
        EffortRange(1, np.zeros(1), *(effort[1] * rng.uniform(1, 5, (2, 1)))),
    ]
    return with_motors(
        robot,
        effort_ranges=tables,
        armature=rng.uniform(0, 0.1, n),
        viscous_friction=rng.uniform(0, 0.1, n) * effort,
        backwards_friction=rng.uniform(0, 0.5, n) * effort,
        forwards_friction=rng.uniform(0, 0.5, n) * effort,
        saturation_effort=rng.uniform(1, 3, n) * effort,
        no_load_velocity=rng.uniform(2, 5, n),
        friction_uncertainty=rng.uniform(0, 0.3),
    )


def random_motion(robot, rng, breakpoints=(0.0, 0.2, 0.4, 0.6, 0.8)):
    """Return quintics that jump at breakpoints; joints reverse inside the pieces."""
    scale = np.array([60.0, 30.0, 20.0, 8.0, 1.0, 1.5])[:, None, None]
    rows = scale * rng.uniform(-1, 1, (6, len(breakpoints) - 1, robot.joint_count))
    return JointTrajectory(robot.joint_names, breakpoints, rows)
