"""explain: reason of an infeasibility, remedies or headroom, in words."""

import json
import shlex
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import pytest
import yaml
from asked_problems import PLANAR, POINTS, REMEDY, asked
from gantry import FIELDS, POST, gantry

from tubeplanner import Explanation, explain, load_problem, parse_problem, plan
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Location, PlanStatus, TimeLimitReached
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies import remedies as trials_module
from tubeplanner.studies.explanation import InvalidProblem, ineffective_text, setting_text

PROBLEM = parse_problem(PLANAR)
PLACE = Location(segment=1, joint="joint2")
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
MOVED_POST = "move obstacle 'post'"
WIDER = "(up to eleven times)"
MOVED = "(moved by up to 1 m)"
TURNED = "(each joint by up to 1 rad or m)"


def invalid(**changes):
    """Return what is known of the planar problem with values by field path, dots as `__`."""
    question = asked({path.replace("__", "."): value for path, value in changes.items()})
    with pytest.raises(ProblemError) as raised:
        question.load()
    return InvalidProblem.of(question, raised.value)


def test_an_end_outside_has_its_place_and_is_drawn():
    known = invalid(start={"joints": [0.2, 4.0]})
    assert known.message.startswith("start: joint 'joint2' at 4 is outside")
    assert (known.location.joint, known.location.segment, known.proved) == ("joint2", 0, None)
    np.testing.assert_array_equal(known.configuration, [0.2, 4.0])
    np.testing.assert_array_equal(known.drawn.tube.points, POINTS)
    assert [each.name for each in known.drawn.obstacles] == ["post.1"]
    known = invalid(goal={"joints": [0.0, -0.5]})  # outside its segment: the tool is its place
    tool = known.drawn.robot.tool_position(np.array([[0.0, -0.5]]))[0]
    assert known.location.position == pytest.approx(tool)
    assert (known.location.segment, known.location.point) == (2, 3)
    np.testing.assert_array_equal(known.configuration, [0.0, -0.5])
    assert invalid(start={"joints": [0.0, -0.5]}).location.point == 0


def test_ranges_that_do_not_meet_are_proved_and_the_tube_is_drawn_without():
    for signs in (APART, {"joint2": [4, 5]}):
        known = invalid(tube__joint_signs=signs)
        assert known.message.endswith("proved: there is no motion")
        assert (known.location.joint, known.location.segment, known.proved) == ("joint2", 0, True)
        assert known.drawn.tube.joint_ranges == ({}, {}, {})
    union = invalid(tube__joint_signs={"joint2": [4, 5]}, tube__visit="any")
    assert union.proved is None  # one capsule may be left out
    assert invalid(tube__tool_radius=0.04).drawn.tube.tool_radius == 0
    assert invalid(tube__radius=-1.0).drawn is None
    with pytest.raises(ProblemError, match=r"no\.stl"):
        invalid(obstacles=[{"name": "part", "mesh": "no.stl"}])


def test_a_problem_without_an_answer_says_where_and_why():
    result = PlanResult(PlanStatus.UNREACHABLE, "for a reason", PLACE, "refinement")
    found = Explanation("name", PROBLEM, result, None, ineffective=("a",))
    assert (found.is_possible, found.succeeded) == (False, False)
    assert (found.status, found.message, found.location) == ("unreachable", "for a reason", PLACE)
    helped = replace(found, remedies=(REMEDY,), tried=7)
    assert (helped.is_possible, helped.succeeded) == (False, True)
    fields = helped.as_dict()
    assert (fields["where"]["joint"], fields["method"]) == ("joint2", "refinement")
    assert (fields["in_vain"], fields["remedies"]) == (["a"], [REMEDY.as_dict()])
    assert (fields["status"], fields["tried"], fields["stopped_by"]) == ("unreachable", 7, None)


def test_what_cannot_be_posed_is_bad_input():
    invalid = InvalidProblem("start is not there", PLACE, True, None, PROBLEM)
    found = Explanation("name", None, None, invalid, stopped_by="time_limit")
    assert (found.message, found.location, found.succeeded) == ("start is not there", PLACE, False)
    assert (found.drawn, found.configuration) == (PROBLEM, None)
    fields = found.as_dict()
    assert (fields["status"], fields["stopped_by"]) == ("bad_input", "time_limit")
    assert (fields["where"]["joint"], fields["proved"]) == ("joint2", True)


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


@pytest.fixture(scope="module")
def near_the_post(tmp_path_factory, shared):
    """The file of a problem that is too near to a post, and its explanation."""

    def found():
        path = gantry(tmp_path_factory.mktemp("near"), [POST])
        return path, explained(path, {"clearance": CLEARANCE})

    return shared("explained.near_the_post", found)


@pytest.mark.dear("tries changes that several tests look at")
def test_the_clearance_at_the_start_is_the_cheapest_and_what_helps_nothing_is_said(near_the_post):
    path, found = near_the_post
    assert (found.status, found.stopped_by) == (PlanStatus.TUBE_BLOCKED, None)
    costs = [each.cost for each in found.remedies]
    assert costs == sorted(costs)
    vain = {"start", "start.joints", "goal.tolerance", "tube.points.1", "tube.radius"}
    assert set(found.ineffective) == vain
    assert not {each.field for each in found.remedies} & vain
    remedy = found.remedies[0]
    assert remedy.text.startswith("clearance 400 -> ")
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
        (remedy,) = [
            each
            for each in found.remedies
            if each.text.split(" by ")[0] == MOVED_POST and each.text.endswith(way)
        ]
        assert remedy.field == "obstacles.post.position"
        moved = np.array(POST["position"], dtype=float)
        moved[axis] += size
        require_known(remedy.before, remedy.after, moved)
    assert not [each for each in found.remedies if "'post'" in each.text and "+x" in each.text]
    require_certified(path, remedy_of(found, "in -x"), {"clearance": CLEARANCE})
    start = remedy_of(found, "in +x")  # the start moves with its point
    assert start.text == "move reference point 0 by 172 mm in +x; start: its joints as a seed"
    require_certified(path, start, {"clearance": CLEARANCE})


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
    assert found.ineffective == ("robot.limits.effort.along",)
    for remedy in found.remedies:
        require_certified(path, remedy)


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
def test_a_problem_with_an_answer_has_its_room(tmp_path):
    path = gantry(tmp_path, [POST])
    found = explained(path, {"clearance": 0.05})
    assert (found.is_possible, found.remedies, found.ineffective) == (True, (), ())
    headrooms = {headroom.text: headroom for headroom in found.headrooms}
    (clearance,) = [headroom for headroom in found.headrooms if headroom.field == "clearance"]
    assert clearance.after <= DISTANCE
    require_known(0.05, clearance.too_much, DISTANCE)
    assert clearance.too_much - 0.05 <= 1.05 * (clearance.after - 0.05)
    assert clearance.is_exact
    away = headrooms["move obstacle 'post' by 1 m in -x"]
    assert (away.after, away.too_much) == ([-1.3, 0.3, -0.15], None)
    assert {headroom.field for headroom in found.headrooms} == {
        *("clearance", "obstacles.post.position", "tube.radius")
    }
    fields = found.as_dict()
    assert fields["room"] == [headroom.as_dict() for headroom in found.headrooms]
    json.dumps(fields, allow_nan=False)


@pytest.mark.slow  # plans with change after change
def test_a_duration_is_a_multiple_of_the_period_and_the_shortest_that_is_planned(tmp_path):
    path, period = gantry(tmp_path), 0.04
    changes = {"period": period, "objective": {"duration": 0.4}}
    found = explained(path, changes)
    remedy = next(each for each in found.remedies if each.field == "objective.duration")
    least = plan(load_problem(path, changes={"period": period}), replace(QUICK, slack=0.0)).duration
    assert remedy.after == remedy.duration == pytest.approx(least, rel=1e-9)
    assert remedy.too_little == pytest.approx(least - period)
    odd = explained(path, {"period": period, "objective": {"duration": least + 0.01}})
    assert [(each.field, each.after) for each in odd.remedies] == [
        ("objective.duration", pytest.approx(least + period))
    ]


@pytest.mark.slow  # moves four points, one by one and together
def test_the_places_above_and_at_the_target_move_together(tmp_path):
    points = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 1.2, 0.0], [0.6, 1.2, 0.0]]
    goal = {"position": [0.6, 1.2, 0.0], "tolerance": 0.001}
    path = gantry(tmp_path, tube={"points": points, "radius": 0.01}, goal=goal, period=0.01)
    found = explained(path)
    assert found.status is PlanStatus.UNREACHABLE
    remedy = remedy_of(found, "in -y")
    assert remedy.text.startswith("move points 2-3 together by ")
    require_known(remedy.before, remedy.after, np.subtract(points[2:], [0, 0.2 - 0.001, 0]))
    require_certified(path, remedy)


def test_no_call_is_waited_for_beyond_the_time_limit(path):
    class Slow(Executor):
        def submit(self, function, *arguments):
            return Future()  # never done

    found = explain(path, changes={"clearance": CLEARANCE}, time_limit=0.5, executor=Slow())
    assert (found.stopped_by, found.tried, found.remedies) == ("time_limit", 0, ())


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
    assert [remedy.field for remedy in found.remedies] == ["clearance"]
    assert (found.remedies[0].is_smallest, found.succeeded) == (False, True)
    headroom = explained(path, progress=stopped_at(3, KeyboardInterrupt))
    assert (headroom.stopped_by, headroom.is_possible, len(headroom.headrooms)) == (
        "interrupt",
        True,
        2,
    )


def test_the_time_limit_keeps_what_was_found(path, monkeypatch):
    tried = []

    def limited(asked, plan_one=trials_module.planned_duration):
        tried.append(asked)
        if len(tried) >= 8:
            raise TimeLimitReached
        return plan_one(asked)

    monkeypatch.setattr(trials_module, "planned_duration", limited)
    found = explained(path, {"clearance": CLEARANCE})
    assert (found.stopped_by, found.tried) == ("time_limit", 7)
    assert [remedy.field for remedy in found.remedies] == ["clearance"]
    assert "obstacles.post.position" not in found.ineffective


@pytest.mark.slow  # tries changes of three segments
def test_the_radius_about_a_point_out_of_reach_is_found(tmp_path):
    beyond = 0.02
    points = [[0.0, 0.0, 0.0], [1 + beyond, 0.0, 0.0], [0.5, 0.0, 0.0]]
    path = gantry(tmp_path, tube={"points": points, "radius": [0.01, 0.05]})
    found = explained(path)
    assert (found.status, found.location.point) == (PlanStatus.UNREACHABLE, 1)
    radius = remedy_of(found, "segment 0: 10 -> ")
    assert radius.field == "tube.radius.0"
    require_known(0.01, radius.after, beyond)
    require_known(1.0, remedy_of(found, "along: upper limit").after[1], 1 + beyond - 0.01)
    assert "tube.radius.1" in found.ineffective
    require_certified(path, radius)


@pytest.mark.slow  # plans for a UR5 with change after change
@pytest.mark.study
def test_a_sign_that_keeps_a_ur5_on_one_side_is_freed():
    name, kept = (
        "example:ur5/over_the_wall",
        {"elbow_joint": "+", "shoulder_pan_joint": [-1.2, -0.2]},
    )
    found = explained(name, {"tube.joint_signs": kept})
    assert found.status is PlanStatus.UNREACHABLE
    first = found.remedies[0]
    assert first.field == "tube.joint_signs.shoulder_pan_joint"
    assert first.after == "0"
    require_certified(name, first)


@pytest.mark.parametrize(
    "value", [1, "none", "-", {"a": [np.inf, -np.inf]}, "it's", True, None, 1e-7]
)
def test_a_value_is_read_again(value):
    option, pair = shlex.split(setting_text({"a.b": value}))
    path, text = pair.split("=", 1)
    assert (option, path) == ("--set", "a.b")
    read = yaml.safe_load(text)
    assert float(read) == value if isinstance(value, float) else read == value


@pytest.mark.parametrize(
    ("paths", "text"),
    [
        ("tube.radius", f"radius of the tube as a whole {WIDER}"),
        (
            "tube.radius.3 clearance tube.radius.0 tube.radius.1 tube.radius.2",
            f"radius of segments 0-3 {WIDER}; clearance (down to 0)",
        ),
        ("tube.points.0 tube.points.2 tube.points.3", f"reference points 0, 2-3 {MOVED}"),
        ("obstacles.a.position obstacles.b.position", f"obstacles a, b {MOVED}"),
        (
            " ".join(f"robot.limits.effort.joint{k}" for k in range(4)),
            f"effort of 4 joints {WIDER}",
        ),
        ("tube.joint_signs.elbow", "sign of elbow (any other)"),
        ("clearance.default", "clearance (down to 0)"),
        ("clearance.pairs.0.clearance", "clearance of pair 0 (down to 0)"),
        ("goal.joints start.joints", f"goal {TURNED}; start {TURNED}"),
        ("some.other", "some.other"),
    ],
)
def test_changes_of_one_kind_are_told_together(paths, text):
    assert ineffective_text(paths.split()) == text
