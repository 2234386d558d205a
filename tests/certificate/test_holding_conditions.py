"""The certificate's condition on held parts: closed forms, mass points, faults.

The slide of `lifting_arm` moves a hand along x and z; gravity is along -z.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from arms import follower_arm
from cases import anywhere, one_joint, with_bump
from lifting_arm import URDF

from tubeplanner import JointTrajectory, Payload, Seed, Tolerance, load_robot, verify
from tubeplanner.certificate.enclosure import enclosed
from tubeplanner.certificate.holding_conditions import HeldPart, judge_holding
from tubeplanner.certificate.judged_motion import JudgedMotion
from tubeplanner.task.holding import Cup, Gripper, Holding, Liquid, Tray

G = 9.81
PART = Payload(0.8, (0.004, -0.002, 0.03), (0.004, 0.005, 0.006, 3e-4, 2e-4, 1e-4))
CONTACTS = {
    "cup": Cup(42.4, 0.015, 0.5, position=(0, 0.01, 0.02), normal=(0.2, 0, 1)),
    "tray": Tray(0.5, (0.06, 0.04), position=(0, 0, 0.01), normal=(0.1, 0.05, 1)),
    "disc": Tray(0.5, 0.03, safety=1.0),
    "gripper": Gripper(60.0, 0.5, (0.02, 0.03)),
    "liquid": Liquid(0.4),
}
LEAN = np.radians(15)
LEANING = (np.sin(LEAN), 0.0, np.cos(LEAN))


@pytest.fixture
def hand(tmp_path):
    """Return a function from a holding to the problem of the slide's hand."""
    (tmp_path / "lifting.urdf").write_text(URDF)
    robot = load_robot(tmp_path / "lifting.urdf", "hand", gravity=(0, 0, -G))
    return lambda *holding: held(robot, *holding)


def held(robot, *holding):
    """Return a problem whose start is chosen: a given one would have to hold the part."""
    start = Seed(np.zeros(robot.joint_count))
    return replace(anywhere(robot), start=start, holding=holding)


def flat(mu=0.3, foot=1.0, height=0.0, safety=1.0, normal=(0.0, 0.0, 1.0)):
    """Return a part on a tray, its centre of mass at a height above the middle of its foot."""
    part = Payload(1.0, tuple(height * np.array(normal)))
    return Holding(Tray(mu, (foot, foot), safety=safety, normal=normal), part)


def pushed(*accelerations, names=("x", "z"), width=1.0):
    """Return the trajectory from rest with constant accelerations, each for a width [s]."""
    rows, q, v = [], np.zeros(len(names)), np.zeros(len(names))
    for a in np.atleast_2d(accelerations):
        rows.append([a / 2, v, q])
        q, v = q + v * width + a * width**2 / 2, v + a * width
    steps = width * np.arange(len(rows) + 1)
    return JointTrajectory(names, steps, np.array(rows).swapaxes(0, 1))


def judged(problem, trajectory):
    return judge_holding(JudgedMotion(problem, trajectory, Tolerance()))


def just_holds(problem, trajectory, what):
    """Check that a trajectory is at the limit, and that 0.05 % faster it is beyond."""
    at_limit, faster = (judged(problem, trajectory.scaled(s)) for s in (1.0, 1 / 1.0005))
    assert abs(at_limit.margin) < 2e-7 and at_limit.holds(Tolerance())
    assert faster.margin < -2e-4 and not faster.holds(Tolerance())
    assert faster.where.contact == what
    assert faster.coverage == "for all t"


@pytest.mark.parametrize(
    ("holding", "acceleration", "what"),
    [
        (flat(0.3), 0.3 * G, "tray slides"),
        (flat(0.5, foot=0.04, height=0.05), 0.4 * G, "tray tips"),
        (Holding(Liquid(LEAN)), G * np.tan(LEAN), "liquid spills"),
        (flat(0.3, normal=LEANING), G * np.tan(LEAN + np.arctan(0.3)), "tray slides"),
    ],
)
def test_the_largest_acceleration_is_the_closed_forms(hand, holding, acceleration, what):
    just_holds(hand(holding), pushed([acceleration, 0.0]), what)


def test_the_turntable_turns_as_fast_as_friction_holds(tmp_path):
    robot = replace_gravity(one_joint(tmp_path), (0, 0, -G))
    holding = Holding(Tray(0.3, 0.2, safety=1.0, position=(0.5, 0, 0)), Payload(1.0, (0.5, 0, 0)))
    rate = np.sqrt(0.3 * G / 0.5)
    assert rate == pytest.approx(2.4261, abs=1e-4)
    turning = JointTrajectory(["turn"], [0.0, 1.0], np.array([[[rate]], [[0.0]]]))
    just_holds(held(robot, holding), turning, "tray slides")


def replace_gravity(robot, gravity):
    again, _ = robot.__reduce__()
    return again(gravity=gravity)


def test_the_gantry_needs_the_time_that_friction_allows(hand):
    duration = 2 * np.sqrt(1.0 / (0.3 * G))
    assert duration == pytest.approx(1.16583, abs=1e-5)
    rail = pushed([0.3 * G, 0], [-0.3 * G, 0], width=duration / 2)
    assert rail.position(duration)[0] == pytest.approx(1.0)
    just_holds(hand(flat(0.3)), rail, "tray slides")


def test_a_lift_slows_down_no_faster_than_the_part_falls(hand):
    up, height = 20.0, 0.5
    first = np.sqrt(2 * height / (up + up**2 / G))
    duration = first * (1 + up / G)
    assert duration == pytest.approx(0.38979, abs=1e-5)
    rows = np.zeros((3, 2, 2))
    rows[:, 0, 1] = up / 2, 0.0, 0.0
    rows[:, 1, 1] = -G / 2, up * first, up * first**2 / 2
    lift = JointTrajectory(["x", "z"], [0.0, first, duration], rows)
    assert lift.position(duration)[1] == pytest.approx(height)
    condition = judged(hand(flat()), lift)
    assert abs(condition.margin) < 2e-7
    faster = judged(hand(flat()), lift.scaled(1 / 1.0005))
    assert faster.margin == pytest.approx(-(1.0005**2 - 1), rel=1e-3)


def test_at_rest_is_judged_everywhere(hand):
    steep = np.radians(20)  # steeper than friction holds: atan 0.3 is 16.7 degrees
    holding = flat(0.3, normal=(np.sin(steep), 0.0, np.cos(steep)))
    condition = judged(hand(holding), pushed([G * np.tan(steep), 0.0]))
    assert condition.where.contact == "tray slides, at rest"
    assert condition.margin == pytest.approx(np.cos(steep) - np.sin(steep) / 0.3, rel=1e-6)
    assert str(condition.where).startswith("tray slides, at rest, t = ")


def test_slower_runs_hold_what_is_held_at_rest_and_at_speed(hand):
    slow, quick = pushed([0.2 * G, 0.0]), pushed([0.4 * G, 0.0])
    assert verify(hand(flat()), slow).slower
    failure = verify(hand(flat()), quick).slower_failure
    assert (failure.condition, failure.speed) == ("holding", 1.0)
    leaning = hand(flat(0.2, normal=LEANING))
    failure = verify(leaning, pushed([G * np.tan(LEAN), 0.0])).slower_failure
    assert (failure.condition, failure.speed) == ("holding", 0.0)
    assert failure.where.contact == "tray slides, at rest"


@pytest.mark.parametrize("safety", [1.0, 1.2, 1.5])
def test_safety_is_divided_by(hand, safety):
    most = 0.3 / safety * G / safety  # the weight that counts, and friction
    just_holds(hand(flat(0.3, safety=safety)), pushed([most, 0.0]), "tray slides")
    cup = Holding(Cup(60.0, 0.5, 0.5, safety=safety), Payload(2.0, (0, 0, 0)))
    most = 0.5 * (60.0 / safety / 2.0 + G)
    just_holds(hand(cup), pushed([most, 0.0]), "cup slides")


@pytest.mark.parametrize("side", [1, -1])
def test_an_eccentric_part_tips_sooner_to_its_side(hand, side):
    safety, height, away = 1.2, 0.05, 0.01
    half = 0.06 / 2 / safety
    holding = Holding(Tray(3.0, (0.06, 1.0), safety=safety), Payload(1.0, (away, 0.0, height)))
    most = G * (half + side * away) / (safety * height)
    just_holds(hand(holding), pushed([side * most, 0.0]), "tray tips")


def test_the_inertia_needs_torque(tmp_path):
    robot = replace_gravity(one_joint(tmp_path), (0, 0, 0))
    part = Payload(1.0, (0, 0, 0), (0.02, 0.02, 0.03, 0, 0, 0))
    cup = Holding(Cup(30.0, 0.1, 0.5, safety=1.0), part)
    # A quarter of the twist is added for the wrenches that tilt and slide as well.
    most = 0.5 * 30.0 * 0.1 / 0.03 / 1.25
    just_holds(held(robot, cup), pushed([most], names=["turn"]), "cup tips")


def test_a_reversed_normal_lets_the_part_fall(hand):
    resting = pushed([0.1, 0.0])
    assert judged(hand(flat()), resting).margin > 0.9
    assert judged(hand(flat(normal=(0.0, 0.0, -1.0))), resting).margin < -0.9


def test_the_worst_of_several_contacts_is_named_with_its_number(hand):
    problem = hand(flat(0.5), Holding(Liquid(0.1)))
    condition = judged(problem, pushed([2.0, 0.0]))
    assert condition.where.contact == "liquid (holding[1]) spills"
    assert "liquid (holding[1]) spills, t = " in verify(problem, pushed([2.0, 0.0])).describe(
        "holding"
    )


def test_nothing_held_is_nothing_required(hand):
    condition = judged(hand(), pushed([2.0, 0.0]))
    assert condition.margin is None and condition.coverage == "nothing is held"


def test_a_spike_between_samples_is_found(hand):
    quiet = JointTrajectory(["x", "z"], [0.0, 1.0], np.zeros((1, 1, 2)))
    # Of 0.2 ms and 0.1 um: in its middle it accelerates by 60 m/s^2.
    condition = judged(hand(flat()), with_bump(quiet, 0, 0.50005, 2e-4, 1e-7))
    assert condition.margin < -5
    assert condition.where.time == pytest.approx(0.50015, abs=1e-4)


# ---- Against masses at points, by differences of positions.

_STEP = 1e-4


def wrench_of_points(robot, holding, trajectory, time):
    """Return the wrench (N, 6) by the forces on six masses that move with the part."""
    part = holding.mass_properties
    principal, axes = np.linalg.eigh(part.inertia_matrix())
    along = np.sqrt(3 * (principal.sum() / 2 - principal) / part.mass)
    points = np.array(part.com) + np.vstack([axes.T * along[:, None], -axes.T * along[:, None]])
    body, placement = robot.link_body[robot.tool_frame], robot.link_placement[robot.tool_frame]

    def located(t, fixed):
        rotation, position = (pose[:, body] for pose in robot.body_poses(trajectory.position(t)))
        in_body = fixed @ placement[:3, :3].T + placement[:3, 3]
        return np.einsum("nij,pj->npi", rotation, in_body) + position[:, None]

    before, now, after = (located(time + step, points) for step in (-_STEP, 0.0, _STEP))
    force = part.mass / 6 * ((before - 2 * now + after) / _STEP**2 - robot.gravity)
    middle = np.array(holding.contact.position)
    origin, *ends = located(time, middle + np.vstack([np.zeros(3), holding.axes.T])).swapaxes(0, 1)
    moment = np.cross(now - origin[:, None], force)
    frame = np.stack([end - origin for end in ends], axis=2)
    both = [np.einsum("nij,ni->nj", frame, each.sum(axis=1)) for each in (force, moment)]
    return np.hstack(both)


@pytest.fixture(scope="module", params=["ur5", "panda", "slide", "followers"])
def arm(request, tmp_path_factory):
    if request.param != "followers":
        return request.getfixturevalue(request.param)
    path = tmp_path_factory.mktemp("followers") / "followers.urdf"
    path.write_text(follower_arm())
    return load_robot(path, "tip")


def moving(robot, seed=0, pieces=3, width=0.1):
    """Return polynomials of degree 5 as fast as arms move, with jumps between the pieces."""
    rng = np.random.default_rng(seed)
    scale = np.array([60.0, 30.0, 20.0, 8.0, 2.0, 1.5])[:, None, None]
    rows = scale * rng.uniform(-1, 1, (6, pieces, robot.joint_count))
    return JointTrajectory(robot.joint_names, width * np.arange(pieces + 1), rows)


def states_of(trajectory, time):
    return [getattr(trajectory, name)(time) for name in ("position", "velocity", "acceleration")]


@pytest.mark.parametrize("name", CONTACTS)
def test_wrenches_and_margins_are_those_of_mass_points(arm, name):
    holding, trajectory = Holding(CONTACTS[name], PART), moving(arm)
    time = np.concatenate([np.linspace(k + 0.01, k + 0.99, 400) / 10 for k in range(3)])
    points = wrench_of_points(arm, holding, trajectory, time)
    part = HeldPart(arm, holding)
    exact = part.wrench(*states_of(trajectory, time))
    assert abs(exact - points).max() < 1e-5 * abs(points).max()
    samples = trajectory.per_piece(400)  # on both sides of the jumps
    wrenches = (
        part.wrench(samples.position, samples.velocity, samples.acceleration),
        part.wrench(samples.position),
    )
    worst = min(cone.margin(wrench).min() for cone in holding.cones for wrench in wrenches)
    problem = SimpleNamespace(robot=arm, holding=(holding,))
    condition = judged(problem, trajectory)
    assert condition.margin <= worst + 1e-4 * abs(worst)
    assert condition.margin == pytest.approx(worst, rel=0.03, abs=0.01)


@pytest.mark.parametrize("gravity", [True, False])
@pytest.mark.parametrize("name", ["cup", "liquid", "in the middle"])
@pytest.mark.parametrize("width", [0.1, 0.3])
def test_no_wrench_lies_outside_its_enclosure(arm, name, width, gravity):
    middle = Holding(Gripper(60.0, 0.5, (0.02, 0.03), position=PART.com), PART)
    holding = middle if name not in CONTACTS else Holding(CONTACTS[name], PART)
    arm = arm if gravity else replace_gravity(arm, (0, 0, 0))
    part, trajectory = HeldPart(arm, holding), moving(arm, 1, width=width)
    time = np.random.default_rng(2).uniform(0, trajectory.duration, 500)
    states = states_of(trajectory, time)
    for quantity in (part.quantity(0), part.quantity(2)):
        for tolerance in (np.inf, 1e-3):
            wrench = enclosed(trajectory, quantity, np.full(6, tolerance))
            interval = np.searchsorted(wrench.start, time, "right") - 1
            off = abs(wrench.at(time) - quantity.values(*states[: quantity.derivatives + 1]))
            assert (off <= wrench.error[interval] + 1e-9).all()
