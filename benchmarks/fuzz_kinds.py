"""The readers that are fuzzed: by kind, files that are right, and what reads them."""

import json
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import fuzz_seeds as seeds
from tubeplanner import (
    MeasureOptions,
    Obstacle,
    explain,
    load_cycle,
    load_problem,
    load_robot,
    load_study,
    measure_tube,
    placement_of,
    run_study,
)
from tubeplanner.files.problem_file import read_fields, with_other_tube
from tubeplanner.problem.moveit_limits import read_limits_file
from tubeplanner.problem.point_file import read_points
from tubeplanner.problem.presets import read_preset
from tubeplanner.robot.robot_info import robot_info
from tubeplanner.robot.srdf import read_allowed_pairs, read_group_states
from tubeplanner.trajectory.trajectory_file import read_trajectory_file
from tubeplanner.views.visual_mesh import read_visual_mesh

_JOINTS = ("joint1", "joint2")
_INFO = ("info", "problem.yaml")
_CHECK = ("check", "problem.yaml")
_VIEW = ("view", "problem.yaml", "--html", "page.html")


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        file: Its name in the folder of a case.
        form: Its format, as `fuzz_mutations.mutated` and `fuzz_attacks.attacks` call it.
        contents: Makes files that are right.
        read: Reads it; called with its path, in its folder.
        commands: Lines of the command line that read it.
        others: Makes the files beside it, by name.
        attacks: Formats whose attacks it is given.
    """

    file: str
    form: str
    contents: Callable[[], list[bytes]]
    read: Callable[[Path], object]
    commands: tuple[tuple[str, ...], ...] = ()
    others: Callable[[], Mapping[str, bytes]] = dict
    attacks: tuple[str, ...] = field(default=())


def _read_problem(path: Path) -> None:
    problem = load_problem(path)
    read_fields(path)
    with_other_tube(path, path.with_name("other.json"), problem.tube)


def _ask(path: Path) -> None:
    explain(path, time_limit=0.5)
    measure_tube(load_problem(path), MeasureOptions(samples=100))


def _read_mesh(path: Path) -> None:
    try:
        Obstacle.mesh("part", path, placement_of())
    finally:
        read_visual_mesh(path)


def _read_robot(path: Path) -> None:
    try:
        robot_info(path)
    finally:
        load_robot(path, "hand")


def _read_srdf(path: Path) -> None:
    read_allowed_pairs(path)
    read_group_states(path)


def _read_study(path: Path) -> None:
    study = load_study(path)
    for index in range(min(3, len(study.points))):
        study.posed(study.points[index])


class _Nobody(Executor):
    """Plans nothing: what the journal lacks is refused."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_exception(RuntimeError("not planned"))
        return future


def _read_journal(path: Path) -> None:
    result = run_study(load_study("study.yaml"), journal=path, executor=_Nobody())
    json.dumps(result.as_dict(), allow_nan=False)
    result.csv()


def _beside(**texts: str) -> Callable[[], Mapping[str, bytes]]:
    return lambda: {name.replace("__", "."): text.encode() for name, text in texts.items()}


def _mesh(ending: str, form: str) -> Kind:
    return Kind(
        f"solid.{ending}",
        form,
        partial(seeds.mesh, ending),
        _read_mesh,
        (_INFO, _VIEW),
        lambda: {
            "problem.yaml": seeds.with_mesh(f"solid.{ending}").encode(),
            "robot.urdf": seeds.urdf_with_mesh(f"solid.{ending}").encode(),
        },
        (ending, "xml") if form == "xml" else (ending,),
    )


def _motion(ending: str, form: str) -> Kind:
    file = f"motion.{ending}"
    return Kind(
        file,
        form,
        partial(seeds.motion, ending),
        lambda path: read_trajectory_file(path, _JOINTS),
        ((*_CHECK, file), (*_VIEW, file), ("plot", "problem.yaml", file, "-o", "plot.png")),
        _beside(problem__yaml=seeds.PROBLEM),
        (form,),
    )


def _part(file: str, text: str, read: Callable[[Path], object], problem: str) -> Kind:
    """Return a YAML file that a problem names."""
    return Kind(
        file,
        "yaml",
        lambda: [text.encode()],
        read,
        (_INFO,),
        _beside(problem__yaml=problem),
        ("yaml",),
    )


KINDS: Mapping[str, Kind] = {
    "problem-yaml": Kind(
        "problem.yaml",
        "yaml",
        seeds.problems,
        _read_problem,
        (_INFO, _VIEW, ("links", "problem.yaml"), (*_CHECK, "motion.json")),
        lambda: {"part.stl": seeds.part(), "motion.json": seeds.motion("json")[0]},
        ("yaml",),
    ),
    "questions": Kind(
        "problem.yaml",
        "yaml",
        seeds.problems,
        _ask,
        (
            ("explain", "problem.yaml", "--time-limit", "1", "--processes", "1"),
            ("measure", "problem.yaml"),
        ),
        lambda: {"part.stl": seeds.part()},
        ("yaml",),
    ),
    "problem-json": Kind(
        "problem.json",
        "json",
        seeds.json_problems,
        _read_problem,
        (("info", "problem.json"),),
        lambda: {"part.stl": seeds.part()},
        ("json",),
    ),
    "include": _part(
        "cell.yaml",
        seeds.CELL,
        lambda path: load_problem("problem.yaml"),
        seeds.INCLUDING,
    ),
    "preset": _part("arm.yaml", seeds.PRESET, read_preset, seeds.with_robot("preset: arm.yaml")),
    "joint-limits": _part(
        "joint_limits.yaml",
        seeds.LIMITS,
        read_limits_file,
        seeds.with_robot("limits_file: joint_limits.yaml"),
    ),
    "points": Kind(
        "points.csv",
        "csv",
        seeds.points,
        lambda path: (read_points(path), load_problem("problem.yaml")),
        (_INFO,),
        _beside(problem__yaml=seeds.WITH_POINTS),
        ("csv",),
    ),
    "trajectory-json": _motion("json", "json"),
    "trajectory-csv": _motion("csv", "csv"),
    "trajectory-ros": _motion("yaml", "yaml"),
    "urdf": Kind(
        "robot.urdf",
        "xml",
        seeds.urdfs,
        _read_robot,
        (("info", "robot.urdf"), _INFO, _VIEW),
        _beside(problem__yaml=seeds.with_robot("").replace("example:two_link", "robot.urdf")),
        ("xml",),
    ),
    "xacro": Kind(
        "arm.urdf.xacro",
        "xml",
        lambda: [seeds.XACRO.encode()],
        lambda path: load_robot(path, "hand"),
        (("info", "arm.urdf.xacro"),),
        _beside(values__yaml="length: 0.3\n"),
        ("xml", "xacro"),
    ),
    "srdf": Kind(
        "arm.srdf",
        "xml",
        lambda: [seeds.SRDF.encode()],
        _read_srdf,
        (_INFO,),
        _beside(problem__yaml=seeds.WITH_STATE),
        ("xml",),
    ),
    "stl": _mesh("stl", "stl"),
    "obj": _mesh("obj", "text"),
    "dae": _mesh("dae", "xml"),
    "cycle": Kind(
        "cycle.yaml",
        "yaml",
        lambda: [seeds.CYCLE.encode()],
        load_cycle,
        (("info", "cycle.yaml"), ("check", "cycle.yaml", "motion.json")),
        lambda: {"motion.json": seeds.motion("json")[0]},
        ("yaml",),
    ),
    "study": Kind(
        "study.yaml",
        "yaml",
        lambda: [seeds.STUDY.encode(), seeds.LATIN.encode()],
        _read_study,
        (("info", "study.yaml"),),
        _beside(problem__yaml=seeds.PROBLEM),
        ("yaml",),
    ),
    "journal": Kind(
        "table.jsonl",
        "text",
        seeds.journals,
        _read_journal,
        (),
        _beside(problem__yaml=seeds.PROBLEM, study__yaml=seeds.STUDY),
        ("json",),
    ),
}
