"""Random planning problems that have a solution: each is built around a walk of the arm.

The walk, a smooth or polygonal line through random configurations, is the witness: moved along it
slowly enough, with rests at its corners, the arm breaks nothing. The tube is laid around its tool,
obstacles are placed beside its links. Candidates are refused for what the walk itself does, never
for what a planner or its inverse kinematics makes of them; `RULES` lists the reasons.
"""

import math
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from tubeplanner import (
    LimitOverrides,
    Obstacle,
    Payload,
    PlanningProblem,
    RobotModel,
    ToolOffset,
    Tube,
    load_robot,
)
from tubeplanner.collision.collision_checker import CollisionChecker
from witness import EFFORT_SHARE, LINK_CLEARANCE, RandomCase, keeps_apart, witness_holds

MIN_RADIUS, MAX_RADIUS = 0.01, 0.15  # [m]
MIN_SEGMENT_LENGTH = 0.03  # [m]
SHARPEST_TURN = math.radians(150)
MAX_SEGMENTS = 5
LIMIT_MARGIN = 0.01  # [rad] between the walk and position limits, and from a signed joint to zero
SMALL_MARGIN = 0.002  # [m] that the tool keeps to its capsule's wall, beside 5 %
MAX_TOLERANCE = math.radians(60)  # of rotation
ROWS_PER_LEG = 100
MAX_CANDIDATES = 5000
MAX_DRAWS = 200  # of one obstacle

LIMITS = "the walk comes within 0.01 rad of a position limit"
GRAVITY = "holding the arm still takes more than 95 % of a motor's effort"
SHORT = "reference points are nearer than 3 cm to each other"
TURN = "the tool's route turns by more than 150 degrees"
CURVED = "the tool strays by more than 15 cm from the straight line"
TURNED = "the tool is turned by more than 60 degrees away from the reference"
LINKS = "links come within 5 mm of each other"
CROWDED = "no place for an obstacle was found"
DENSE = "the check between the samples failed"
RULES = (LIMITS, GRAVITY, SHORT, TURN, CURVED, TURNED, LINKS, CROWDED, DENSE)


class Rejected(Exception):
    """A candidate's walk breaks one of the rules."""


@dataclass(frozen=True)
class Features:
    """What a problem is to have, drawn before its walk so that no rule changes the mix.

    Attributes:
        segments: Of the tube.
        smooth: Whether the walk is a spline rather than a polygon.
        at_knots: Whether the reference points are the walk's knots (sharp turns, wide tubes)
            rather than where it bends most (gentle turns, narrow tubes).
        has_obstacles: Whether there are any.
        bounds_rotation: Whether there is a rotation tolerance.
        has_goal: Whether the goal is given.
        has_signs: Whether joints have signs, if any keeps its own.
        clearance: Of links from obstacles [m].
    """

    segments: int
    smooth: bool
    at_knots: bool
    has_obstacles: bool
    bounds_rotation: bool
    has_goal: bool
    has_signs: bool
    clearance: float


def two_link() -> RobotModel:
    """Return the paper's arm, without gravity and velocity limits."""
    unlimited = LimitOverrides(velocity={"joint1": math.inf, "joint2": math.inf})
    return load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=unlimited)


def xarm7() -> RobotModel:
    """Return an xArm7 with the tool of the bundled problem."""
    offset, payload = ToolOffset(position=(0.0, 0.0, 0.1)), Payload(0.8, (0, 0, 0.08))
    return load_robot("example:xarm7", "link_eef", tool_offset=offset, payload=payload)


ARMS: dict[str, Callable[[], RobotModel]] = {
    "ur5": lambda: load_robot("example:ur5", "tool0"),
    "panda": lambda: load_robot("example:panda", "panda_hand_tcp", payload=Payload(0.5)),
    "xarm7": xarm7,
    "ur10": lambda: load_robot("example:ur10", "tool0", payload=Payload(5.0, (0, 0, 0.1))),
    "two_link": two_link,
}


def random_case(
    arm: str, robot: RobotModel, seed: int, rejections: Counter[str] | None = None
) -> RandomCase:
    """Return the problem of an arm and a seed; always the same.

    Args:
        arm: Of `ARMS`.
        robot: That arm.
        seed: Any number >= 0.
        rejections: Counts the candidates refused, by rule.
    """
    rng = np.random.default_rng([seed, zlib.crc32(arm.encode())])
    features = _features(rng, seed)
    for _ in range(MAX_CANDIDATES):
        try:
            case = _candidate(arm, robot, seed, rng, features)
            if not witness_holds(case):
                raise Rejected(DENSE)
        except Rejected as rule:
            if rejections is not None:
                rejections[str(rule)] += 1
            continue
        return case
    raise RuntimeError(f"{arm}, seed {seed}: no sound walk in {MAX_CANDIDATES} candidates")


def _features(rng: np.random.Generator, seed: int) -> Features:
    return Features(
        segments=int(rng.integers(1, MAX_SEGMENTS + 1)),
        smooth=bool(rng.random() < 0.5),
        at_knots=bool(rng.random() < 0.6),
        has_obstacles=seed % 2 == 1,
        bounds_rotation=seed % 8 in (2, 5),  # one with and one without obstacles
        has_goal=bool(rng.random() < 0.5),
        has_signs=bool(rng.random() < 0.4),
        clearance=float(rng.choice([0.0, 0.005, 0.01])),
    )


def _candidate(
    arm: str, robot: RobotModel, seed: int, rng: np.random.Generator, features: Features
) -> RandomCase:
    """Return a problem around a new walk.

    Raises:
        Rejected: The walk breaks a rule.
    """
    walk = _walk(rng, robot, features)
    limits = robot.limits
    margin = np.minimum(walk - limits.lower_position, limits.upper_position - walk)
    _require(margin.min() >= LIMIT_MARGIN, LIMITS)
    _require((abs(robot.gravity_effort(walk)) <= EFFORT_SHARE * limits.effort).all(), GRAVITY)
    switching_rows = _switching_rows(robot.tool_position(walk), features)
    tube = _tube(rng, robot, walk, switching_rows, features)
    goal = walk[-1] if features.has_goal else None
    name = f"{arm}, seed {seed}"
    bare = CollisionChecker(robot)
    _require(keeps_apart(bare, walk[::10], bare.link_pairs, LINK_CLEARANCE), LINKS)
    around = []
    if features.has_obstacles:
        count = int(rng.integers(1, 5))
        around = [_obstacle_beside(rng, robot, walk[::5], f"{k}") for k in range(count)]
    problem = PlanningProblem(
        robot, tube, walk[0], goal, around, clearance=features.clearance, name=name
    )
    return RandomCase(arm, seed, problem, walk, switching_rows)


def _require(holds: bool, rule: str) -> None:
    if not holds:
        raise Rejected(rule)


def _walk(rng: np.random.Generator, robot: RobotModel, features: Features) -> np.ndarray:
    """Return configurations (P, n) of a random walk; rows of its knots are ROWS_PER_LEG apart."""
    limits = robot.limits
    low = np.maximum(limits.lower_position, -np.pi) + 5 * LIMIT_MARGIN
    high = np.minimum(limits.upper_position, np.pi) - 5 * LIMIT_MARGIN
    legs = features.segments if features.at_knots else max(1, features.segments // 2)
    knots = [rng.uniform(low, high)]
    for _ in range(legs):
        longest = rng.uniform(0.2, 1.0)  # [rad] of a joint
        step = rng.uniform(-longest, longest, len(low))
        knots.append(np.clip(knots[-1] + step, low, high))
    at = np.arange(legs * ROWS_PER_LEG + 1) / ROWS_PER_LEG
    if features.smooth and legs > 1:
        walk: np.ndarray = CubicSpline(np.arange(legs + 1), knots, bc_type="natural")(at)
        return walk
    columns = np.array(knots).T
    return np.array([np.interp(at, np.arange(legs + 1), column) for column in columns]).T


def _switching_rows(tool: np.ndarray, features: Features) -> tuple[int, ...]:
    """Return the rows of the walk at which the tool's positions (P, 3) are reference points."""
    if features.at_knots:
        switching_rows = list(range(0, len(tool), ROWS_PER_LEG))
    else:
        switching_rows = [0, len(tool) - 1]
        while len(switching_rows) <= features.segments:
            off = [_off_line(tool[a : b + 1]) for a, b in pairwise(switching_rows)]
            k = int(np.argmax([distance.max() for distance in off]))
            switching_rows.insert(k + 1, switching_rows[k] + max(1, int(off[k].argmax())))
    points = tool[switching_rows]
    lines = np.diff(points, axis=0)
    lengths = np.linalg.norm(lines, axis=1)
    _require(lengths.min() >= MIN_SEGMENT_LENGTH, SHORT)
    cosines = np.sum(lines[:-1] * lines[1:], axis=1) / (lengths[:-1] * lengths[1:])
    _require(cosines.min(initial=1.0) >= math.cos(SHARPEST_TURN), TURN)
    return tuple(switching_rows)


def _off_line(tool: np.ndarray) -> np.ndarray:
    """Return the distances (P,) of positions from the straight line between first and last [m]."""
    if np.linalg.norm(tool[-1] - tool[0]) < MIN_SEGMENT_LENGTH:
        return np.linalg.norm(tool - tool[0], axis=1)
    return Tube(tool[[0, -1]], 1.0).distance(tool)[:, 0]


def _tube(
    rng: np.random.Generator,
    robot: RobotModel,
    walk: np.ndarray,
    switching_rows: tuple[int, ...],
    features: Features,
) -> Tube:
    rotation, tool = robot.tool_pose(walk)
    legs = [slice(a, b + 1) for a, b in pairwise(switching_rows)]
    needed = np.array([1.05 * _off_line(tool[leg]).max() + SMALL_MARGIN for leg in legs])
    _require(needed.max() <= MAX_RADIUS, CURVED)
    drawn = np.exp(rng.uniform(*np.log([MIN_RADIUS, MAX_RADIUS]), size=len(legs)))
    one_for_all = rng.random() < 0.5
    radius = np.maximum(needed, drawn)
    if one_for_all:
        radius = np.full(len(legs), max(needed.max(), drawn[0]))
    signs = _signs(rng, robot, walk, legs) if features.has_signs else None
    points = tool[list(switching_rows)]
    if not features.bounds_rotation:
        return Tube(points, radius, joint_signs=signs)
    orientations = Rotation.from_matrix(rotation[list(switching_rows)]).as_quat()
    free = Tube(points, radius, orientations=orientations, rotation_tolerance=3.0).rotation
    errors = [free.error(rotation[leg], tool[leg], k) for k, leg in enumerate(legs)]
    tolerance = _rotation_tolerance(rng, errors, is_planar=robot.joint_count == 2)
    return Tube(
        points, radius, joint_signs=signs, orientations=orientations, rotation_tolerance=tolerance
    )


def _rotation_tolerance(
    rng: np.random.Generator, errors: list[np.ndarray], *, is_planar: bool
) -> list[float | list[float]]:
    """Return bounds that rotation vectors (P, 3) per segment keep: angles, or components' bounds.

    Of three components one may be free. A planar arm turns its tool about z alone.
    """
    by_component = rng.random() < 0.5
    drawn = np.radians(rng.uniform(3, 30))
    free = rng.integers(0, 6)  # 3 to 5: none
    tolerance: list[float | list[float]] = []
    for error in errors:
        angle = np.linalg.norm(error, axis=1).max()
        _require(1.15 * angle <= MAX_TOLERANCE, TURNED)
        if not by_component:
            tolerance.append(float(max(drawn, 1.15 * angle + 0.01)))
            continue
        bounds = np.maximum(drawn, 1.15 * abs(error).max(axis=0) + 0.01).tolist()
        if is_planar:
            bounds[:2] = [math.inf, math.inf]
        elif free < 3:
            bounds[free] = math.inf
        tolerance.append(bounds)
    return tolerance


def _signs(
    rng: np.random.Generator, robot: RobotModel, walk: np.ndarray, legs: list[slice]
) -> list[dict[str, str]]:
    """Return per segment the signs of one or two joints, as far as they keep one in it."""
    joints = rng.permutation(robot.joint_count)[: int(rng.integers(1, 3))]
    maps = []
    for leg in legs:
        signs = {}
        for joint in joints:
            column = walk[leg, joint]
            if abs(column).min() > LIMIT_MARGIN and len(set(np.sign(column))) == 1:
                signs[robot.joint_names[joint]] = "+" if column[0] > 0 else "-"
        maps.append(signs)
    return maps


def _obstacle_beside(
    rng: np.random.Generator, robot: RobotModel, walk: np.ndarray, name: str
) -> Obstacle:
    """Return a solid that some link of the walk passes at 2 to 10 cm and none nearer.

    Raises:
        Rejected: None was found.
    """
    bare = CollisionChecker(robot, self_collision=False)
    moving = [body_shape for body_shape in bare.shapes if body_shape.body > 0]
    for _ in range(MAX_DRAWS):
        row, link = int(rng.integers(len(walk))), moving[int(rng.integers(len(moving)))]
        rotation, position = robot.body_poses(walk[row : row + 1])
        centre = rotation[0, link.body] @ link.shape.center + position[0, link.body]
        direction = rng.normal(size=3)
        if robot.joint_count == 2:  # a planar arm: beside it, not above
            direction[2] = 0.0
        direction /= np.linalg.norm(direction)
        make = _random_solid(rng, name)
        gap = rng.uniform(0.02, 0.10)
        away = link.shape.bounding_radius + gap
        for _ in range(5):
            solid = make(centre + away * direction)
            distance = _least_distance(robot, solid, walk)
            if 0.02 <= distance <= 0.10:
                return solid
            away += gap - distance
    raise Rejected(CROWDED)


def _random_solid(rng: np.random.Generator, name: str) -> Callable[[np.ndarray], Obstacle]:
    """Return what makes a solid of random kind, size and rotation at a position (3,)."""
    kind = ("box", "sphere", "cylinder")[int(rng.integers(3))]
    turn = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    sizes = {
        "box": [rng.uniform(0.04, 0.3, 3).tolist()],
        "sphere": [rng.uniform(0.03, 0.12)],
        "cylinder": [rng.uniform(0.02, 0.06), rng.uniform(0.1, 0.6)],
    }[kind]

    def at(position: np.ndarray) -> Obstacle:
        placement = np.eye(4)
        placement[:3, :3], placement[:3, 3] = turn, position
        return getattr(Obstacle, kind)(f"{kind} {name}", *sizes, placement)

    return at


def _least_distance(robot: RobotModel, solid: Obstacle, walk: np.ndarray) -> float:
    checker = CollisionChecker(robot, (solid,), self_collision=False)
    rotation, position = robot.body_poses(walk)
    least = np.inf
    for k, near in enumerate(checker.sphere_distances(rotation, position, checker.obstacle_pairs)):
        pairs = checker.obstacle_pairs[near < least]
        if len(pairs):
            least = min(least, float(checker.distances(rotation[k], position[k], pairs).min()))
    return least
