"""Problem files with a witness: a tube around the tool path of a trajectory known to solve them.

Limits, motors, loads, boxes, speeds and concave solids come now and then.
"""

import math
from collections import Counter
from copy import deepcopy
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from campaign_holding import random_holding
from campaign_witness import (
    MAX_RADIUS,
    RADIUS_FACTOR,
    ROWS,
    Unsuitable,
    Witness,
    random_arm,
    random_witness,
    without_efforts,
)
from outside.arm import Arm, placed, solid_geometry
from outside.distances import Poses, least_margin
from outside.files import BUNDLED, BadInput
from outside.problem import Problem, read_distances
from outside.tube import rotation_error, tool_rate
from outside.tube_fields import OF_TOOL, TubeFields
from outside_judge import Judge, passes

MAX_ATTEMPTS = 60
MIN_MARGIN = 0.002  # [m] that the witness keeps beyond what is asked
SIGN_MARGIN = 1e-3  # [rad, m]
MAX_TURN = math.radians(150)  # of the reference orientation along a segment
MAX_OBSTACLES, MAX_DRAWS, MAX_SHIFTS = 4, 12, 4
HOLDING_FRACTION = 0.25
MOTOR_FRACTION, ATTACHED_FRACTION, BOX_FRACTION, SPEED_FRACTION = 0.2, 0.12, 0.2, 0.2
CONCAVE = "groove.stl"
PER_SEGMENT = ("points", "radius", "joint_signs", "orientations", "rotation_tolerance")
PER_SEGMENT += ("cross_section", *OF_TOOL)
PART = BUNDLED / "ur5" / "part.stl"
JERK, ACCELERATION = (20.0, 2000.0), (2.0, 30.0)  # [rad/s^3 or m/s^3], [rad/s^2 or m/s^2]
FASTER = (1.3, 30.0)  # limits on the tool's speed and acceleration, in the witness's
_GROOVE = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
_GROOVE_FACES = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]])
# Shares of the effort limit that friction takes, viscous at the velocity limit; of the effort limit
# at twenty times the velocity limit per second, what rotors take.
VISCOUS, COULOMB, ARMATURE = 0.3, 0.2, 1.0
SPEED, RATE = 3.0, 20.0  # [rad/s or m/s] where there is no velocity limit; [1/s]
STALL, NO_LOAD = (0.8, 2.0), (1.0, 2.5)  # in effort and velocity limits
MIN_SIDE = 0.6  # of the effort limit


@dataclass(frozen=True, eq=False)
class Built:
    """A problem file with a witness.

    Attributes:
        path: The file.
        fields: What it holds.
        arm: Which arm, in words.
        judge: For its trajectories.
        witness: What solves it.
        kinds: What it has, for counting.
    """

    path: Path
    fields: dict[str, Any]
    arm: str
    judge: Judge
    witness: Witness
    kinds: tuple[str, ...]


def build(
    seed: int,
    folder: Path,
    *,
    motors: bool = False,
    robot: dict[str, Any] | None = None,
    holds: bool = True,
) -> Built:
    """Write the problem of a seed into a folder; always the same.

    Draws that cannot become a problem are replaced by further ones of the same seed.

    Args:
        seed: Of the problem.
        folder: Where to write.
        motors: Whether its arm has random motors.
        robot: The section `robot` of the arm, if it is not drawn too.
        holds: Whether some tools hold a part.

    Raises:
        Unsuitable: None became one; the message counts the reasons.
    """
    reasons: Counter[str] = Counter()
    for attempt in range(MAX_ATTEMPTS):
        try:
            rng = np.random.default_rng([seed, attempt])
            return _attempt(rng, folder, motors, robot, holds)
        except (Unsuitable, BadInput) as reason:
            reasons[str(reason)[:100]] += 1
    counted = "; ".join(f"{count} x {reason}" for reason, count in reasons.most_common(4))
    raise Unsuitable(f"no problem in {MAX_ATTEMPTS} draws: {counted}")


def write(fields: dict[str, Any], path: Path) -> None:
    """Write a problem file."""
    path.write_text(yaml.safe_dump(fields, sort_keys=False, default_flow_style=None, width=140))


def two_moves(built: Built) -> Path:
    """Write the cycle that goes through a problem's tube and back; return its path."""
    path = built.path.with_name("cycle.yaml")
    write(there_and_back(built.fields, reversed_problem(built.fields)), path)
    return path


def reversed_problem(fields: dict[str, Any]) -> dict[str, Any]:
    """Return a problem the other way round.

    A trajectory run backwards needs the same efforts, unless there is friction.
    """
    tube = {
        key: value[::-1] if key in PER_SEGMENT and isinstance(value, list) else value
        for key, value in fields["tube"].items()
    }
    return fields | {"tube": tube, "start": fields["goal"], "goal": fields["start"]}


def vary_limits(rng: np.random.Generator, robot: dict[str, Any], arm: Arm) -> None:
    """Limit jerks, and accelerations where nothing limits them, in place."""
    limits = robot.setdefault("limits", {})
    for quantity, bounds in (("jerk", JERK), ("acceleration", ACCELERATION)):
        if quantity not in limits and rng.random() < 0.25:
            drawn = np.exp(rng.uniform(*np.log(bounds), len(arm.joint_names)))
            limits[quantity] = dict(zip(arm.joint_names, drawn.tolist(), strict=True))


def attach_solid(rng: np.random.Generator, robot: dict[str, Any]) -> None:
    """Let the tool carry a solid that may touch the link that it is fixed to, in place."""
    size = float(rng.uniform(0.02, 0.12))
    shapes: list[dict[str, Any]] = [{"box": [size, size, 2 * size]}, {"sphere": size}]
    shape = shapes[int(rng.integers(len(shapes)))]
    away = rng.normal(size=3)
    position = (1.5 * size * away / np.linalg.norm(away)).tolist()
    solid = {"name": "carried", **shape, "position": position}
    robot["attached"] = [solid | {"touch_links": [robot["tool_frame"]]}]


def with_boxes(rng: np.random.Generator, tube: dict[str, Any], witness: Witness) -> dict[str, Any]:
    """Return a tube some of whose segments have a box, as wide and high as drawn."""
    sections: list[Any] = []
    radii: list[float | None] = []
    spans = np.diff(witness.points, axis=0)
    for k, (radius, span) in enumerate(zip(tube["radius"], spans, strict=True)):
        if rng.random() < 0.5:
            sections.append(None)
            radii.append(radius)
            continue
        least = RADIUS_FACTOR * witness.needed[k]
        sides = np.maximum(least, witness.scale * rng.uniform(0.3, 1.5, 2))
        up = np.cross(span / np.linalg.norm(span), rng.normal(size=3))
        box = (2 * np.minimum(sides, MAX_RADIUS)).tolist()
        sections.append({"box": box, "up": (up / np.linalg.norm(up)).tolist()})
        radii.append(None)
    return tube | {"radius": radii, "cross_section": sections}


def tool_limits(
    rng: np.random.Generator, arm: Arm, witness: Witness, name: str
) -> list[float | None]:
    """Return limits on the tool's speed or acceleration in some segments, above the witness's."""
    if name == "tool_speed":
        step = witness.trajectory.duration / (ROWS - 1)
        speed = np.linalg.norm(np.diff(arm.tool(witness.q)[1], axis=0), axis=1) / step
    else:
        speed = tool_rate(arm, witness.trajectory, witness.trajectory.samples(ROWS), name)
    limits: list[float | None] = []
    for a, b in pairwise(witness.gates):
        # Where parts of the tube overlap, the witness may be in either.
        fastest = speed[max(a - 20, 0) : b + 20].max()
        factor = float(np.exp(rng.uniform(*np.log(FASTER))))
        limits.append(float(factor * fastest) if rng.random() < 0.6 else None)
    return limits


def write_concave_mesh(path: Path) -> None:
    """Write a block with a groove, as binary STL: 3 m wide and high, 2 m deep about its middle."""
    flat = _GROOVE - 1.5
    corners = np.vstack([np.column_stack([flat, np.full(8, z)]) for z in (-1.0, 1.0)])
    walls = [(k, (k + 1) % 8) for k in range(8)]
    sides = [face for a, b in walls for face in ((a, b, b + 8), (a, b + 8, a + 8))]
    triangles = corners[np.vstack([_GROOVE_FACES[:, ::-1], _GROOVE_FACES + 8, np.array(sides)])]
    record = np.zeros(len(triangles), dtype=[("normal", "<3f4"), ("at", "<9f4"), ("end", "<u2")])
    record["at"] = triangles.reshape(-1, 9)
    path.write_bytes(bytes(80) + np.uint32(len(triangles)).tobytes() + record.tobytes())


def there_and_back(fields: dict[str, Any], backwards: dict[str, Any]) -> dict[str, Any]:
    """Return a cycle of two moves: a problem with a given goal, and the same the other way round.

    Args:
        fields: The problem.
        backwards: The problem the other way round.
    """
    shared = ("robot", "start", "obstacles", "clearance")
    header = {key: fields[key] for key in shared if key in fields}
    held = {key: fields[key] for key in ("holding",) if key in fields}
    moves = [
        {"name": "there", "tube": fields["tube"], "goal": fields["goal"], **held},
        {"name": "back", "tube": backwards["tube"], "goal": backwards["goal"], **held},
    ]
    return {"format": "tubeplanner/cycle", **header, "moves": moves}


def vary_motors(rng: np.random.Generator, robot: dict[str, Any], arm: Arm) -> None:
    """Give the section `robot` of a problem motors, and effort limits that differ, in place.

    Joints without a limit on the effort get friction in multiples of 1 N m or N.
    """
    effort, velocity = arm.limits.effort, arm.limits.velocity
    effort = np.where(np.isfinite(effort), effort, 1.0)
    velocity = np.where(np.isfinite(velocity), velocity, SPEED)
    most = {
        "armature": ARMATURE * effort / (RATE * velocity),
        "viscous_friction": VISCOUS * effort / velocity,
        "coulomb_friction": COULOMB * effort,
    }
    motors: dict[str, Any] = {}
    for quantity, largest in most.items():
        if rng.random() < 0.7:
            chosen = [largest * rng.random(len(largest)) for _ in range(2)]
            motors[quantity] = {
                name: _either(rng, quantity == "coulomb_friction", *pair)
                for name, *pair in zip(arm.joint_names, *chosen, strict=True)
                if rng.random() < 0.8
            }
    if rng.random() < 0.4:
        with_line = [k for k in range(len(effort)) if rng.random() < 0.7]
        names = [arm.joint_names[k] for k in with_line]
        stall = effort[with_line] * rng.uniform(*STALL, len(names))
        no_load = velocity[with_line] * rng.uniform(*NO_LOAD, len(names))
        motors["saturation_effort"] = dict(zip(names, stall.tolist(), strict=True))
        motors["no_load_velocity"] = dict(zip(names, no_load.tolist(), strict=True))
    if rng.random() < 0.3:
        motors["friction_uncertainty"] = float(rng.uniform(0.0, 0.4))
    robot["motors"] = motors
    _vary_efforts(rng, robot, arm)


def _attempt(
    rng: np.random.Generator,
    folder: Path,
    motors: bool,
    chosen: dict[str, Any] | None,
    holds: bool,
) -> Built:
    if chosen is None:
        name, robot = random_arm(rng, folder)
    else:
        name, robot = str(chosen["urdf"]).removeprefix("example:"), deepcopy(chosen)
    _vary_robot(rng, robot, name)
    arm = _arm(robot, folder)
    vary_limits(rng, robot, arm)
    if rng.random() < MOTOR_FRACTION or motors:
        vary_motors(rng.spawn(1)[0], robot, arm)
    arm = _arm(robot, folder)
    witness = random_witness(rng, arm)
    tube = _tube(rng, arm, witness)
    fields: dict[str, Any] = {"robot": robot, "tube": tube}
    fields["start"] = {"joints": witness.q[0].tolist()}
    if rng.random() < 0.6:
        fields["goal"] = {"joints": witness.q[-1].tolist()}
    clearance = float(rng.choice([0.0, 0.0, 0.005, 0.01]))
    if rng.random() < 0.5:
        count = int(rng.integers(1, MAX_OBSTACLES + 1))
        poses = Poses(*arm.poses(witness.q[::10]))
        write_concave_mesh(folder / CONCAVE)
        drawn = (arm, poses, clearance, folder)
        solids = [_obstacle(rng, *drawn, f"o{k}") for k in range(count)]
        fields["obstacles"] = [solid for solid in solids if solid is not None]
        fields["clearance"] = clearance
    own = rng.spawn(1)[0]
    if holds and own.random() < HOLDING_FRACTION:
        holding = random_holding(own, robot, arm, witness)
        fields |= {} if holding is None else {"holding": holding}
    path = folder / "problem.yaml"
    write(fields, path)
    judge = Judge(path)
    _require_solved(judge, witness)
    return Built(path, fields, name, judge, witness, _kinds(fields, arm))


def _kinds(fields: dict[str, Any], arm: Arm) -> tuple[str, ...]:
    """Return what a problem has of that which not all have."""
    robot, tube = fields["robot"], fields["tube"]
    meshes = [one["mesh"] for one in fields.get("obstacles", []) if "mesh" in one]
    has = {
        "sliding joints": bool(arm.slides.any()),
        "motors": "motors" in robot,
        "payload": "payload" in robot,
        "attached": "attached" in robot,
        "jerk limits": "jerk" in robot.get("limits", {}),
        "obstacles": bool(fields.get("obstacles")),
        "concave mesh": CONCAVE in meshes,
        "rotation": "orientations" in tube,
        "signs": any(tube.get("joint_signs", [])),
        "boxes": "cross_section" in tube,
        "tool speeds": "tool_speed" in tube,
        "tool accelerations": "tool_acceleration" in tube,
        "open goal": "goal" not in fields,
        **{f"held by a {kind}": True for kind in fields.get("holding", {}) if kind != "part"},
    }
    return tuple(name for name, value in has.items() if value)


def _require_solved(judge: Judge, witness: Witness) -> None:
    """Raise unless the witness keeps all that the file asks, links and obstacles something more."""
    found = judge.judge(witness.trajectory)
    if not passes(found, 1e-9):
        broken = [name for name, one in found.items() if not one.holds(1e-9)]
        raise Unsuitable(f"the witness breaks {', '.join(broken)}")
    for name in ("obstacles", "self_collision"):
        margin = found[name].margin
        if margin is not None and margin < MIN_MARGIN:
            raise Unsuitable(f"the witness comes within 2 mm of breaking {name}")


def _vary_robot(rng: np.random.Generator, robot: dict[str, Any], name: str) -> None:
    if rng.random() < 0.3:
        offset = {"position": rng.uniform(-0.1, 0.1, 3).tolist()}
        robot["tool_offset"] = offset | {"rpy": rng.uniform(-3, 3, 3).tolist()}
    if rng.random() < 0.2 and name != "two_link":
        direction = rng.normal(size=3)
        robot["gravity"] = (9.81 * direction / np.linalg.norm(direction)).tolist()
    if rng.random() < 0.15:
        robot["payload"] = {"mass": float(rng.uniform(0.05, 0.5)), "com": [0.0, 0.0, 0.05]}
    if rng.random() < ATTACHED_FRACTION:
        attach_solid(rng, robot)
    if rng.random() < 0.2:
        scale = {"velocity": float(rng.uniform(0.3, 1.0)), "effort": float(rng.uniform(0.8, 1.0))}
        robot.setdefault("limits", {})["scale"] = scale


def _arm(robot: dict[str, Any], folder: Path) -> Arm:
    """Return the arm of a section `robot`, whose limits are completed.

    Raises:
        Unsuitable: It has no masses and cannot do without.
    """
    free = np.full(1, np.inf)
    ranges: list[dict[str, tuple[float, float]]] = [{}]
    point = TubeFields(
        np.zeros((2, 3)), np.ones(1), ranges, None, None, free, np.zeros(1), True, [], [0, 1]
    )
    problem = Problem(folder, robot, point, {}, {}, [], read_distances(0.0, [], 1), True, [])
    arm = Arm(problem)
    if not arm.has_masses:
        without_efforts(robot, arm.joint_names)
        arm = Arm(problem)
    return arm


def _tube(rng: np.random.Generator, arm: Arm, witness: Witness) -> dict[str, Any]:
    """Return the section `tube`: as narrow as drawn, with what the witness keeps."""
    count = len(witness.needed)
    if rng.random() < 0.5:
        drawn = np.full(count, witness.scale)
    else:
        drawn = np.maximum(
            RADIUS_FACTOR * witness.needed, witness.scale * rng.uniform(0.3, 1.0, count)
        )
    radius = np.minimum(drawn, MAX_RADIUS)
    tube: dict[str, Any] = {"points": witness.points.tolist(), "radius": radius.tolist()}
    spans = list(pairwise(witness.gates))
    if rng.random() < 0.4:
        tube["joint_signs"] = [_signs(rng, arm, witness.q[a : b + 1]) for a, b in spans]
    if rng.random() < 0.25:
        tube |= _rotation(rng, arm, witness, spans)
    if rng.random() < BOX_FRACTION:
        tube = with_boxes(rng, tube, witness)
    if rng.random() < SPEED_FRACTION:
        tube["tool_speed"] = tool_limits(rng, arm, witness, "tool_speed")
    own = np.random.Generator(rng.bit_generator.jumped())  # what is drawn elsewhere stays as it is
    if own.random() < SPEED_FRACTION:
        tube["tool_acceleration"] = tool_limits(own, arm, witness, "tool_acceleration")
    return tube


def _signs(rng: np.random.Generator, arm: Arm, q: np.ndarray) -> dict[str, Any]:
    """Return signs of some joints where the witness (N, n) keeps them, and a range now and then."""
    signs: dict[str, Any] = {}
    for name, column in zip(arm.joint_names, q.T, strict=True):
        low, high = float(column.min()), float(column.max())
        draw = rng.random()
        if draw < 0.3 and max(low, -high) > SIGN_MARGIN:
            signs[name] = "+" if low > 0 else "-"
        elif draw > 0.9:
            wider = float(rng.uniform(0.01, 0.5))
            signs[name] = [low - wider, high + wider]
    return signs


def _rotation(
    rng: np.random.Generator, arm: Arm, witness: Witness, spans: list[tuple[int, int]]
) -> dict[str, Any]:
    """Return orientations and tolerances that the witness keeps, or nothing if it turns too far."""
    rotation, position = arm.tool(witness.q)
    gates = rotation[witness.gates]
    turns = Rotation.from_matrix(gates[:-1]).inv() * Rotation.from_matrix(gates[1:])
    if turns.magnitude().max() > MAX_TURN:
        return {}
    orientations = Rotation.from_matrix(gates).as_quat()
    ranges: list[dict[str, tuple[float, float]]] = [{}] * len(spans)
    numbers = list(range(len(witness.points)))
    free = np.full(len(witness.needed), np.inf)
    distances = np.zeros(len(witness.needed))
    known = (witness.points, witness.needed, ranges, orientations, None, free, distances)
    tube = TubeFields(*known, True, [], numbers)
    least, by_component = float(rng.uniform(0.01, 0.5)), rng.random() < 0.5
    bounds: list[Any] = []
    for k, (a, b) in enumerate(spans):
        error = rotation_error(tube, rotation[a : b + 1], position[a : b + 1], k)
        if by_component:
            bounds.append(
                np.maximum(least, RADIUS_FACTOR * abs(error).max(axis=0) + 0.005).tolist()
            )
        else:
            angle = float(np.linalg.norm(error, axis=1).max())
            bounds.append(max(least, RADIUS_FACTOR * angle + 0.005))
    return {"orientations": orientations.tolist(), "rotation_tolerance": bounds}


def _obstacle(
    rng: np.random.Generator, arm: Arm, poses: Poses, clearance: float, folder: Path, name: str
) -> dict[str, Any] | None:
    """Return a solid beside a link of the witness, clear of all true meshes; None if none is."""
    moving = [solid for solid in arm.solids if arm.moved_by[solid.joint].any()]
    if not moving:
        return None
    for _ in range(MAX_DRAWS):
        solid, row = moving[int(rng.integers(len(moving)))], int(rng.integers(len(poses.position)))
        rotation, origin = poses.rotation[row, solid.joint], poses.position[row, solid.joint]
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        gap = float(np.exp(rng.uniform(*np.log([0.005, 0.2]))))
        fields = _random_solid(rng, name)
        away = gap + solid.radius
        for _ in range(MAX_SHIFTS):
            centre = origin + rotation @ solid.centre + away * direction
            fields["position"] = centre.tolist()
            distance = _distance(moving, poses, fields, folder)
            if distance >= clearance + 2 * MIN_MARGIN:
                return fields
            away += max(gap, -distance)
    return None


def _random_solid(rng: np.random.Generator, name: str) -> dict[str, Any]:
    size = float(np.exp(rng.uniform(*np.log([0.01, 0.2]))))
    kind = str(rng.choice(["box", "sphere", "cylinder", "capsule", "mesh", "groove"]))
    sizes: dict[str, Any] = {
        "box": {"box": (2 * size * rng.uniform(0.1, 1, 3)).tolist()},
        "sphere": {"sphere": size},
        "cylinder": {"cylinder": [size / 2, 3 * size]},
        "capsule": {"capsule": [size / 2, 2 * size]},
        "mesh": {"mesh": str(PART), "scale": float(rng.uniform(0.3, 1.5))},
        "groove": {"mesh": CONCAVE, "scale": 0.6 * size},
    }
    return {"name": name, **sizes[kind], "rpy": rng.uniform(-3, 3, 3).tolist()}


def _distance(moving: list[Any], poses: Poses, fields: dict[str, Any], folder: Path) -> float:
    geometry, placement = solid_geometry(fields, folder, [])
    obstacle = placed(fields["name"], "obstacle", 0, placement, geometry)
    return least_margin([(solid, obstacle) for solid in moving], poses, 0.0)[0].margin


def _either(
    rng: np.random.Generator, may_differ: bool, one: float, other: float
) -> float | list[float]:
    """Return a number, or two for both directions."""
    return [float(one), float(other)] if may_differ and rng.random() < 0.5 else float(one)


def _vary_efforts(rng: np.random.Generator, robot: dict[str, Any], arm: Arm) -> None:
    """Make the efforts of some joints differ by direction, or with the position, in place."""
    scale = robot.get("limits", {}).get("scale", {}).get("effort", 1.0)
    limits = robot.setdefault("limits", {})
    given = limits.setdefault("effort", {})
    for name, most in zip(arm.joint_names, arm.limits.effort, strict=True):
        draw = rng.random()
        if not np.isfinite(most) or draw > 0.4:
            continue
        own = most / scale * rng.uniform(MIN_SIDE, 1.0, 4)
        if draw < 0.2:
            given[name] = own[:2].tolist()
        else:
            position = np.sort(rng.uniform(-2.0, 2.0, 4)) + 0.01 * np.arange(4)
            given[name] = {"position": position.tolist(), "effort": own.tolist()}
