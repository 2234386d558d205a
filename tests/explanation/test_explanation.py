"""explain: reason of an infeasibility, remedies or headroom, in words."""

import json
import pickle
import shlex
from dataclasses import replace

import numpy as np
import pytest
import yaml
from asked_problems import PLANAR, POINTS, REMEDY, ROOM, asked
from gantry import ALONG, FIELDS, LENGTH, POST, gantry

from tubeplanner import Explanation, explain, load_problem, parse_problem, plan
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.explanation import trials as trials_module
from tubeplanner.explanation.in_vain_text import in_vain_text
from tubeplanner.explanation.setting_text import setting_text, tried_text
from tubeplanner.explanation.unposed import Unposed
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult

PROBLEM = parse_problem(PLANAR)
PLACE = Place(segment=1, joint="joint2")
APART = [{"joint2": [-2, -1]}, {"joint2": [0, 1]}, {}]
HEAD = 0.02  # of the gantry [m]
NEAREST = 0.2  # of the post, along x and along y, to where the tool starts [m]
DISTANCE = np.hypot(NEAREST, NEAREST) - HEAD
CLEARANCE = 0.4
# How far from the post's edge, along one axis and upwards, the clearance lets the tool be.
WIDE_APART = np.sqrt((CLEARANCE + HEAD) ** 2 - NEAREST**2)
ABOVE = np.sqrt((CLEARANCE + HEAD) ** 2 - 2 * NEAREST**2)
QUICK = PlanOptions(quality="fast")
GRAVITY, HEAD_MASS = 9.81, 1.0
PAYLOAD = {"mass": 0.5, "com": [0, 0, 0], "inertia": [0, 0, 0, 0, 0, 0]}
WIDER = "(up to eleven times)"
MOVED = "(moved by up to 1 m)"
TURNED = "(each joint by up to 1 rad or m)"


def unposed(**changes):
    """Return what is known of the planar problem with values by field path, dots as `__`."""
    question = asked({path.replace("__", "."): value for path, value in changes.items()})
    with pytest.raises(ProblemError) as raised:
        question.load()
    return Unposed.of(question, raised.value)


def test_an_end_outside_has_its_place_and_is_drawn():
    known = unposed(start={"joints": [0.2, 4.0]})
    assert known.message.startswith("start: joint 'joint2' at 4 is outside")
    assert (known.place.joint, known.place.segment, known.proved) == ("joint2", 0, None)
    np.testing.assert_array_equal(known.configuration, [0.2, 4.0])
    np.testing.assert_array_equal(known.drawn.tube.points, POINTS)
    assert [each.name for each in known.drawn.obstacles] == ["post.1"]
    known = unposed(start={"joints": [0.0, -0.5]})  # outside its segment: the tool is its place
    tool = known.drawn.robot.tool_position(np.array([[0.0, -0.5]]))[0]
    assert known.place.position == pytest.approx(tool)
    assert (known.place.segment, known.place.point) == (0, 0)
    np.testing.assert_array_equal(known.configuration, [0.0, -0.5])
    known = unposed(goal={"joints": [0.0, -0.5]})
    assert (known.place.segment, known.place.point) == (2, 3)
    np.testing.assert_array_equal(known.configuration, [0.0, -0.5])


def test_ranges_that_do_not_meet_are_proved_and_the_tube_is_drawn_without():
    for signs in (APART, {"joint2": [4, 5]}):
        known = unposed(tube__joint_signs=signs)
        assert known.proved is True
        assert known.message.endswith("proved: there is no motion")
        assert (known.place.joint, known.place.segment) == ("joint2", 0)
        assert known.drawn.tube.joint_ranges == ({}, {}, {})


def test_a_tube_is_drawn_without_what_it_contradicts():
    union = unposed(tube__joint_signs={"joint2": [4, 5]}, tube__visit="any")
    assert union.proved is None  # one capsule may be left out
    thick = unposed(tube__tool_radius=0.04)
    assert thick.drawn.tube.tool_radius == 0
    assert thick.drawn.tube.radius.tolist() == [0.03, 0.05, 0.05]
    none = unposed(tube__radius=-1.0)
    assert none.drawn is None
    assert none.place.joint is None
    with pytest.raises(ProblemError, match=r"no\.stl"):
        unposed(obstacles=[{"name": "part", "mesh": "no.stl"}])


def ended(status, **found):
    """Return an explanation of how planning ended."""
    result = PlanResult(status, "for a reason", PLACE, "refinement")
    return Explanation("name", PROBLEM, result, None, **found)


def test_a_problem_without_an_answer_says_where_and_why():
    found = ended(PlanStatus.UNREACHABLE, in_vain=("a",))
    assert (found.is_possible, found.succeeded) == (False, False)
    assert (found.status, found.message) == (PlanStatus.UNREACHABLE, "for a reason")
    assert found.place == PLACE
    fields = found.as_dict()
    assert (fields["where"]["joint"], fields["method"]) == ("joint2", "refinement")
    assert fields["in_vain"] == ["a"]
    helped = replace(found, remedies=(REMEDY,), tried=7)
    assert (helped.is_possible, helped.succeeded) == (False, True)
    fields = helped.as_dict()
    assert fields["remedies"] == [REMEDY.as_dict()]
    assert (fields["status"], fields["tried"], fields["stopped_by"]) == ("unreachable", 7, None)


def test_what_cannot_be_posed_is_bad_input():
    unposed = Unposed("start is not there", PLACE, True, None, PROBLEM)
    found = Explanation("name", None, None, unposed, stopped_by="time_limit")
    assert (found.status, found.message) == (PlanStatus.BAD_INPUT, "start is not there")
    assert (found.place, found.succeeded) == (PLACE, False)
    assert (found.drawn, found.configuration) == (PROBLEM, None)
    fields = found.as_dict()
    assert (fields["status"], fields["stopped_by"]) == ("bad_input", "time_limit")
    assert (fields["where"]["joint"], fields["proved"]) == ("joint2", True)


def test_a_problem_with_an_answer_has_room():
    found = ended(PlanStatus.SUCCESS, rooms=(ROOM,))
    assert found.is_possible and found.succeeded
    fields = found.as_dict()
    assert fields["room"] == [ROOM.as_dict()]
    assert fields["remedies"] == []
    json.dumps(fields, allow_nan=False)


def explained(path, changes=None, **others):
    return explain(path, changes=changes, options=QUICK, time_limit=1000.0, **others)


def require_known(before, after, known):
    """Check that the change is the known one, or up to 5 % more."""
    size, least = abs(np.subtract(after, before)).max(), abs(np.subtract(known, before)).max()
    assert least * (1 - 1e-5) <= size <= 1.05 * least


def remedy_of(found, word):
    """Return the one remedy whose text has a word."""
    (remedy,) = [each for each in found.remedies if word in each.text]
    return remedy


def require_certified(path, remedy, changes=None):
    """Check that the changes of a remedy do what it promises, with a plan of their own."""
    problem = load_problem(path, changes={**(changes or {}), **remedy.changes})
    result = plan(problem, PlanOptions(quality="fast", slack=0.0))
    assert result.duration == pytest.approx(remedy.duration, rel=1e-6)


@pytest.fixture(scope="module", autouse=True)
def planned_once():
    """Plan what several searches try only once."""
    known, plan_one = {}, trials_module.planned

    def planned(trial):
        key = pickle.dumps((trial.problem, replace(trial.options, time_limit=None)))
        if key not in known:
            known[key] = plan_one(trial)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trials_module, "planned", planned)
        yield


@pytest.fixture(scope="module")
def near_the_post(tmp_path_factory, shared):
    """The file of a problem that is too near to a post, and its explanation."""

    def found():
        path = gantry(tmp_path_factory.mktemp("near"), [POST])
        return path, explained(path, {"clearance": CLEARANCE})

    return shared("explained.near_the_post", found)


@pytest.mark.dear("tries changes that several tests look at")
def test_the_clearance_at_the_start_is_found(near_the_post):
    path, found = near_the_post
    assert found.status is PlanStatus.TUBE_BLOCKED
    assert found.stopped_by is None
    remedy = remedy_of(found, "clearance")
    assert (remedy.field, remedy.before) == ("clearance", CLEARANCE)
    require_known(CLEARANCE, remedy.after, DISTANCE)
    assert remedy.too_little > DISTANCE
    assert remedy.is_smallest
    require_certified(path, remedy, {"clearance": CLEARANCE})


@pytest.mark.dear("tries changes that several tests look at")
def test_how_far_an_obstacle_must_move_is_found(near_the_post):
    path, found = near_the_post
    known = {
        "in -x": (0, -(WIDE_APART - NEAREST)),
        "in +y": (1, WIDE_APART - NEAREST),
        "in -z": (2, -(ABOVE + 0.05)),
        "in +z": (2, ABOVE + 0.35),
        "in -y": (1, -(WIDE_APART + 0.4)),
    }
    for way, (axis, size) in known.items():
        remedy = remedy_of(found, way)
        assert remedy.field == "obstacles.post.position"
        moved = np.array(POST["position"], dtype=float)
        moved[axis] += size
        require_known(remedy.before, remedy.after, moved)
    assert not [each for each in found.remedies if "in +x" in each.text]
    require_certified(path, remedy_of(found, "in -x"), {"clearance": CLEARANCE})


@pytest.mark.dear("tries changes that several tests look at")
def test_the_cheapest_change_comes_first_and_what_helps_nothing_is_said(near_the_post):
    found = near_the_post[1]
    costs = [remedy.cost for remedy in found.remedies]
    assert costs == sorted(costs)
    assert found.remedies[0].text.startswith("clearance 400 -> ")
    vain = {"start", "start.joints", "tube.points.0", "tube.points.1", "tube.radius"}
    assert set(found.in_vain) == vain
    assert not {remedy.field for remedy in found.remedies} & vain


@pytest.mark.dear("tries many changes")
def test_the_effort_and_the_payload_that_gravity_allows_are_found(tmp_path):
    limits = FIELDS["robot"]["limits"] | {"effort": {"along": 100.0, "across": 12.0}}
    robot = FIELDS["robot"] | {"gravity": [0, -GRAVITY, 0], "limits": limits, "payload": PAYLOAD}
    path = gantry(tmp_path, robot=robot)
    found = explained(path)
    assert found.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    effort, payload = remedy_of(found, "across: "), remedy_of(found, "payload at most")
    require_known(12.0, effort.after, (HEAD_MASS + 0.5) * GRAVITY)
    require_known(0.5, payload.after, 12.0 / GRAVITY - HEAD_MASS)
    assert payload.text == f"payload at most {payload.after:g} kg"
    assert effort.text == f"across: {effort.after - 12:.3g} N more (12 -> {effort.after:g} N)"
    assert len(found.remedies) == 2
    assert found.in_vain == ("robot.limits.effort.along",)
    for remedy in found.remedies:
        require_certified(path, remedy)


def test_how_far_a_goal_is_out_of_reach_is_found(tmp_path):
    path = gantry(tmp_path, tube={"points": [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]], "radius": 0.01})
    found = explained(path)
    assert (found.status, found.place.point) == (PlanStatus.UNREACHABLE, 1)
    require_known([1.1, 0, 0], remedy_of(found, "in -x").after, [1, 0, 0])
    require_known([0, 1], remedy_of(found, "along: upper limit").after, [0, 1.1])
    assert remedy_of(found, "towards the arm's base").after == remedy_of(found, "in -x").after
    assert "tube.radius" in found.in_vain  # the goal is the point itself


def test_a_start_outside_a_limit_is_mended_at_either_end(tmp_path):
    path = gantry(tmp_path)
    changes = {"start.joints": [-0.03, 0.0], "tube.points.0": [-0.03, 0.0, 0.0]}
    found = explained(path, changes)
    assert (found.status, found.problem, found.result) == (PlanStatus.BAD_INPUT, None, None)
    assert found.message.startswith("start: joint 'along' at -0.03 is outside [0, 1]")
    start, limit = remedy_of(found, "on along"), remedy_of(found, "lower limit")
    assert start.text == f"start: {1000 * (start.after[0] + 0.03):.3g} mm on along"
    require_known([-0.03, 0], start.after, [0, 0])
    require_known([0, 1], limit.after, [-0.03, 1])
    require_certified(path, limit, changes)


@pytest.mark.dear("tries a hundred changes")
def test_a_duration_that_is_too_short_is_made_longer(tmp_path):
    path = gantry(tmp_path)
    found = explained(path, {"objective.duration": 0.5})
    assert found.status is PlanStatus.NO_TRAJECTORY
    remedy = remedy_of(found, "objective.duration")
    shortest = 2 * np.sqrt(LENGTH / ALONG)
    assert 0.99 * shortest < remedy.after < 1.02 * shortest + 0.05 * (shortest - 0.5)
    assert remedy.duration == pytest.approx(remedy.after)
    # The tube is too narrow, and efforts are no limit.
    assert not [each for each in found.remedies if "effort" in each.field]


@pytest.mark.dear("tries a hundred changes")
def test_a_problem_with_an_answer_has_its_room(tmp_path):
    path = gantry(tmp_path, [POST])
    found = explained(path, {"clearance": 0.05})
    assert found.is_possible
    assert found.remedies == found.in_vain == ()
    rooms = {room.text: room for room in found.rooms}
    (clearance,) = [room for room in found.rooms if room.field == "clearance"]
    assert clearance.after <= DISTANCE <= clearance.too_much
    require_known(0.05, clearance.too_much, DISTANCE)
    assert clearance.too_much - 0.05 <= 1.05 * (clearance.after - 0.05)
    assert clearance.is_exact
    away = rooms["move obstacle 'post' by 1 m in -x"]
    assert (away.after, away.too_much) == ([-1.3, 0.3, -0.15], None)
    assert {room.field for room in found.rooms} == {
        *("clearance", "obstacles.post.position", "tube.radius")
    }
    json.dumps(found.as_dict(), allow_nan=False)


def stopped_at(count, error):
    """Return a progress callback that raises when so many changes were tried."""
    seen = []

    def callback(progress):
        seen.append(progress.stage.startswith("tried"))
        if sum(seen) == count:
            raise error

    return callback


@pytest.fixture
def path(tmp_path):
    """The file of the gantry beside the post."""
    return gantry(tmp_path, [POST])


def test_ctrl_c_keeps_what_was_found(path):
    callback = stopped_at(7, KeyboardInterrupt)
    found = explained(path, {"clearance": CLEARANCE}, progress=callback)
    assert found.stopped_by == "interrupt"
    assert found.status is PlanStatus.TUBE_BLOCKED
    assert [remedy.field for remedy in found.remedies] == ["clearance"]
    assert not found.remedies[0].is_smallest
    assert found.succeeded
    room = explained(path, progress=stopped_at(3, KeyboardInterrupt))
    assert (room.stopped_by, room.is_possible, len(room.rooms)) == ("interrupt", True, 2)

    def at_once(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):  # before anything is known
        explained(path, progress=at_once)


def test_the_time_limit_keeps_what_was_found(path, monkeypatch):
    tried = []

    def limited(asked, plan_one=trials_module.planned):
        tried.append(asked)
        return plan_one(asked) if len(tried) < 8 else trials_module.Answer(is_cut_short=True)

    monkeypatch.setattr(trials_module, "planned", limited)
    found = explained(path, {"clearance": CLEARANCE})
    assert (found.stopped_by, found.tried) == ("time_limit", 7)
    assert [remedy.field for remedy in found.remedies] == ["clearance"]
    assert "obstacles.post.position" not in found.in_vain


@pytest.mark.parametrize("limit", [0.0, float("nan")])
def test_a_time_limit_that_is_none_is_refused(tmp_path, limit):
    with pytest.raises(OptionError, match=f"time_limit is {limit:g} s; it must be > 0"):
        explain(gantry(tmp_path), time_limit=limit)


@pytest.mark.slow  # tries changes of three segments
def test_the_radius_about_a_point_out_of_reach_is_found(tmp_path):
    beyond = 0.02
    points = [[0.0, 0.0, 0.0], [1 + beyond, 0.0, 0.0], [0.5, 0.0, 0.0]]
    path = gantry(tmp_path, tube={"points": points, "radius": [0.01, 0.05]})
    found = explained(path)
    assert (found.status, found.place.point) == (PlanStatus.UNREACHABLE, 1)
    radius = remedy_of(found, "segment 0: 10 -> ")
    assert radius.field == "tube.radius.0"
    require_known(0.01, radius.after, beyond)
    require_known(1.0, remedy_of(found, "along: upper limit").after[1], 1 + beyond - 0.01)
    texts = [each for each in found.remedies if "point 1 by" in each.text]
    (nearer,) = [each for each in texts if "in -x" in each.text]
    require_known(points[1], nearer.after, [1.01, 0, 0])
    assert "tube.radius.1" in found.in_vain
    require_certified(path, radius)


@pytest.mark.slow  # plans for a UR5 with change after change
def test_a_sign_that_keeps_a_ur5_on_one_side_is_freed():
    """And the effort is found that holds it at its start."""
    name, lift = "example:ur5/over_the_wall", "robot.limits.effort.shoulder_lift_joint"
    problem = load_problem(name)
    needed = abs(problem.robot.gravity_effort(np.array([problem.start]))[0, 1])
    found = explained(name, {lift: 25.0})
    assert found.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert found.place.joint == "shoulder_lift_joint"
    (remedy,) = found.remedies
    assert remedy.field == lift
    assert 25.0 < remedy.too_little < needed <= remedy.after <= 25 + 1.06 * (needed - 25)
    require_certified(name, remedy, {lift: 25.0})
    kept = {"elbow_joint": "+", "shoulder_pan_joint": [-1.2, -0.2]}
    found = explained(name, {"tube.joint_signs": kept})
    assert found.status is PlanStatus.UNREACHABLE
    first = found.remedies[0]
    assert first.field == "tube.joint_signs.shoulder_pan_joint"
    assert first.after == "0"
    require_certified(name, first)


@pytest.mark.parametrize(
    "value", [0.05, [1.0, -0.5], {"a": [float("inf"), -float("inf")]}, "it's", True, None, 1e-7]
)
def test_a_value_is_read_again(value):
    option, pair = shlex.split(setting_text({"a.b": value}))
    path, text = pair.split("=", 1)
    assert (option, path) == ("--set", "a.b")
    read = yaml.safe_load(text)
    assert float(read) == value if isinstance(value, float) else read == value


def test_what_was_not_narrowed_says_so():
    assert [tried_text(value, is_close=True) for value in ("", "3 mm")] == ["", "3 mm"]
    open_texts = [tried_text(value, is_close=False) for value in ("", "3 mm")]
    assert open_texts == ["(not narrowed)", "3 mm (not narrowed)"]


@pytest.mark.parametrize(
    ("paths", "text"),
    [
        ("tube.radius", f"radius of the tube as a whole {WIDER}"),
        ("tube.radius.2", f"radius of segment 2 {WIDER}"),
        (
            "tube.radius.3 clearance tube.radius.0 tube.radius.1 tube.radius.2",
            f"radius of segments 0-3 {WIDER}; clearance (down to 0)",
        ),
        ("tube.points.0 tube.points.2 tube.points.3", f"reference points 0, 2-3 {MOVED}"),
        ("obstacles.post.1.position", f"obstacle post.1 {MOVED}"),
        ("obstacles.a.position obstacles.b.position", f"obstacles a, b {MOVED}"),
        (
            " ".join(f"robot.limits.effort.joint{k}" for k in range(4)),
            f"effort of 4 joints {WIDER}",
        ),
        ("tube.joint_signs.elbow", "sign of elbow (any other)"),
        ("clearance.default", "clearance (down to 0)"),
        ("clearance.segments.1", "clearance of segment 1 (down to 0)"),
        ("clearance.pairs.0.clearance", "clearance of pair 0 (down to 0)"),
        ("tube.rotation_tolerance.0", "rotation tolerance of segment 0 (up to 3 rad more)"),
        ("goal.joints start.joints", f"goal {TURNED}; start {TURNED}"),
        ("some.other", "some.other"),
        ("", ""),
    ],
)
def test_changes_of_one_kind_are_told_together(paths, text):
    assert in_vain_text(paths.split()) == text
