"""Conditions on efforts: limits, torque-speed lines, rates."""

from functools import reduce

import numpy as np
import pytest
from cases import (
    INERTIA,
    PEAK_JERK,
    anywhere,
    changed,
    one_joint,
    quintic,
    random_motion,
    random_motors,
    with_motors,
)

from tubeplanner import JointTrajectory, Tolerance, verify
from tubeplanner.certificate.effort_conditions import friction_jumps
from tubeplanner.certificate.judged_motion import JudgedMotion
from tubeplanner.certificate.verification import JUDGED
from tubeplanner.robot.joint_limits import EffortRange
from tubeplanner.robot.model import effort_rate

# Efforts with friction at dense samples of random motions, written out.

FRACTIONS = np.linspace(0, 1, 2001)


def samples(robot, trajectory):
    """Return positions, velocities, efforts and what friction may change, dense, both sides.

    Beside the even samples of every piece, both one-sided limits where a joint reverses, and the
    instants at which one passes a corner of its table: at an instant, directions are those of
    just before and just after.
    """
    motors, states = robot.motors, []
    for piece, width in enumerate(trajectory.widths):
        rows = trajectory.coefficients[:, piece]
        polynomials = [np.polyder(row) for row in rows.T]
        for table in robot.limits.effort_ranges:
            polynomials += [np.polysub(rows[:, table.joint], at) for at in table.position]
        roots = np.concatenate([np.roots(each) for each in polynomials])
        real = roots[abs(roots.imag) < 1e-9].real
        time = np.concatenate([FRACTIONS * width, real[(real > 0) & (real < width)]])
        pieces = np.full(len(time), piece)
        q, v, a = (trajectory.within(pieces, time, order) for order in range(3))
        smooth = robot.inverse_dynamics(q, v, a)
        for step in (-1e-7, 1e-7):
            ahead = trajectory.within(pieces, np.clip(time + step, 0, width), 1)
            dry = np.where(ahead > 0, motors.forwards_friction, -motors.backwards_friction)
            unsure = motors.friction_uncertainty * abs(motors.viscous_friction * v + dry)
            states.append((q, v, smooth + dry, unsure))
    return [np.concatenate(each) for each in zip(*states, strict=True)]


def worst_use(robot, trajectory):
    """Return the largest fraction of the effort limits that a sample uses."""
    q, _, effort, unsure = samples(robot, trajectory)
    most = robot.limits.effort
    used = []
    for sign in (1, -1):
        allowed = np.broadcast_to(most, q.shape).copy()
        for table in robot.limits.effort_ranges:
            side = table.forwards if sign > 0 else table.backwards
            allowed[:, table.joint] = np.interp(q[:, table.joint], table.position, side)
        used.append(1 + (sign * effort + unsure - allowed) / most)
    return float(np.max(used))


def worst_curve_use(robot, trajectory):
    """Return the largest fraction of the torque-speed lines that a sample uses."""
    _, v, effort, unsure = samples(robot, trajectory)
    stall, fraction = robot.motors.saturation_effort, v / robot.motors.no_load_velocity
    return max(((sign * effort + unsure) / stall + sign * fraction).max() for sign in (1, -1))


def dry(back, forth):
    return {"backwards_friction": back, "forwards_friction": forth}


VISCOUS, BACK, FORTH, LARGEST = 0.8, 0.9, 0.3, 5.0
FRICTION = dry(BACK, FORTH)
ALL = {"viscous_friction": VISCOUS, **FRICTION}

HEAVY = {"mass": 0.5, **dry(100.0, 100.0)}
STALL, NO_LOAD = 6.0, 10.0
LINE = {"saturation_effort": STALL, "no_load_velocity": NO_LOAD}
LEVER = 0.5  # of the bar's centre of mass [m]


def judged(name, robot, trajectory):
    return JUDGED[name](JudgedMotion(anywhere(robot), trajectory, Tolerance()))


def course(powers, *more, width=1.0):
    """Return a joint's motion by polynomials of the time in each piece, highest power first."""
    rows = np.array([powers, *more]).T[:, :, None]
    return JointTrajectory(["turn"], width * np.arange(1 + rows.shape[1]), rows)


def integral(*factors):
    """Return the powers of a position whose velocity is a product of polynomials."""
    return np.polyint(reduce(np.polymul, factors))


@pytest.fixture
def bar(tmp_path):
    """Return a function from limits and motors to a bar of known inertia, without weight."""

    def make(mass=0.0, limits=None, **motors):
        limits = {"effort": LARGEST} | (limits or {})
        return with_motors(one_joint(tmp_path, mass, velocity=1e3), limits=limits, **motors)

    return make


def rated(rate):
    """Return limits on the effort's rate alone."""
    return {"effort": np.inf, "effort_rate": rate}


# Efforts with friction and limits that differ: closed forms of a bar.


AT = 0.371  # where joints reverse, between all looks [s]
SHORT_BACK = integral([1.0, -0.3], [1.0, -0.302])
TOUCHING = integral([1.0, -AT], [1.0, -AT])
SLOWING = integral([-1.0, 3 * AT, 2 - 3 * AT**2, AT**3 - 2 * AT])  # of u = t - AT: 2 u - u^3
BETWEEN = course([1.0, 0.0], [-1.0, 1.0], [1.0, 0.0], width=0.5)
# Friction, motion, the effort that is needed at most and when.
NEEDED = {
    "forwards": (ALL, course([1.5, 0.2]), VISCOUS * 1.5 + FORTH, None),
    "backwards": (ALL, course([-1.5, 0.2]), VISCOUS * 1.5 + BACK, None),
    # Gravity loads it by m g l; friction could hold it as well as not.
    "a joint that stands still": (HEAVY, course([0.0, 0.0]), 0.5 * 9.81 * LEVER, None),
    "a short way back": (dry(4.0, 0.0), course(SHORT_BACK), 4.0 + INERTIA * 0.002, 0.3),
    # Its acceleration is the largest at the reversal: 2 rad/s^2, and falls on either side.
    "at the reversal alone": (FRICTION, course(SLOWING), 2 * INERTIA + FORTH, AT),
    # The velocity touches zero and does not change its sign: nothing is backwards.
    "it stops and goes on": (dry(5.0, 0.0), course(TOUCHING), 2 * INERTIA * (1 - AT), 1.0),
    "it goes on with friction": (dry(0, 1), course(TOUCHING), 1 + 2 * INERTIA * (1 - AT), 1.0),
    # From rest to rest: its acceleration is -6 rad/s^2 at first, then 6.
    "backwards from rest": (dry(0.4, 3.0), course([2, -3, 0, 0]), 6 * INERTIA + 0.4, 0.0),
    "across breakpoints": (FRICTION, BETWEEN, BACK, None),
}


@pytest.mark.parametrize(("motors", "motion", "needed", "time"), NEEDED.values(), ids=NEEDED)
def test_friction_is_that_of_the_direction(bar, motors, motion, needed, time):
    condition = judged("effort", bar(**motors), motion)
    assert condition.margin == pytest.approx(1 - needed / LARGEST, abs=1e-8)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")
    assert condition.where.joint == "turn"
    assert time is None or condition.where.time == pytest.approx(time, abs=1e-6)


@pytest.mark.parametrize("acceleration", [3.0, -3.0])
def test_both_sides_of_a_reversal_count(bar, acceleration):
    """It slows down, reverses, and goes back no faster."""
    condition = judged("effort", bar(**FRICTION), course([acceleration / 2, -acceleration * AT, 0]))
    before, after = (-BACK, FORTH) if acceleration > 0 else (FORTH, -BACK)
    needed = [abs(INERTIA * acceleration + dry) for dry in (before, after)]
    assert condition.margin == pytest.approx(1 - max(needed) / LARGEST, abs=1e-8)
    assert (condition.where.time >= AT - 1e-9) == (needed[1] > needed[0])


@pytest.mark.parametrize("fraction", [0.0, 0.25])
@pytest.mark.parametrize("drives", [True, False])
def test_uncertain_friction_is_the_worst_it_may_be(bar, drives, fraction):
    """More where it adds to the effort, less where it helps to brake."""
    acceleration, sign = (2.0, 1) if drives else (-4.0, -1)
    friction = VISCOUS * (3.0 + 0.1 * acceleration) + FORTH
    most = sign * (INERTIA * acceleration + friction) + fraction * friction
    robot = bar(limits={"effort": 9.0}, **ALL, friction_uncertainty=fraction)
    condition = judged("effort", robot, course([acceleration / 2, 3.0, 0.0], width=0.1))
    assert condition.margin == pytest.approx(1 - most / 9.0, abs=1e-8)
    assert condition.where.time == pytest.approx(0.1, abs=1e-6)


def table(position, backwards, forwards):
    return EffortRange(
        0, *(np.array(each, dtype=float) for each in (position, backwards, forwards))
    )


PAIR = table([0], [2], [4])
CORNERS = table([-0.3, 0.123, 0.4], [3, 1, 2], [2, 1.5, 4])
ENDING = table([0, 0.2], [9, 9], [1, 3])
FALLING = table([0, 1], [6, 6], [4, 2])
# The limit, friction, motion, what is left at the least in shares of the larger side, and when.
LEFT = {
    "a pair, forwards": (PAIR, FORTH, FORTH, [1.0, 0.0], (2 + FORTH) / 4, None),
    "a pair, backwards": (PAIR, BACK, BACK, [-1.0, 0.0], (2 - BACK) / 4, None),
    "a corner passed forwards": (CORNERS, BACK, FORTH, [1.0, -0.5], (1.5 - FORTH) / 4, 0.623),
    "a corner passed backwards": (CORNERS, BACK, FORTH, [-1.0, 0.5], (1 - BACK) / 4, 0.377),
    "before its first end": (ENDING, BACK, FORTH, [0.1, -0.5], (1 - FORTH) / 9, None),
    "beyond its last end": (ENDING, BACK, FORTH, [0.1, 0.5], (3 - FORTH) / 9, None),
    "without friction": (FALLING, 0.0, 0.0, [2.0, 0, 0], (2 - 4 * INERTIA) / 6, None),
}


@pytest.mark.parametrize(
    ("limit", "back", "forth", "powers", "left", "time"), LEFT.values(), ids=LEFT
)
def test_limits_may_differ_by_sign_and_position(bar, limit, back, forth, powers, left, time):
    condition = judged("effort", bar(effort_ranges=[limit], **dry(back, forth)), course(powers))
    assert condition.margin == pytest.approx(left, abs=1e-8)
    assert time is None or condition.where.time == pytest.approx(time, abs=1e-6)


def test_a_joint_without_a_limit_is_not_asked(ur5):
    """However much friction it has."""
    limits, dry = ur5.limits.effort.copy(), np.zeros(6)
    limits[2], dry[2], dry[3] = np.inf, 1e6, 500.0
    robot = with_motors(ur5, limits={"effort": limits}, forwards_friction=dry)
    condition = judged("effort", robot, random_motion(ur5, np.random.default_rng(3)))
    assert condition.where.joint == ur5.joint_names[3]
    assert condition.margin == pytest.approx(1 - 500.0 / limits[3], abs=3.0)


@pytest.mark.parametrize(("name", "seed"), [("two_link", 0), ("slide", 1), ("ur5", 2)])
def test_no_sample_uses_more_of_limits_and_lines_and_one_as_much(request, name, seed):
    """Arms with random motors, on random motions with reversals and breakpoints that jump."""
    robot, rng = request.getfixturevalue(name), np.random.default_rng(seed)
    arm, motion = random_motors(robot, rng), random_motion(robot, rng)
    for condition, worst in (("effort", worst_use), ("motor_curve", worst_curve_use)):
        found, sampled = judged(condition, arm, motion), 1 - worst(arm, motion)
        assert sampled - 1e-6 <= found.margin <= sampled + 1e-9
        assert found.coverage == "for all t"


# Torque-speed lines: closed forms of a bar that turns.


RUBBING = {"viscous_friction": 0.2, "friction_uncertainty": 0.1, **dry(1.1, 0.7)}
# Friction, motion, the fraction of the line that is used at most.
USED = {
    "driving, faster and faster": ({}, course([1.5, 1.0, 0.0]), 3 * INERTIA / STALL + 0.4),
    # From 9 to 8 rad/s within 0.1 s: 7 N m of braking, more than the motor's stall effort.
    "braking": ({}, course([-5.0, 9.0, 0.0], width=0.1), max(7 / STALL - 0.8, 0.9 - 7 / STALL)),
    "forwards": (RUBBING, course([4.0, 0.0]), 1.1 * (0.2 * 4 + 0.7) / STALL + 0.4),
    "backwards": (RUBBING, course([-4.0, 0.0]), 1.1 * (0.2 * 4 + 1.1) / STALL + 0.4),
}


@pytest.mark.parametrize(("motors", "motion", "used"), USED.values(), ids=USED)
def test_a_motor_has_less_effort_the_faster_it_drives(bar, motors, motion, used):
    condition = judged("motor_curve", bar(limits={"effort": np.inf}, **LINE, **motors), motion)
    assert condition.margin == pytest.approx(1 - used, abs=1e-8)
    assert condition.where.joint == "turn"
    assert (condition.unit, condition.coverage) == ("relative", "for all t")


def test_only_joints_with_a_line_are_asked(ur5):
    motion = random_motion(ur5, np.random.default_rng(0))
    saturation, fastest = np.full((2, 6), np.inf)
    saturation[3], fastest[3] = 30.0, 5.0
    arm = with_motors(ur5, saturation_effort=saturation, no_load_velocity=fastest)
    condition = judged("motor_curve", arm, motion)
    assert condition.where.joint == ur5.joint_names[3]
    states = motion.at(np.linspace(0, motion.duration, 5000))
    effort = arm.inverse_dynamics(states.position, states.velocity, states.acceleration)[:, 3]
    used = abs(effort / 30 + states.velocity[:, 3] / 5).max()
    assert condition.margin == pytest.approx(1 - used, abs=0.02)


# How often and how far Coulomb friction jumps, in words.


EVERY = np.ones(3, dtype=bool)


def jumps(robot, rows, breakpoints=(0.0, 1.0), joints=EVERY):
    trajectory = JointTrajectory(robot.joint_names, breakpoints, np.array(rows))
    return friction_jumps(JudgedMotion(anywhere(robot), trajectory, Tolerance()), joints)


@pytest.fixture
def arm(slide):
    """It turns, extends and lifts."""
    return with_motors(slide, backwards_friction=[1.0, 4.0, 2.0], forwards_friction=[2.0, 5.0, 0.0])


def swings(at):
    """Rows of joints that reverse at times within a second; None: moves on, 0: stands still."""
    rows = np.zeros((3, 1, 3))
    for joint, time in enumerate(at):
        if time != 0:
            rows[:2, 0, joint] = (0.0, 1.0) if time is None else (0.5, -time)
    return rows


@pytest.mark.parametrize(
    ("at", "joints", "text"),
    [
        ([0.25, 0.5, 0.75], EVERY, "at 3 reversals, by at most 9 N (extend, t = 0.5000 s)"),
        ([0.25, None, 0], EVERY, "at 1 reversal, by at most 3 N m (turn, t = 0.2500 s)"),
        (
            [0.25, 0.5, 0.75],
            np.array([True, False, True]),
            "at 2 reversals, by at most 3 N m (turn, t = 0.2500 s)",
        ),
    ],
)
def test_the_largest_jump_of_those_asked_for_has_its_joint_and_time(arm, at, joints, text):
    expected = f"Coulomb friction, which is apart, jumps {text}"
    assert jumps(arm, swings(at), joints=joints) == expected


def test_uncertain_friction_may_jump_farther(slide):
    arm = with_motors(slide, forwards_friction=1.0, friction_uncertainty=0.5)
    assert "by at most 1.5 N m" in jumps(arm, swings([0.25, None, None]))


def test_a_reversal_at_a_breakpoint_or_after_a_stop_is_one(arm):
    """It goes on for a second, rests for two, and comes back."""
    rows = np.zeros((2, 3, 3))
    rows[0, :, 0], rows[1, :, 0] = (1.0, 0.0, -1.0), (0.0, 1.0, 1.0)
    text = jumps(arm, rows, (0.0, 1.0, 3.0, 4.0))
    assert text.endswith("jumps at 1 reversal, by at most 3 N m (turn, t = 3.0000 s)")


def test_without_friction_there_is_nothing_to_tell(slide, arm):
    assert jumps(slide, swings([0.25, 0.5, 0.75])) == ""
    assert jumps(arm, swings([0.25, 0.5, 0.75]), joints=~EVERY) == ""
    assert jumps(arm, swings([None, 0, None])).endswith("no joint reverses")


# How fast efforts change: closed forms, breakpoints, defects that only samples between show.


@pytest.mark.parametrize("fraction", [0.5, 1 - 2e-6, 1 + 2e-6, 3.0])
def test_the_margin_is_what_the_largest_jerk_leaves(bar, fraction):
    """Without gravity the rate is inertia times jerk, 60 rad/s^3 at both ends of the quintic."""
    robot = bar(limits=rated(fraction * INERTIA * PEAK_JERK))
    certificate = verify(anywhere(robot), quintic(1.0))
    condition = certificate.conditions["effort_rate"]
    assert condition.margin == pytest.approx(1 - 1 / fraction, abs=2e-8 / fraction)
    assert condition.where.joint == "turn"
    assert min(condition.where.time, 1 - condition.where.time) == pytest.approx(0.0, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")
    assert ("effort_rate" in certificate.failures()) == (fraction < 1)


def test_a_pendulums_own_weight_counts(bar):
    """Turned uniformly, its effort is m g l cos(q): the rate is the largest where it is upright."""
    speed, largest = 2.0, 0.5 * 9.81 * LEVER * 2.0
    robot = bar(mass=0.5, limits=rated(1.25 * largest))
    condition = judged("effort_rate", robot, course([speed, 0.1], width=1.5))
    assert condition.margin == pytest.approx(0.2, abs=2e-8)
    assert condition.where.time == pytest.approx((np.pi / 2 - 0.1) / speed, abs=1e-3)


@pytest.mark.parametrize(("first", "second"), [(1.0, 1 / 3), (1 / 3, 1.0)])
def test_both_sides_of_a_breakpoint_are_judged(bar, first, second):
    """The jerk jumps there: from 6 to 2 rad/s^3, or the other way."""
    width = 0.5
    then = [second, 3 * first * width, 3 * first * width**2, first * width**3]
    motion = course([first, 0.0, 0.0, 0.0], then, width=width)
    condition = judged("effort_rate", bar(limits=rated(INERTIA * 7)), motion)
    assert condition.margin == pytest.approx(1 / 7, abs=2e-8)
    assert (condition.where.time <= width) == (first > second)


def test_viscous_friction_and_rotors_count(bar):
    """At constant jerk j: (I + J) j + d a, the largest at the end."""
    robot = bar(limits=rated(20.0), armature=0.3, viscous_friction=0.8)
    condition = judged("effort_rate", robot, course([0.5, 0, 0.2, 0], width=1.5))
    assert condition.margin == pytest.approx(1 - (3 * (INERTIA + 0.3) + 0.8 * 4.5) / 20, abs=2e-8)
    assert condition.coverage == "for all t"


def test_jumps_of_coulomb_friction_are_told_apart(bar):
    """They change nothing but the coverage."""
    motion = course(integral([1.0, -0.2], [1.0, -0.7]))
    plain, rubbing = (
        judged("effort_rate", bar(limits=rated(20.0), **motors), motion)
        for motors in ({}, dry(1.25, 0.5))
    )
    assert rubbing.margin == plain.margin
    assert rubbing.coverage == (
        "for all t; Coulomb friction, which is apart, jumps at 2 reversals, by at most 1.75 N m "
        "(turn, t = 0.2000 s)"
    )


def test_friction_of_joints_without_a_limit_on_rates_is_not_told(ur5):
    rates = np.where(np.arange(6) == 2, 1e4, np.inf)
    robot = with_motors(ur5, limits={"effort_rate": rates}, forwards_friction=1.0)
    rows = np.zeros((3, 1, 6))
    rows[:2, 0, 1] = 1.0, -0.5
    condition = judged("effort_rate", robot, JointTrajectory(ur5.joint_names, [0, 1.0], rows))
    assert condition.coverage.endswith("; Coulomb friction does not jump: no joint reverses")


# What holds of all three: found to two parts in a thousand, safe where undecided.


def test_two_parts_in_a_thousand_of_a_rate_are_found_with_joint_and_time(stored):
    """A motor that is slower by 0.2 % than a trajectory needs, at one instant."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    robot = problem.robot
    piece = np.repeat(np.arange(len(trajectory.widths)), 5001)
    local = (np.linspace(0, 1, 5001) * trajectory.widths[:, None]).ravel()
    rates = abs(effort_rate(robot, *(trajectory.within(piece, local, k) for k in range(4))))
    use = rates / robot.limits.effort
    row, joint = np.unravel_index(use.argmax(), use.shape)
    limit = np.where(np.arange(2) == joint, 0.998 * rates[row, joint], np.inf)
    weak = with_motors(robot, limits={"velocity": np.inf, "effort_rate": limit})
    certificate = verify(changed(problem, robot=weak), trajectory)
    assert certificate.failures() == ["effort_rate"]
    condition = certificate.conditions["effort_rate"]
    assert condition.margin == pytest.approx(1 - 1 / 0.998, abs=1e-6)
    assert condition.where.joint == robot.joint_names[joint]
    time = trajectory.breakpoints[piece[row]] + local[row]
    assert condition.where.time == pytest.approx(time, abs=1e-3)


SWING = course([3.0, -1.0, 0.0])
SAFE = {
    "effort": ({}, FRICTION, SWING),
    "motor_curve": ({"effort": np.inf}, LINE, SWING),
    "effort_rate": (rated(20.0), {}, SWING),
}


@pytest.mark.parametrize(("name", "limits", "motors", "motion"), [(k, *v) for k, v in SAFE.items()])
def test_an_undecided_margin_is_safe_and_told(bar, name, limits, motors, motion, monkeypatch):
    robot = bar(mass=0.5, limits=limits, **motors)
    exact = judged(name, robot, motion)
    assert exact.coverage == "for all t"
    monkeypatch.setattr("tubeplanner.certificate.enclosure._MAX_INTERVALS", 1)
    rough = judged(name, robot, motion)
    assert rough.margin < exact.margin - 1e-9
    found = rough.coverage.removeprefix("for all t, undecided: the margin found is ")
    assert float(found.removesuffix(" relative")) == pytest.approx(exact.margin, abs=0.02)


TOLERANCES = {
    "effort": "judged_motion.EFFORT_ENCLOSURE",
    "effort_rate": "effort_conditions._RATE_ENCLOSURE",
}


@pytest.mark.parametrize(("name", "tolerance"), TOLERANCES.items())
def test_the_error_of_the_enclosure_is_taken_off_the_margin(bar, name, tolerance, monkeypatch):
    robot, motion = bar(mass=0.5, limits=SAFE[name][0]), quintic(3.0, 1.5)
    exact = judged(name, robot, motion).margin
    monkeypatch.setattr(f"tubeplanner.certificate.{tolerance}", 1e-2)
    assert exact - 2.1e-2 < judged(name, robot, motion).margin < exact - 1e-7


def test_without_a_limit_it_is_not_required(bar):
    reasons = {
        "motor_curve": "no motor has a torque-speed line",
        "effort_rate": "no joint has this limit",
    }
    for name, reason in reasons.items():
        condition = judged(name, bar(**FRICTION), course([1.0, 0.0]))
        assert (condition.margin, condition.coverage) == (None, reason)
