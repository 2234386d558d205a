"""plan_many: many problems and cycles at once, packed for other processes."""

import os
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_cycle import SMALL
from worker_problems import FAST, LINE, DeadlyProblem, RaisingProblem, bits, planned_alone

from tubeplanner import (
    CycleResult,
    OptionError,
    PlanOptions,
    PlanStatus,
    ProblemSpec,
    WorkerProcesses,
    load_problem,
    parse_cycle,
    plan_many,
)
from tubeplanner.documents import parse_yaml
from tubeplanner.output.files.fingerprint import problem_hash
from tubeplanner.studies import plan_many as parcel_module
from tubeplanner.studies import plan_many as plan_many_module
from tubeplanner.studies.plan_many import Packer, read_reply, reply


@pytest.fixture
def post(bundled):
    return bundled("two_link/around_a_post")


@pytest.fixture(autouse=True)
def knows_none(monkeypatch):
    monkeypatch.setattr(parcel_module, "_scenes", {})


def narrower(problem, fraction):
    return replace(problem, tube=replace(problem.tube, radius=fraction * problem.tube.radius))


def sent(thing):
    return pickle.loads(pickle.dumps(thing))


def test_problems_of_one_scene_share_it_there_too(post):
    packed = Packer().pack(post)
    there = sent(packed).unpacked()
    assert problem_hash(there) == problem_hash(post)
    assert there.name == post.name
    packer = Packer()
    packs = [packer.pack(narrower(post, fraction)) for fraction in (0.9, 0.8)]
    assert packs[0].scene is packs[1].scene  # pickled once, and apart
    assert len(packs[0].content) < len(packs[0].scene)
    one, other = (sent(pack).unpacked() for pack in packs)
    assert one.scene is other.scene
    assert one.robot is other.robot is one.scene.robot
    np.testing.assert_array_equal(other.tube.radius, 0.8 * post.tube.radius)
    bare = packer.pack(replace(post, obstacles=()))  # other solids are another scene
    assert bare.scene_hash != packs[0].scene_hash
    assert len(one.scene.obstacles) == 1
    assert len(sent(bare).unpacked().scene.obstacles) == 0


def test_of_many_scenes_the_latest_are_kept(post, monkeypatch):
    monkeypatch.setattr(parcel_module, "_MAX_SCENES", 2)
    packer = Packer()
    first, second, third = (packer.pack(replace(post, clearance=c)) for c in (0.0, 0.001, 0.002))
    packs = [replace(first, scene_hash=name) for name in "abc"]
    scene = packs[0].unpacked().scene
    packs[1].unpacked()
    assert packs[0].unpacked().scene is scene  # used again: the other is the oldest now
    packs[2].unpacked()
    assert list(parcel_module._scenes) == ["a", "c"]
    assert {second.scene_hash, third.scene_hash} == {first.scene_hash}


def test_an_answer_gets_robot_and_scene_of_the_sender(post):
    there = sent(Packer().pack(post)).unpacked()
    packed = reply({"problem": there, "robot": there.robot, "more": [1]}, there)
    answer = read_reply(packed, post)
    assert answer["robot"] is post.robot
    assert answer["problem"].scene is post.scene
    assert answer["more"] == [1]
    assert len(packed) < len(pickle.dumps(there)) / 2


FRACTIONS = (1.0, 0.9, 0.8)


@pytest.fixture(scope="module")
def alone():
    return planned_alone(LINE, FRACTIONS)


def by_index(items):
    found = list(items)
    assert sorted(item.index for item in found) == list(range(len(found)))
    return sorted(found, key=lambda item: item.index)


@pytest.mark.slow  # plans in three processes
def test_answers_are_those_of_plan_bit_for_bit(alone):
    spec = ProblemSpec.read(LINE)
    problems = [
        load_problem(LINE, changes={"tube.radius": f"x{fraction}"}) for fraction in FRACTIONS
    ]
    problems += [spec.changed({"tube.radius": f"x{fraction}"}) for fraction in FRACTIONS]
    with WorkerProcesses(2) as workers:
        found = by_index(plan_many(problems, FAST, workers))
        again = workers.submit(abs, -1).result()
    assert [bits(item.result) for item in found] == [*alone, *alone]
    assert {item.status for item in found} == {PlanStatus.SUCCESS}
    assert all(item.duration == item.result.duration for item in found)
    assert again == 1  # the executor stays open


def test_by_default_processes_of_its_own_plan(monkeypatch):
    made = []

    class Watched(ThreadPoolExecutor):
        def __init__(self):
            super().__init__(1)
            made.append(self)

    monkeypatch.setattr(plan_many_module, "WorkerProcesses", Watched)
    (item,) = plan_many([LINE], FAST)
    assert item.status == PlanStatus.SUCCESS
    with pytest.raises(RuntimeError, match="after shutdown"):
        made[0].submit(abs, -1)


def test_threads_plan_the_same_and_a_tube_without_an_answer_is_a_result():
    here = load_problem(LINE)
    far = ProblemSpec.read(LINE).changed({"tube.points": [[0.3, -0.5, 0], [2.0, 0.5, 0]]})
    with ThreadPoolExecutor(2) as threads:
        one, other, item = by_index(plan_many([here, LINE, far], FAST, threads))
    assert bits(one.result) == bits(other.result)
    assert item.result is not None
    assert item.status == item.result.status == PlanStatus.UNREACHABLE
    assert item.message == item.result.message
    assert item.duration is None
    with pytest.raises(OptionError, match="options are 'fast'; give PlanOptions"):
        plan_many([LINE], "fast")


@pytest.mark.slow  # plans in another process
def test_a_name_is_a_file_of_this_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text(f"include: {LINE}\n")
    with WorkerProcesses(1) as workers:
        workers.submit(os.chdir, "/").result()
        found = by_index(plan_many(["mine.yaml", Path("mine.yaml"), LINE], FAST, workers))
    assert len({bits(item.result) for item in found}) == 1
    assert all(item.loading_time > 0 for item in found)


@pytest.mark.dear("plans two short cycles")
def test_cycles_are_planned_too():
    held = parse_yaml(SMALL)
    held |= {"moves": held["moves"][:2], "closed": False}
    spec = ProblemSpec(held, Path(), "short")
    with ThreadPoolExecutor(1) as threads:
        found = by_index(plan_many([spec, parse_cycle(held)], FAST, threads))
    assert all(isinstance(item.result, CycleResult) for item in found)
    assert found[0].duration == found[1].duration > 0


@pytest.mark.slow  # plans in processes that die
def test_what_cannot_be_posed_raises_or_kills_costs_its_item_alone(alone):
    spec = ProblemSpec.read(LINE)
    parts = (spec.document, spec.folder, spec.name)
    problems = [
        *(spec, "no/such/file.yaml", spec.changed({"robot.tool_frame": "nowhere"})),
        *(DeadlyProblem(*parts), RaisingProblem(*parts), spec),
    ]
    with WorkerProcesses(2) as workers:
        found = by_index(plan_many(problems, FAST, workers))
    good, missing, frameless, dead, raising, last = found
    assert bits(good.result) == bits(last.result) == alone[0]
    assert missing.status == frameless.status == PlanStatus.BAD_INPUT
    assert "no/such/file.yaml" in missing.message
    assert "nowhere" in frameless.message
    assert dead.status == raising.status == PlanStatus.CRASHED
    assert dead.message == "WorkerDied: the process that worked on it was ended by SIGKILL"
    assert raising.message == "ZeroDivisionError: in a test"
    assert [item.crashed for item in found] == [False, False, False, True, True, False]
    assert dead.result is dead.duration is None


def test_problems_are_taken_as_needed():
    taken = []

    def problems():
        for fraction in FRACTIONS:
            taken.append(fraction)
            yield ProblemSpec.read(LINE)

    items = plan_many(problems(), PlanOptions("stop-at-corners"), ThreadPoolExecutor(1))
    assert taken == []
    assert next(items).index == 0
    assert len(list(items)) == 2
