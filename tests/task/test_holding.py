"""Cones of held parts: closed forms, forces of contacts by linear programs; checks of holdings."""

from dataclasses import replace

import numpy as np
import pytest
from placed_problem import bundled_fields
from scipy.optimize import linprog
from small_cycle import small_cycle

from tubeplanner import Payload, PlanOptions, parse_problem, plan_cycle
from tubeplanner.errors import ProblemError
from tubeplanner.output.files.fingerprint import differing_parts, part_hashes, task_hash
from tubeplanner.task.holding import Cup, Gripper, Holding, Liquid, Tray
from tubeplanner.task.info import problem_doubts

G = 9.81
_INERTIA = (1e-3, 8e-4, 5e-4, 1e-4, 0.0, 0.0)


def _wrench(holding, acceleration):
    """Return the wrench (6,) of a part that accelerates without turning, gravity included."""
    com = np.subtract(holding.part.com, holding.contact.position) @ holding.axes
    force = holding.part.mass * np.asarray(acceleration, dtype=float)
    return np.hstack([force, np.cross(com, force)])


def _margin(holding, wrench):
    return min(cone.margin(wrench[None])[0] for cone in holding.cones)


# ---- Closed forms.


@pytest.mark.parametrize(
    "force, acceleration",
    [
        (1362.4, (0, 0, -(G + 5))),  # Schmalz' case I: lifted from above
        (1822.4, (5, 0, -G)),  # II: moved horizontally
        (2724.9, (G + 5, 0, 0)),  # III: lifted at its side
    ],
)
def test_cups_hold_what_the_maker_says(force, acceleration):
    for factor, is_held in ((0.996, False), (1.004, True)):
        cup = Cup(factor * force, 1.0, 0.5, safety=1.5)
        holding = Holding(cup, Payload(61.33))
        assert (_margin(holding, _wrench(holding, acceleration)) > 0) == is_held


_PART = Payload(0.5, (0.0, 0.0, 0.05))
_TILT = np.radians(15)


@pytest.mark.parametrize(
    "contact, name, largest, direction",
    [
        (Tray(0.3, (0.08, 0.08), safety=1), "slides", 2.943, (1, 0, 0)),
        (Tray(0.5, (0.04, 0.04), safety=1), "tips", 3.924, (0, 1, 0)),
        (Tray(0.5, 0.02, safety=1), "tips", 3.924, (0.6, 0.8, 0)),
        (Liquid(_TILT), "spills", 2.6286, (0, 1, 0)),
        # A turntable, 0.5 m from its axis, at 2.4261 rad/s.
        (Tray(0.3, (0.08, 0.08), safety=1), "slides", 0.5 * 2.4261**2, (-1, 0, 0)),
        # A waiter whose tray leans by 15 degrees.
        (Tray(0.3, (0.08, 0.08), safety=1), "slides", 6.0586, (np.cos(_TILT), 0, np.sin(_TILT))),
    ],
)
def test_the_largest_acceleration_is_the_closed_form(contact, name, largest, direction):
    holding = Holding(contact, None if contact.kind == "liquid" else _PART)
    lean = np.arctan2(direction[2], direction[0]) if direction[2] else 0.0
    upwards = G * np.array([-np.sin(lean), 0, np.cos(lean)])
    for factor, is_held in ((0.996, True), (1.004, False)):
        wrench = _wrench(holding, upwards + factor * largest * np.array(direction))
        assert (_margin(holding, wrench) > 0) == is_held
        worst = min(holding.cones, key=lambda cone: cone.margin(wrench[None])[0])
        assert is_held or worst.name == name


def test_a_tray_keeps_a_share_of_the_weight():
    holding = Holding(Tray(0.3, 0.03, safety=1.2), _PART)
    falling = _wrench(holding, (0, 0, (1 - 1 / 1.2) * G))
    assert _margin(holding, falling) == pytest.approx(0, abs=1e-12)


def test_a_heavier_part_on_a_tray_changes_no_margin():
    light, heavy = (Holding(Tray(0.3, (0.04, 0.06)), replace(_PART, mass=m)) for m in (0.1, 3.0))
    margins = [
        [cone.margin(_wrench(each, (1.0, 2.0, 8.0))[None])[0] for cone in each.cones]
        for each in (light, heavy)
    ]
    np.testing.assert_allclose(*margins)


# ---- Soundness: what passes is carried by forces at points, each in its cone of friction.

_SIDES = 24
_ANGLES = 2 * np.pi * np.arange(_SIDES) / _SIDES
_ROUND = 1 / np.cos(np.pi / _SIDES)  # polygons about circles


def _is_carried(wrench, points, friction, signs=None, sums=None):
    """Return True if forces at points (M, 3) add up to a wrench (6,).

    They press along the normal, or along it times a sign for each point; then the normal forces of
    both signs have sums, in place of the wrench's normal force.
    """
    signs = np.ones(len(points)) if signs is None else signs
    forces = np.array(
        [(friction * np.cos(a), friction * np.sin(a), s) for s in signs for a in _ANGLES]
    )
    columns = np.hstack([forces, np.cross(np.repeat(points, _SIDES, axis=0), forces)]).T
    if sums is not None:
        is_first = np.repeat(signs > 0, _SIDES)
        columns = np.vstack([columns[[0, 1, 3, 4, 5]], is_first, ~is_first])
        wrench = [*wrench[[0, 1, 3, 4, 5]], *sums]
    return linprog(np.zeros(columns.shape[1]), A_eq=columns, b_eq=wrench).status == 0


def _contacts():
    """Return names, contacts with safety 1, and their points (M, 3)."""
    ring = np.array([(np.cos(a), np.sin(a), 0.0) for a in _ANGLES]) * _ROUND
    for friction, a, b in ((0.3, 0.04, 0.04), (0.6, 0.08, 0.03)):
        corners = np.array([(x * a / 2, y * b / 2, 0) for x in (1, -1) for y in (1, -1)])
        yield f"tray {friction}", Tray(friction, (a, b), safety=1), corners
        yield f"gripper {friction}", Gripper(30.0, friction, (a, b), 0.05, safety=1), corners
    yield "disc", Tray(0.4, 0.02, safety=1), 0.02 * ring
    yield "cup", Cup(42.4, 0.015, 0.5, safety=1), 0.015 * ring


def _sizes(holding):
    """Return the size of wrenches (6,) that a contact carries about."""
    contact, weight = holding.contact, holding.part.mass * G
    press = weight if contact.kind == "tray" else getattr(contact, "force", weight)
    numbers = [getattr(contact, name, 0.0) for name in ("foot", "pad", "radius")]
    arm = max(np.max(each) for each in numbers)
    mu = contact.friction
    return np.array([mu, mu, 1, arm, arm, mu * arm]) * np.array([press] * 6)


@pytest.mark.parametrize("com", [(0.0, 0.0, 0.05), (0.0, 0.0, 0.006), (0.004, -0.003, 0.03)])
@pytest.mark.parametrize("inertia", [(0.0,) * 6, _INERTIA])
@pytest.mark.parametrize(("name", "contact", "points"), list(_contacts()))
def test_no_wrench_that_passes_needs_more_friction_than_there_is(
    name, contact, points, inertia, com
):
    if contact.kind == "gripper":
        com = (com[2], com[0], com[1])  # the tool frame's x is the closing direction
    holding = Holding(contact, Payload(0.7, com, inertia))
    random, mass = np.random.default_rng(7), holding.part.mass
    sizes, count = _sizes(holding), 0
    own = _wrench(holding, (0, 0, G if contact.kind == "tray" else 0.0))
    middle = np.subtract(com, contact.position) @ holding.axes
    for _ in range(60):
        change = random.normal(size=6) * sizes * random.integers(0, 2, 6)
        if not any(inertia):  # no moment but that of the force
            change[3:] = np.cross(middle, change[:3])
        if not change.any():
            continue
        low, high = 0.0, 4.0
        for _ in range(30):
            half = (low + high) / 2
            low, high = (half, high) if _margin(holding, own + half * change) > 0 else (low, half)
        wrench, count = own + 0.9999 * low * change, count + 1
        friction = 1.001 * contact.friction * _ROUND
        if contact.kind == "gripper":
            sums = holding.contact.force + np.array([1, -1]) * wrench[2] / 2
            for width in (0.0, 0.02, 0.1):
                sides = [points + np.array([0, 0, sign * width / 2]) for sign in (-1, 1)]
                signs = np.repeat([1.0, -1.0], len(points))
                assert _is_carried(wrench, np.vstack(sides), friction, signs, sums), width
        else:
            pull = contact.force if contact.kind == "cup" else 0.0
            wrench[2] += pull
            assert _is_carried(wrench, points, friction), (name, wrench)
            beyond = own + 1.03 * low * change + [0, 0, pull, 0, 0, 0]
            is_exact = not any(inertia) and (contact.kind == "tray" or com[0] == 0)
            if is_exact and low < 3.99:
                assert not _is_carried(beyond, points, friction), (name, mass)
        if count == 15:
            break
    assert count == 15


# ---- The fields of files.

_PROBLEM = "ur10/onto_a_conveyor"  # its tool points down
_HELD = {"mass": 1.0, "com": [0, 0, 0.03], "inertia": [1e-3] * 3 + [0] * 3}
_CUP = {"force": 42.4, "radius": 0.015, "friction": 0.5}
_FLAT = {"friction": 0.3, "foot": [0.04, 0.04]}


def _read(holding, /, **changes):
    fields = bundled_fields(_PROBLEM) | ({} if holding is None else {"holding": holding})
    return parse_problem(fields, f"robots/{_PROBLEM.split('/')[0]}", changes=changes)


def test_a_cup_has_a_force_and_a_radius_or_a_vacuum_and_a_diameter():
    (holding,) = _read({"part": _HELD, "cup": _CUP}).holding
    assert holding.contact == Cup(42.4, 0.015, 0.5) and holding.part.com == (0, 0, 0.03)
    (other,) = _read(
        {"part": _HELD, "cup": {"vacuum": 60000, "diameter": 0.03, "friction": 0.5}}
    ).holding
    assert other.contact.force == pytest.approx(42.41, abs=0.005)
    assert other.contact.radius == 0.015


@pytest.mark.parametrize(
    "holding, message",
    [
        ({"part": _HELD, "cup": _CUP, "tray": _FLAT}, "exactly one of .* it has cup, tray"),
        ({"part": _HELD}, "exactly one of cup, tray, gripper, liquid; it has none"),
        ({"cup": _CUP}, r"holding\.part is required"),
        ({"part": _HELD, "suction": _CUP}, "unknown key 'suction'; there is: part, cup, tray"),
        ({"part": _HELD, "cup": _CUP | {"pull": 1}}, r"holding\.cup: unknown key 'pull'"),
        ({"part": _HELD, "cup": _CUP | {"safety": 0.9}}, "cup.safety is 0.9; 1 to 100 are"),
        (
            [{"part": _HELD, "cup": _CUP | {"friction": 0}}],
            r"holding\[0\].cup.friction is 0; 0.001",
        ),
        ({"part": _HELD, "cup": _CUP | {"radius": 20}}, "radius is 20 m; 1e-05 to 10 m are acc"),
        ({"part": _HELD, "cup": _CUP | {"diameter": 1}}, "cup: radius and diameter are both given"),
        ({"part": _HELD, "cup": {"radius": 1, "friction": 1}}, "force and vacuum are both missing"),
        ({"part": _HELD, "tray": _FLAT | {"foot": [0.1]}}, "foot .* two lengths, or a number, the"),
        ({"part": _HELD | {"mass": 0}, "cup": _CUP}, r"holding\.part.mass is 0 kg"),
        ({"part": _HELD | {"mass": -1}, "cup": _CUP}, r"holding\.part.mass -1 kg must be from 0"),
        ({"part": _HELD | {"mass": 8}, "cup": _CUP}, "8 kg, more than robot.payload, 7.5 kg"),
        ({"part": _HELD, "tray": _FLAT | {"normal": [0, 0, -1]}}, "com is 30 mm below the tray"),
        ({"part": _HELD, "tray": _FLAT | {"position": [0.02, 0, 0]}}, "com is at x -20 mm, y 0 mm"),
        ({"part": _HELD, "liquid": {"tilt": 0.3}}, r"holding\.part does not go with a liquid"),
        ({"liquid": {"tilt": 2}}, "liquid.tilt is 2 rad; 0.001 to 1.5 rad are accepted"),
        (
            {"part": _HELD, "tray": _FLAT},
            "start: .* slides off at rest: the tray's normal is 180.0 ",
        ),
        (
            {"part": _HELD, "cup": _CUP | {"force": 10}},
            "start: .* off at rest: it takes 47.2 % more",
        ),
        (3, "holding is 3; it must be a map with part and cup, tray, gripper or liquid, or a list"),
    ],
)
def test_what_cannot_hold_is_refused_by_field_and_bound(holding, message):
    with pytest.raises(ProblemError, match=message):
        _read(holding)


def test_a_tray_takes_gravity():
    up = {"part": _HELD | {"com": [0, 0, -0.03]}, "tray": _FLAT | {"normal": [0, 0, -1]}}
    assert len(_read(up).holding) == 1
    with pytest.raises(ProblemError, match=r"a tray takes gravity, and robot.gravity is"):
        _read(up, **{"robot.gravity": [0, 0, 0]})


def test_field_paths_reach_a_contact_and_null_removes_it():
    cup = {"part": _HELD, "cup": _CUP}
    assert _read(cup, **{"holding.cup.force": 50}).holding[0].contact.force == 50
    assert _read([cup], **{"holding.0.cup.friction": 0.4}).holding[0].contact.friction == 0.4
    assert _read(cup, **{"holding": None}).holding == ()


def test_a_part_without_inertia_or_reserve_is_noted():
    notes = problem_doubts(_read({"part": {"mass": 1.0}, "cup": _CUP | {"safety": 1.0}}))
    assert "holding.cup.safety is 1: a motion that just holds the part loses it" in notes[-2]
    assert notes[-2].endswith("1.5 is usual")
    assert notes[-1].startswith("holding.part.inertia is not given: the part counts as a point")


def test_hashes_differ_with_what_is_held_and_stay_without():
    without, held = _read(None), _read({"part": _HELD, "cup": _CUP})
    firmer = _read({"part": _HELD, "cup": _CUP}, **{"holding.cup.force": 42.5})
    assert len({task_hash(each) for each in (without, held, firmer)}) == 3
    assert differing_parts(held, part_hashes(without)) == ["holding"]
    assert task_hash(_read({"part": _HELD, "cup": _CUP})) == task_hash(held)
    assert repr(held).endswith(", holding: cup>")


# ---- Cycles.

_GRIP = {"force": 50, "friction": 0.5, "pad": [0.02, 0.02]}


def test_what_is_attached_is_held_until_it_is_detached():
    cycle = small_cycle(moves__2__holding={"gripper": _GRIP})
    legs = [cycle.problem_from_anywhere(k) for k in range(len(cycle.legs))]
    assert [len(each.holding) for each in legs] == [0, 1, 0]
    (holding,) = legs[1].holding
    # The part is the attached payload.
    assert holding.part == Payload(0.5, (0, 0, 0), (0.001, 0.001, 0.001, 0, 0, 0))
    before, after = cycle.stop_at(1), cycle.stop_at(2)
    assert [len(each) for each in before.holdings] == [0, 0, 1]
    assert [len(each) for each in after.holdings] == [1, 1, 0]
    assert task_hash(cycle) != task_hash(small_cycle())


def test_a_part_of_an_attached_object_is_at_most_its_payload():
    part = {"mass": 0.3, "com": [0, 0, 0.01]}
    cycle = small_cycle(moves__2__holding={"part": part, "gripper": _GRIP})
    assert cycle.problem_from_anywhere(1).holding[0].part == Payload(0.3, (0, 0, 0.01))
    with pytest.raises(ProblemError, match=r"'part': holding.part.mass is 0.6 kg, more than its"):
        small_cycle(moves__2__holding={"part": part | {"mass": 0.6}, "gripper": _GRIP})
    with pytest.raises(ProblemError, match=r"'part': holding.gripper.friction is 0; 0.001 to 10"):
        small_cycle(moves__2__holding={"gripper": _GRIP | {"friction": 0}})


def test_a_move_holds_what_its_own_field_says():
    held = [{"liquid": {"tilt": 0.3}}]
    cycle = small_cycle(moves__3__holding=held, moves__4__holding=held)
    assert [len(cycle.problem_from_anywhere(k).holding) for k in range(3)] == [0, 1, 0]
    with pytest.raises(ProblemError, match=r"pass_through: holding differs from the move's before"):
        small_cycle(moves__3__holding=held)


@pytest.mark.slow
def test_a_cycle_holds_what_it_carries():
    # Weaker fingers take longer, 50 N hardly so.
    durations = []
    for force in (12, 50):
        cycle = small_cycle(moves__2__holding={"gripper": _GRIP | {"force": force}})
        result = plan_cycle(cycle, PlanOptions(quality="fast", slack=0.0))
        assert result.succeeded, result.message
        durations.append(result.duration)
    assert durations[1] < durations[0] < 1.05 * durations[1]
