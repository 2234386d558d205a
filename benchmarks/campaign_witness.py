"""A random arm, and a slow smooth trajectory of it whose tool keeps to a tube of a drawn width.

The arm is a bundled one, any chain of example-robot-data or a random chain. The trajectory is a
spline of degree five through random configurations, at rest at both ends; some go back some of
their way. It is made smaller until its tool path strays no farther from the reference points' lines
than the drawn radius, and slower until no limit is near.
"""

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from itertools import pairwise
from math import factorial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PPoly, make_interp_spline

from outside.arm import Arm
from outside.conditions import judge_limits
from outside.files import Description, Joint, data_share, data_urdfs, read_description
from outside.trajectory import Trajectory
from outside.tube import distance

BUNDLED = {
    "two_link": "hand",
    "ur5": "tool0",
    "ur10": "tool0",
    "panda": "panda_hand_tcp",
    "xarm7": "link_eef",
}
FRACTIONS = {"bundled": 0.35, "data": 0.45, "chain": 0.2}
MIN_JOINTS, MAX_JOINTS = 1, 10
BRANCH_FRACTION = 0.4  # of a random chain's links that carry something beside it
SLIDING_FRACTION = 0.35  # of a random chain's joints
# Where a URDF has no limit, or none that makes sense.
TRAVEL = {"prismatic": [-0.4, 0.4], "revolute": [-2.8, 2.8], "continuous": [-math.inf, math.inf]}
_ROUNDING = 1e-3  # fraction of a principal moment that may be negative
SPEED, ACCELERATION = 2.0, 20.0  # [rad/s, m/s], [rad/s^2, m/s^2]
MIN_RADIUS, MAX_RADIUS = 5e-4, 0.3  # [m]
MAX_SEGMENTS = 199
MIN_LENGTH = 3e-4  # [m] of a segment
RADIUS_FACTOR = 1.2  # of the radius to what the witness needs
ROWS = 4001  # of the tool path that is looked at
LIMIT_MARGIN = 0.02  # [rad, m] that the walk begins away from position limits
FRACTION = 0.1  # of each limit that the witness leaves, at least
MAX_SMALLER, MAX_SLOWER = 40, 14


class Unsuitable(Exception):
    """A draw cannot become a problem; the message says why."""


def random_arm(rng: np.random.Generator, folder: Path) -> tuple[str, dict[str, Any]]:
    """Return a name and the section `robot` of a problem file; efforts may still be missing.

    Args:
        rng: Random numbers.
        folder: Where the URDF of a random chain is written.

    Raises:
        Unsuitable: The robot drawn has no chain that can be planned for.
    """
    kind = rng.choice(list(FRACTIONS), p=list(FRACTIONS.values()))
    if kind == "bundled":
        name = str(rng.choice(list(BUNDLED)))
        return name, bundled_arm(name)
    if kind == "chain":
        (folder / "chain.urdf").write_text(random_chain(rng))
        return "chain", {"urdf": "chain.urdf", "tool_frame": "tip"}
    paths = data_urdfs()
    path = paths[int(rng.integers(len(paths)))]
    if not _has_real_masses(path):
        raise Unsuitable(f"{path.name}: the masses of a link are none of a body")
    description = read_description(path, [])
    tool, joints = _random_tool(rng, description)
    limits = _missing_limits({name: description.joints[name] for name in joints})
    name = f"package://{path.relative_to(data_share())}"
    return f"{path.stem}/{tool}", {"urdf": name, "tool_frame": tool, "limits": limits}


def bundled_arm(name: str) -> dict[str, Any]:
    """Return the section `robot` of a bundled arm."""
    robot: dict[str, Any] = {"urdf": f"example:{name}", "tool_frame": BUNDLED[name]}
    if name == "two_link":  # made for the plane
        unlimited = dict.fromkeys(("joint1", "joint2"), math.inf)
        robot |= {"gravity": [0, 0, 0], "limits": {"velocity": unlimited}}
    return robot


def without_efforts(robot: dict[str, Any], joints: list[str]) -> None:
    """Limit an arm's accelerations instead of its efforts, as where a URDF has no masses."""
    limits = robot.setdefault("limits", {})
    limits["effort"] = dict.fromkeys(joints, math.inf)
    limits["acceleration"] = dict.fromkeys(joints, ACCELERATION)


@dataclass(frozen=True, eq=False)
class Witness:
    """A trajectory that solves a problem, and the tube's reference points on its tool path.

    Attributes:
        trajectory: Slow enough for all limits.
        q: Configurations along it, shape (ROWS, n).
        gates: Rows of `q` at which the tool is at the reference points, shape (m+1,).
        points: Reference points, shape (m+1, 3) [m].
        needed: How far the tool strays from each segment, shape (m,) [m].
        scale: The radius that was drawn [m].
    """

    trajectory: Trajectory
    q: np.ndarray
    gates: np.ndarray
    points: np.ndarray
    needed: np.ndarray
    scale: float


def random_witness(rng: np.random.Generator, arm: Arm) -> Witness:
    """Return a random witness.

    Raises:
        Unsuitable: The walk leaves the limits, its tool hardly moves, or the arm cannot be held.
    """
    scale = float(np.exp(rng.uniform(*np.log([MIN_RADIUS, MAX_RADIUS]))))
    segments = round(float(np.exp(rng.uniform(0, np.log(MAX_SEGMENTS)))))
    knots = _walk(rng, arm, steps=int(rng.integers(2, 7)))
    turn = None
    if rng.random() < 0.2:  # it goes back some of its way
        turn = len(knots) - 1
        knots = np.vstack([knots, knots[-2::-1][: int(rng.integers(1, len(knots)))]])
    fractions = _fractions(rng, segments)
    for _ in range(MAX_SMALLER):
        spline = _spline(knots)
        q = spline(np.linspace(0, 1, ROWS))
        position = arm.tool(q)[1]
        row = None if turn is None else round(turn / (len(knots) - 1) * (ROWS - 1))
        gates = _gates(position, fractions, row)
        points = position[gates]
        spans = pairwise(gates)
        off = [distance(points, position[a : b + 1], k).max() for k, (a, b) in enumerate(spans)]
        if np.linalg.norm(np.diff(points, axis=0), axis=1).min() < MIN_LENGTH:
            if len(fractions) == 2:
                raise Unsuitable("the tool hardly moves")
            fractions = np.append(fractions[:-1:2], 1.0)
        elif RADIUS_FACTOR * max(off) <= scale:
            inside = np.minimum(q - arm.limits.lower, arm.limits.upper - q).min()
            if inside < LIMIT_MARGIN / 4:
                raise Unsuitable("the walk leaves the position limits")
            trajectory = _slow(arm, spline)
            return Witness(trajectory, q, gates, points, np.array(off), scale)
        else:
            knots = knots[0] + 0.7 * (knots - knots[0])
    raise Unsuitable("the tool path does not become straight enough")


def _has_real_masses(path: Path) -> bool:
    """Return whether no inertia of a URDF has a negative principal moment: none can be loaded."""
    for given in ElementTree.parse(path).iter("inertia"):
        xx, xy, xz, yy, yz, zz = (
            float(given.get(name, 0)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if moments[0] < -_ROUNDING * moments[-1]:
            return False
    return True


def _random_tool(rng: np.random.Generator, description: Description) -> tuple[str, list[str]]:
    """Return a link that a chain of joints moves, none of which mimics or leads another."""
    coupled = {name for name, joint in description.joints.items() if joint.mimic is not None}
    coupled |= {joint.mimic[0] for joint in description.joints.values() if joint.mimic is not None}
    chains = {link: description.chain(link) for link in description.parents}
    fit = [
        link
        for link, chain in chains.items()
        if MIN_JOINTS <= len(chain) <= MAX_JOINTS and not coupled & set(chain)
    ]
    if not fit:
        raise Unsuitable("no link is moved by one to ten joints")
    tool = fit[int(rng.integers(len(fit)))]
    return tool, chains[tool]


def _missing_limits(joints: dict[str, Joint]) -> dict[str, dict[str, Any]]:
    """Return what a URDF does not say, or says without sense, of its joints' limits."""
    limits: dict[str, dict[str, Any]] = {"velocity": {}, "effort": {}, "position": {}}
    for name, joint in joints.items():
        if not joint.lower < joint.upper:
            limits["position"][name] = TRAVEL[joint.kind]
        if joint.velocity is None or not 0 < joint.velocity < math.inf:
            limits["velocity"][name] = SPEED
        if joint.effort is None or not 0 < joint.effort < math.inf:
            limits["effort"][name] = math.inf
            limits.setdefault("acceleration", {})[name] = ACCELERATION
    return {quantity: values for quantity, values in limits.items() if values}


def random_chain(rng: np.random.Generator) -> str:
    """Return the URDF of one to ten links, of boxes, cylinders and spheres, with side branches."""
    count = int(rng.integers(MIN_JOINTS, MAX_JOINTS + 1))
    parts = ['<robot name="chain"><link name="link0"/>']
    reach = 0.0
    for k in range(1, count + 1):
        length = float(rng.uniform(0.1, 0.4))
        parts.append(_link(rng, f"link{k}", length, mass=float(rng.uniform(0.5, 6.0)) / k))
        parts.append(_joint(rng, k, reach, count))
        if rng.random() < BRANCH_FRACTION:
            parts.append(_branch(rng, k, length))
        reach = length
    parts.append('<link name="tip"/><joint name="tip_joint" type="fixed">')
    parts.append(f'<parent link="link{count}"/><child link="tip"/><origin xyz="{reach} 0 0"/>')
    return "\n".join([*parts, "</joint></robot>"])


def _branch(rng: np.random.Generator, k: int, length: float) -> str:
    """Return a link beside the chain, fixed or on a joint of its own that nothing moves."""
    size = float(rng.uniform(0.02, 0.08))
    along, turn = float(rng.uniform(0.3, 0.7)) * length, float(rng.uniform(-3.0, 3.0))
    kind = "fixed" if rng.random() < 0.5 else "revolute"
    return (
        _link(rng, f"branch{k}", size, mass=0.3)
        + f'<joint name="branch_joint{k}" type="{kind}"><parent link="link{k}"/>'
        f'<child link="branch{k}"/><origin xyz="{along} 0 0.05" rpy="{turn} -1.2 0"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="10" velocity="2"/></joint>'
    )


def _link(rng: np.random.Generator, name: str, length: float, mass: float) -> str:
    width = float(rng.uniform(0.02, 0.06))
    shape = rng.choice(
        [
            f'<box size="{0.6 * length} {width} {width}"/>',
            f'<cylinder radius="{width / 2}" length="{0.6 * length}"/>',
            f'<sphere radius="{width}"/>',
        ]
    )
    across, along = mass * width**2 / 3, mass * length**2 / 12
    inertia = f'ixx="{across}" iyy="{along}" izz="{along}" ixy="0" ixz="0" iyz="0"'
    origin = f'<origin xyz="{length / 2} 0 0" rpy="0 1.5707963267948966 0"/>'
    if shape.startswith("<box"):
        origin = f'<origin xyz="{length / 2} 0 0"/>'
    return (
        f'<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/>'
        f"<inertia {inertia}/></inertial><collision>{origin}<geometry>{shape}</geometry>"
        "</collision></link>"
    )


def _joint(rng: np.random.Generator, k: int, reach: float, count: int) -> str:
    slides = rng.random() < SLIDING_FRACTION
    axis = "1 0 0" if slides and rng.random() < 0.5 else str(rng.choice(["0 0 1", "0 1 0"]))
    lower, upper = (-0.25, 0.25) if slides else (-2.6, 2.6)
    effort = float(rng.uniform(150, 400)) / k + 60 * (count - k)
    turn = float(rng.uniform(-math.pi / 2, math.pi / 2))
    return (
        f'<joint name="joint{k}" type="{"prismatic" if slides else "revolute"}">'
        f'<parent link="link{k - 1}"/><child link="link{k}"/>'
        f'<origin xyz="{reach} 0 0" rpy="{turn} 0 0"/><axis xyz="{axis}"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="2.5"/></joint>'
    )


def _walk(rng: np.random.Generator, arm: Arm, steps: int) -> np.ndarray:
    lower, upper = arm.limits.lower + LIMIT_MARGIN, arm.limits.upper - LIMIT_MARGIN
    if not (lower < upper).all():
        raise Unsuitable("a joint can hardly move between its position limits")
    knots = [np.clip(arm.random(rng, 1)[0], lower, upper)]
    longest = rng.uniform(0.3, 1.2) * np.where(arm.slides, 0.3, 1.0)
    for _ in range(steps):
        step = rng.uniform(-longest, longest)
        knots.append(np.clip(knots[-1] + step, lower, upper))
    return np.array(knots)


def _spline(knots: np.ndarray) -> PPoly:
    """Return the spline through configurations (K, n), over 0 to 1."""
    rest = [(1, np.zeros(knots.shape[1])), (2, np.zeros(knots.shape[1]))]
    spline = make_interp_spline(np.linspace(0, 1, len(knots)), knots, k=5, bc_type=(rest, rest))
    at = np.unique(spline.t)
    orders = range(spline.k, -1, -1)
    return PPoly(np.array([spline(at[:-1], nu=k) / factorial(k) for k in orders]), at)


def _fractions(rng: np.random.Generator, segments: int) -> np.ndarray:
    """Return the arc lengths of reference points as shares of the whole, equal parts or not."""
    if rng.random() < 0.7:
        return np.linspace(0, 1, segments + 1)
    parts = rng.dirichlet(np.full(segments, 0.5))
    return np.append(np.concatenate([[0.0], np.cumsum(parts)])[:-1], 1.0)


def _gates(position: np.ndarray, fractions: np.ndarray, turn: int | None) -> np.ndarray:
    """Return rows at shares of the arc length of a path (N, 3), and the one where it turns."""
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    arc_length = np.concatenate([[0.0], np.cumsum(steps)])
    gates = np.searchsorted(arc_length, arc_length[-1] * fractions)
    gates[-1] = len(position) - 1
    gates = np.minimum(gates, len(position) - 1)
    if turn is not None:
        gates = np.sort(np.append(gates, turn))
    return np.unique(gates)


def _slow(arm: Arm, spline: PPoly) -> Trajectory:
    """Return a spline over 0 to 1 as a trajectory that leaves a fraction of every limit.

    Raises:
        Unsuitable: However slow, it does not.
    """
    powers = np.arange(len(spline.c) - 1, -1, -1)[:, None, None]
    for doubling in range(MAX_SLOWER):
        duration = 0.5 * 2.0**doubling
        trajectory = Trajectory(
            list(arm.joint_names), spline.x * duration, spline.c / duration**powers
        )
        found = judge_limits(arm, trajectory, trajectory.samples(500))
        fractions = [one.margin for one in found.values() if one.unit == "relative"]
        if (
            min((fraction for fraction in fractions if fraction is not None), default=1.0)
            >= FRACTION
        ):
            return trajectory
    raise Unsuitable("the motors cannot hold the arm")
