"""verify_cycle: each leg by `verify`, and the junctions."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import rest_to_rest
from rail_arm import rail_arm
from small_cycle import planned_cycle, small_cycle

from cycles import (
    DWELL,
    HOME,
    PICK,
    PLACE,
    ball,
    move,
    pick_and_place,
    planar_arm,
    slow_motion,
    weight,
)
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
    Obstacle,
    Place,
    ProblemError,
    Tolerance,
    TrajectoryError,
    load_robot,
    placement_of,
    verify_cycle,
)
from tubeplanner.cycle.cycle_motion import LegMotion, cycle_motion

# What a cycle's certificate says of what holds and what does not.


CYCLE = pick_and_place()
SOUND = verify_cycle(CYCLE, slow_motion(CYCLE))


def certificate(margin=0.0, unit="rad", refused=None, tolerance=None):
    """Return the sound certificate with one seam alone."""
    condition = JudgedCondition(margin, unit, Place(time=1.0), "for all t")
    seams = {"a - b": {"continuity": condition}}
    return CycleCertificate(SOUND.moves, seams, refused or {}, tolerance or Tolerance())


def test_a_seam_holds_within_the_tolerance_of_its_unit():
    for unit in ("rad", "s"):
        assert certificate(-0.5, unit, tolerance=Tolerance(0.6, 0.1)).passed
        assert not certificate(-0.5, unit, tolerance=Tolerance(0.1, 0.6)).passed
    assert certificate(-0.5, "relative", tolerance=Tolerance(0.1, 0.6)).passed
    assert certificate(None).passed
    found = certificate(-0.1)
    assert found.failures() == ["a - b: continuity"]
    assert found.describe("a - b: continuity") == "a - b: continuity: margin -0.1 rad (for all t)"


def test_a_refused_move_fails_and_says_why():
    found = certificate(refused={"on": "start: no place"})
    assert found.failures() == ["on: start"]
    assert found.describe("on: start") == "on: start: no place"
    fields = found.as_dict()
    assert fields["passed"] is False
    assert fields["moves"]["on"] == {
        "passed": False,
        "refused": "start: no place",
        "conditions": {},
    }
    assert repr(found) == "<CycleCertificate fails on: start: 3 moves, 1 seams>"


def test_a_move_that_fails_is_described_as_its_certificate_does():
    away = verify_cycle(CYCLE, slow_motion(CYCLE, (HOME, PICK, PLACE, HOME + 0.01)))
    assert away.failures() == ["back: goal", "closed: continuity"]
    expected = away.moves["back"].describe("goal")
    assert away.describe("back: goal") == f"back: {expected}"


def test_it_is_written_as_json():
    fields = json.loads(json.dumps(SOUND.as_dict(), allow_nan=False))
    assert fields["passed"] is True
    assert fields["tolerance"] == {"absolute": 1e-6, "relative": 1e-6}
    assert list(fields["moves"]) == ["to_pick", "to_place", "back"]
    assert fields["moves"]["back"]["conditions"]["tube"]["satisfied"] is True
    seam = fields["seams"]["to_pick - to_place"]
    assert list(seam) == ["continuity", "dwell", "effort"]
    assert set(seam["dwell"]) == {"margin", "unit", "satisfied", "where", "coverage"}
    assert seam["dwell"]["margin"] == pytest.approx(0.0, abs=1e-12)
    assert seam["dwell"]["where"]["time"] == 2.0
    failed = certificate(-0.1).as_dict()
    assert failed["seams"]["a - b"]["continuity"]["satisfied"] is False
    assert repr(SOUND) == "<CycleCertificate passed: 3 moves, 5 seams>"


# Where a cycle's certificate says that something does not hold.


@pytest.fixture(scope="module")
def failing():
    """Return the certificate of a motion in a narrower tube, a seam and a refusal added."""
    motion = planned_cycle().motion
    narrow = small_cycle(moves__beside__tube__radius=0.01)
    judged = verify_cycle(narrow, replace(motion, cycle=narrow))
    stay = replace(judged.seams["closed"]["continuity"], margin=-1.0, where=Place(time=1.5))
    seams = {**judged.seams, "closed": {"continuity": stay}}
    return replace(judged, seams=seams, refused={"back": "it begins nowhere"})


def test_every_failure_has_its_place(failing):
    places = {failure: failing.place(failure) for failure in failing.failures()}
    assert places["back: start"] == Place(move="back")
    assert places["closed: continuity"] == Place(time=1.5)
    assert (places["beside: tube"].move, places["beside: tube"].segment) == ("beside", 0)


# The judge of cycles: a sound motion passes, and every defect fails in its own place alone.


GRAVITY = (0.0, -9.81, 0.0)
MOTION = slow_motion(CYCLE)
SEAM = "to_pick - to_place"


def edited(change, motion=MOTION):
    """Return the motion with other coefficients, which a function changes in place."""
    coefficients = motion.trajectory.coefficients.copy()
    change(coefficients)
    whole = motion.trajectory
    made = JointTrajectory(whole.joint_names, whole.breakpoints, coefficients)
    return CycleMotion(motion.cycle, made, motion.marks)


def remarked(**times):
    """Return the motion with marks moved to other times, by their place in the list."""
    marks = [
        replace(mark, time=times.get(f"_{k}", mark.time)) for k, mark in enumerate(MOTION.marks)
    ]
    return CycleMotion(CYCLE, MOTION.trajectory, tuple(marks))


def failures(motion):
    return verify_cycle(motion.cycle, motion).failures()


def test_a_sound_motion_passes():
    certificate = verify_cycle(CYCLE, MOTION)
    assert certificate.failures() == []
    assert list(certificate.moves) == ["to_pick", "to_place", "back"]
    seams = ["start - to_pick", SEAM, "to_place - back", "back - end", "closed"]
    assert list(certificate.seams) == seams
    # Pieces of a slow motion: the velocity of the quintic, by hand.
    widest = abs(PLACE - PICK).max() * 1.875 / 2.0
    margin = certificate.moves["to_place"].conditions["velocity"].margin
    assert margin == pytest.approx(1 - widest / CYCLE.robot.limits.velocity[0])


def test_one_number_changed_fails_in_its_move_alone():
    """Piece 0 is to_pick, 1 its dwell, 2 to_place; its quadratic term makes its end elsewhere."""

    def bend(coefficients):
        coefficients[-3, 2, 0] += 0.05

    found = failures(edited(bend))
    assert {failure.split(":")[0] for failure in found} == {"to_place", "to_place - back"}
    assert "to_place: rest" in found
    assert "to_place - back: continuity" in found


def test_a_motion_that_begins_elsewhere_than_the_cycle_fails_at_its_start():
    elsewhere = HOME + np.array([0.01, 0.0])
    motion = slow_motion(CYCLE, (elsewhere, PICK, PLACE, elsewhere))
    assert failures(motion) == ["to_pick: start", "back: goal"]


def test_moves_and_seams_are_judged_with_the_tolerance_that_is_given():
    elsewhere = HOME + np.array([0.01, 0.0])
    motion = slow_motion(CYCLE, (elsewhere, PICK, PLACE, HOME))
    assert failures(motion) == ["to_pick: start", "closed: continuity"]
    assert verify_cycle(CYCLE, motion, Tolerance(0.02, 0.02)).passed


def test_places_are_those_of_the_whole_motion():
    """A motion too fast for the robot: where it is fastest, in the cycle's own time."""
    slow = planar_arm()
    limits = replace(slow.limits, velocity=np.full(2, 0.5))
    cycle = pick_and_place(slow.with_limits(limits, slow.motors))
    certificate = verify_cycle(cycle, slow_motion(cycle))
    assert certificate.failures() == ["to_pick: velocity", "to_place: velocity", "back: velocity"]
    where = certificate.moves["to_place"].conditions["velocity"].where
    assert (where.move, where.joint) == ("to_place", "joint1")
    assert where.time == pytest.approx(2.0 + DWELL + 1.0)
    tube = certificate.moves["back"].conditions["tube"].where
    assert (tube.move, tube.segment) == ("back", 0)


def test_an_arm_that_moves_while_it_dwells_is_found():
    def creep(coefficients):
        coefficients[-2, 1, 1] = 1e-4  # [rad/s]

    assert failures(edited(creep)) == [f"{SEAM}: continuity"]
    condition = verify_cycle(CYCLE, edited(creep)).seams[SEAM]["continuity"]
    assert condition.margin == pytest.approx(-1e-4 * DWELL)
    assert (condition.where.joint, condition.where.time) == ("joint2", 2.0)


def test_an_arm_that_goes_away_and_comes_back_while_it_dwells_is_found():
    def swing(coefficients):
        coefficients[-3:-1, 1, 0] = [-1e-3, 1e-3 * DWELL]  # [rad/s^2, rad/s]

    found = edited(swing)
    np.testing.assert_allclose(found.trajectory.position(2.0 + DWELL), PICK, atol=1e-12)
    assert failures(found) == [f"{SEAM}: continuity"]


@pytest.mark.parametrize("piece", [1, 2])
def test_a_jump_at_a_seam_is_found(piece):
    """The dwell, or what comes after it, begins elsewhere."""

    def jump(coefficients):
        coefficients[-1, piece:, 1] += 1e-3

    found = failures(edited(jump))
    assert f"{SEAM}: continuity" in found
    assert not [failure for failure in found if failure.startswith("to_p") and "tube" in failure]
    condition = verify_cycle(CYCLE, edited(jump)).seams[SEAM]["continuity"]
    assert condition.margin == pytest.approx(-1e-3)
    assert condition.where.joint == "joint2"


def test_a_jump_at_a_seam_at_which_the_arm_does_not_dwell_is_found():
    cycle = pick_and_place(dwell=0.0)
    assert failures(slow_motion(cycle)) == []

    def jump(coefficients):
        coefficients[-1, 1, 0] += 1e-3

    found = failures(edited(jump, slow_motion(cycle)))
    assert f"{SEAM}: continuity" in found


def test_a_dwell_that_is_too_short_is_found():
    cycle = pick_and_place(dwell=DWELL + 0.01)
    short = CycleMotion(cycle, MOTION.trajectory, MOTION.marks)
    certificate = verify_cycle(cycle, short)
    assert certificate.failures() == [f"{SEAM}: dwell", "to_place - back: dwell"]
    condition = certificate.seams["to_place - back"]["dwell"]
    assert condition.margin == pytest.approx(-0.01)
    assert (condition.unit, condition.where.time) == ("s", pytest.approx(4.0 + DWELL))
    assert "margin -0.01 s" in certificate.describe(f"{SEAM}: dwell")


def test_one_of_several_dwells_that_is_too_short_is_found_after_moves_that_pass_through():
    robot = planar_arm()
    through = replace(move(robot, "on", PICK, PLACE), passes_through=True)
    events = [Event("one", None, 0.2), Event("two", None, 0.3), Event("three", None, 0.1)]
    cycle = Cycle(HOME, [move(robot, "go", HOME, PICK), through, *events])
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, PLACE, 2.0), (1.0,))
    sound = cycle_motion(cycle, [leg])
    asked = replace(events[1], dwell=0.35)
    longer = replace(cycle, steps=[*cycle.steps[:3], asked, cycle.steps[4]])
    motion = CycleMotion(longer, sound.trajectory, sound.marks)
    seam = verify_cycle(longer, motion).seams["go, on - end"]["dwell"]
    assert seam.margin == pytest.approx(-0.05)
    assert seam.where.time == pytest.approx(2.2)


def test_a_longer_dwell_is_none_the_worse():
    cycle = pick_and_place(dwell=DWELL - 0.01)
    assert failures(CycleMotion(cycle, MOTION.trajectory, MOTION.marks)) == []


def test_a_gap_of_a_sliding_joint_is_in_metres(tmp_path):
    (tmp_path / "rail.urdf").write_text(rail_arm())
    robot = load_robot(tmp_path / "rail.urdf", "flange")
    home, away = np.zeros(6), np.array([0.01, 0.005, 0.0, 0.0, 0.0, 0.0])
    there = np.array([0.3, 0.0, 0.2, 0.3, 0.0, 0.0])
    cycle = Cycle(
        home, [move(robot, "go", home, there), move(robot, "back", there, home)], closed=True
    )
    closed = verify_cycle(cycle, slow_motion(cycle, (home, there, away))).seams["closed"]
    found = closed["continuity"]
    assert (found.unit, found.where.joint) == ("m", "rail")
    assert found.margin == pytest.approx(-0.01)


def test_a_part_taken_while_the_hand_comes_is_found():
    """A move that is said to end before the arm stands still does not end at rest."""
    found = failures(remarked(_1=1.9))
    assert "to_pick: rest" in found
    assert f"{SEAM}: continuity" in found


def test_a_cycle_that_does_not_close_is_found():
    away = HOME + np.array([0.0, 0.01])
    motion = slow_motion(CYCLE, (HOME, PICK, PLACE, away))
    assert failures(motion) == ["back: goal", "closed: continuity"]
    condition = verify_cycle(CYCLE, motion).seams["closed"]["continuity"]
    assert (condition.margin, condition.where.joint) == (pytest.approx(-0.01), "joint2")
    is_open = replace(CYCLE, closed=False)
    assert failures(slow_motion(is_open, (HOME, PICK, PLACE, away))) == ["back: goal"]


def lift(load, steps, q=PICK):
    """Return whether the motors hold what is taken or let go, by the name of the seam."""
    robot = planar_arm(GRAVITY)
    free = np.full(2, np.inf)
    quick = robot.with_limits(replace(robot.limits, velocity=free), robot.motors)
    cycle = Cycle(HOME, [move(quick, "go", HOME, q), *steps(load)])
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, q, 2.0))
    certificate = verify_cycle(cycle, cycle_motion(cycle, [leg]))
    return certificate.seams["go - end"]["effort"]


@pytest.mark.parametrize(
    "steps",
    [
        lambda load: [Attach("mass", load)],
        lambda load: [Attach("mass", load), Event("weigh", None, 0.1), Detach("mass")],
    ],
)
def test_motors_hold_what_is_taken_or_are_found_too_weak(steps):
    """Against the torque of a weight at its distance, by hand; only while it is held counts."""
    robot = planar_arm(GRAVITY)
    arm = robot.tool_position(PICK)[0]  # [m], horizontal, from joint 1
    elbow = arm - 0.3 * np.cos(PICK[0])
    empty = robot.gravity_effort(PICK)
    effort = empty + 20.0 * 9.81 * np.array([arm, elbow])
    share = 1 - abs(effort) / robot.limits.effort
    found = lift(weight(20.0), steps)
    assert found.margin == pytest.approx(share.min(), abs=1e-9)
    assert found.where.joint == robot.joint_names[int(share.argmin())]
    assert found.margin < 0
    light = lift(weight(0.0), steps)
    assert light.margin == pytest.approx((1 - abs(empty) / robot.limits.effort).min())


@pytest.mark.parametrize("way", [1, -1])
def test_motors_hold_by_what_they_have_in_the_direction_that_gravity_asks(way):
    """A motor of another strength each way, one without limit, gravity one way and the other."""
    given = LimitOverrides(effort={"joint1": [40.0, 90.0], "joint2": np.inf})
    robot = planar_arm((0.0, -9.81 * way, 0.0), limits=given)
    cycle = Cycle(HOME, [move(robot, "go", HOME, PICK)])
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, PICK, 2.0))
    seam = verify_cycle(cycle, cycle_motion(cycle, [leg])).seams["go - end"]["effort"]
    effort = robot.gravity_effort(PICK)[0]
    assert np.sign(effort) == way
    assert seam.where.joint == "joint1"
    assert seam.margin == pytest.approx(1 - abs(effort) / (90.0 if way > 0 else 40.0))


def test_motors_without_limits_hold_anything():
    limits = LimitOverrides(effort=np.inf)
    robot = planar_arm(GRAVITY, limits=limits)
    cycle = Cycle(HOME, [move(robot, "go", HOME, PICK)])
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, PICK, 2.0))
    seam = verify_cycle(cycle, cycle_motion(cycle, [leg])).seams["go - end"]["effort"]
    assert seam.margin is None


def test_what_is_put_down_must_be_held_until_it_is():
    """Carried by a motion that counts no effort: what the seam asks is asked before the detach."""
    heavy = weight(20.0)
    robot = planar_arm(GRAVITY)
    cycle = Cycle(HOME, [Attach("mass", heavy), move(robot, "go", HOME, PICK), Detach("mass")])
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, PICK, 2.0))
    certificate = verify_cycle(cycle, cycle_motion(cycle, [leg]))
    assert {"start - go: effort", "go - end: effort"} <= set(certificate.failures())


def test_a_part_that_was_put_in_the_way_is_hit():
    """The part stands where it was put down: the next move's hand passes through it."""
    robot = planar_arm()
    through = np.array([0.4, -0.9])
    part = ball(robot, PLACE)
    steps = [
        move(robot, "carry", PLACE, through, radius=0.3),
        Attach("part"),
        move(robot, "on", through, HOME, radius=0.3),
    ]
    made = Cycle(PLACE, steps, [part])
    motion = slow_motion(made, (PLACE, through, HOME))
    problem = made.problem(1, motion.seams)
    assert [each.name for each in problem.attached] == ["part"]
    low = Obstacle.sphere("post", 0.03, placement_of(robot.tool_position(HOME)))
    blocked = replace(made, obstacles=[part, low])
    found = failures(CycleMotion(blocked, motion.trajectory, motion.marks))
    assert found == ["on: obstacles"]


def test_moves_that_pass_through_are_judged_together():
    robot = planar_arm()
    on = replace(move(robot, "on", PICK, PLACE), passes_through=True)
    cycle = Cycle(HOME, [move(robot, "go", HOME, PICK), on])
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, PLACE, 2.0), (0.75,))
    certificate = verify_cycle(cycle, cycle_motion(cycle, [leg]))
    assert list(certificate.moves) == ["go", "on"]
    assert certificate.moves["go"] is certificate.moves["on"]
    assert list(certificate.seams) == ["start - go, on", "go, on - end"]


def test_a_place_in_a_leg_is_one_in_its_move():
    """The second move's tube is so thin that a line in joint space leaves it."""
    robot = planar_arm()
    on = replace(move(robot, "on", PICK, PLACE, radius=0.005), passes_through=True)
    cycle = Cycle(HOME, [move(robot, "go", HOME, PICK, radius=0.1), on])
    leg = LegMotion(rest_to_rest(robot.joint_names, HOME, PLACE, 2.0), (0.75,))
    certificate = verify_cycle(cycle, cycle_motion(cycle, [leg]))
    assert "on: tube" in certificate.failures()
    where = certificate.moves["go"].conditions["tube"].where
    assert (where.move, where.segment) == ("on", 0)


def test_a_move_that_begins_where_its_problem_has_no_place_is_refused():
    """The part is let go where the next move's tube is not: its own margins tell nothing."""
    seams = (HOME, PICK + np.array([1.2, 0.0]), PLACE, HOME)
    certificate = verify_cycle(CYCLE, slow_motion(CYCLE, seams))
    assert not certificate.passed
    assert "to_place: start" in certificate.failures()
    assert "start" in certificate.describe("to_place: start")
    assert certificate.as_dict()["moves"]["to_place"]["passed"] is False


def test_tolerances_are_those_that_are_given():
    def creep(coefficients):
        coefficients[-2, 1, 1] = 1e-4

    loose = verify_cycle(CYCLE, edited(creep), Tolerance(1e-3, 1e-3))
    assert loose.passed
    assert loose.tolerance == Tolerance(1e-3, 1e-3)


def test_what_is_no_cycle_or_no_motion_is_refused():
    with pytest.raises(ProblemError, match="the cycle is 'a'; give a Cycle"):
        verify_cycle("a", MOTION)
    with pytest.raises(TrajectoryError, match="the motion is 'a'; give a CycleMotion, as plan_cyc"):
        verify_cycle(CYCLE, "a")
