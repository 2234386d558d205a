"""The outside judge finds one planted fault per condition, and passes what is sound."""

import ast
import json
from functools import cache
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest
import yaml
from arms import RULES, follower_arm

import outside_judge
from outside.arm import Arm
from outside.conditions import judge_ends
from outside.distances import Poses, least_margin, signed_distance
from outside.files import BadInput, find_urdf
from outside.problem import read_problem
from outside.trajectory import Trajectory, read_trajectory
from outside.tube import ordered_visits
from outside.tube_fields import bounds_of, box_margin, radii, read_sections
from outside_judge import Judge, main, passes
from tubeplanner import JointTrajectory, Tube, load_problem, load_robot, parse_problem, verify
from tubeplanner.errors import RobotError
from tubeplanner.files.export import trajectory_json
from tubeplanner.resources import bundled_problems, example_robot_names, find_description

BENCHMARKS = Path(outside_judge.__file__).parent
CASES = Path(__file__).parents[1] / "data/cases"
SLIGHTLY = 1e-3
SAMPLES = 500  # divided further where it matters

FOLDING = """<robot name="folding"><link name="base"/>
{links}<link name="tip"/><joint name="end" type="fixed"><parent link="link3"/><child link="tip"/>
<origin xyz="0.3 0 0"/></joint></robot>"""
FOLDING_LINK = """<link name="link{k}"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.15 0 0"/><geometry><box size="0.2 0.04 0.04"/></geometry></collision>
</link><joint name="joint{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/>
<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3.1" upper="3.1" effort="100" velocity="5"/></joint>
"""


REST_TO_REST = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])  # a unit step in a unit time


ARM = cache(lambda frame: load_robot("example:two_link", frame))


def limit(upper=9.0, velocity=99.0):
    return f'<limit lower="-9" upper="{upper}" effort="50" velocity="{velocity}"/>'


class Case:
    """A problem's fields and a trajectory, to be changed before they are judged."""

    def __init__(self, fields, trajectory):
        self.fields, self.trajectory = fields, trajectory
        self.robot, self.tube = fields["robot"], fields["tube"]

    def limit(self, quantity, values):
        self.robot.setdefault("limits", {}).setdefault(quantity, {}).update(values)

    def peak(self, order):
        samples = self.trajectory.samples(2000)
        return float(abs(self.trajectory.at(samples, order)[:, 0]).max())

    def speed(self, joint):
        return float(abs(self.trajectory.at(self.trajectory.samples(2000), 1)[:, joint]).max())

    def strongest(self, joint):
        robot = load_robot(self.folder / "arm.urdf", "tip")
        samples = self.trajectory.samples(2000)
        efforts = robot.inverse_dynamics(*(self.trajectory.at(samples, k) for k in range(3)))
        return float(abs(efforts[:, joint]).max())

    def positions(self):
        return self.trajectory.at(self.trajectory.samples(2000))

    def add(self, piece, polynomial, joint=0):
        """Add a polynomial in the share of a piece, highest power first."""
        width = np.diff(self.trajectory.breakpoints)[piece]
        old = self.trajectory.coefficients
        degree = max(len(old), len(polynomial))
        new = np.zeros((degree, *old.shape[1:]))
        new[degree - len(old) :] = old
        powers = width ** np.arange(len(polynomial) - 1, -1, -1)
        new[degree - len(polynomial) :, piece, joint] += polynomial / powers
        self.trajectory = Trajectory(self.trajectory.joint_names, self.trajectory.breakpoints, new)

    def write(self, folder):
        problem, trajectory = folder / "problem.yaml", folder / "trajectory.json"
        problem.write_text(yaml.safe_dump(self.fields))
        fields = {
            "format": "tubeplanner/trajectory",
            "version": 1,
            "joint_names": self.trajectory.joint_names,
            "duration": self.trajectory.duration,
            "breakpoints": self.trajectory.breakpoints.tolist(),
            "coefficients": self.trajectory.coefficients.tolist(),
        }
        trajectory.write_text(json.dumps(fields))
        return problem, trajectory

    def judged(self, folder, count=SAMPLES):
        problem = folder / "problem.yaml"
        problem.write_text(yaml.safe_dump(self.fields))
        return Judge(problem).judge(self.trajectory, count)

    def verified(self, folder):
        """Return the package's own conditions, of the problem that was judged last."""
        ours = self.trajectory
        trajectory = JointTrajectory(ours.joint_names, ours.breakpoints, ours.coefficients)
        return verify(load_problem(folder / "problem.yaml"), trajectory).conditions

    def broken(self, folder):
        return {
            name
            for name, each in self.judged(folder).items()
            if not each.holds(outside_judge.TOLERANCE)
        }


@pytest.fixture(scope="session")
def certified(stored, tmp_path_factory):
    """A certified trajectory of the two-link arm, and what its problem file holds."""
    _, trajectory = stored("two_link/around_a_post")
    path = tmp_path_factory.mktemp("certified") / "trajectory.json"
    path.write_text(trajectory_json(trajectory))
    text = bundled_problems()["two_link/around_a_post"].read_text()
    return text, read_trajectory(path)


@pytest.fixture
def case(certified):
    text, trajectory = certified
    return Case(yaml.safe_load(text), trajectory)


def stand_at_its_ends(case):
    q = case.positions()
    case.fields["start"], case.fields["goal"] = ({"joints": end.tolist()} for end in (q[0], q[-1]))


def beside(case):
    """The tool stays inside the wider segments, and leaves the first by a millimetre."""
    aside = case.tube["radius"][0] + SLIGHTLY
    case.tube["points"] = [[x, y, z + aside] for x, y, z in case.tube["points"]]
    stand_at_its_ends(case)


def wrong_side(case):
    case.tube["joint_signs"] = {"joint2": "+"}


def out_of_range(case):
    highest = float(case.positions()[:, 1].max())
    case.tube["joint_signs"] = {"joint2": [-3.0, highest - SLIGHTLY]}


def too_far(case):
    highest = float(case.positions()[:, 0].max())
    case.limit("position", {"joint1": [-6.0, highest - SLIGHTLY]})


def less_than_used(quantity, order):
    return lambda case: case.limit(quantity, {"joint1": case.peak(order) * (1 - SLIGHTLY)})


def too_strong(case):
    # 95 and 27 N m are what the trajectory was planned for, and uses.
    case.limit("effort", {"joint1": 95 * (1 - SLIGHTLY), "joint2": 27 * (1 - SLIGHTLY)})


def too_abrupt(case):
    """The fastest change of an effort, between two samples that are held against each other."""
    samples = case.trajectory.samples(20_001)
    efforts = ARM(case.robot["tool_frame"]).inverse_dynamics(
        *(case.trajectory.at(samples, k) for k in range(3))
    )
    step = np.diff(samples.time)
    inside = (np.diff(samples.piece) == 0) & (step > 0)
    fastest = abs(np.diff(efforts, axis=0)[inside] / step[inside, None]).max(axis=0)
    case.limit("effort_rate", {"joint2": float(fastest[1]) * (1 - SLIGHTLY)})


def jump(case):
    coefficients = case.trajectory.coefficients.copy()
    coefficients[-1, -3:, 0] += 1e-4
    case.trajectory = Trajectory(
        case.trajectory.joint_names, case.trajectory.breakpoints, coefficients
    )


def kink(case):
    case.add(3, np.array([-1e-4, 1e-4, 0.0]))


def moves_at_the_end(case):
    case.add(-1, np.array([-1e-4, 1e-4, 0.0, 0.0, 0.0]))


def wrong_start(case):
    case.fields["start"] = {"joints": (case.positions()[0] + SLIGHTLY).tolist()}


def wrong_goal(case):
    q = case.positions()[-1] + SLIGHTLY
    case.fields["goal"] = {"joints": dict(zip(("joint1", "joint2"), q.tolist(), strict=True))}


def through_a_ball(case):
    ball = {"name": "ball", "sphere": 0.02, "position": [0.44, 0.0, 0.02]}
    case.fields["obstacles"].append(ball)


def too_near(case):
    case.fields["clearance"] = 0.2


def turned(case):
    angle = abs(case.positions().sum(axis=1)).max()
    case.tube["orientations"] = [[0.0, 0.0, 0.0, 1.0]] * 4
    bound = [np.inf, np.inf, float(angle) - SLIGHTLY]
    case.tube["rotation_tolerance"] = [bound] * 3


def other_way_round(case):
    for key in ("points", "radius"):
        case.tube[key] = case.tube[key][::-1]
    stand_at_its_ends(case)


def spur(case, length):
    """Give the tube a way out of its plane and back, from a line where the tool passes by."""
    points, radius = np.array(case.tube["points"]), list(case.tube["radius"])
    begin, along = points[1], points[2] - points[1]
    tools = ARM(case.robot["tool_frame"]).tool_position(case.positions())
    middle = tools[abs((tools - begin) @ along / (along @ along) - 0.5).argmin()]
    foot = begin + (middle - begin) @ along / (along @ along) * along
    new = [*points[:2], foot, np.add(foot, [0.0, 0.0, length]), foot, *points[2:]]
    case.tube["points"] = [[float(value) for value in point] for point in new]
    case.tube["radius"] = [*radius[:1], *radius[1:2] * 4, *radius[2:]]
    return radius[1] - np.linalg.norm(tools - new[3], axis=1).min()


def tool_speed(case):
    """Return how fast the tool is at samples [m/s]."""
    samples = case.trajectory.samples(2000)
    jacobian = ARM(case.robot["tool_frame"]).tool_jacobian(case.trajectory.at(samples))[1][:, :3]
    v = case.trajectory.at(samples, 1)
    return np.linalg.norm(np.einsum("nij,nj->ni", jacobian, v), axis=1)


def tool_too_fast(case):
    case.robot.setdefault("limits", {})["tool_speed"] = float(
        tool_speed(case).max() * (1 - SLIGHTLY)
    )


def tool_too_fast_in_a_segment(case):
    """It stops at corners, so that each segment has its own fastest instant."""
    case.tube["tool_speed"] = [None, float(tool_speed(case).max() * (1 - SLIGHTLY)), None]
    speed, thirds = tool_speed(case), len(tool_speed(case)) // 3
    assert thirds < speed.argmax() < 2 * thirds


def law_left(case, share):
    """Give the first joint a law of which its motion leaves some share of its largest velocity."""
    q = case.positions()[:, 0]
    v = case.trajectory.at(case.trajectory.samples(2000), 1)[:, 0]
    deceleration, offset, largest = 5.0, 0.4, 50.0
    rising = v > 0
    root = np.maximum(v[rising] + share * largest, 0.0) + offset
    upper = float((q[rising] + root**2 / (2 * deceleration)).max())
    law = {"deceleration": deceleration, "offset": offset, "lower": -50.0, "upper": upper}
    case.limit("velocity", {"joint1": largest})
    case.limit("velocity_by_position", {"joint1": law})


def tool_point(case, share):
    """Limit the tool's place as a point of its link, and one that is never so fast."""
    fastest = float(tool_speed(case).max())
    point = {"link": case.robot["tool_frame"], "position": [0.0, 0.0, 0.0]}
    case.robot.setdefault("limits", {})["point_speed"] = [
        {"link": "link1", "position": [0.1, 0.0, 0.0], "speed": 100.0},
        point | {"speed": fastest * share},
    ]


def motors(case, **values):
    case.robot.setdefault("motors", {}).update(values)


def first_joint(case):
    """Return position, velocity, acceleration and effort of the first joint at samples."""
    arm = ARM(case.robot["tool_frame"])
    samples = case.trajectory.samples(20_000)
    states = [case.trajectory.at(samples, order) for order in range(3)]
    return *(state[:, 0] for state in states), arm.inverse_dynamics(*states)[:, 0]


def almost_strong_enough(case, effort, without):
    """Limit the first joint to almost what it needs, which is more than without motors."""
    most = float(abs(effort).max()) * (1 - SLIGHTLY)
    assert most > abs(without).max() * (1 + SLIGHTLY)
    case.limit("effort", {"joint1": most})


def friction_unpaid(case):
    _, v, _, effort = first_joint(case)
    motors(case, coulomb_friction={"joint1": [2.0, 30.0]})
    dry = np.where(v > 0, 30.0, -2.0)
    almost_strong_enough(case, effort + dry, effort)


def friction_unpaid_at_worst(case):
    _, v, _, effort = first_joint(case)
    motors(case, viscous_friction={"joint1": 1.0}, coulomb_friction={"joint1": 2.0})
    motors(case, friction_uncertainty=0.4)
    friction = v + 2.0 * np.sign(v)
    unsure = 0.4 * abs(friction) * np.sign(effort + friction)
    almost_strong_enough(case, effort + friction + unsure, effort + friction)


def rotor_unpaid(case):
    _, _, a, effort = first_joint(case)
    motors(case, armature={"joint1": 0.3})
    almost_strong_enough(case, effort + 0.3 * a, effort)


def used_of_a_line(case):
    """Return the largest share of a line from 95 N m to 40 rad/s that the first joint uses."""
    _, v, _, effort = first_joint(case)
    return float(abs(effort / 95.0 + v / 40.0).max())


def beyond_a_line(case):
    used = used_of_a_line(case) * (1 - SLIGHTLY)
    ends = {"saturation_effort": 95.0 * used, "no_load_velocity": 40.0 * used}
    motors(case, **{key: {"joint1": value} for key, value in ends.items()})


def weaker_backwards(case):
    _, _, _, effort = first_joint(case)
    case.limit("effort", {"joint1": [float(-effort.min()) * (1 - SLIGHTLY), 1e3]})


def weaker_in_one_place(case):
    """Where the first joint uses most, and beside; it has more elsewhere."""
    q, _, _, effort = first_joint(case)
    at, most = float(q[abs(effort).argmax()]), float(abs(effort).max()) * (1 - SLIGHTLY)
    table = {"position": [at - 0.2, at - 0.1, at + 0.1, at + 0.2]}
    table["effort"] = [3 * most, most, most, 3 * most]
    case.limit("effort", {"joint1": table})


def misses_a_point(case):
    assert spur(case, 0.2) < -0.01


def boxes(case, height=0.2):
    """Put boxes about all discs."""
    case.tube["cross_section"] = [
        {"box": [2 * radius + 0.02, height], "up": [0, 0, 1]} for radius in case.tube["radius"]
    ]
    case.tube["radius"] = None


def above_a_box(case):
    """The tool stays inside the walls, and above the top by a millimetre."""
    boxes(case, height=0.02)
    case.tube["points"] = [[x, y, z - 0.01 - SLIGHTLY] for x, y, z in case.tube["points"]]
    stand_at_its_ends(case)


# By name: a fault, and the condition that it breaks.
FAULTS = {
    "beside": (beside, "tube"),
    "above a box": (above_a_box, "tube"),
    "other way round": (other_way_round, "tube"),
    "wrong side": (wrong_side, "joint_signs"),
    "out of range": (out_of_range, "joint_signs"),
    "too far": (too_far, "position"),
    "too fast": (less_than_used("velocity", 1), "velocity"),
    "too quick": (less_than_used("acceleration", 2), "acceleration"),
    "too jerky": (less_than_used("jerk", 3), "jerk"),
    "too strong": (too_strong, "effort"),
    "too abrupt": (too_abrupt, "effort_rate"),
    "jump": (jump, "continuity"),
    "kink": (kink, "continuity"),
    "moves at the end": (moves_at_the_end, "rest"),
    "wrong start": (wrong_start, "start"),
    "wrong goal": (wrong_goal, "goal"),
    "through a ball": (through_a_ball, "obstacles"),
    "too near": (too_near, "obstacles"),
    "turned": (turned, "rotation"),
    "misses a point": (misses_a_point, "points"),
    "tool too fast": (tool_too_fast, "tool_speed"),
    "tool too fast in a segment": (tool_too_fast_in_a_segment, "tool_speed"),
    "friction unpaid": (friction_unpaid, "effort"),
    "friction unpaid at worst": (friction_unpaid_at_worst, "effort"),
    "rotor unpaid": (rotor_unpaid, "effort"),
    "beyond a line": (beyond_a_line, "motor_curve"),
    "weaker backwards": (weaker_backwards, "effort"),
    "weaker in one place": (weaker_in_one_place, "effort"),
}
WITH_OTHERS = {"jump", "kink", "moves at the end"}  # they break what follows from it as well


def test_a_certified_trajectory_passes(case, tmp_path):
    assert case.broken(tmp_path) == set()


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found(name, case, tmp_path):
    plant, condition = FAULTS[name]
    plant(case)
    broken = case.broken(tmp_path)
    assert condition in broken
    assert name in WITH_OTHERS or broken == {condition}


def test_a_trajectory_the_other_way_round_is_in_the_union(case, tmp_path):
    other_way_round(case)
    case.tube["visit"] = "any"
    assert case.broken(tmp_path) == set()


def test_limits_from_files_are_those_of_the_package(tmp_path):
    """Lists are in the order of the chain, whatever the group's; the problem's own limits win."""
    (tmp_path / "moveit.yaml").write_text(
        "joint_limits: {finger: {max_velocity: 9}, elbow_joint: {max_velocity: 2.0, max_jerk: 800,"
        " max_acceleration: 9, has_deceleration_limits: true, max_deceleration: -8},"
        " wrist_1_joint: {has_velocity_limits: false, max_velocity: 9, max_effort: 20},"
        " wrist_2_joint: {has_position_limits: true, min_position: -1, max_position: 2}}"
    )
    preset = {
        "format": "tubeplanner/preset",
        "joints": 6,
        "limits": {"effort": [11, 12, 13, 14, 15, 16], "jerk": 700, "tool_speed": 1.5},
        "sources": {f"limits.{name}": "test" for name in ("effort", "jerk", "tool_speed")},
    }
    (tmp_path / "preset.yaml").write_text(yaml.safe_dump(preset))
    names = ["wrist_3_joint", "elbow_joint", "wrist_1_joint", "shoulder_pan_joint"]
    names += ["wrist_2_joint", "shoulder_lift_joint"]
    robot = {
        "urdf": "example:ur5",
        "tool_frame": "tool0",
        "joints": names,
        "limits_file": "moveit.yaml",
        "preset": ["preset.yaml"],
        "limits": {
            "acceleration": {"wrist_1_joint": 5},
            "velocity": {"wrist_2_joint": 1.0},
            "scale": {"effort": 0.5},
        },
    }
    tube = {"points": [[0.4, 0, 0.4], [0.4, 0.2, 0.4]], "radius": 0.05}
    fields = {"robot": robot, "tube": tube, "start": {"seed": [0.0] * 6}}
    path = tmp_path / "problem.yaml"
    path.write_text(yaml.safe_dump(fields))
    found, expected = Arm(read_problem(path)).limits, parse_problem(fields, tmp_path).robot.limits
    assert expected.effort.tolist() == [8, 6.5, 7, 5.5, 7.5, 6]
    assert expected.acceleration[1] == 8
    for name in ("velocity", "acceleration", "jerk", "effort", "tool_speed"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(found.lower, expected.lower_position)
    np.testing.assert_array_equal(found.upper, expected.upper_position)


@pytest.mark.parametrize("points", [3, 4])
@pytest.mark.parametrize("tolerance", [[0.1, 0.2, 0.3], [[0.1, 0.2, 0.3]], 0.2])
def test_one_triple_serves_as_in_the_package(points, tolerance):
    corners = [[k, k**2, 0] for k in range(points)]
    turns = [[0, 0, 0, 1]] * points
    tube = Tube(corners, 0.1, orientations=turns, rotation_tolerance=tolerance)
    np.testing.assert_array_equal(bounds_of(tolerance, points - 1), tube.rotation.bounds)


def test_a_rotation_tolerance_that_is_kept_is_no_fault(case, tmp_path):
    turned(case)
    for bound in case.tube["rotation_tolerance"]:
        bound[2] += 2 * SLIGHTLY
    assert case.broken(tmp_path) == set()


def test_a_tools_speed_that_is_kept_is_no_fault(case, tmp_path):
    fastest = float(tool_speed(case).max())
    case.tube["tool_speed"] = [None, fastest * (1 + SLIGHTLY), None]
    case.robot.setdefault("limits", {})["tool_speed"] = fastest * (1 + SLIGHTLY / 2)
    conditions = case.judged(tmp_path)
    assert passes(conditions)
    assert conditions["tool_speed"].margin == pytest.approx(SLIGHTLY / 2, abs=5e-6)
    assert conditions["tool_speed"].unit == "relative"
    case.tube["tool_speed"] = fastest * (1 + SLIGHTLY / 4)
    margin = case.judged(tmp_path)["tool_speed"].margin
    assert margin == pytest.approx(SLIGHTLY / 4, abs=5e-6)


LIMITS = [
    ({"point_speed": [{"link": "no", "position": [0, 0, 0], "speed": 1.0}]}, "not known"),
    ({"point_speed": [{"link": "link1", "position": [0, 0, 0]}]}, "not known"),
    ({"point_speed": [{"link": "link1", "position": [0, 0, 0], "speed": 0}]}, "point_speed"),
    ({"velocity_by_position": {"no": {}}}, "no is no joint"),
    ({"velocity_by_position": {"joint1": {"deceleration": 1.0, "o": 1}}}, "o is not known"),
    ({"velocity_by_position": {"joint1": {"deceleration": 0.0, "offset": 1.0}}}, "joint1 has"),
    ({"effort": {"joint1": [1.0, 0.0]}}, "has the effort limit"),
    ({"effort": {"joint1": [1.0, 2.0, 3.0]}}, "has the effort limit|JointError|many"),
    ({"effort": {"joint1": {"position": [0], "effort": []}}}, "the effort limit"),
    ({"effort": {"joint1": {"position": [1, 0], "effort": [1, 1]}}}, "do not rise"),
]
NO_MOTORS = [
    ({"gear": 3}, "robot.motors.gear is not known"),
    ({"armature": {"no": 1.0}}, "no is no joint"),
    ({"armature": [1.0]}, "1 values for 2 joints"),
    ({"viscous_friction": {"joint1": -1.0}}, "joint 'joint1' has -1"),
    ({"saturation_effort": {"joint1": 9.0}}, "one end alone"),
]
TUBES = [
    ({"tool_speed": [1.0]}, "1 entries for 3"),
    ({"tool_speed": 0}, "is 0"),
    ({"tool_speed": True}, "is True"),
    ({"tool_speed": "fast"}, "is fast"),
    ({"cross_section": [None]}, "1 entries for 3 segments"),
    ({"cross_section": {"box": [1, 1]}}, "has box and up"),
    ({"cross_section": {"box": [1, 0], "up": [0, 0, 1]}}, "must be two lengths"),
    ({"cross_section": {"box": [1, 1], "up": [0, 0, 1]}}, "segment 0 has a box"),
    ({"radius": None}, "segment 0 has neither a radius nor a box"),
    ({"radius": [0.1]}, "1 values for 3 segments"),
]


@pytest.mark.parametrize(
    ("section", "changes", "message"),
    [
        *(("limits", *each) for each in LIMITS),
        *(("motors", *each) for each in NO_MOTORS),
        *(("tube", *each) for each in TUBES),
    ],
)
def test_what_says_nothing_is_refused(case, tmp_path, section, changes, message):
    fields = case.tube if section == "tube" else case.robot.setdefault(section, {})
    fields.update(changes)
    with pytest.raises(BadInput, match=message):
        case.broken(tmp_path)


@pytest.mark.parametrize("share", [-SLIGHTLY, SLIGHTLY])
def test_both_judges_have_the_same_limits_by_place(case, tmp_path, share):
    """Of a certified trajectory that leaves some share of them."""
    law_left(case, share)
    tool_point(case, 1 + share)
    outside = case.judged(tmp_path)
    inside = case.verified(tmp_path)
    for name in ("velocity", "point_speed"):
        assert outside[name].margin == pytest.approx(share, abs=5e-6)
        assert outside[name].margin == pytest.approx(inside[name].margin, abs=1e-3)
        assert outside[name].unit == "relative"
    assert outside["velocity"].where == "joint joint1"
    assert outside["point_speed"].where == f"point 1 on {case.robot['tool_frame']}"
    broken = {name for name, each in outside.items() if not each.holds(outside_judge.TOLERANCE)}
    assert broken == ({"velocity", "point_speed"} if share < 0 else set())


def test_motors_that_have_enough_are_no_fault(case, tmp_path):
    used = used_of_a_line(case) * (1 + SLIGHTLY)
    motors(case, saturation_effort={"joint1": 95.0 * used}, no_load_velocity={"joint1": 40 * used})
    motors(case, coulomb_friction={"joint2": [0.3, 0.2]}, friction_uncertainty=0.5)
    case.limit("effort", {"joint2": 27.5})
    conditions = case.judged(tmp_path)
    assert passes(conditions)
    curve = conditions["motor_curve"]
    assert curve.margin == pytest.approx(SLIGHTLY, abs=5e-6)
    assert (curve.unit, curve.where) == ("relative", "joint joint1")


MOTORS = [
    {"coulomb_friction": {"joint1": [4.0, 9.0], "joint2": 1.0}},
    {"coulomb_friction": 2.0, "viscous_friction": [1.0, 2.0], "friction_uncertainty": 0.3},
    {"armature": 0.2, "saturation_effort": [120.0, 40.0], "no_load_velocity": {
        "joint1": 12.0, "joint2": 15.0}},
]  # fmt: skip
EFFORTS = [
    {"joint1": [70, 140]},
    {"joint2": {"position": [-2.0, -1.0, 0.0], "effort": [40, 20, 30]}},
]


@pytest.mark.parametrize(
    ("motors", "efforts"),
    [(MOTORS[0], EFFORTS[1]), (MOTORS[1], EFFORTS[0]), (MOTORS[2], EFFORTS[1])],
)
def test_both_judges_have_the_same_motors(case, tmp_path, motors, efforts):
    case.robot["motors"] = motors
    case.limit("effort", efforts)
    case.limit("scale", {"effort": 0.9})
    outside, inside = case.judged(tmp_path), case.verified(tmp_path)
    for name in ("effort", "motor_curve"):
        if inside[name].margin is None:
            assert outside[name].margin is None
        else:
            assert outside[name].margin == pytest.approx(inside[name].margin, abs=1e-3)
            assert outside[name].margin >= inside[name].margin - 1e-9
            assert outside[name].where == f"joint {inside[name].where.joint}"


def test_motors_from_files_are_those_of_the_package(tmp_path):
    """Of presets, the URDF and the problem; lists are in the order of the chain."""
    preset = {
        "format": "tubeplanner/preset",
        "joints": 2,
        "motors": {"armature": [0.1, 0.2], "coulomb_friction": [3.0, [1.0, 2.0]]},
        "sources": {f"motors.{name}": "test" for name in ("armature", "coulomb_friction")},
    }
    (tmp_path / "preset.yaml").write_text(yaml.safe_dump(preset))
    text = find_description("example:two_link", Path()).read_text()
    assert text.count("<limit") == 2
    friction = '<dynamics damping="0.4" friction="0.7"/><limit'
    (tmp_path / "arm.urdf").write_text(text.replace("<limit", friction))
    robot = {
        "urdf": "arm.urdf",
        "tool_frame": "hand",
        "joints": ["joint2", "joint1"],
        "preset": ["preset.yaml"],
        "motors": {
            "armature": {"joint1": 0.3},
            "viscous_friction": {"joint2": 0.9},
            "saturation_effort": {"joint1": 100.0},
            "no_load_velocity": {"joint1": 9.0},
            "friction_from_urdf": True,
            "friction_uncertainty": 0.2,
        },
        "limits": {"effort": {"joint1": [50, 60]}, "scale": {"effort": 0.5}},
    }
    tube = {"points": [[0.4, 0, 0], [0.4, 0.2, 0]], "radius": 0.05}
    fields = {"robot": robot, "tube": tube, "start": {"seed": [0.0] * 2}}
    path = tmp_path / "problem.yaml"
    path.write_text(yaml.safe_dump(fields))
    arm, expected = Arm(read_problem(path)), parse_problem(fields, tmp_path).robot
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


def test_friction_of_followers_is_felt_by_their_masters(following, tmp_path):
    """As in the package, from a URDF that states friction of all joints."""
    text = (tmp_path / "arm.urdf").read_text()
    friction = '<dynamics damping="0.4" friction="0.7"/><limit'
    (tmp_path / "arm.urdf").write_text(text.replace("<limit", friction))
    motors(following, friction_from_urdf=True)
    problem, _ = following.write(tmp_path)
    mine, theirs = Judge(problem).arm.motors, load_problem(problem).robot.motors
    np.testing.assert_allclose(mine.viscous, theirs.viscous_friction)
    np.testing.assert_allclose(mine.dry[1], theirs.forwards_friction)
    assert (mine.dry[1] > 0.7).any()


def test_boxes_about_discs_are_kept_and_a_divided_line_of_them_is_one(case, tmp_path):
    before = case.judged(tmp_path)["tube"].margin
    boxes(case)
    conditions = case.judged(tmp_path)
    assert passes(conditions)
    assert conditions["tube"].margin >= before + 0.01 - 1e-9
    case.tube["points"].insert(1, np.mean(case.tube["points"][:2], axis=0).tolist())
    case.tube["cross_section"].insert(0, dict(case.tube["cross_section"][0]))
    divided = case.judged(tmp_path)["tube"].margin
    assert divided == pytest.approx(conditions["tube"].margin, abs=1e-12)
    case.tube["tool_radius"] = 0.005
    assert case.judged(tmp_path)["tube"].margin >= before + 0.005 - 1e-9


@pytest.mark.parametrize("seed", range(2))
def test_both_judges_have_the_same_boxes(seed):
    rng = np.random.default_rng(seed)
    points, sides, up = rng.uniform(-1, 1, (2, 3)), rng.uniform(0.1, 0.5, 2), rng.normal(size=3)
    section = {"box": sides.tolist(), "up": up.tolist()}
    tube = Tube(points, None, cross_section=section, tool_radius=0.02)
    p = rng.uniform(-1.5, 1.5, (500, 3))
    (mine,) = read_sections(section, 1)
    np.testing.assert_allclose(box_margin(*points, mine, 0.02, p), tube.margin(p)[:, 0], atol=1e-12)
    assert radii(None, [mine]) == pytest.approx(tube.radius)


@pytest.fixture
def cart(tmp_path):
    """A cart that goes from 0 to 0.6 m at 1 m/s, and from some place on at 0.4 m/s."""
    (tmp_path / "cart.urdf").write_text(
        """<robot name="cart"><link name="rail"/><link name="cart"/>
        <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/>
        <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="10" velocity="100"/></joint>
        </robot>"""
    )

    def slowed_at(place, **tube):
        times = np.array([0.0, place, place + (0.6 - place) / 0.4])
        rows = np.array([[1.0, 0.4], [0.0, place]])[:, :, None]
        tube = {"points": [[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0]], "radius": 0.02, **tube}
        robot = {"urdf": "cart.urdf", "tool_frame": "cart", "limits": {"effort": {"slide": 1e3}}}
        start = {"joints": [0.0]}
        fields = {"robot": robot, "tube": tube, "start": start, "collision": {"self": False}}
        return Case(fields, Trajectory(["slide"], times, rows))

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
def test_hand_overs_are_where_the_tool_is_slow_enough(cart, tmp_path, place, visit, passes):
    """The first capsule, where it may be fast, ends 20 mm behind the middle."""
    case = cart(place, tool_speed=[None, 0.5], visit=visit)
    found = case.broken(tmp_path) & {"tube", "tool_speed", "points"}
    assert found == (set() if passes else {"tool_speed"})


@pytest.mark.parametrize(("speeds", "count"), [([0.5, 0.5], 1), (0.5, 1), ([0.5, 0.6], 2)])
def test_segments_of_one_line_with_one_speed_are_one(cart, tmp_path, speeds, count):
    problem, _ = cart(0.2, tool_speed=speeds).write(tmp_path)
    assert len(read_problem(problem).tube.radius) == count


@pytest.mark.parametrize(
    ("turn", "margin"),
    [({}, -0.001), ({"rpy": [0, 0, 0.01]}, -0.01), ({"quaternion": [0, 0, 0, 1]}, -0.001)],
)
def test_a_pose_is_where_the_tool_is_and_how_it_is_turned(turn, margin, cart, tmp_path):
    case = cart(0.2)
    case.fields["goal"] = {"pose": {"position": [0.6, 0, 0.001], **turn}}
    goal = case.judged(tmp_path, 10)["goal"]
    assert goal.margin == pytest.approx(margin, abs=1e-9)


def test_a_point_that_is_passed_or_not_asked_is_no_fault(case, tmp_path):
    inside = spur(case, 0.02)
    found = case.judged(tmp_path)["points"]
    assert 0.0 < found.margin <= inside + 1e-4
    assert found.where == "point 3"
    case.tube["pass_through_points"] = "none"
    assert case.judged(tmp_path)["points"].margin is None


@pytest.mark.parametrize("parts", [1, 3])
def test_a_divided_line_is_one(parts, case, tmp_path):
    before = case.judged(tmp_path)
    points, count = np.array(case.tube["points"]), len(case.tube["radius"])
    places = np.arange(count * parts + 1) / parts
    divided = np.array([np.interp(places, np.arange(count + 1), c) for c in points.T]).T
    divided[::parts] = points
    rows = [",".join(repr(float(value)) for value in point) for point in [divided[0], *divided]]
    (tmp_path / "path.csv").write_text("x,y,z\n" + "\n".join(rows))
    case.tube["points"] = "path.csv"
    radius = np.repeat(case.tube["radius"], parts).tolist()
    case.tube["radius"] = [radius[0], *radius]
    after = case.judged(tmp_path)
    assert [one.margin for one in after.values()] == [one.margin for one in before.values()]


def test_a_segment_of_no_length_is_lost_only_if_it_asks_nothing_else(case, tmp_path):
    case.tube["points"].insert(1, case.tube["points"][0])
    case.tube["radius"].insert(0, 1e-3)
    with pytest.raises(BadInput, match="segment 0 has no length"):
        case.broken(tmp_path)


@pytest.mark.parametrize("seed", range(4))
def test_visits_that_pass_points_are_the_best_there_are(seed):
    rng = np.random.default_rng(seed)
    least = np.round(rng.normal(size=(7, 4)), 1)
    inside = {k: np.round(rng.normal(size=7), 1) for k in (1, 3)}

    def worst(samples):
        ends = [0, *samples, 6]
        kept = [least[ends[k] : ends[k + 1] + 1, k].min() for k in range(4)]
        passed = [m[ends[k - 1] : ends[k + 1] + 1].max() for k, m in inside.items()]
        return min([*kept, *passed])

    rows, segments = ordered_visits(least, inside)
    found = [int(rows[segments == k][0]) for k in (1, 2, 3)]
    choices = combinations_with_replacement(range(7), 3)
    assert worst(found) == max(worst(choice) for choice in choices)


def test_many_small_jumps_are_added_up():
    at = np.linspace(0, 1.0, 301)
    stairs = Trajectory(
        ["joint1", "joint2"], at, 8e-7 * np.ones((1, 300, 2)) * np.arange(300)[:, None]
    )
    judge = Judge(bundled_problems()["two_link/around_a_post"])
    margin = judge_ends(judge.problem, judge.arm, stairs)["continuity"].margin
    assert margin == pytest.approx(-299 * 8e-7)


def test_a_solid_that_encloses_the_arm_is_met(case, tmp_path):
    part = bundled_problems()["ur5/every_field"].with_name("part.stl")
    shell = {"name": "shell", "mesh": str(part), "scale": 1000.0}
    case.fields["obstacles"] = [shell | {"position": [0.0, 0.0, -10.0]}]
    assert case.broken(tmp_path) == {"obstacles"}


def test_links_of_primitives_meet(tmp_path):
    links = [("base", 0.0), ("link1", 0.3), ("link2", 0.3)]
    parts = (FOLDING_LINK.format(k=k + 1, parent=p, x=x) for k, (p, x) in enumerate(links))
    (tmp_path / "folding.urdf").write_text(FOLDING.format(links="".join(parts)))
    begin, end = np.array([0.0, 1.5, 0.2]), np.array([0.0, 2.2, 2.6])
    coefficients = REST_TO_REST[:, None, None] * (end - begin)
    coefficients[-1] += begin
    trajectory = Trajectory(["joint1", "joint2", "joint3"], np.array([0.0, 1.0]), coefficients)
    robot = {"urdf": "folding.urdf", "tool_frame": "tip", "gravity": [0, 0, 0]}
    robot["limits"] = {"velocity": dict.fromkeys(trajectory.joint_names, 50.0)}
    tube = {"points": [[-1, 0, 0], [1, 0, 0]], "radius": 2.0}
    ends = {"start": {"joints": begin.tolist()}, "goal": {"joints": end.tolist()}}
    case = Case({"robot": robot, "tube": tube, **ends}, trajectory)
    assert case.broken(tmp_path) == {"self_collision"}
    case.fields["collision"] = {"ignore": [["link1", "link3"]]}
    assert case.broken(tmp_path) == set()


@pytest.fixture
def following(tmp_path):
    """A slow trajectory of an arm three of whose joints follow planned ones."""
    (tmp_path / "arm.urdf").write_text(follower_arm())
    begin, end = np.array([0.2, -0.3, 0.1]), np.array([0.4, 0.2, -0.4])
    coefficients = REST_TO_REST[:, None, None] * (end - begin)
    coefficients[-1] += begin
    trajectory = Trajectory(["lift", "first", "wrist"], np.array([0.0, 1.0]), coefficients)
    robot = load_robot(tmp_path / "arm.urdf", "tip")
    first, last = robot.tool_position(np.stack([begin, end])).tolist()
    fields = {"urdf": "arm.urdf", "tool_frame": "tip", "locked_joints": {"side_joint": 0.5}}
    fields["limits"] = {"effort": dict.fromkeys(robot.joint_names, 1e3)}
    tube = {"points": [first, last], "radius": 2.0}
    return Case({"robot": fields, "tube": tube, "start": {"joints": begin.tolist()}}, trajectory)


def test_joints_that_follow_others_are_where_and_cost_what_they_do(following, tmp_path):
    problem, _ = following.write(tmp_path)
    arm, robot = Judge(problem).arm, load_robot(tmp_path / "arm.urdf", "tip")
    assert arm.joint_names == list(robot.joint_names)
    q, v, a = np.random.default_rng(2).uniform(-1, 1, (3, 20, 3))
    for mine, other in zip(arm.tool(q), robot.tool_pose(q), strict=True):
        np.testing.assert_allclose(mine, other, atol=1e-12)
    velocity = robot.tool_velocity(q, v)[0]
    np.testing.assert_allclose(arm.tool_velocity(q, v), velocity, atol=1e-12)
    np.testing.assert_allclose(arm.efforts(q, v, a), robot.inverse_dynamics(q, v, a), atol=1e-9)
    np.testing.assert_allclose(arm.limits.lower, robot.limits.lower_position)
    np.testing.assert_allclose(arm.limits.velocity, robot.limits.velocity)


def other_rule(case):
    """The tool ends elsewhere than planned if a follower follows at another rate."""
    return {"rules": RULES | {"tip_joint": ("second", 0.5, 0.2), "slide": ("lift", 0.6, 0.1)}}


def follower_too_far(case):
    """`second` gets to -2 (-0.3) + 0.3."""
    return {"own": {"second": limit(upper=0.9 - SLIGHTLY)}}


def follower_too_fast(case):
    """`second` moves twice as fast as `first`."""
    return {"own": {"second": limit(velocity=2 * case.speed(1) * (1 - SLIGHTLY))}}


def follower_too_heavy(case):
    """`lift` holds all of the arm; what `slide` takes along its axis is its as well."""
    case.limit("effort", {"lift": case.strongest(0) * (1 - SLIGHTLY)})
    return {}


@pytest.mark.parametrize(
    ("plant", "condition"),
    [
        (other_rule, "goal"),
        (follower_too_far, "position"),
        (follower_too_fast, "velocity"),
        (follower_too_heavy, "effort"),
    ],
)
def test_a_fault_of_a_follower_is_found(following, tmp_path, plant, condition):
    assert following.broken(tmp_path) == set()
    following.folder = tmp_path
    (tmp_path / "arm.urdf").write_text(follower_arm(**plant(following)))
    assert following.broken(tmp_path) == {condition}


def test_a_follower_is_neither_planned_nor_locked(following, tmp_path):
    following.robot["locked_joints"]["slide"] = 0.1
    with pytest.raises(BadInput, match="slide"):
        following.broken(tmp_path)
    del following.robot["locked_joints"]
    following.robot["joints"] = ["lift", "first", "second", "wrist"]
    with pytest.raises(BadInput, match="'second' mimics"):
        following.broken(tmp_path)


def test_concave_links_that_pass_through_each_other_are_found():
    found = outside_judge.judge(CASES / "hextilt_1.yaml", CASES / "hextilt_1.answer.json")
    met = found["self_collision"]
    assert met.where == "flying_arm_5__link_2 and flying_arm_5__link_4"
    assert met.margin < -0.01
    assert all(one.holds(1e-5) for name, one in found.items() if name != "self_collision")


def test_an_arm_with_meshes_passes_and_its_least_distance_is_that_of_all_samples(stored, tmp_path):
    _, trajectory = stored("ur5/over_the_wall")
    path = tmp_path / "trajectory.json"
    path.write_text(trajectory_json(trajectory))
    judge, trajectory = Judge(bundled_problems()["ur5/over_the_wall"]), read_trajectory(path)
    assert passes(judge.judge(trajectory, 100))
    poses = Poses(*judge.arm.poses(trajectory.at(trajectory.samples(2))))
    for pairs in (judge.clearance.link_pairs, judge.clearance.obstacle_pairs):
        rows = range(len(poses.position))
        every = min(signed_distance(pair, poses, row) for pair in pairs for row in rows)
        assert least_margin(pairs, poses, 0.0)[0].margin == pytest.approx(every, abs=1e-9)


def test_the_way_in_order_takes_the_best_switching_times():
    inside = np.array([[9.0, -9, -9], [2, 1, -9], [5, 3, 4], [-9, 6, 4], [-9, -9, 7]])
    rows, segments = ordered_visits(inside)
    assert list(zip(rows, segments, strict=True))[-1] == (4, 2)
    assert inside[rows, segments].min() == 2  # at the second sample
    assert (np.diff(segments) >= 0).all()


def test_a_field_that_is_not_known_is_refused_by_name(case, tmp_path, capsys):
    case.tube["colour"] = None
    files = [str(path) for path in case.write(tmp_path)]
    assert main(files) == 2
    assert "tube.colour" in capsys.readouterr().err


def test_json_is_one_object(case, tmp_path, capsys):
    wrong_start(case)
    files = [str(path) for path in case.write(tmp_path)]
    assert main([*files, "--json"]) == 1
    verdict = json.loads(capsys.readouterr().out)
    assert not verdict["passes"]
    assert verdict["conditions"]["start"]["margin"] == pytest.approx(-SLIGHTLY)


def test_a_trajectory_of_other_joints_is_refused(case, tmp_path):
    problem, _ = case.write(tmp_path)
    other = Trajectory(["a", "b"], case.trajectory.breakpoints, case.trajectory.coefficients)
    with pytest.raises(BadInput, match="joint1"):
        Judge(problem).judge(other)


def test_joints_may_come_in_another_order(case, tmp_path):
    problem, _ = case.write(tmp_path)
    trajectory = case.trajectory
    other = Trajectory(
        ["joint2", "joint1"], trajectory.breakpoints, trajectory.coefficients[:, :, ::-1]
    )
    assert passes(Judge(problem).judge(other))


def test_names_of_robots_mean_the_same_to_both():
    for name in example_robot_names()[::3]:
        try:
            path = find_urdf(f"example:{name}", Path(), [])
        except BadInput:
            continue  # it does not guess
        try:
            assert path == find_description(f"example:{name}", Path()).resolve()
        except RobotError:
            pytest.fail(name)


def test_nothing_of_tubeplanner_is_imported():
    """Neither by the judge nor by what it imports, which is its own folder's."""
    others = {path.stem for path in BENCHMARKS.glob("*.py")}
    for path in [BENCHMARKS / "outside_judge.py", *(BENCHMARKS / "outside").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [getattr(node, "module", None), *(alias.name for alias in node.names)]
                roots = {name.partition(".")[0] for name in names if name}
                assert not roots & {"tubeplanner", *others}


@pytest.mark.parametrize(("tolerance", "holds"), [(0.004, False), (0.006, True)])
def test_a_ball_that_the_tool_ends_in_or_not(tolerance, holds, case, tmp_path):
    x, y, z = case.tube["points"][-1]
    case.fields["goal"] = {"position": [x + 0.003, y - 0.004, z], "tolerance": tolerance}
    goal = case.judged(tmp_path)["goal"]
    assert goal.margin == pytest.approx(tolerance - 0.005, abs=1e-6)
    assert goal.holds(outside_judge.TOLERANCE) == holds


def test_the_end_is_turned_as_far_as_the_goal_allows(case, tmp_path):
    """The two-link arm's hand is turned about z, by the sum of its joints."""
    count = len(case.tube["points"])
    case.tube["orientations"] = [[0.0, 0.0, 0.0, 1.0]] * count
    case.tube["rotation_tolerance"] = [float("inf")] * (count - 1)
    turned = abs(float(case.positions()[-1].sum()))
    ball = {"position": case.tube["points"][-1]}
    for bound in (turned + 0.1, [9.0, 9.0, turned - 0.1]):
        case.fields["goal"] = ball | {"rotation_tolerance": bound}
        rotation = case.judged(tmp_path)["rotation"]
        assert rotation.margin == pytest.approx(0.1 if isinstance(bound, float) else -0.1, abs=1e-9)
        assert rotation.where == "at the goal"
    del case.tube["orientations"], case.tube["rotation_tolerance"]
    with pytest.raises(BadInput, match=r"goal\.rotation_tolerance needs tube\.orientations"):
        case.judged(tmp_path)
