"""The metamorphic table: its variants are what they claim, and ten families keep the promise."""

import math

import numpy as np
import pytest
from cases import study_but

import metamorphic
from campaign_problems import write
from metamorphic_families import EQUAL, VARIANTS, family, file_of
from tubeplanner import JointTrajectory, PlanOptions, load_problem, plan, verify

SIZES = {"x0.3": 0.3, "x10": 10.0}
BY_NAME = {variant.name: variant for variant in VARIANTS}
# Quick ones, chains and bundled arms: sliding joints, motors, payloads, obstacles, rotation, signs
# and limits on jerks are among them. Of each, variants that are planned.
FAMILIES = {
    0: ("x10", "pose"),
    6: ("mirrored", "radius x1.2"),
    11: ("reversed", "jerk 1e9", "limits x1.1"),
    13: ("renamed", "ball"),
    30: ("split", "open"),
    33: ("reversed", "open"),
    40: ("moved", "no rotation", "no obstacles"),
    44: ("x0.3", "no signs"),
    46: ("moved", "pose", "fast"),
    57: ("x10", "limits x1.1", "ball"),
}


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """Return a function from a seed to the base problem of its family."""
    built = {}

    def of(seed):
        if seed not in built:
            built[seed] = family(seed, tmp_path_factory.mktemp(f"family_{seed}"))
        return built[seed]

    return of


def variant_of(built, variant):
    """Return the problem of a variant, None if it does not apply."""
    fields = variant.change(built)
    if fields is None:
        return None
    path = file_of(variant, built.path.parent)
    write(fields, path)
    return load_problem(path)


def carried(witness, slides, name, problem):
    """Return what a solution of the base is in the problem of a variant."""
    breakpoints, coefficients = witness.breakpoints, witness.coefficients
    if name == "reversed":
        breakpoints = witness.duration - breakpoints[::-1]
        pieces = [
            [np.poly1d(piece)(np.poly1d([-1.0, width])) for piece in by_joint]
            for by_joint, width in zip(
                np.moveaxis(coefficients, 0, -1)[::-1], np.diff(breakpoints), strict=True
            )
        ]
        padded = [[np.r_[np.zeros(len(coefficients) - len(p.c)), p.c] for p in x] for x in pieces]
        coefficients = np.moveaxis(np.array(padded), -1, 0)
    coefficients = coefficients * np.where(slides, SIZES.get(name, 1.0), 1.0)
    return JointTrajectory(problem.robot.joint_names, breakpoints, coefficients)


@pytest.mark.dear("builds ten problems and verifies a trajectory in a third of their variants")
@pytest.mark.parametrize(("part", "seed"), list(enumerate(FAMILIES)))
def test_a_solution_of_the_base_solves_every_variant_and_equal_ones_ask_as_much(base, part, seed):
    built = base(seed)
    witness, slides = built.witness.trajectory, built.judge.arm.slides
    margins = {}
    for variant in (VARIANTS[0], *VARIANTS[1 + part % 3 : -2 : 3]):
        name, problem = variant.name, variant_of(built, variant)
        if problem is None:
            continue
        certificate = verify(problem, carried(witness, slides, name, problem))
        assert certificate.passed, (name, certificate.message)
        margins[name] = {k: each.margin for k, each in certificate.conditions.items()}
        if variant.relation == EQUAL:
            known, size = margins["base"], SIZES.get(name, 1.0)
            for key in ("velocity", "acceleration", "effort", "motor_curve"):
                assert margins[name].get(key) == pytest.approx(known.get(key), abs=1e-6), name
            for key in ("obstacles", "self_collision"):
                scaled = known[key] and size * known[key]
                assert margins[name][key] == pytest.approx(scaled, abs=1e-6), name


# Plans two to four problems of each of ten families: 1 to 2 s each.
@pytest.mark.parametrize(("seed", "names"), study_but([*FAMILIES.items()][:4], FAMILIES.items()))
def test_equal_problems_are_planned_equally_fast_and_looser_ones_never_slower(base, seed, names):
    built = base(seed)
    answers = {}
    for name in ("base", *names):
        options = PlanOptions(quality=BY_NAME[name].quality, slack=0.0)
        result = plan(variant_of(built, BY_NAME[name]), options)
        answers[name] = {"status": str(result.status), "duration": result.duration}
    ratios = metamorphic.ratios(answers)
    assert ratios.keys() >= set(names)
    assert max(ratios.values()) <= metamorphic.STUCK, ratios


def answers(**durations):
    """Return answers of variants by duration, None if refused, 0 if the time did not suffice."""
    return {
        name: {"status": {None: "no_trajectory", 0: "timeout"}.get(x, "success"), "duration": x}
        for name, x in durations.items()
    }


@pytest.mark.parametrize(
    ("durations", "expected"),
    [
        ({"base": 1.0}, {}),
        ({"base": 1.0, "split": 1.1}, {"base": 1.0, "split": 1.1}),
        ({"base": 1.1, "split": 1.0, "any": 1.0}, {"base": 1.1, "split": 1.0, "any": 1.0}),
        ({"base": 1.0, "pose": 0.5, "open": 0.75}, {"pose": 0.5, "open": 1.5}),
        ({"base": 1.5, "fast": 1.0}, {"fast": 1.5}),
        ({"base": 1.0, "fast": None}, {}),
        ({"base": None, "fast": 1.0}, {"fast": math.inf}),
        ({"base": 1.0, "any": None}, {"any": math.inf}),
        ({"base": 1.0, "any": 0}, {}),
        ({"base": None, "any": None}, {}),
        ({"base": None, "any": 1.0}, {}),
    ],
)
def test_ratios_are_to_the_fastest_that_should_be_at_least_as_slow(durations, expected):
    assert metamorphic.ratios(answers(**durations)) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("line", "good"),
    [
        ({}, True),
        ({"split": {"duration": 1.02}}, False),
        ({"any": {"duration": None, "status": "no_trajectory"}}, False),
        ({"any": {"duration": 1.0, "judged": False}}, False),
        ({"any": {"duration": None, "status": "timeout"}}, True),
    ],
)
def test_the_exit_status_tells_of_what_is_stuck_missing_or_wrong(monkeypatch, capsys, line, good):
    each = {"status": "success", "message": "", "duration": 1.0, "cpu": 1.0}
    changed = {name: each | answer for name, answer in {"base": {}, **line}.items()}
    made = {"seed": 7, "status": "planned", "arm": "ur5", "answers": changed}
    monkeypatch.setattr(metamorphic, "examine", lambda seed, options: made)
    monkeypatch.setattr("sys.argv", ["metamorphic.py", "--seeds", "7", "--processes", "1"])
    assert metamorphic.main() == (0 if good else 1)
    printed = capsys.readouterr().out
    assert all(name in printed for name in line)


def test_a_family_that_crashes_is_told_and_not_good(monkeypatch, capsys):
    monkeypatch.setattr(metamorphic, "examine", lambda seed, options: 1 / 0)
    monkeypatch.setattr("sys.argv", ["metamorphic.py", "--seeds", "7", "--processes", "1"])
    assert metamorphic.main() == 1
    assert "7: crash: ZeroDivisionError" in capsys.readouterr().out
