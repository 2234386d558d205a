"""Problems of which one thing was made impossible, with orientations: that thing must be named."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import (
    AttachedSolid,
    Obstacle,
    Payload,
    PlanningProblem,
    PlanOptions,
    Seed,
    Tube,
    load_robot,
    placement_of,
    plan,
)
from tubeplanner.outcome import Location
from tubeplanner.planning.diagnosis import blocking_sample, path_samples

BLOCKED, FAR, HEAVY = "tube_blocked", "unreachable", "gravity_exceeds_effort"
POINTS = [[0.45, -0.35, 0.14], [0.45, -0.35, 0.45], [0.35, 0.48, 0.46], [0.64, 0.26, 0.61]]
DOWN, FORWARD = [1.0, 0.0, 0.0, 0.0], [0.7071068, 0.7071068, 0.0, 0.0]
TOLERANCE = [[0.05, 0.05, np.inf], [0.3, 0.3, np.inf], [0.2, 0.2, np.inf]]
HAND = ("panda_hand", "panda_leftfinger", "panda_rightfinger", "panda_link7", "panda_link8")
START = np.array([0.0, 0.0, 0.0, -2.5, 0.0, 2.5, 0.8])
SIGNS = ("signs and orientation", FAR, "joint signs are in the way of the orientation")


def limited(robot, **limits):
    return robot.with_limits(replace(robot.limits, **limits), robot.motors)


def out_of_a_bin(points=None, tolerance=None, last=FORWARD, mass=1.5, signs=None, **others):
    """A Panda carries a part out of a bin; no branch keeps the rotation tolerance to the goal."""
    payload = Payload(mass=mass, com=(0, 0, 0.03))
    robot = load_robot("example:panda", "panda_hand_tcp", payload=payload)
    robot = limited(robot, acceleration=np.full(7, 15.0))
    box = Obstacle.box("part", [0.06, 0.06, 0.1], placement_of([0, 0, 0.04]))
    part = AttachedSolid("part", box.shapes, touch_links=HAND)
    floor = Obstacle.box("floor", [0.4, 0.3, 0.02], placement_of([0.45, -0.35, 0.01]))
    tube = Tube(
        POINTS if points is None else points,
        [0.03, 0.12, 0.03],
        orientations=[DOWN, DOWN, DOWN, last],
        rotation_tolerance=TOLERANCE if tolerance is None else tolerance,
        joint_signs=signs,
    )
    obstacles = [floor, *others.pop("obstacles", [])]
    given = {"clearance": 0.01, "attached": [part], "obstacles": obstacles, **others}
    return PlanningProblem(robot, tube, Seed(START), **given)


def with_point(k, point):
    return [*POINTS[:k], point, *POINTS[k + 1 :]]


def reason_of(problem):
    """Return what blocks a problem, without planning it."""
    return blocking_sample(problem, START, Location())


@pytest.fixture(scope="module")
def possible():
    return out_of_a_bin()


def made_impossible(name, possible):
    folded = np.where(np.arange(7) == 3, -2.4, possible.robot.limits.upper_position)
    block = Obstacle.box("block", [0.1, 0.1, 0.1], placement_of(POINTS[3]))
    tight = {"last": [0.7071068, 0, -0.7071068, 0], "tolerance": [*TOLERANCE[:2], 0.01]}
    if name == "joint limit":
        return replace(possible, robot=limited(possible.robot, upper_position=folded))
    others = {
        "far goal": {"points": with_point(3, [1.55, 0.3, 0.6])},
        "far middle": {"points": with_point(2, [0.66, 0.58, 0.74])},
        "joint signs": {"signs": {"panda_joint4": [-3.0, -2.4]}},
        "heavy": {"mass": 14.0},
        "goal in an obstacle": {"obstacles": [block]},
        "signs and orientation": {"signs": {"panda_joint4": [-3.0, -1.2]}},
        "orientation": tight,
    }
    return out_of_a_bin(**others[name])


def test_nothing_blocks_what_can_be_planned(possible):
    assert reason_of(possible) is None


@pytest.mark.parametrize(
    ("name", "status", "named", "point"),
    [
        ("far goal", FAR, "0.6538 m short even without joint limits; move the goal", 3),
        ("far middle", FAR, "even without joint limits; move the reference point 2", 2),
        ("joint limit", FAR, "position limits are in the way, 'panda_joint4'", 3),
        ("joint signs", FAR, "joint signs are in the way, 'panda_joint4'", 3),
        ("heavy", HEAVY, "joint 'panda_joint6' needs", 2),
        ("goal in an obstacle", BLOCKED, "into 'block' (clearance 10 mm) in the goal", 3),
        pytest.param(*SIGNS, 3, marks=pytest.mark.dear("looks at many configurations")),
        ("orientation", FAR, "the rotation tolerance of segment 2", 3),
    ],
)
def test_what_blocks_is_named_before_the_rotation_tolerance(name, status, named, point, possible):
    reason = reason_of(made_impossible(name, possible))
    assert reason is not None
    assert (reason.status, reason.location.point) == (status, point)
    assert named in str(reason)


@pytest.mark.parametrize(
    ("name", "status", "named", "persistent"),
    [
        ("joint signs", FAR, "start from its seed: joint signs are in the way of the orient", True),
        ("goal in an obstacle", BLOCKED, "'block'", False),
        ("heavy", HEAVY, "needs 111.45 N m against gravity alone, its effort limit is 87.00", True),
    ],
)
def test_planning_names_it(name, status, named, persistent, possible):
    result = plan(made_impossible(name, possible), PlanOptions(persistent=persistent))
    assert result.status == status
    assert named in result.message


def test_places_are_points_then_what_lies_between(possible):
    ended = Location(segment=1, position=(0.4, 0.2, 0.45))
    samples = path_samples(possible, ended)
    points = [1, 2, 3, None, None, None, None]
    assert [sample.location.point for sample in samples] == points
    assert [sample.location.segment for sample in samples] == [0, 1, 2, 0, 1, 1, 2]
    assert (samples[2].is_goal, samples[2].allowed) == (True, 0)
    assert samples[1].allowed == pytest.approx(0.015)  # half the smaller radius
    assert samples[1].segments == samples[1].rotation_rows == (1, 2)
    np.testing.assert_allclose(samples[5].tool, ended.position)  # beyond the middle


def test_of_a_long_path_few_places_are_asked(possible):
    points = [[0.3 + 0.01 * k, 0.3 + 0.02 * (k % 2), 0.4] for k in range(31)]
    problem = PlanningProblem(possible.robot, Tube(points, 0.01), Seed(START))
    samples = path_samples(problem, Location(segment=20))
    segments = {sample.location.segment for sample in samples}
    assert segments == {17, 18, 19, 20, 21, 22, 23, 29}
