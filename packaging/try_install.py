"""Installs what a folder of distributions has into empty environments, and tries each of them.

    python -m build && python packaging/try_install.py dist [--pythons python3.11 python3.13 ...]

For each Python: the wheel, the sdist where there is a compiler, and the sdist where there is none
(nothing but the environment's own commands on the path). In each, the README's first commands run
in an empty folder (`try_wheel.py`). Prints a row per environment; ends with an error if one fails
or if planned durations are further apart than the rounding of builds explains.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TRY = Path(__file__).with_name("try_wheel.py")
TOLERANCE = 0.01  # of durations: each build rounds differently and may end elsewhere
COLUMNS = ("python", "from", "compiler", "install s", "MB", "build", "durations s", "commands s")
HIDDEN = ("CXX", "TUBEPLANNER_BUILD", "TUBEPLANNER_TARGET", "TUBEPLANNER_PURE", "PYTHONPATH")


def megabytes(folder: Path) -> float:
    """Return the size of all files in a folder [MB]."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def installed(python: str, archive: Path, has_compiler: bool, folder: Path) -> list[str]:
    """Return the row of one environment, made and tried."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    scripts = folder / ("Scripts" if os.name == "nt" else "bin")
    environment = {name: value for name, value in os.environ.items() if name not in HIDDEN}
    if not has_compiler:
        environment["PATH"] = str(scripts)
    own, before, begun = str(scripts / "python"), megabytes(folder), time.perf_counter()
    pip = [own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    # pip would keep the wheel that it makes of an sdist, with or without native code, for the next.
    alone = [*pip, "--no-cache-dir", "--no-deps", archive]
    subprocess.run(alone, check=True, env=environment)
    version = archive.name.removesuffix(".tar.gz").split("-")[1]
    subprocess.run([*pip, f"tubeplanner=={version}"], check=True, env=environment)
    seconds, size = time.perf_counter() - begun, megabytes(folder) - before
    words = [own, TRY, "--json"]
    if archive.suffix == ".whl":
        expected = "pure" if archive.name.endswith("-any.whl") else "native"
    else:
        expected = "native" if has_compiler and os.name != "nt" else "pure"
    run = subprocess.run(
        [*words, "--only", expected], env=environment, stdout=subprocess.PIPE, text=True
    )
    if run.returncode:
        raise SystemExit(f"{python}, {archive.name}, compiler: {has_compiler}: failed")
    result = json.loads(run.stdout)
    kind = "sdist" if archive.suffix == ".gz" else "wheel"
    durations = " ".join(f"{value:.4f}" for value in result["durations"])
    running = subprocess.run([own, "--version"], capture_output=True, text=True).stdout.split()[1]
    cells = (running, kind, "yes" if has_compiler else "no", f"{seconds:.0f}", f"{size:.0f}")
    return [*map(str, cells), result["build"], durations, f"{result['seconds']:.0f}"]


def main() -> None:
    """Try all environments, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("dist", type=Path, help="folder with one sdist and its wheels")
    parser.add_argument("--pythons", nargs="+", default=[sys.executable])
    arguments = parser.parse_args()
    wheels, sources = (sorted(arguments.dist.glob(name)) for name in ("*.whl", "*.tar.gz"))
    cases = [(path, False) for path in wheels]
    cases += [(path, has_compiler) for path in sources for has_compiler in (True, False)]
    if not cases:
        raise SystemExit(f"{arguments.dist} has no distribution; python -m build makes them")
    print("| " + " | ".join(COLUMNS) + " |\n|" + "---|" * len(COLUMNS), flush=True)
    durations = []
    for python in arguments.pythons:
        for path, has_compiler in cases:
            with tempfile.TemporaryDirectory() as folder:
                row = installed(python, path.resolve(), has_compiler, Path(folder) / "venv")
            print("| " + " | ".join(row) + " |", flush=True)
            durations.append([float(value) for value in row[-2].split()])
    for values in zip(*durations, strict=True):
        if max(values) > (1 + TOLERANCE) * min(values):
            raise SystemExit(f"durations differ by more than {TOLERANCE:.0%}: {values}")


if __name__ == "__main__":
    main()
