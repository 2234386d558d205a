"""The outside judge finds one planted fault per condition, and passes what is sound."""

import ast
import json
from contextlib import suppress
from itertools import combinations_with_replacement
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
import yaml
from arms import OPENED, RULES, follower_arm, joint, link, opened, solid_link, written

import outside_judge
import tubeplanner as t
from outside.arm import Arm, placed, solid_geometry
from outside.conditions import judge_ends
from outside.distances import Poses, is_inside, least_margin, signed_distance
from outside.files import BadInput, find_urdf
from outside.problem import read_problem
from outside.trajectory import Samples, Trajectory, read_trajectory
from outside.tube import ordered_visits
from outside.tube_fields import OF_TOOL, TubeFields, bounds_of, box_margin, radii, read_sections
from outside_judge import TOLERANCE, Judge, main, passes
from tubeplanner.output.files.trajectory_writer import trajectory_json
from tubeplanner.resources import bundled_problems, example_robot_names, find_description

BENCHMARKS = Path(outside_judge.__file__).parent
CASES = Path(__file__).parents[1] / "data/cases"
SLIGHTLY = 1e-3
ALMOST, MORE = 1 - SLIGHTLY, 1 + SLIGHTLY
REST_TO_REST = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])  # a unit step in a unit time


class Motion(NamedTuple):
    """Joints at samples, shape (N, n), and the tool's speed [m/s] and acceleration there, (N,)."""

    samples: Samples
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    jerk: np.ndarray
    effort: np.ndarray
    tool_speed: np.ndarray
    tool_acceleration: np.ndarray


class Case:
    """A problem's fields and a trajectory of its robot, to be changed before they are judged."""

    def __init__(self, folder, fields, trajectory, robot=None):
        self.fields, self.tube, self.robot = fields, fields["tube"], robot
        self.trajectory, self.folder, self.problem = trajectory, folder, folder / "problem.yaml"

    def put(self, path, value):
        """Set a field of the problem, such as `robot.limits.jerk`."""
        *keys, last = path.split(".")
        fields = self.fields
        for key in keys:
            fields = fields.setdefault(key, {})
        fields[last] = value

    def motion(self, count=5000):
        samples = self.trajectory.samples(count)
        q, v, a, jerk = (self.trajectory.at(samples, order) for order in range(4))
        tool = (self.robot.tool_velocity(q, v)[0], self.robot.tool_motion(q, v, a)[:, :3])
        sizes = (np.linalg.norm(rate, axis=1) for rate in tool)
        return Motion(samples, q, v, a, jerk, self.robot.inverse_dynamics(q, v, a), *sizes)

    def add(self, piece, polynomial):
        """Add a polynomial in the fraction of a piece to the first joint, highest power first."""
        trajectory, degree = self.trajectory, len(self.trajectory.coefficients)
        powers = np.arange(len(polynomial) - 1, -1, -1)
        coefficients = trajectory.coefficients.copy()
        scale = np.diff(trajectory.breakpoints)[piece] ** powers
        coefficients[degree - len(polynomial) :, piece, 0] += polynomial / scale
        self.trajectory = Trajectory(trajectory.joint_names, trajectory.breakpoints, coefficients)

    def write(self):
        """Write the problem; return its path."""
        plain = json.loads(json.dumps(self.fields, default=np.ndarray.tolist))
        self.problem.write_text(yaml.safe_dump(plain))
        return self.problem

    def packaged(self):
        """Return the trajectory as the package has it."""
        ours = self.trajectory
        return t.JointTrajectory(ours.joint_names, ours.breakpoints, ours.coefficients)

    def judged(self, count=500):  # divided further where it matters
        return Judge(self.write()).judge(self.trajectory, count)

    def judged_by_both(self):
        """Return the conditions of the outside judge and those of the package."""
        outside = self.judged()
        return outside, t.verify(t.load_problem(self.problem), self.packaged()).conditions

    def broken(self, conditions=None):
        conditions = conditions or self.judged()
        return {name for name, each in conditions.items() if not each.holds(TOLERANCE)}

    def told(self, *more):
        """Return the exit status of the command."""
        path = self.folder / "trajectory.json"
        path.write_text(trajectory_json(self.packaged()))
        return main([str(self.write()), str(path), *more])


@pytest.fixture
def case(stored, two_link, tmp_path):
    """A certified trajectory of the two-link arm, and what its problem file holds."""
    fields = yaml.safe_load(bundled_problems()["two_link/around_a_post"].read_text())
    return Case(tmp_path, fields, reread(stored("two_link/around_a_post")[1], tmp_path), two_link)


def reread(trajectory, folder):
    """Return a trajectory of the package as the outside judge reads it."""
    path = folder / "trajectory.json"
    path.write_text(trajectory_json(trajectory))
    return read_trajectory(path)


def straight(joint_names, begin, end):
    """Return a trajectory from rest to rest in a second."""
    coefficients = REST_TO_REST[:, None, None] * (end - begin)
    coefficients[-1] += begin
    return Trajectory(joint_names, np.array([0.0, 1.0]), coefficients)


def peak(values):
    return abs(values).max()


def fastest_change(motion):
    """The largest rate of an effort, between two samples that are held against each other."""
    step = np.diff(motion.samples.time)
    inside = (np.diff(motion.samples.piece) == 0) & (step > 0)
    return peak(np.diff(motion.effort[:, 1])[inside] / step[inside])


def weaker_in_one_place(motion):
    """Where the first joint uses most, and beside; it has more elsewhere."""
    effort = motion.effort[:, 0]
    at, most = motion.q[abs(effort).argmax(), 0], peak(effort) * ALMOST
    return {
        "position": [at - 0.2, at - 0.1, at + 0.1, at + 0.2],
        "effort": [3 * most, most, most, 3 * most],
    }


def motor_line(motion, fraction):
    """Motors whose line from stall to no load has a fraction of the first joint's use."""
    used = peak(motion.effort[:, 0] / 95.0 + motion.v[:, 0] / 40.0) * fraction
    ends = {"saturation_effort": 95.0 * used, "no_load_velocity": 40.0 * used}
    return {key: {"joint1": value} for key, value in ends.items()}


JOINTS = ("joint1", "joint2")
BALL = {"name": "ball", "sphere": 0.02, "position": [0.44, 0.0, 0.02]}
# A field, the condition that it breaks, and its value, of a motion that is sound without it.
CHANGES = [
    ("tube.joint_signs.joint2", "joint_signs", lambda m: "+"),
    ("tube.joint_signs.joint2", "joint_signs", lambda m: [-3.0, m.q[:, 1].max() - SLIGHTLY]),
    ("tube.tool_speed", "tool_speed", lambda m: [None, m.tool_speed.max() * ALMOST, None]),
    ("robot.limits.tool_speed", "tool_speed", lambda m: m.tool_speed.max() * ALMOST),
    *(
        (
            f"{where}.tool_acceleration",
            "tool_acceleration",
            lambda m: m.tool_acceleration.max() * ALMOST,
        )
        for where in ("tube", "robot.limits")
    ),
    ("robot.limits.position.joint1", "position", lambda m: [-6.0, m.q[:, 0].max() - SLIGHTLY]),
    (
        "robot.limits.position_margin.joint1",
        "position",
        lambda m: 2 * np.pi - m.q[:, 0].max() + SLIGHTLY,
    ),
    ("robot.limits.velocity.joint1", "velocity", lambda m: peak(m.v[:, 0]) * ALMOST),
    ("robot.limits.acceleration.joint1", "acceleration", lambda m: peak(m.a[:, 0]) * ALMOST),
    ("robot.limits.jerk.joint1", "jerk", lambda m: peak(m.jerk[:, 0]) * ALMOST),
    # 95 and 27 N m are what the trajectory was planned for, and uses.
    ("robot.limits.effort", "effort", lambda m: {"joint1": 95 * ALMOST, "joint2": 27 * ALMOST}),
    ("robot.limits.effort.joint1", "effort", lambda m: [-m.effort[:, 0].min() * ALMOST, 1e3]),
    ("robot.limits.effort.joint1", "effort", weaker_in_one_place),
    ("robot.limits.effort_rate.joint2", "effort_rate", lambda m: fastest_change(m) * ALMOST),
    ("robot.motors", "motor_curve", lambda m: motor_line(m, ALMOST)),
    ("start", "start", lambda m: {"joints": m.q[0] + SLIGHTLY}),
    ("goal", "goal", lambda m: {"joints": dict(zip(JOINTS, m.q[-1] + SLIGHTLY, strict=True))}),
    ("obstacles", "obstacles", lambda m: [BALL]),
    ("clearance", "obstacles", lambda m: 0.2),
]


@pytest.mark.parametrize(("path", "condition", "value"), CHANGES)
def test_a_field_that_is_almost_kept_breaks_its_condition(case, path, condition, value):
    case.put(path, value(case.motion()))
    assert case.broken() == {condition}


def rubbed(effort, v):
    return effort + v + 2.0 * np.sign(v)


# Motors of the first joint, and its effort with and without what is looked at.
MOTORS = {
    "friction": (
        {"coulomb_friction": {"joint1": [2.0, 30.0]}},
        lambda effort, v, a: (effort + np.where(v > 0, 30.0, -2.0), effort),
    ),
    "uncertain friction": (
        {"viscous_friction": {"joint1": 1.0}, "coulomb_friction": {"joint1": 2.0}}
        | {"friction_uncertainty": 0.4},
        lambda effort, v, a: (
            rubbed(effort, v) + 0.4 * abs(rubbed(0.0, v)) * np.sign(rubbed(effort, v)),
            rubbed(effort, v),
        ),
    ),
    "a rotor": ({"armature": {"joint1": 0.3}}, lambda effort, v, a: (effort + 0.3 * a, effort)),
}


@pytest.mark.parametrize("name", MOTORS)
def test_effort_that_motors_take_is_found(case, name):
    """The first joint is limited to almost what it needs, which is more than without motors."""
    case.fields["robot"]["motors"], efforts = MOTORS[name]
    motion = case.motion(20_000)
    effort, without = efforts(motion.effort[:, 0], motion.v[:, 0], motion.a[:, 0])
    most = peak(effort) * ALMOST
    assert most > peak(without) * MORE
    case.put("robot.limits.effort.joint1", most)
    assert case.broken() == {"effort"}


def stand_at_its_ends(case):
    q = case.motion().q
    case.fields["start"], case.fields["goal"] = ({"joints": end} for end in (q[0], q[-1]))


def shift_tube(case, height):
    """Move the tube up; its ends stay where the arm is."""
    case.tube["points"] = [[x, y, z + height] for x, y, z in case.tube["points"]]
    stand_at_its_ends(case)


def beside(case):
    """The tool stays inside the wider segments, and leaves the first by a millimetre."""
    shift_tube(case, case.tube["radius"][0] + SLIGHTLY)


def boxes(case, height=0.2):
    """Put boxes about all discs."""
    widths = [2 * radius + 0.02 for radius in case.tube["radius"]]
    case.tube["cross_section"] = [{"box": [width, height], "up": [0, 0, 1]} for width in widths]
    case.tube["radius"] = None


def above_a_box(case):
    """The tool stays inside the walls, and above the top by a millimetre."""
    boxes(case, height=0.02)
    shift_tube(case, -0.01 - SLIGHTLY)


def other_way_round(case, visit="ordered"):
    case.tube["visit"] = visit
    for key in ("points", "radius"):
        case.tube[key] = case.tube[key][::-1]
    stand_at_its_ends(case)


def turned(case, slack):
    """Let the last segment's tool turn, about z by the sum of the joints, by a slack more."""
    angle = peak(case.motion().q.sum(axis=1))
    case.tube["orientations"] = [[0.0, 0.0, 0.0, 1.0]] * 4
    case.tube["rotation_tolerance"] = [[np.inf, np.inf, angle + slack]] * 3


def spur(case, length):
    """Give the tube a way out of its plane and back, from a line where the tool passes by.

    Returns:
        How far inside its end the tool passes [m].
    """
    points, radius = np.array(case.tube["points"]), case.tube["radius"]
    begin, along = points[1], points[2] - points[1]
    tools = case.robot.tool_position(case.motion().q)
    fraction = (tools - begin) @ along / (along @ along)
    foot = begin + fraction[abs(fraction - 0.5).argmin()] * along
    new = [*points[:2], foot, foot + np.array([0.0, 0.0, length]), foot, *points[2:]]
    case.tube["points"] = np.array(new)
    case.tube["radius"] = [*radius[:1], *radius[1:2] * 4, *radius[2:]]
    return radius[1] - np.linalg.norm(tools - new[3], axis=1).min()


def jump(case):
    for piece in (-3, -2, -1):
        case.add(piece, np.array([1e-4]))


# A fault, and all that it breaks.
FAULTS = {
    "beside": (beside, {"tube"}),
    "above a box": (above_a_box, {"tube"}),
    "other way round": (other_way_round, {"tube"}),
    "turned": (lambda case: turned(case, -SLIGHTLY), {"rotation"}),
    "misses a point": (lambda case: spur(case, 0.2), {"points"}),
    "jump": (jump, {"continuity", "goal"}),
    "kink": (lambda case: case.add(3, np.array([-1e-4, 1e-4, 0])), {"continuity"}),
    "moves at the end": (lambda case: case.add(-1, np.array([-1e-4, 1e-4, 0, 0, 0])), {"rest"}),
}


@pytest.mark.parametrize(("plant", "broken"), FAULTS.values(), ids=FAULTS)
def test_a_planted_fault_is_found(plant, broken, case):
    plant(case)
    assert case.broken() == broken


KEPT = {
    "a certified trajectory": lambda case: None,
    "the other way round in a union": lambda case: other_way_round(case, visit="any"),
    "turned as far as allowed": lambda case: turned(case, SLIGHTLY),
}


@pytest.mark.parametrize("change", KEPT.values(), ids=KEPT)
def test_what_is_kept_is_no_fault(change, case):
    change(case)
    assert case.broken() == set()


@pytest.mark.parametrize("name", ["tool_speed", "tool_acceleration"])
def test_what_a_tool_keeps_is_no_fault(case, name):
    most = getattr(case.motion(), name).max()
    case.tube[name] = [most * MORE] * 3
    case.put(f"robot.limits.{name}", most * (1 + SLIGHTLY / 2))
    conditions = case.judged()
    assert passes(conditions)
    assert conditions[name].margin == pytest.approx(SLIGHTLY / 2, abs=5e-6)
    assert conditions[name].unit == "relative"
    case.tube[name] = most * (1 + SLIGHTLY / 4)
    assert case.judged()[name].margin == pytest.approx(SLIGHTLY / 4, abs=5e-6)


def test_motors_that_have_enough_are_no_fault(case):
    friction = {"coulomb_friction": {"joint2": [0.3, 0.2]}, "friction_uncertainty": 0.5}
    case.put("robot.motors", motor_line(case.motion(20_000), MORE) | friction)
    case.put("robot.limits.effort.joint2", 27.5)
    conditions = case.judged()
    assert passes(conditions)
    curve = conditions["motor_curve"]
    assert curve.margin == pytest.approx(SLIGHTLY, abs=5e-6)
    assert (curve.unit, curve.where) == ("relative", "joint joint1")


LAW = "robot.limits.velocity_by_position.joint1"
POINT = {"link": "link1", "position": [0, 0, 0]}
BOX = {"box": [1, 1], "up": [0, 0, 1]}


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("tube.colour", None, "tube.colour"),
        ("tube.tool_speed", [1.0], "1 entries for 3"),
        ("tube.tool_speed", 0, "is 0"),
        ("tube.tool_acceleration", [0, 1, 1], "tube.tool_acceleration is 0"),
        ("tube.tool_speed", True, "is True"),
        ("tube.tool_speed", "fast", "is fast"),
        ("tube.cross_section", [None], "1 entries for 3 segments"),
        ("tube.cross_section", {"box": [1, 1]}, "has box and up"),
        ("tube.cross_section", BOX | {"box": [1, 0]}, "must be two lengths"),
        ("tube.cross_section", BOX, "segment 0 has a box"),
        ("tube.radius", None, "segment 0 has neither a radius nor a box"),
        ("tube.radius", [0.1], "1 values for 3 segments"),
        ("robot.limits.point_speed", [POINT | {"link": "no", "speed": 1.0}], "not known"),
        ("robot.limits.point_speed", [POINT], "not known"),
        ("robot.limits.point_speed", [POINT | {"speed": 0}], "point_speed"),
        ("robot.limits.velocity_by_position", {"no": {}}, "no is no joint"),
        (LAW, {"deceleration": 1.0, "o": 1}, "o is not known"),
        (LAW, {"deceleration": 0.0, "offset": 1.0}, "joint1 has"),
        ("robot.limits.effort.joint1", [1.0, 0.0], "has the effort limit"),
        ("robot.limits.effort.joint1", [1.0, 2.0, 3.0], "has the effort limit|JointError|many"),
        ("robot.limits.effort.joint1", {"position": [0], "effort": []}, "the effort limit"),
        ("robot.limits.effort.joint1", {"position": [1, 0], "effort": [1, 1]}, "do not rise"),
        ("robot.motors.gear", 3, "robot.motors.gear is not known"),
        ("robot.motors.armature", {"no": 1.0}, "no is no joint"),
        ("robot.motors.armature", [1.0], "1 values for 2 joints"),
        ("robot.motors.viscous_friction", {"joint1": -1.0}, "joint 'joint1' has -1"),
        ("robot.motors.saturation_effort", {"joint1": 9.0}, "one end alone"),
    ],
)
def test_what_says_nothing_is_refused(case, path, value, message):
    case.put(path, value)
    with pytest.raises(BadInput, match=message):
        case.broken()


def law_left(motion, fraction):
    """A law of the first joint of which its motion leaves some fraction of its largest velocity."""
    q, v = motion.q[:, 0], motion.v[:, 0]
    deceleration, offset, largest = 5.0, 0.4, 50.0
    rising = v > 0
    root = np.maximum(v[rising] + fraction * largest, 0.0) + offset
    upper = (q[rising] + root**2 / (2 * deceleration)).max()
    return {"deceleration": deceleration, "offset": offset, "lower": -50.0, "upper": upper}


@pytest.mark.parametrize("fraction", [-SLIGHTLY, SLIGHTLY])
def test_both_judges_have_the_same_limits_by_place(case, fraction):
    """Of a certified trajectory that leaves some fraction of them; one point is never so fast."""
    motion = case.motion()
    case.put("robot.limits.velocity.joint1", 50.0)
    case.put("robot.limits.velocity_by_position.joint1", law_left(motion, fraction))
    tool = {"link": "hand", "position": [0.0, 0.0, 0.0]}
    slow = {"link": "link1", "position": [0.1, 0.0, 0.0], "speed": 100.0}
    fast = tool | {"speed": motion.tool_speed.max() * (1 + fraction)}
    case.put("robot.limits.point_speed", [slow, fast])
    outside, inside = case.judged_by_both()
    for name, where in (("velocity", "joint joint1"), ("point_speed", "point 1 on hand")):
        assert outside[name].margin == pytest.approx(fraction, abs=5e-6)
        assert outside[name].margin == pytest.approx(inside[name].margin, abs=1e-3)
        assert (outside[name].unit, outside[name].where) == ("relative", where)
    assert case.broken(outside) == ({"velocity", "point_speed"} if fraction < 0 else set())


EFFORT_BY_PLACE = {"joint2": {"position": [-2.0, -1.0, 0.0], "effort": [40, 20, 30]}}


@pytest.mark.parametrize(
    ("efforts", "motors"),
    [
        (EFFORT_BY_PLACE, {"coulomb_friction": {"joint1": [4.0, 9.0], "joint2": 1.0}}),
        (
            {"joint1": [70, 140]},
            {"coulomb_friction": 2.0, "viscous_friction": [1.0, 2.0], "friction_uncertainty": 0.3},
        ),
        (
            EFFORT_BY_PLACE,
            {"armature": 0.2, "saturation_effort": [120.0, 40.0], "no_load_velocity": [12.0, 15.0]},
        ),
    ],
)
def test_both_judges_have_the_same_motors(case, efforts, motors):
    case.put("robot.motors", motors)
    case.put("robot.limits", {"effort": efforts, "scale": {"effort": 0.9}})
    outside, inside = case.judged_by_both()
    for name in ("effort", "motor_curve"):
        if inside[name].margin is None:
            assert outside[name].margin is None
        else:
            assert outside[name].margin == pytest.approx(inside[name].margin, abs=1e-3)
            assert outside[name].margin >= inside[name].margin - 1e-9
            assert outside[name].where == f"joint {inside[name].where.joint}"


def read_by_both(folder, robot, joint_count, **preset):
    """Return a robot, which has a preset, as the outside judge and the package read it."""
    parts = {f"{part}.{name}" for part, values in preset.items() for name in values}
    preset |= {"format": "tubeplanner/preset", "joints": joint_count}
    preset["sources"] = dict.fromkeys(parts, "test")
    (folder / "preset.yaml").write_text(yaml.safe_dump(preset))
    tube = {"points": [[0.4, 0, 0.4], [0.4, 0.2, 0.4]], "radius": 0.05}
    robot = robot | {"preset": ["preset.yaml"]}
    fields = {"robot": robot, "tube": tube, "start": {"seed": [0.0] * joint_count}}
    path = folder / "problem.yaml"
    path.write_text(yaml.safe_dump(fields))
    return Arm(read_problem(path)), t.parse_problem(fields, folder).robot


def test_limits_from_files_are_those_of_the_package(tmp_path):
    """Lists are in the order of the chain, whatever the group's; the problem's own limits win."""
    (tmp_path / "moveit.yaml").write_text(
        "joint_limits: {finger: {max_velocity: 9}, elbow_joint: {max_velocity: 2.0, max_jerk: 800,"
        " max_acceleration: 9, has_deceleration_limits: true, max_deceleration: -8},"
        " wrist_1_joint: {has_velocity_limits: false, max_velocity: 9, max_effort: 20},"
        " wrist_2_joint: {has_position_limits: true, min_position: -1, max_position: 2}}"
    )
    names = ["wrist_3_joint", "elbow_joint", "wrist_1_joint", "shoulder_pan_joint"]
    names += ["wrist_2_joint", "shoulder_lift_joint"]
    robot = {"urdf": "example:ur5", "tool_frame": "tool0", "joints": names}
    robot["limits_file"] = "moveit.yaml"
    robot["limits"] = {
        "acceleration": {"wrist_1_joint": 5},
        "velocity": {"wrist_2_joint": 1.0},
        "scale": {"effort": 0.5},
    }
    limits = {
        "effort": [11, 12, 13, 14, 15, 16],
        "jerk": 700,
        "tool_speed": 1.5,
        "tool_acceleration": 9,
    }
    arm, robot = read_by_both(tmp_path, robot, 6, limits=limits)
    found, expected = arm.limits, robot.limits
    assert expected.effort.tolist() == [8, 6.5, 7, 5.5, 7.5, 6]
    assert expected.acceleration[1] == 8
    for name in ("velocity", "acceleration", "jerk", "effort", *OF_TOOL):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(found.lower, expected.lower_position)
    np.testing.assert_array_equal(found.upper, expected.upper_position)


def with_friction(urdf):
    """Return a URDF of which all joints have friction."""
    return urdf.replace("<limit", '<dynamics damping="0.4" friction="0.7"/><limit')


def test_motors_from_files_are_those_of_the_package(tmp_path):
    """Of presets, the URDF and the problem; lists are in the order of the chain."""
    text = find_description("example:two_link", Path()).read_text()
    assert text.count("<limit") == 2
    (tmp_path / "arm.urdf").write_text(with_friction(text))
    robot = {"urdf": "arm.urdf", "tool_frame": "hand", "joints": ["joint2", "joint1"]}
    robot["limits"] = {"effort": {"joint1": [50, 60]}, "scale": {"effort": 0.5}}
    robot["motors"] = {
        "armature": {"joint1": 0.3},
        "viscous_friction": {"joint2": 0.9},
        "saturation_effort": {"joint1": 100.0},
        "no_load_velocity": {"joint1": 9.0},
        "friction_from_urdf": True,
        "friction_uncertainty": 0.2,
    }
    motors = {"armature": [0.1, 0.2], "coulomb_friction": [3.0, [1.0, 2.0]]}
    arm, expected = read_by_both(tmp_path, robot, 2, motors=motors)
    mine, theirs = arm.motors, expected.motors
    assert mine.armature.tolist() == theirs.armature.tolist() == [0.2, 0.3]
    assert mine.viscous.tolist() == theirs.viscous_friction.tolist() == [0.9, 0.4]
    assert mine.dry.tolist() == [[1.0, 3.0], [2.0, 3.0]]
    np.testing.assert_array_equal(mine.dry, [theirs.backwards_friction, theirs.forwards_friction])
    assert mine.stall.tolist() == theirs.saturation_effort.tolist() == [np.inf, 50.0]
    assert mine.no_load.tolist() == theirs.no_load_velocity.tolist() == [np.inf, 9.0]
    assert mine.unsure == theirs.friction_uncertainty == 0.2
    assert (arm.limits.by_place[1].backwards, arm.limits.by_place[1].forwards) == (25, 30)
    np.testing.assert_array_equal(arm.limits.effort, expected.limits.effort)
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 20, 2))
    np.testing.assert_allclose(arm.efforts(q, v, a), expected.inverse_dynamics(q, v, a), atol=1e-9)


@pytest.fixture
def following(tmp_path):
    """A slow trajectory of an arm three of whose joints follow planned ones."""
    (tmp_path / "arm.urdf").write_text(follower_arm())
    begin, end = np.array([0.2, -0.3, 0.1]), np.array([0.4, 0.2, -0.4])
    robot = t.load_robot(tmp_path / "arm.urdf", "tip")
    fields = {"urdf": "arm.urdf", "tool_frame": "tip", "locked_joints": {"side_joint": 0.5}}
    fields["limits"] = {"effort": dict.fromkeys(robot.joint_names, 1e3)}
    tube = {"points": robot.tool_position(np.stack([begin, end])), "radius": 2.0}
    fields = {"robot": fields, "tube": tube, "start": {"joints": begin}}
    return Case(tmp_path, fields, straight(["lift", "first", "wrist"], begin, end), robot)


def test_joints_that_follow_others_are_where_and_cost_what_they_do(following):
    arm, robot = Judge(following.write()).arm, following.robot
    assert arm.joint_names == list(robot.joint_names)
    q, v, a = np.random.default_rng(2).uniform(-1, 1, (3, 20, 3))
    for mine, other in zip(arm.tool(q), robot.tool_pose(q), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-12)
    velocity = robot.tool_velocity(q, v)[0]
    np.testing.assert_allclose(arm.tool_velocity(q, v), velocity, atol=1e-12)
    np.testing.assert_allclose(arm.efforts(q, v, a), robot.inverse_dynamics(q, v, a), atol=1e-9)
    np.testing.assert_allclose(arm.limits.lower, robot.limits.lower_position)
    np.testing.assert_allclose(arm.limits.velocity, robot.limits.velocity)


def test_friction_of_followers_is_felt_by_their_masters(following):
    """As in the package, from a URDF that states friction of all joints."""
    (following.folder / "arm.urdf").write_text(with_friction(follower_arm()))
    following.put("robot.motors", {"friction_from_urdf": True})
    problem = following.write()
    mine, theirs = Judge(problem).arm.motors, t.load_problem(problem).robot.motors
    np.testing.assert_allclose(mine.viscous, theirs.viscous_friction)
    np.testing.assert_allclose(mine.dry[1], theirs.forwards_friction)
    assert (mine.dry[1] > 0.7).any()


def limit(upper=9.0, velocity=99.0):
    return f'<limit lower="-9" upper="{upper}" effort="50" velocity="{velocity}"/>'


@pytest.mark.parametrize(
    ("condition", "changes"),
    [
        # The tool ends elsewhere than planned if a follower follows at another rate.
        ("goal", lambda m: {"rules": RULES | {"slide": ("lift", 0.6, 0.1)}}),
        # `second` gets to -2 (-0.3) + 0.3, and moves twice as fast as `first`.
        ("position", lambda m: {"own": {"second": limit(upper=0.9 - SLIGHTLY)}}),
        ("velocity", lambda m: {"own": {"second": limit(velocity=2 * peak(m.v[:, 1]) * ALMOST)}}),
    ],
)
def test_a_fault_of_a_follower_is_found(following, condition, changes):
    assert following.broken() == set()
    urdf = follower_arm(**changes(following.motion()))
    (following.folder / "arm.urdf").write_text(urdf)
    assert following.broken() == {condition}


def test_a_follower_that_is_too_heavy_is_found(following):
    """`lift` holds all of the arm; what `slide` takes along its axis is its as well."""
    following.put("robot.limits.effort.lift", peak(following.motion().effort[:, 0]) * ALMOST)
    assert following.broken() == {"effort"}


def test_a_follower_is_neither_planned_nor_locked(following):
    following.put("robot.locked_joints.slide", 0.1)
    with pytest.raises(BadInput, match="slide"):
        following.broken()
    del following.fields["robot"]["locked_joints"]
    following.put("robot.joints", ["lift", "first", "second", "wrist"])
    with pytest.raises(BadInput, match="'second' mimics"):
        following.broken()


@pytest.mark.parametrize("points", [3, 4])
@pytest.mark.parametrize("tolerance", [[0.1, 0.2, 0.3], [[0.1, 0.2, 0.3]], 0.2])
def test_one_triple_serves_as_in_the_package(points, tolerance):
    corners = [[k, k**2, 0] for k in range(points)]
    turns = [[0, 0, 0, 1]] * points
    tube = t.Tube(corners, 0.1, orientations=turns, rotation_tolerance=tolerance)
    np.testing.assert_array_equal(bounds_of(tolerance, points - 1), tube.rotation.bounds)


def test_boxes_about_discs_are_kept_and_a_divided_line_of_them_is_one(case):
    before = case.judged()["tube"].margin
    boxes(case)
    conditions = case.judged()
    assert passes(conditions)
    assert conditions["tube"].margin >= before + 0.01 - 1e-9
    case.tube["points"].insert(1, np.mean(case.tube["points"][:2], axis=0))
    case.tube["cross_section"].insert(0, case.tube["cross_section"][0])
    divided = case.judged()["tube"].margin
    assert divided == pytest.approx(conditions["tube"].margin, abs=1e-12)
    case.tube["tool_radius"] = 0.005
    assert case.judged()["tube"].margin >= before + 0.005 - 1e-9


@pytest.mark.parametrize("seed", range(2))
def test_both_judges_have_the_same_boxes(seed):
    rng = np.random.default_rng(seed)
    points, sides, up = rng.uniform(-1, 1, (2, 3)), rng.uniform(0.1, 0.5, 2), rng.normal(size=3)
    section = {"box": sides.tolist(), "up": up.tolist()}
    tube = t.Tube(points, None, cross_section=section, tool_radius=0.02)
    p = rng.uniform(-1.5, 1.5, (500, 3))
    (mine,) = read_sections(section, 1)
    np.testing.assert_allclose(box_margin(*points, mine, 0.02, p), tube.margin(p)[:, 0], atol=1e-12)
    assert radii(None, [mine]) == pytest.approx(tube.radius)


@pytest.fixture
def cart(tmp_path):
    """A cart that goes from 0 to 0.6 m at 1 m/s, and from some place on at 0.4 m/s."""
    slide = joint("slide", "rail", "cart", "prismatic", axis="1 0 0")
    written(tmp_path, link("rail"), link("cart"), slide)

    def slowed_at(place, **tube):
        times = np.array([0.0, place, place + (0.6 - place) / 0.4])
        rows = np.array([[1.0, 0.4], [0.0, place]])[:, :, None]
        tube = {"points": [[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0]], "radius": 0.02, **tube}
        robot = {"urdf": "arm.urdf", "tool_frame": "cart", "limits": {"effort": {"slide": 1e3}}}
        start = {"joints": [0.0]}
        fields = {"robot": robot, "tube": tube, "start": start, "collision": {"self": False}}
        return Case(tmp_path, fields, Trajectory(["slide"], times, rows))

    return slowed_at


@pytest.mark.parametrize(
    ("place", "visit", "passes"),
    [
        (0.2, "any", True),
        (0.3195, "ordered", True),
        (0.3205, "ordered", False),
        (0.3205, "any", False),
    ],
)
def test_hand_overs_are_where_the_tool_is_slow_enough(cart, place, visit, passes):
    """The first capsule, where it may be fast, ends 20 mm behind the middle."""
    case = cart(place, tool_speed=[None, 0.5], visit=visit)
    found = case.broken() & {"tube", "tool_speed", "points"}
    assert found == (set() if passes else {"tool_speed"})


IN_BAND = {
    "points": [[0, 0, 0], [0.2, 0, 0], [0.4, 0, 0], [0.6, 0, 0]],
    "tool_speed": [None, {"speed": 1.1, "tolerance": 0.2}, None],
}


@pytest.mark.parametrize("radius", [0.02, [0.1, 0.02, 0.1]])
@pytest.mark.parametrize(
    ("place", "process", "margin"),
    [
        (0.401, {}, 1 - 1 / 1.1),
        (0.399, {}, 0.4 / 0.88 - 1),
        (0.35, {}, 0.4 / 0.88 - 1),
        (0.35, {"steady": "best"}, 1 - 1 / 1.1),
        (0.401, {"run_in": 0.05, "run_out": 0.05}, 1 - 1 / 1.1),
        (0.399, {"run_in": 0.05, "run_out": 0.05}, 0.4 / 0.88 - 1),
    ],
)
def test_a_band_holds_from_the_first_point_to_the_last(cart, radius, place, process, margin):
    """No wider neighbour takes a part of the stretch; the speed falls at an instant."""
    case = cart(place, radius=radius, process=process, **IN_BAND)
    outside, inside = case.judged_by_both()
    for conditions in (outside, inside):
        assert conditions["tool_speed"].margin == pytest.approx(margin, abs=2e-3)
    assert case.broken(outside) & {"tube", "tool_speed"} == (
        {"tool_speed"} if margin < 0 else set()
    )


@pytest.mark.parametrize(("off", "holds"), [(-0.001, True), (0.005, False)])
def test_a_stretch_is_entered_behind_its_first_point(off, holds):
    points, floor = np.array([[0, 0.2, 0], [0, 0, 0], [0.2, 0, 0], [0.3, 0, 0]]), [0, 1.0, 0]
    free = np.full(3, np.inf)
    tube = TubeFields(
        points, free, [{}] * 3, None, None, free, free, True, [], [], floor=np.array(floor)
    )
    gates = tube.gates(np.array([[off, 0.005, 0], [0.205, off, 0]]))
    np.testing.assert_allclose(gates, [[np.inf, -off, off - 0.2], [np.inf, -0.205, 0.005]])
    rows, segments = ordered_visits(np.full((2, 3), 1.0), gates=gates)
    assert segments.tolist() == [0, 1, 1, 2]
    assert (gates[rows[1], 1] >= 0) is np.bool_(holds)


@pytest.mark.parametrize(
    ("band", "message"),
    [
        ({"speed": 1.0}, "a band has speed and tolerance"),
        ({"between": [1.0, 1.0]}, "a band from 1 to 1 m/s"),
    ],
)
def test_a_band_that_is_none_is_no_input(cart, band, message):
    with pytest.raises(BadInput) as error:
        read_problem(cart(0.2, tool_speed=[None, band]).write())
    assert message in str(error.value)


@pytest.mark.parametrize("name", OF_TOOL)
@pytest.mark.parametrize(("limits", "count"), [([0.5, 0.5], 1), (0.5, 1), ([0.5, 0.6], 2)])
def test_segments_of_one_line_with_one_limit_are_one(cart, name, limits, count):
    assert len(read_problem(cart(0.2, **{name: limits}).write()).tube.radius) == count


@pytest.mark.parametrize("parts", [1, 3])
def test_a_divided_line_is_one(parts, case):
    before = case.judged()
    points, count = np.array(case.tube["points"]), len(case.tube["radius"])
    places = np.arange(count * parts + 1) / parts
    divided = np.array([np.interp(places, np.arange(count + 1), c) for c in points.T]).T
    divided[::parts] = points
    rows = [",".join(repr(float(value)) for value in point) for point in [divided[0], *divided]]
    (case.folder / "path.csv").write_text("x,y,z\n" + "\n".join(rows))
    case.tube["points"] = "path.csv"
    radius = np.repeat(case.tube["radius"], parts)
    case.tube["radius"] = [radius[0], *radius]
    after = case.judged()
    assert [one.margin for one in after.values()] == [one.margin for one in before.values()]


def test_a_segment_of_no_length_is_lost_only_if_it_asks_nothing_else(case):
    case.tube["points"].insert(1, case.tube["points"][0])
    case.tube["radius"].insert(0, 1e-3)
    with pytest.raises(BadInput, match="segment 0 has no length"):
        case.broken()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("passed", [(), (1, 3)])
def test_visits_that_pass_points_are_the_best_there_are(seed, passed):
    rng = np.random.default_rng(seed)
    least = np.round(rng.normal(size=(7, 4)), 1)
    inside = {k: np.round(rng.normal(size=7), 1) for k in passed}

    def worst(samples):
        ends = [0, *samples, 6]
        kept = [least[ends[k] : ends[k + 1] + 1, k].min() for k in range(4)]
        passed = [m[ends[k - 1] : ends[k + 1] + 1].max() for k, m in inside.items()]
        return min([*kept, *passed])

    rows, segments = ordered_visits(least, inside)
    assert (np.diff(segments) >= 0).all()
    found = [int(rows[segments == k][0]) for k in (1, 2, 3)]
    choices = combinations_with_replacement(range(7), 3)
    assert worst(found) == max(worst(choice) for choice in choices)


def test_a_point_that_is_passed_or_not_asked_is_no_fault(case):
    inside = spur(case, 0.02)
    found = case.judged()["points"]
    assert 0.0 < found.margin <= inside + 1e-4
    assert found.where == "point 3"
    case.tube["pass_through_points"] = "none"
    assert case.judged()["points"].margin is None


def test_the_end_is_turned_as_far_as_the_goal_allows(case):
    turned(case, np.inf)
    angle, ball = abs(case.motion().q[-1].sum()), {"position": case.tube["points"][-1]}
    for bound, margin in ((angle + 0.1, 0.1), ([9.0, 9.0, angle - 0.1], -0.1)):
        case.fields["goal"] = ball | {"rotation_tolerance": bound}
        rotation = case.judged()["rotation"]
        assert rotation.margin == pytest.approx(margin, abs=1e-9)
        assert rotation.where == "at the goal"
    del case.tube["orientations"], case.tube["rotation_tolerance"]
    with pytest.raises(BadInput, match=r"goal\.rotation_tolerance needs tube\.orientations"):
        case.judged()


@pytest.mark.parametrize(
    ("goal", "margin"),
    [
        ({"position": [0.6, 0.003, 0.004], "tolerance": 0.004}, -0.001),
        ({"position": [0.6, 0.003, 0.004], "tolerance": 0.006}, 0.001),
        ({"pose": {"position": [0.6, 0, 0.001]}}, -0.001),
        ({"pose": {"position": [0.6, 0, 0.001], "rpy": [0, 0, 0.01]}}, -0.01),
        ({"pose": {"position": [0.6, 0, 0.001], "quaternion": [0, 0, 0, 1]}}, -0.001),
    ],
)
def test_a_goal_is_a_ball_or_a_pose_where_the_tool_is_and_how_it_is_turned(goal, margin, cart):
    case = cart(0.2)
    case.fields["goal"] = goal
    assert case.judged(10)["goal"].margin == pytest.approx(margin, abs=1e-9)


def test_many_small_jumps_are_added_up():
    steps = 8e-7 * np.ones((1, 300, 2)) * np.arange(300)[:, None]
    stairs = Trajectory(["joint1", "joint2"], np.linspace(0, 1.0, 301), steps)
    judge = Judge(bundled_problems()["two_link/around_a_post"])
    margin = judge_ends(judge.problem, judge.arm, stairs)["continuity"].margin
    assert margin == pytest.approx(-299 * 8e-7)


def test_a_solid_that_encloses_the_arm_is_met(case):
    part = bundled_problems()["ur5/every_field"].with_name("part.stl")
    shell = {"name": "shell", "mesh": str(part), "scale": 1000.0}
    case.fields["obstacles"] = [shell | {"position": [0.0, 0.0, -10.0]}]
    assert case.broken() == {"obstacles"}


@pytest.mark.parametrize("kind", ["closed", *OPENED])
def test_a_mesh_that_is_not_closed_encloses_what_it_would_closed(tmp_path, kind):
    path = opened(trimesh.creation.box([0.4, 0.4, 0.4]), kind, tmp_path / "block.stl")
    geometry, _ = solid_geometry({"name": "block", "mesh": str(path)}, tmp_path, [])
    block = placed("block", "obstacle", 0, pin.SE3.Identity(), geometry)
    ball = placed("ball", "link", 0, pin.SE3.Identity(), coal.Sphere(0.01))
    for x, inside in ((-0.15, True), (-0.22, False)):
        at = (ball, np.eye(3), np.array([x, 0.02, -0.03]))
        assert is_inside(at, (block, np.eye(3), np.zeros(3))) == inside


def test_an_obj_file_with_several_materials_keeps_its_triangles(tmp_path):
    block = trimesh.creation.icosphere(1)
    lines = [f"v {x} {y} {z}" for x, y, z in block.vertices]
    for k, face in enumerate(block.faces + 1):
        lines += [f"usemtl paint{k * 7 % 5}", "f {} {} {}".format(*face)]
    (tmp_path / "ball.obj").write_text("\n".join(lines))
    geometry, _ = solid_geometry({"name": "ball", "mesh": "ball.obj", "scale": 2}, tmp_path, [])
    corners = np.array(geometry.vertices())
    indices = [geometry.tri_indices(k) for k in range(geometry.num_tris)]
    triangles = np.array([[corners[int(row[k])] for k in range(3)] for row in indices])

    def ordered(each):
        middle = each.mean(axis=1)
        return middle[np.lexsort(middle.round(6).T)]

    expected = 2 * block.vertices[block.faces]
    np.testing.assert_allclose(ordered(triangles), ordered(expected), atol=1e-6)


def test_links_of_primitives_meet(tmp_path):
    box, middle = '<box size="0.2 0.04 0.04"/>', '<origin xyz="0.15 0 0"/>'
    wide = '<limit lower="-3.1" upper="3.1" effort="100" velocity="50"/>'
    written(
        tmp_path,
        link("base"),
        *(solid_link(f"link{k}", box, middle) for k in (1, 2, 3)),
        link("tip"),
        joint("joint1", "base", "link1", limit=wide),
        joint("joint2", "link1", "link2", xyz="0.3 0 0", limit=wide),
        joint("joint3", "link2", "link3", xyz="0.3 0 0", limit=wide),
        joint("end", "link3", "tip", "fixed", xyz="0.3 0 0"),
    )
    begin, end = np.array([0.0, 1.5, 0.2]), np.array([0.0, 2.2, 2.6])
    trajectory = straight(["joint1", "joint2", "joint3"], begin, end)
    robot = {"urdf": "arm.urdf", "tool_frame": "tip", "gravity": [0, 0, 0]}
    tube = {"points": [[-1, 0, 0], [1, 0, 0]], "radius": 2.0}
    ends = {"start": {"joints": begin}, "goal": {"joints": end}}
    case = Case(tmp_path, {"robot": robot, "tube": tube, **ends}, trajectory)
    assert case.broken() == {"self_collision"}
    case.fields["collision"] = {"ignore": [["link1", "link3"]]}
    assert case.broken() == set()


@pytest.mark.dear("judges a robot of concave meshes")
def test_concave_links_that_pass_through_each_other_are_found():
    found = outside_judge.judge(CASES / "hextilt_1.yaml", CASES / "hextilt_1.answer.json")
    met = found["self_collision"]
    assert met.where == "flying_arm_5__link_2 and flying_arm_5__link_4"
    assert met.margin < -0.01
    assert all(one.holds(1e-5) for name, one in found.items() if name != "self_collision")


@pytest.mark.dear("judges a UR5 and measures its meshes at all samples")
def test_an_arm_with_meshes_passes_and_its_least_distance_is_that_of_all_samples(stored, tmp_path):
    trajectory = reread(stored("ur5/over_the_wall")[1], tmp_path)
    judge = Judge(bundled_problems()["ur5/over_the_wall"])
    assert passes(judge.judge(trajectory, 100))
    poses = Poses(*judge.arm.poses(trajectory.at(trajectory.samples(2))))
    for pairs in (judge.clearance.link_pairs, judge.clearance.obstacle_pairs):
        rows = range(len(poses.position))
        every = min(signed_distance(pair, poses, row) for pair in pairs for row in rows)
        assert least_margin(pairs, poses, 0.0)[0].margin == pytest.approx(every, abs=1e-9)


def test_the_command_names_what_it_cannot_judge_and_prints_one_json_object(case, capsys):
    case.put("tube.colour", None)
    assert case.told() == 2
    assert "tube.colour" in capsys.readouterr().err
    del case.tube["colour"]
    case.fields["start"] = {"joints": case.motion().q[0] + SLIGHTLY}
    assert case.told("--json") == 1
    verdict = json.loads(capsys.readouterr().out)
    assert not verdict["passes"]
    assert verdict["conditions"]["start"]["margin"] == pytest.approx(-SLIGHTLY)


def test_joints_may_come_in_another_order_but_must_be_the_problems(case):
    breakpoints, coefficients = case.trajectory.breakpoints, case.trajectory.coefficients
    case.trajectory = Trajectory(["joint2", "joint1"], breakpoints, coefficients[:, :, ::-1])
    assert case.broken() == set()
    case.trajectory = Trajectory(["a", "b"], breakpoints, coefficients)
    with pytest.raises(BadInput, match="joint1"):
        case.judged()


def test_names_of_robots_mean_the_same_to_both():
    for name in example_robot_names()[::3]:
        with suppress(BadInput):  # the outside judge does not guess
            path = find_urdf(f"example:{name}", Path(), [])
            assert path == find_description(f"example:{name}", Path()).resolve()


def test_nothing_of_tubeplanner_is_imported():
    """Neither by the judge nor by what it imports, which is its own folder's."""
    others = {path.stem for path in BENCHMARKS.glob("*.py")}
    for path in [BENCHMARKS / "outside_judge.py", *(BENCHMARKS / "outside").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [getattr(node, "module", None), *(alias.name for alias in node.names)]
                roots = {name.partition(".")[0] for name in names if name}
                assert not roots & {"tubeplanner", *others}
