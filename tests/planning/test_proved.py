""" "Proved: there is no motion" against problems that are made around a motion.

Random arms of one to three joints with followers, slides, friction and sided motors move at random,
rest to rest; limits, tube and ends are then drawn as tightly about that motion as it allows.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from arms import INERTIAL, joint, link, loaded, solid

from tubeplanner import (
    BasePose,
    GoalRegion,
    JointTrajectory,
    LimitOverrides,
    MotorOverrides,
    Obstacle,
    Payload,
    PlanningProblem,
    Seed,
    ToolOffset,
    ToolPose,
    Tube,
    placement_of,
    verify,
)
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import KnownBranches, configured_ends
from tubeplanner.outcome import ContradictionError, Infeasible, PlanningClock
from tubeplanner.planning.diagnosis import require_possible, require_within_bound

QUINTIC = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])


def words(values):
    return " ".join(f"{value:.6f}" for value in values)


@dataclass
class Drawn:
    """A random arm, before its limits are known, and the motion it makes."""

    urdf: tuple
    options: dict
    motion: JointTrajectory


def elements(rng, count):
    """Return links and joints of a chain: `count` planned joints, and up to two that follow."""
    kinds = ["planned"] * count + ["follower"] * rng.integers(0, 3)
    rng.shuffle(kinds)
    names = iter([f"j{k}" for k in range(count)])
    parts, parent = [link("l0", INERTIAL)], "l0"
    for k, kind in enumerate(kinds, 1):
        name, more = (next(names), "") if kind == "planned" else (f"f{k}", mimic(rng, count))
        slides = rng.random() < 0.4
        limit = '<limit lower="-50" upper="50" effort="1e6" velocity="1e3"/>' + more
        at = f'{words(rng.uniform(-0.4, 0.4, 3))}" rpy="{words(rng.uniform(-3, 3, 3))}'
        box = solid('<box size="0.05 0.03 0.03"/>', '<origin xyz="0.1 0 0"/>')
        parts += [link(f"l{k}", INERTIAL + box)]
        axis = words(rng.normal(size=3) if rng.random() < 0.5 else [0, 0, 1])
        kind = "prismatic" if slides else "revolute"
        parts += [joint(name, parent, f"l{k}", kind, at, axis, limit)]
        parent = f"l{k}"
    tip = joint("fix", parent, "tip", "fixed", words(rng.uniform(-0.4, 0.4, 3)), limit="")
    return (*parts, link("tip", ""), tip)


def mimic(rng, count):
    sizes = rng.choice([-1, 1]) * rng.uniform(0.1, 3), rng.uniform(-0.5, 0.5)
    leader = f"j{rng.integers(count)}"
    return f'<mimic joint="{leader}" multiplier="{sizes[0]:.6f}" offset="{sizes[1]:.6f}"/>'


def drawn(rng):
    count = int(rng.integers(1, 4))
    names = [f"j{k}" for k in range(count)]
    stops = rng.uniform(-1.5, 1.5, (int(rng.integers(2, 4)), count))
    stops[:, rng.random(count) < 0.3] = stops[0, rng.random(count).argmax()]  # these stand still
    steps, time = np.diff(stops, axis=0), rng.uniform(0.4, 3, len(stops) - 1)
    powers = time[:, None] ** np.arange(-5.0, 1.0)
    rows = np.einsum("k,pk,pn->kpn", QUINTIC, powers, steps)
    rows[-1] = stops[:-1]
    motion = JointTrajectory(names, np.append(0, np.cumsum(time)), rows)
    options = {"gravity": tuple(rng.normal(size=3) * rng.choice([0.0, 9.81]))}
    if rng.random() < 0.5:
        pose = rng.uniform(-1, 1, 3), rng.uniform(-3, 3, 3)
        options["base"] = BasePose(*(tuple(each.tolist()) for each in pose))
    if rng.random() < 0.5:
        options["payload"] = Payload(rng.uniform(0, 3), tuple(rng.uniform(-0.1, 0.1, 3).tolist()))
    if rng.random() < 0.5:
        options["tool_offset"] = ToolOffset(tuple(rng.uniform(-0.2, 0.2, 3).tolist()))
    return Drawn(elements(rng, count), options, motion)


def motors_of(rng, count):
    sizes = rng.choice([0.0, 1.0, 30.0], (count, 2)) * rng.random((count, 2))
    return MotorOverrides(
        coulomb_friction=[tuple(pair) for pair in sizes.tolist()],
        friction_uncertainty=float(rng.choice([0.0, 0.3])),
    )


def limits_of(rng, arm, motion):
    """Return the tightest limits that the motion keeps: sided efforts, ranges, by position."""
    at, motors = motion.per_piece(400), arm.motors
    smooth = arm.inverse_dynamics(at.position, at.velocity, at.acceleration)
    moved = np.repeat(np.sign(np.diff(motion.position(motion.breakpoints), axis=0)), 400, axis=0)
    dry = motors.coulomb_effort(moved)
    unsure = motors.friction_uncertainty * abs(dry)
    sides = [
        (1 + 1e-4) * np.maximum((way * (smooth + dry) + unsure).max(axis=0), 1e-3)
        for way in (-1, 1)
    ]
    low, high = at.position.min(axis=0), at.position.max(axis=0)
    laws = {}
    for k in np.flatnonzero(rng.random(len(low)) < 0.5):
        q, v, gap = at.position[:, k], at.velocity[:, k], rng.choice([0.0, 0.3], 2)
        lower, upper = low[k] - gap[0] - 0.1, high[k] + gap[1] + 0.1
        if len(motion.widths) == 1:  # the end that it leaves may be beyond the edge
            lower, upper = (lower + 0.05, upper) if v.sum() > 0 else (lower, upper - 0.05)
        offset = rng.uniform(0, 0.5)
        left = np.where(v > 0, upper - q, q - lower)[v != 0]
        need = ((abs(v[v != 0]) + offset) ** 2 / (2 * left)).max(initial=1.0)
        law = {"deceleration": 1.01 * need, "offset": offset, "lower": lower, "upper": upper}
        laws[motion.joint_names[k]] = {key: float(value) for key, value in law.items()}
    names = motion.joint_names
    return LimitOverrides(
        effort=dict(zip(names, zip(*(side.tolist() for side in sides), strict=True), strict=True)),
        velocity=dict(zip(names, (1e-3 + abs(at.velocity).max(axis=0)).tolist(), strict=True)),
        position={
            name: (a - 1e-9, max(b, a + 1e-3) + 1e-9)
            for name, a, b in zip(names, low.tolist(), high.tolist(), strict=True)
        },
        velocity_by_position=laws,
    )


def tube_of(rng, arm, motion, obstacle):
    """Return a tube in which the motion passes from segment to segment at random times."""
    inner = np.sort(rng.uniform(0.1, 0.9, int(rng.integers(0, 3)))) * motion.duration
    times = np.array([0.0, *inner, motion.duration])
    corners = arm.tool_position(motion.position(times))
    off = rng.normal(size=corners.shape) * rng.choice([0.0, 0.1])
    off[[0, -1]] = 0
    visit = str(rng.choice(["ordered", "any"]))
    points, radius, signs, clearances = corners + off, [], [], []
    for k in range(len(points) - 1):
        q = motion.position(np.linspace(times[k], times[k + 1], 100))
        axis = points[k + 1] - points[k]
        tool = arm.tool_position(q) - points[k]
        along = np.clip(tool @ axis / max(axis @ axis, 1e-12), 0, 1)
        radius.append(np.linalg.norm(tool - along[:, None] * axis, axis=1).max() + 1e-4)
        signs.append({})
        if rng.random() < 0.5:
            name = motion.joint_names[(j := rng.integers(q.shape[1]))]
            signs[-1] = {name: [q[:, j].min() - 1e-9, q[:, j].max() + 1e-9]}
        clearances.append(clearance(arm, q, obstacle))
    if visit == "any" and rng.random() < 0.7:  # begins with a detour that is never taken
        points = np.vstack([points[0], points[0] + [9.0, 9.0, 9.0], points])
        radius, signs = [0.01, 0.01, *radius], [{}, {}, *signs]
        clearances = [9.0, 9.0, *clearances]
    solids = {} if min(clearances) <= 0 else {"obstacles": (obstacle,)}
    if not solids:
        clearances = None
    options = {"joint_signs": signs, "clearance": clearances, "pass_through_points": "none"}
    return Tube(points, radius, visit=visit, **options), solids


def clearance(arm, q, obstacle):
    tube = Tube([*arm.tool_position(q[[0]]), np.full(3, 9.0)], 9.0)
    scene = PlanningProblem(arm, tube, Seed(q[0]), obstacles=(obstacle,), self_collision=False)
    checker = scene.collision
    if not len(checker.pairs):
        return 0.0
    poses = zip(*arm.body_poses(q), strict=True)
    return 0.99 * min(checker.distances(*pose, checker.pairs).min() for pose in poses) - 1e-3


def end_of(rng, arm, q, is_goal):
    rotation, tool = (part[0] for part in arm.tool_pose(q[None]))
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation, tool
    choices = [q, q, Seed(q), ToolPose(placement, q)]
    if is_goal:
        off = rng.normal(size=3) * 0.1
        choices += [None, GoalRegion(tool + off, float(np.linalg.norm(off)) * 1.001)]
    return choices[rng.integers(len(choices))]


def problem_and_witness(seed, folder):
    """Return a problem and its motion; None if a draw is no problem, or not kept by the motion."""
    rng = np.random.default_rng(seed)
    each = drawn(rng)
    motors = motors_of(rng, len(each.motion.joint_names))
    arm = loaded(folder, *each.urdf, motors=motors, **each.options)
    if arm.joint_names != each.motion.joint_names:  # a follower alone moves the tool
        return None
    limits = limits_of(rng, arm, each.motion)
    obstacle = Obstacle.box("box", [0.1, 0.1, 0.1], placement_of(rng.uniform(-1.5, 1.5, 3)))
    tube, solids = tube_of(rng, arm, each.motion, obstacle)
    ends = each.motion.position(np.array([0.0, each.motion.duration]))
    start, goal = (end_of(rng, arm, q, k == 1) for k, q in enumerate(ends))
    arm = loaded(folder, *each.urdf, motors=motors, limits=limits, **each.options)
    problem = PlanningProblem(arm, tube, start, goal, self_collision=False, **solids)
    return problem, each.motion


def proof(seed, folder):
    """Return the message of what is proved before planning of a problem and its motion, if any.

    Returns:
        Message and motion; None without a proof, or if the draw is no problem at all.
    """
    made = None
    try:
        made = problem_and_witness(seed, folder)
        if made is None:
            return None
        require_within_bound(made[0])
        configured, _ = configured_ends(made[0])
        require_possible(configured, KnownBranches(configured, PlanningClock(None, None)))
    except (ContradictionError, Infeasible) as reason:
        if reason.proved:
            return str(reason), made
    except ProblemError:
        pass
    return None


# Draws that refuted a proof once: slides that follow turning joints, joints that friction locks,
# clearances of segments that need not be visited.
REFUTED = ((3, 34, 42, 68), (124, 125, 227, 233, 269, 303, 336, 367), (19, 25))


@pytest.mark.parametrize("seeds", [*REFUTED, range(500, 510), range(510, 520)])
def test_no_random_motion_refutes_a_proof(seeds, tmp_path):
    for seed in seeds:
        if (result := proof(seed, tmp_path)) is not None:
            message, made = result
            assert made is not None and not verify(*made).passed, (seed, message)


@pytest.mark.parametrize(("gap", "proved"), [(1e-6, None), (1e-5, True)])
def test_ranges_that_meet_within_the_certificates_tolerance_prove_nothing(gap, proved):
    signs = [{"j0": [-1.0, 0.0]}, {"j0": [gap, 1.0]}]
    with pytest.raises(ContradictionError, match="do not meet") as caught:
        Tube([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], 0.1, joint_signs=signs)
    assert caught.value.proved is proved
