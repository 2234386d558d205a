"""verify_cycle: each leg by `verify`, and the junctions."""

import json
from dataclasses import replace

import numpy as np
import pytest
from arms import rail_arm
from cases import rest_to_rest

from cycles import DWELL, HOME, PICK, PLACE, move, pick_and_place, planar_arm, slow_motion, weight
from tubeplanner import (
    Attach,
    Cycle,
    CycleCertificate,
    CycleMotion,
    Detach,
    Event,
    JointTrajectory,
    JudgedCondition,
    LimitOverrides,
    Location,
    Payload,
    ProblemError,
    Tolerance,
    TrajectoryError,
    load_robot,
    verify_cycle,
)
from tubeplanner.task.holding import Cup, Holding
from tubeplanner.task.motion import LegMotion, cycle_motion

GRAVITY = (0.0, -9.81, 0.0)
CYCLE = pick_and_place()
MOTION = slow_motion(CYCLE)
SEAM = "to_pick - to_place"


@pytest.fixture(scope="module")
def sound():
    return verify_cycle(CYCLE, MOTION)


def failures(motion):
    return verify_cycle(motion.cycle, motion).failures()


def ending(end):
    """Return the motion that ends elsewhere."""
    return slow_motion(CYCLE, (HOME, PICK, PLACE, end))


def one_leg(cycle, end=PICK, fractions=()):
    """Return a motion from home to an end in one leg, whose moves end at shares of it."""
    leg = LegMotion(rest_to_rest(cycle.robot.joint_names, HOME, end, 2.0), fractions)
    return cycle_motion(cycle, [leg])


# What a cycle's certificate says of what holds and what does not.


def with_seam(sound, margin=0.0, unit="rad", refused=None, tolerance=None):
    """Return the sound certificate with one seam alone."""
    condition = JudgedCondition(margin, unit, Location(time=1.0), "for all t")
    junctions = {"a - b": {"continuity": condition}}
    return CycleCertificate(sound.moves, junctions, refused or {}, tolerance or Tolerance())


def test_a_seam_holds_within_the_tolerance_of_its_unit(sound):
    absolute, relative = Tolerance(0.6, 0.1), Tolerance(0.1, 0.6)
    for unit in ("rad", "s"):
        assert with_seam(sound, -0.5, unit, tolerance=absolute).passed
        assert not with_seam(sound, -0.5, unit, tolerance=relative).passed
    assert with_seam(sound, -0.5, "relative", tolerance=relative).passed
    assert with_seam(sound, None).passed
    found = with_seam(sound, -0.1)
    assert found.failures() == ["a - b: continuity"]
    assert found.describe("a - b: continuity") == "a - b: continuity: margin -0.1 rad (for all t)"
    assert found.location("a - b: continuity") == Location(time=1.0)
    assert found.as_dict()["seams"]["a - b"]["continuity"]["satisfied"] is False


def test_a_refused_move_fails_and_says_why(sound):
    found = with_seam(sound, refused={"on": "start: no place"})
    assert found.failures() == ["on: start"]
    assert found.describe("on: start") == "on: start: no place"
    assert found.location("on: start") == Location(move="on")
    fields = found.as_dict()
    assert fields["passed"] is False
    assert fields["moves"]["on"] == {
        "passed": False,
        "refused": "start: no place",
        "conditions": {},
    }
    assert repr(found) == "<CycleCertificate fails on: start: 3 moves, 1 junctions>"


def test_it_is_written_as_json(sound):
    fields = json.loads(json.dumps(sound.as_dict(), allow_nan=False))
    assert fields["passed"] is True
    assert fields["tolerance"] == {"absolute": 1e-6, "relative": 1e-6}
    assert list(fields["moves"]) == ["to_pick", "to_place", "back"]
    assert fields["moves"]["back"]["conditions"]["tube"]["satisfied"] is True
    junction = fields["seams"][SEAM]
    assert list(junction) == ["continuity", "dwell", "effort", "holding"]
    assert set(junction["dwell"]) == {"margin", "unit", "satisfied", "where", "coverage"}
    assert junction["dwell"]["margin"] == pytest.approx(0.0, abs=1e-12)
    assert junction["dwell"]["where"]["time"] == 2.0
    assert repr(sound) == "<CycleCertificate passed: 3 moves, 5 junctions>"


# A sound motion passes, and every defect fails in its own place alone.


def test_a_sound_motion_passes(sound):
    assert sound.failures() == []
    assert list(sound.moves) == ["to_pick", "to_place", "back"]
    assert list(sound.junctions) == [
        "start - to_pick",
        SEAM,
        "to_place - back",
        "back - end",
        "closed",
    ]
    # Pieces of a slow motion: the velocity of the quintic, by hand.
    widest = abs(PLACE - PICK).max() * 1.875 / 2.0
    margin = sound.moves["to_place"].conditions["velocity"].margin
    assert margin == pytest.approx(1 - widest / CYCLE.robot.limits.velocity[0])


def edited(rows, piece, joint, values, motion=MOTION):
    """Return the motion with other coefficients; piece 0 is to_pick, 1 its dwell, 2 to_place."""
    whole = motion.trajectory
    coefficients = whole.coefficients.copy()
    coefficients[rows, piece, joint] += values
    made = JointTrajectory(whole.joint_names, whole.breakpoints, coefficients)
    return CycleMotion(motion.cycle, made, motion.marks)


CREEPING = edited(-2, 1, 1, 1e-4)  # [rad/s]


def test_one_number_changed_fails_in_its_move_alone():
    """A quadratic term makes its end elsewhere."""
    found = failures(edited(-3, 2, 0, 0.05))
    assert {failure.split(":")[0] for failure in found} == {"to_place", "to_place - back"}
    assert "to_place: rest" in found
    assert "to_place - back: continuity" in found


def test_an_arm_that_moves_while_it_dwells_is_found():
    certificate = verify_cycle(CYCLE, CREEPING)
    assert certificate.failures() == [f"{SEAM}: continuity"]
    condition = certificate.junctions[SEAM]["continuity"]
    assert condition.margin == pytest.approx(-1e-4 * DWELL)
    assert (condition.where.joint, condition.where.time) == ("joint2", 2.0)
    loose = verify_cycle(CYCLE, CREEPING, Tolerance(1e-3, 1e-3))
    assert loose.passed
    assert loose.tolerance == Tolerance(1e-3, 1e-3)


def test_an_arm_that_goes_away_and_comes_back_while_it_dwells_is_found():
    swinging = edited(slice(-3, -1), 1, 0, [-1e-3, 1e-3 * DWELL])  # [rad/s^2, rad/s]
    np.testing.assert_allclose(swinging.trajectory.position(2.0 + DWELL), PICK, atol=1e-12)
    assert failures(swinging) == [f"{SEAM}: continuity"]


@pytest.mark.parametrize(("dwell", "piece"), [(DWELL, 1), (DWELL, 2), (0.0, 1)])
def test_a_jump_at_a_seam_is_found(dwell, piece):
    """The dwell, or what comes after it, or a move without one, begins elsewhere."""
    motion = slow_motion(pick_and_place(dwell=dwell))
    certificate = verify_cycle(motion.cycle, edited(-1, slice(piece, None), 1, 1e-3, motion))
    found = certificate.failures()
    assert f"{SEAM}: continuity" in found
    assert not [failure for failure in found if failure.startswith("to_p") and "tube" in failure]
    condition = certificate.junctions[SEAM]["continuity"]
    assert condition.margin == pytest.approx(-1e-3)
    assert condition.where.joint == "joint2"


def test_a_gap_of_a_sliding_joint_is_in_metres(tmp_path):
    (tmp_path / "rail.urdf").write_text(rail_arm())
    robot = load_robot(tmp_path / "rail.urdf", "flange")
    home, away = np.zeros(6), np.array([0.01, 0.005, 0.0, 0.0, 0.0, 0.0])
    there = np.array([0.3, 0.0, 0.2, 0.3, 0.0, 0.0])
    moves = [move(robot, "go", home, there), move(robot, "back", there, home)]
    cycle = Cycle(home, moves, closed=True)
    closed = verify_cycle(cycle, slow_motion(cycle, (home, there, away))).junctions["closed"]
    found = closed["continuity"]
    assert (found.unit, found.where.joint) == ("m", "rail")
    assert found.margin == pytest.approx(-0.01)


def test_a_motion_that_begins_elsewhere_than_the_cycle_fails_at_its_start():
    elsewhere = HOME + np.array([0.01, 0.0])
    motion = slow_motion(CYCLE, (elsewhere, PICK, PLACE, elsewhere))
    assert failures(motion) == ["to_pick: start", "back: goal"]
    motion = slow_motion(CYCLE, (elsewhere, PICK, PLACE, HOME))
    assert failures(motion) == ["to_pick: start", "closed: continuity"]
    assert verify_cycle(CYCLE, motion, Tolerance(0.02, 0.02)).passed


def test_a_cycle_that_does_not_close_is_found():
    motion = ending(HOME + np.array([0.0, 0.01]))
    certificate = verify_cycle(CYCLE, motion)
    assert certificate.failures() == ["back: goal", "closed: continuity"]
    expected = certificate.moves["back"].describe("goal")
    assert certificate.describe("back: goal") == f"back: {expected}"
    condition = certificate.junctions["closed"]["continuity"]
    assert (condition.margin, condition.where.joint) == (pytest.approx(-0.01), "joint2")
    assert failures(replace(motion, cycle=replace(CYCLE, closed=False))) == ["back: goal"]


def test_a_move_that_begins_where_its_problem_has_no_place_is_refused():
    """The part is let go where the next move's tube is not: its own margins tell nothing."""
    junctions = (HOME, PICK + np.array([1.2, 0.0]), PLACE, HOME)
    certificate = verify_cycle(CYCLE, slow_motion(CYCLE, junctions))
    assert not certificate.passed
    assert "to_place: start" in certificate.failures()
    assert "start" in certificate.describe("to_place: start")
    assert certificate.as_dict()["moves"]["to_place"]["passed"] is False


def test_places_are_those_of_the_whole_motion():
    """A motion too fast for the robot: where it is fastest, in the cycle's own time."""
    cycle = pick_and_place(planar_arm(limits=LimitOverrides(velocity=0.5)))
    certificate = verify_cycle(cycle, slow_motion(cycle))
    assert certificate.failures() == ["to_pick: velocity", "to_place: velocity", "back: velocity"]
    where = certificate.location("to_place: velocity")
    assert (where.move, where.joint) == ("to_place", "joint1")
    assert where.time == pytest.approx(2.0 + DWELL + 1.0)
    tube = certificate.moves["back"].conditions["tube"].where
    assert (tube.move, tube.segment) == ("back", 0)


def test_moves_that_pass_through_are_judged_together_and_each_has_its_places():
    """The second move's tube is so thin that a line in joint space leaves it."""
    robot = planar_arm()
    on = replace(move(robot, "on", PICK, PLACE, radius=0.005), passes_through=True)
    cycle = Cycle(HOME, [move(robot, "go", HOME, PICK, radius=0.1), on])
    certificate = verify_cycle(cycle, one_leg(cycle, PLACE, (0.75,)))
    assert list(certificate.moves) == ["go", "on"]
    assert certificate.moves["go"] is certificate.moves["on"]
    assert list(certificate.junctions) == ["start - go, on", "go, on - end"]
    assert "on: tube" in certificate.failures()
    where = certificate.location("on: tube")
    assert (where.move, where.segment) == ("on", 0)


# Dwells.


def test_a_dwell_may_be_longer_but_not_shorter_than_it_is_asked():
    longer, shorter = (pick_and_place(dwell=DWELL + change) for change in (-0.01, 0.01))
    assert failures(CycleMotion(longer, MOTION.trajectory, MOTION.marks)) == []
    certificate = verify_cycle(shorter, CycleMotion(shorter, MOTION.trajectory, MOTION.marks))
    assert certificate.failures() == [f"{SEAM}: dwell", "to_place - back: dwell"]
    condition = certificate.junctions["to_place - back"]["dwell"]
    assert condition.margin == pytest.approx(-0.01)
    assert (condition.unit, condition.where.time) == ("s", pytest.approx(4.0 + DWELL))
    assert "margin -0.01 s" in certificate.describe(f"{SEAM}: dwell")


def test_one_of_several_dwells_that_is_too_short_is_found_after_moves_that_pass_through():
    robot = planar_arm()
    through = replace(move(robot, "on", PICK, PLACE), passes_through=True)
    moves = [move(robot, "go", HOME, PICK), through]

    def dwelling(second):
        dwells = {"one": 0.2, "two": second, "three": 0.1}
        return Cycle(HOME, [*moves, *(Event(name, None, dwell) for name, dwell in dwells.items())])

    motion = one_leg(dwelling(0.3), PLACE, (1.0,))
    longer = replace(motion, cycle=dwelling(0.35))
    junction = verify_cycle(longer.cycle, longer).junctions["go, on - end"]["dwell"]
    assert junction.margin == pytest.approx(-0.05)
    assert junction.where.time == pytest.approx(2.2)


# Efforts at rest, against the torque of a weight at its distance, by hand.


def held(robot, *steps):
    """Return whether the motors hold what is taken or let go where a move ends."""
    cycle = Cycle(HOME, [move(robot, "go", HOME, PICK), *steps])
    return verify_cycle(cycle, one_leg(cycle)).junctions["go - end"]["effort"]


@pytest.mark.parametrize("then", [[], [Event("weigh", None, 0.1), Detach("mass")]])
def test_motors_hold_what_is_taken_or_are_found_too_weak(then):
    """Only while it is held it counts."""
    robot = planar_arm(GRAVITY)
    lever = robot.tool_position(PICK)[0] - np.array([0.0, 0.3 * np.cos(PICK[0])])  # horizontal [m]
    empty = robot.gravity_effort(PICK)
    fraction = 1 - abs(empty + 20.0 * 9.81 * lever) / robot.limits.effort
    found = held(robot, Attach("mass", weight(20.0)), *then)
    assert found.margin == pytest.approx(fraction.min(), abs=1e-9)
    assert found.where.joint == robot.joint_names[int(fraction.argmin())]
    assert found.margin < 0
    light = held(robot, Attach("mass", weight(0.0)), *then)
    assert light.margin == pytest.approx((1 - abs(empty) / robot.limits.effort).min())


@pytest.mark.parametrize(("sign", "limit"), [(1, 90.0), (-1, 40.0)])
def test_motors_hold_by_what_they_have_in_the_direction_that_gravity_asks(sign, limit):
    """A motor of another strength each way, one without limit, gravity one way and the other."""
    limits = LimitOverrides(effort={"joint1": [40.0, 90.0], "joint2": np.inf})
    robot = planar_arm((0.0, -9.81 * sign, 0.0), limits=limits)
    effort = robot.gravity_effort(PICK)[0]
    assert np.sign(effort) == sign
    found = held(robot)
    assert found.where.joint == "joint1"
    assert found.margin == pytest.approx(1 - abs(effort) / limit)


def test_motors_without_limits_hold_anything():
    assert held(planar_arm(GRAVITY, limits=LimitOverrides(effort=np.inf))).margin is None


def test_what_is_put_down_must_be_held_until_it_is():
    """Carried by a motion that counts no effort: what the seam asks is asked before the detach."""
    robot = planar_arm(GRAVITY)
    go = move(robot, "go", HOME, PICK)
    cycle = Cycle(HOME, [Attach("mass", weight(20.0)), go, Detach("mass")])
    assert {"start - go: effort", "go - end: effort"} <= set(failures(one_leg(cycle)))


DOWN = (0.0, 0.0, -9.81)  # the arm moves in the plane


def carried(mass, friction=0.4):
    """Return what takes a mass with a cup that is pressed from the side, and holds it so."""
    part = Payload(mass, (0.0, 0.0, 0.0))
    return Attach(
        "mass", part, holding=(Holding(Cup(60.0, 0.02, friction, normal=(1, 0, 0)), part),)
    )


@pytest.mark.parametrize("then", [[], [Event("weigh", None, 0.1), Detach("mass")]])
def test_contacts_hold_what_is_taken_while_the_arm_rests(then):
    """Friction carries the weight: just as taken, and just before it is let go."""
    cycle = Cycle(HOME, [move(planar_arm(DOWN), "go", HOME, PICK), carried(2.0), *then])
    certificate = verify_cycle(cycle, one_leg(cycle))
    condition = certificate.junctions["go - end"]["holding"]
    assert condition.margin == pytest.approx(1 - 2.0 * 9.81 / (0.4 * 60.0 / 1.5))
    assert condition.where.contact == "cup slides, at rest"
    assert certificate.junctions["start - go"]["holding"].margin is None
    assert "go - end: holding" in certificate.failures()
    assert certificate.describe("go - end: holding") == (
        "go - end: holding: margin -0.226 (cup slides, at rest, with and without what is taken or "
        "let go)"
    )
    light = Cycle(HOME, [move(planar_arm(DOWN), "go", HOME, PICK), carried(0.5), *then])
    assert "go - end: holding" not in verify_cycle(light, one_leg(light)).failures()


def test_legs_and_both_stops_hold_what_they_carry():
    robot = planar_arm(DOWN)
    steps = [carried(1.0), move(robot, "go", HOME, PICK), Detach("mass")]
    cycle = Cycle(HOME, [*steps, move(robot, "back", PICK, HOME)])
    certificate = verify_cycle(cycle, slow_motion(cycle, (HOME, PICK, HOME)))
    assert not [name for name in certificate.failures() if "holding" in name]
    margins = {
        name: conditions["holding"].margin for name, conditions in certificate.junctions.items()
    }
    assert {name for name, margin in margins.items() if margin is None} == {"back - end"}
    assert margins["start - go"] == pytest.approx(margins["go - back"])
    assert certificate.moves["back"].conditions["holding"].margin is None
    assert 0 < certificate.moves["go"].conditions["holding"].margin < margins["start - go"]


def test_what_is_no_cycle_or_no_motion_is_refused():
    with pytest.raises(ProblemError, match="the cycle is 'a'; give a Cycle"):
        verify_cycle("a", MOTION)
    with pytest.raises(TrajectoryError, match="the motion is 'a'; give a CycleMotion, as plan_cyc"):
        verify_cycle(CYCLE, "a")
