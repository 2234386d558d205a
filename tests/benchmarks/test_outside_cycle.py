"""The outside judge on cycles: a cube is taken off a table and set down, all in closed form."""

import json

import numpy as np
import pytest
from lifting_arm import QUINTIC, TIP, written

import outside_judge
from outside.distances import DEEP
from outside.files import BadInput
from outside.judge import Judge
from outside.trajectory import Samples, Trajectory, part_of
from tubeplanner import load_cycle, read_cycle_motion, verify_cycle

ABOVE, ON, AWAY, DOWN = [0.0, 0.35], [0.0, 0.15], [0.4, 0.35], [0.4, 0.15]  # of the hand [m]
PLACES = [ABOVE, ON, ON, ABOVE, AWAY, DOWN, DOWN, AWAY, ABOVE]
BREAKPOINTS = [0.0, 1.0, 1.2, 2.2, 3.2, 4.2, 4.3, 5.3, 6.3]
BEGINS = [0.0, 1.0, 1.2, 1.2, 4.2, 4.3, 4.3]  # of the steps
GRAVITY, HAND, PART, LIMIT = 9.81, 1.0, 10.0, 125.0  # [m/s^2, kg, kg, N]


def tube(*places):
    return {"points": [[x, 0.0, z] for x, z in places], "radius": 0.05}


def cycle_fields():
    return {
        "format": "tubeplanner/cycle",
        "robot": {
            "urdf": "lifting.urdf",
            "tool_frame": TIP,
            "tool_offset": {"position": [0, 0, 0]},
            "limits": {"effort": {"z": LIMIT}},
        },
        "start": {"joints": ABOVE},
        "obstacles": [
            {"name": "table", "box": [4, 4, 0.1], "position": [0, 0, -0.05]},
            {"name": "part", "box": [0.1, 0.1, 0.1], "position": [0, 0, 0.05]},
            {"name": "wall", "box": [0.02, 1, 0.18], "position": [0.2, 0, 0.09]},
        ],
        "clearance": 0.01,
        "closed": True,
        "moves": [
            {"name": "down", "tube": tube(ABOVE, ON)},
            {"event": "gripper", "set": "close", "dwell": 0.2},
            {"attach": "part", "payload": {"mass": PART}},
            {"name": "over", "tube": tube(ON, ABOVE, AWAY, DOWN)},
            {"event": "gripper", "set": "open", "dwell": 0.1},
            {"detach": "part"},
            {"name": "back", "tube": tube(DOWN, AWAY, ABOVE)},
        ],
    }


def trajectory_fields(cycle):
    """Return straight lines from rest to rest, and marks for steps that begin at `BEGINS`."""
    widths = np.diff(BREAKPOINTS)
    coefficients = QUINTIC[:, None, None] * np.diff(PLACES, axis=0)
    coefficients /= (widths ** np.arange(5, -1, -1)[:, None])[:, :, None]
    coefficients[-1] += np.array(PLACES[:-1])
    marks = []
    for begin, step in zip(BEGINS, cycle["moves"], strict=True):
        kind = next((kind for kind in ("event", "attach", "detach") if kind in step), "move")
        setting = {"set": step["set"]} if "set" in step else {}
        marks.append({"time": begin, kind: step["name" if kind == "move" else kind], **setting})
    return {
        "format": "tubeplanner/trajectory",
        "version": 1,
        "joint_names": ["x", "z"],
        "duration": BREAKPOINTS[-1],
        "breakpoints": BREAKPOINTS,
        "coefficients": coefficients.tolist(),
        "marks": marks,
    }


class Files:
    """A cycle and a trajectory, to be changed before they are judged."""

    def __init__(self, folder):
        self.folder, self.cycle = folder, cycle_fields()
        self.trajectory = trajectory_fields(self.cycle)

    def step(self, k):
        return self.cycle["moves"][k]

    def paths(self):
        path = self.folder / "trajectory.json"
        path.write_text(json.dumps(self.trajectory))
        return written(self.folder, self.cycle), path

    def judged(self):
        return outside_judge.judge(*self.paths())

    def broken(self, conditions=None):
        """Return what fails, which must be what fails by the package's own judge too."""
        judged = conditions or self.judged()
        broken = {name for name, each in judged.items() if not each.holds(outside_judge.TOLERANCE)}
        cycle = load_cycle(self.paths()[0])
        own = verify_cycle(cycle, read_cycle_motion(self.paths()[1], cycle))
        assert set(own.failures()) == broken
        return broken


@pytest.fixture
def files(tmp_path, monkeypatch):
    monkeypatch.setattr(Judge.judge, "__defaults__", (60,))  # enough for straight lines
    return Files(tmp_path)


def later_leg(files):
    files.trajectory["marks"][3]["time"] += 0.05


def restless_and_heavier(files):
    """At rest, on the way and at the end."""
    for power, value in ((2, -0.4), (1, 0.08)):  # 4 mm aside and back again
        files.trajectory["coefficients"][-1 - power][1][0] = value
    files.step(2)["payload"]["mass"] = PART + 1
    files.cycle["obstacles"][1]["position"][2] -= 0.005
    files.trajectory["coefficients"][-1][-1][0] -= 0.002  # all of the last piece


def stricter_steps(files):
    """Dwell, load, own limits and contacts."""
    files.step(1)["dwell"] = 0.21
    files.step(2)["payload"]["mass"] = PART + 2
    files.step(3)["limits"] = {"velocity": {"x": 0.7}}
    files.step(6)["contacts"] = [{"links": ["part", TIP], "segments": [0], "within": 0.005}]


def farther_in_a_segment(files):
    files.step(3)["clearance"] = {"segments": [0.01, 0.03, 0.01]}


# Faults that are planted at once, and what they break.
FAULTS = [
    (later_leg, {"down - over: continuity", "over: rest", "over: obstacles"}),
    (
        restless_and_heavier,
        {"down - over: continuity", "over: effort", "over: obstacles"}
        | {"back: continuity", "back: goal", "closed: continuity"},
    ),
    (
        stricter_steps,
        {"down - over: dwell", "over: effort", "down - over: effort", "over - back: effort"}
        | {"over: velocity", "back: obstacles"},
    ),
    (farther_in_a_segment, {"over: obstacles"}),
]


@pytest.mark.parametrize(("plant", "broken"), FAULTS)
def test_planted_faults_are_seen_by_both_judges(plant, broken, files):
    plant(files)
    assert files.broken() == broken


def test_margins_are_those_of_the_closed_form(files, monkeypatch):
    monkeypatch.setattr(Judge.judge, "__defaults__", (200,))
    found = files.judged()
    assert outside_judge.passes(found)
    held = 1 - (HAND + PART) * GRAVITY / LIMIT
    assert found["down - over: effort"].margin == pytest.approx(held, abs=1e-9)
    assert found["start - down: effort"].margin == pytest.approx(1 - HAND * GRAVITY / LIMIT)
    assert found["over: obstacles"].margin == pytest.approx(0.0, abs=1e-9)
    assert found["down - over: dwell"].margin == pytest.approx(0.0, abs=1e-9)
    peak = 10 / np.sqrt(3) * 0.2  # [m/s^2] of a rest-to-rest quintic over 0.2 m
    lifted = 1 - (HAND + PART) * (GRAVITY + peak) / LIMIT
    assert found["over: effort"].margin == pytest.approx(lifted, abs=1e-5)
    assert 1.2 < found["over: effort"].time < 4.2
    assert files.broken(found) == set()


def test_payloads_add_up_and_the_move_before_carries_none(files):
    files.cycle["robot"]["payload"] = {"mass": 0.5, "com": [0, 0, 0.1]}
    files.cycle["moves"].insert(3, {"attach": "weight", "payload": {"mass": 1.5}})
    files.cycle["moves"].insert(6, {"detach": "weight"})
    marks = files.trajectory["marks"]
    marks.insert(3, {"time": 1.2, "attach": "weight"})
    marks.insert(6, {"time": 4.3, "detach": "weight"})
    files.cycle["robot"]["limits"]["effort"]["z"] = 200.0
    found = files.judged()
    held = 1 - (HAND + 0.5 + PART + 1.5) * GRAVITY / 200
    assert found["over - back: effort"].margin == pytest.approx(held, abs=1e-9)
    assert found["back - end: effort"].margin == pytest.approx(1 - 1.5 * GRAVITY / 200, abs=1e-9)
    assert files.broken(found) == set()


ON_TABLE = {"links": ["part", "table"], "within": 0.005}


def split(files):
    """Let the way over be two moves without a stop between them."""
    first = {"name": "up", "tube": tube(ON, ABOVE)}
    rest = {"name": "across", "pass_through": True, "tube": tube(ABOVE, AWAY, DOWN)}
    files.cycle["moves"][3:4] = [first, rest]
    files.trajectory["marks"][3:4] = [{"time": 1.2, "move": "up"}, {"time": 2.2, "move": "across"}]


@pytest.mark.dear("judges a cycle three times")
def test_moves_without_a_stop_are_one_leg_of_which_all_is_asked(files):
    split(files)
    files.step(4)["contacts"] = [ON_TABLE | {"segments": [0]}]  # its start is no end of the leg
    conditions = files.judged()
    assert outside_judge.passes(conditions)
    assert conditions["up, across: obstacles"].margin == pytest.approx(0.0, abs=1e-9)
    files.step(4)["contacts"] = [ON_TABLE | {"segments": [-1]}]
    assert files.judged()["up, across: obstacles"].margin < DEEP
    del files.step(4)["contacts"]
    files.step(4)["clearance"] = 0.03  # the part passes the wall at 0.02 m
    assert files.judged()["up, across: obstacles"].margin < DEEP


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.trajectory.pop("marks"), "marks are not one for each of 7 steps"),
        (lambda f: f.trajectory["marks"][1].update(set="open"), "is not that of"),
        (lambda f: f.trajectory["marks"][4].update(time=1.1), "not in the order of time"),
        (lambda f: f.step(0).update(colour=1), r"moves\.0\.colour is not known here"),
        (lambda f: f.cycle.update(period=0.01), "period is not known here"),
        (lambda f: f.cycle["moves"].pop(5), "'part' is still attached where the cycle closes"),
        (lambda f: f.step(3).update(pass_through=True), "passes through where the arm rests"),
        (lambda f: f.step(5).update(detach="parts"), "'parts' is let go and was not attached"),
    ],
)
def test_what_cannot_be_judged_is_refused_by_name(change, message, files):
    change(files)
    with pytest.raises(BadInput, match=message):
        files.judged()


def test_a_part_of_a_trajectory_is_what_it_does_then():
    rng = np.random.default_rng(2)
    whole = Trajectory(["a", "b"], np.array([0.0, 0.4, 1.0]), rng.normal(size=(5, 2, 2)))
    part = part_of(whole, 0.1, 0.7)
    np.testing.assert_allclose(part.breakpoints, [0.0, 0.3, 0.6])
    samples = part.samples(50)
    shift = np.where(samples.piece == 0, 0.1, 0.0)
    moved = Samples(samples.piece, samples.local + shift, samples.time + 0.1)
    for order in range(3):
        np.testing.assert_allclose(part.at(samples, order), whole.at(moved, order), atol=1e-9)
    with pytest.raises(BadInput, match="is no part of"):
        part_of(whole, 0.5, 0.5)
