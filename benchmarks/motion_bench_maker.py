"""From start and goal alone: how often, how fast and how good, on the public MotionBenchMaker?

    python benchmarks/motion_bench_maker.py FOLDER --journal F.jsonl [--robot panda ur5]
        [--set box cage] [--first 1] [--every N] [--poses] [--carry KG] [--shrink RAD]
        [--limits curobo|moveit] [--seed 1] [--processes 1] [--keep FOLDER]
    python benchmarks/motion_bench_maker.py --report F.jsonl [F2.jsonl ...]

FOLDER is a download of the folder `resources` of KavrakiLab/vamp: FOLDER/panda and FOLDER/ur5, each
with ROBOT.urdf, ROBOT.srdf, meshes and problems.tar.bz2, which is unpacked into a temporary folder
unless FOLDER/ROBOT/problems is there. Each problem is the one that `tubeplanner import` makes of a
planning scene and a motion plan request, planned as `route` does, at slack 0: no number of it is
chosen by hand, and none by robot or scene.
Limits: accelerations of 15 rad/s^2 for the Panda and 12 rad/s^2 for the UR5, jerks of 500 rad/s^3,
efforts of the URDFs (87 and 12 N m; 150 and 28 N m). Velocities of `curobo` are those of the
Panda's URDF (2.39 and 2.87 rad/s), of `moveit` its maker's (2.175 and 2.61 rad/s); of the UR5 3.15
and 3.2. With --poses the goal is the pose of the tool, not joints, and the bound is that of the
configuration in which the motion ends. --carry adds a payload [kg] at the tool, --shrink narrows
the position limits [rad].
The journal has a line per problem, in which processor times [s] are of one process: `loading` is
that of reading messages, robot and collision geometry, `first` is from there to the first certified
motion, `total` to the end. Those of a first problem have the libraries' first calls in them. What a
journal has by the same options and sources is not done again. --report prints Markdown tables.
--keep writes problem and trajectory files, which `outside_judge.py` takes: the problem then has a
tube of 10 km, which allows all. Exit status 1 if a problem has no certified answer, unless its own
ends are refused.
"""

import argparse
import hashlib
import sys
import tarfile
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import motion_bench_problems
from journals import Fields, journalled, recorded
from motion_bench_problems import LIMITS, ROBOTS, Options, examine
from shared import cause, figure
from tubeplanner.native.library import LIBRARY
from tubeplanner.studies.problem_spec import package_hash

MAX_LISTED = 12  # problems of a cause


def main() -> int:
    """Run the benchmark or read its journals, print tables, and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", help="download: FOLDER/panda, FOLDER/ur5")
    parser.add_argument("--robot", nargs="+", choices=ROBOTS, default=ROBOTS)
    parser.add_argument("--set", nargs="+", dest="sets", help="such as box, cage; default: all")
    parser.add_argument("--first", type=int, default=1, help="least number of a problem")
    parser.add_argument("--every", type=int, default=1, help="only each so-many-th of a set")
    parser.add_argument("--poses", action="store_true", help="goals as poses of the tool")
    parser.add_argument("--carry", type=float, default=0.0, help="payload at the tool [kg]")
    parser.add_argument("--shrink", type=float, default=0.0, help="off position limits [rad]")
    parser.add_argument("--limits", choices=LIMITS, default="curobo")
    parser.add_argument("--seed", type=int, default=1, help="of the search")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--journal", type=Path, help="one JSON line per problem; is gone on with")
    parser.add_argument("--keep", type=Path, help="folder for problem and trajectory files")
    parser.add_argument("--report", type=Path, nargs="+", help="print the tables of journals")
    arguments = parser.parse_args()
    if arguments.report is not None:
        lines = [line for path in arguments.report for line in recorded(path, "problem")]
        print(report(lines))
        return status_of(lines)
    if arguments.folder is None:
        parser.error("FOLDER is required, or --report")
    print(LIBRARY.build, file=sys.stderr)  # pure Python takes ten times as long
    with ExitStack() as stack:
        sources = {robot: arguments.folder.resolve() / robot for robot in arguments.robot}
        folders = {robot: (path, unpacked(path, stack)) for robot, path in sources.items()}
        options = Options(
            folders,
            arguments.limits,
            arguments.poses,
            arguments.carry,
            arguments.shrink,
            arguments.seed,
            arguments.keep and arguments.keep.resolve(),
        )
        names = list(problem_names(folders, arguments.sets))
        names = [name for name in names if int(name[-4:]) >= arguments.first]
        keys = {
            f"{name} ({options.variant})": _key(name, options)
            for name in names
            if (int(name[-4:]) - arguments.first) % arguments.every == 0
        }
        if not keys:
            parser.error(f"{arguments.folder} has none of these problems")
        work, lines = partial(examine, options=options), list[Fields]()
        for line, is_new in journalled(
            keys, work, arguments.journal, arguments.processes, "problem"
        ):
            lines.append(line)
            if is_new:
                print(progress_text(line), flush=True)
    print(report(lines))
    return status_of(lines)


def unpacked(folder: Path, stack: ExitStack) -> Path:
    """Return the folder with the sets of a robot's problems, unpacked until a stack is closed."""
    if (folder / "problems").is_dir():
        return folder / "problems"
    archive = folder / "problems.tar.bz2"
    if not archive.is_file():
        raise SystemExit(f"{archive} is missing: FOLDER is the folder `resources` of vamp")
    target = Path(stack.enter_context(tempfile.TemporaryDirectory()))
    with tarfile.open(archive) as content:
        content.extraction_filter = getattr(tarfile, "data_filter", None)  # Python 3.11.4 or later
        content.extractall(target)
    return target / "problems" if (target / "problems").is_dir() else target


def problem_names(folders: dict[str, tuple[Path, Path]], sets: list[str] | None) -> Iterator[str]:
    """Yield ROBOT/SET/NUMBER of the problems of some sets, by robot, set and number."""
    for robot, (_, folder) in folders.items():
        for path in sorted(folder.glob(f"*_{robot}/request*.yaml")):
            name = path.parent.name.removesuffix(f"_{robot}")
            if sets is None or name in sets:
                yield f"{robot}/{name}/{path.stem.removeprefix('request')}"


def progress_text(line: Fields) -> str:
    """Return a line for the terminal."""
    if line.get("duration") is None:
        return f"{line['problem']}: {line['status']}: {line['message'][:120]}"
    return (
        f"{line['problem']}: {line['duration']:.4f} s, bound {figure(line['bound'])} s; "
        f"{line['first']:.2f} and {line['total']:.2f} s after {line['loading']:.2f} s"
    )


# ---- The report: tables in Markdown.

_HEADINGS = (
    *("set", "problems", "found", "certified", "duration [s]", "first motion [s]", "bound [s]"),
    *("ratio, mean", "ratio, median", "first: median / p95 [s]"),
    "all: median / p95 / max [s]",
)


def report(lines: Iterable[Fields]) -> str:
    """Return a table for every variant and robot, and failures by cause."""
    groups: dict[tuple[str, str], list[Fields]] = defaultdict(list)
    for line in lines:
        groups[line.get("variant", ""), line.get("robot", "")].append(line)
    parts = []
    for (variant, robot), own in groups.items():
        rows = [f"### {robot}, {variant}", "", _row(_HEADINGS), "|" + "---|" * len(_HEADINGS)]
        sets = sorted({line["set"] for line in own if "set" in line})
        rows += [_row(_cells(name, [x for x in own if x.get("set") == name])) for name in sets]
        rows += [_row(_cells("all", own)), *_causes(own)]
        parts.append("\n".join(rows))
    return "\n\n".join(parts) or "no problem was examined"


def status_of(lines: Iterable[Fields]) -> int:
    """Return 1 if a problem has no certified answer and its ends are not the reason."""
    return int(any(not line.get("certified") and line["status"] != "bad_input" for line in lines))


def _cells(name: str, lines: list[Fields]) -> list[str]:
    """Return the cells of a row: counts, mean durations, ratios, processor times."""
    found = [line for line in lines if line.get("duration") is not None]
    certified = sum(bool(line.get("certified")) for line in found)
    cells = [name, str(len(lines)), str(len(found)), str(certified)]
    if not found:
        return cells + ["-"] * (len(_HEADINGS) - len(cells))
    bounded = [line for line in found if line["bound"]]
    ratios = [line["duration"] / line["bound"] for line in bounded]
    cells += [figure(_mean(found, "duration")), figure(_mean(found, "first_duration"))]
    cells += [figure(_mean(bounded, "bound") if bounded else None)]
    cells += [figure(float(f(ratios)) if ratios else None) for f in (np.mean, np.median)]
    for key, parts in (("first", (50, 95)), ("total", (50, 95, 100))):
        values = np.percentile([line[key] for line in found], parts)
        cells.append(" / ".join(figure(float(value), 2) for value in values))
    return cells


def _mean(lines: list[Fields], key: str) -> float:
    return float(np.mean([line[key] for line in lines]))


def _causes(lines: list[Fields]) -> list[str]:
    """Return a list of failures by cause, the most frequent first, after an empty line."""
    by_cause: dict[str, list[str]] = defaultdict(list)
    for line in lines:
        if not line.get("certified"):
            name = line["problem"].partition(" ")[0]
            by_cause[f"{line['status']}: {cause(line['message'])}"].append(name)
    rows = []
    for text, names in sorted(by_cause.items(), key=lambda item: -len(item[1])):
        more = f" and {len(names) - MAX_LISTED} more" * (len(names) > MAX_LISTED)
        rows.append(f"- {len(names)}: {text} ({', '.join(names[:MAX_LISTED])}{more})")
    return ["", "Without an answer, by cause:", "", *rows] if rows else []


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _key(name: str, options: Options) -> str:
    """Return a hash of all that the line of a problem depends on, but for the files."""
    how = replace(options, keep=None, folders={})
    content = repr((name, how, package_hash(), LIBRARY.build)).encode()
    content += Path(motion_bench_problems.__file__).read_bytes()
    return hashlib.sha256(content).hexdigest()


if __name__ == "__main__":
    raise SystemExit(main())
