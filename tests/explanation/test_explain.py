"""Explanations of problems whose remedies and room are known in closed form, to 5 %.

A gantry has two axes from 0 to 1 m and a head, a ball of 0.02 m about the tool. Its base does not
move, so that only the head comes near anything.
"""

import json

import numpy as np
import pytest

from gantry import ALONG, FIELDS, LENGTH, POST, gantry
from small_cycle import SMALL
from tubeplanner import explain, load_problem, plan
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.explanation import trials as trials_module
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.plan_options import PlanOptions

HEAD = 0.02  # [m]
NEAREST = 0.2  # of the post, along x and along y, to where the tool starts [m]
DISTANCE = np.hypot(NEAREST, NEAREST) - HEAD
CLEARANCE = 0.4
# How far from the post's edge, along one axis, the clearance lets the tool be.
APART = np.sqrt((CLEARANCE + HEAD) ** 2 - NEAREST**2)
QUICK = PlanOptions(quality="fast")
GRAVITY, HEAD_MASS = 9.81, 1.0
PAYLOAD = {"mass": 0.5, "com": [0, 0, 0], "inertia": [0, 0, 0, 0, 0, 0]}


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
def near_the_post(tmp_path_factory):
    path = gantry(tmp_path_factory.mktemp("near"), [POST])
    return path, explained(path, {"clearance": CLEARANCE})


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


def test_how_far_an_obstacle_must_move_is_found(near_the_post):
    path, found = near_the_post
    known = {
        "in -x": (0, -(APART - NEAREST)),
        "in +y": (1, APART - NEAREST),
        "in -z": (2, -(np.sqrt((CLEARANCE + HEAD) ** 2 - 2 * NEAREST**2) + 0.05)),
        "in +z": (2, np.sqrt((CLEARANCE + HEAD) ** 2 - 2 * NEAREST**2) + 0.35),
        "in -y": (1, -(APART + 0.4)),
    }
    for way, (axis, size) in known.items():
        remedy = remedy_of(found, way)
        assert remedy.field == "obstacles.post.position"
        moved = np.array(POST["position"], dtype=float)
        moved[axis] += size
        require_known(remedy.before, remedy.after, moved)
    assert not [each for each in found.remedies if "in +x" in each.text]
    require_certified(path, remedy_of(found, "in -x"), {"clearance": CLEARANCE})


def test_the_smallest_change_for_its_scale_comes_first(near_the_post):
    costs = [remedy.cost for remedy in near_the_post[1].remedies]
    assert costs == sorted(costs)
    assert near_the_post[1].remedies[0].text.startswith("clearance 400 -> ")


def test_what_helps_nothing_is_said(near_the_post):
    in_vain = near_the_post[1].in_vain
    assert set(in_vain) == {
        *("start", "start.joints", "tube.points.0", "tube.points.1", "tube.radius"),
    }
    assert not {remedy.field for remedy in near_the_post[1].remedies} & set(in_vain)


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
        *("clearance", "obstacles.post.position", "tube.radius"),
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


def test_ctrl_c_keeps_what_was_found(tmp_path):
    path = gantry(tmp_path, [POST])
    callback = stopped_at(7, KeyboardInterrupt)
    found = explained(path, {"clearance": CLEARANCE}, progress=callback)
    assert found.stopped_by == "interrupt"
    assert found.status is PlanStatus.TUBE_BLOCKED
    assert [remedy.field for remedy in found.remedies] == ["clearance"]
    assert not found.remedies[0].is_smallest
    assert found.succeeded
    room = explained(path, progress=stopped_at(3, KeyboardInterrupt))
    assert (room.stopped_by, room.is_possible, len(room.rooms)) == ("interrupt", True, 2)


def test_ctrl_c_before_anything_is_known_is_ctrl_c(tmp_path):
    def callback(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        explained(gantry(tmp_path), progress=callback)


def test_the_time_limit_keeps_what_was_found(tmp_path, monkeypatch):
    tried = []

    def limited(asked, plan_one=trials_module.planned):
        tried.append(asked)
        return plan_one(asked) if len(tried) < 8 else trials_module.Answer(is_cut_short=True)

    monkeypatch.setattr(trials_module, "planned", limited)
    found = explained(gantry(tmp_path, [POST]), {"clearance": CLEARANCE})
    assert (found.stopped_by, found.tried) == ("time_limit", 7)
    assert [remedy.field for remedy in found.remedies] == ["clearance"]
    assert "obstacles.post.position" not in found.in_vain


@pytest.mark.parametrize(
    ("document", "message"),
    [(SMALL, "this is a cycle"), ("study: {}", "this is a study"), ("robot: 1", "robot")],
)
def test_what_is_no_problem_is_refused(tmp_path, document, message):
    path = tmp_path / "file.yaml"
    path.write_text(document)
    with pytest.raises(ProblemError, match=message):
        explain(path)


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_a_time_limit_that_is_none_is_refused(tmp_path, limit):
    with pytest.raises(OptionError, match=f"time_limit is {limit:g} s; it must be > 0"):
        explain(gantry(tmp_path), time_limit=limit)


@pytest.mark.slow
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
    (nearer,) = [
        each for each in found.remedies if "point 1 by" in each.text and "in -x" in each.text
    ]
    require_known(points[1], nearer.after, [1.01, 0, 0])
    assert "tube.radius.1" in found.in_vain
    require_certified(path, radius)
