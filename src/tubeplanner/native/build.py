"""Compilation of the library by a system compiler or ziglang; stand-alone, for the wheel too.

    python -m tubeplanner.native.build

builds it for a checkout, beside this module; `pip install` does the same by itself. Nothing here
needs a library, so that a build can run it before there are any.
"""

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

FOLDER = Path(__file__).parent
SOURCES = FOLDER / "sources"
# The processors that a library is built for. The loader takes the last that runs.
LEVELS: tuple[str, ...] = ("baseline",)
if platform.machine().lower() in ("x86_64", "amd64"):
    LEVELS = ("baseline", "x86-64-v3")
_FLAGS = (
    "-std=c++17",
    "-O3",
    "-fPIC",
    "-shared",
    "-fno-exceptions",
    "-fno-rtti",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fopenmp-simd",
    "-fvisibility=hidden",
)
_COMPILERS = ("c++", "g++", "clang++")


def compiler(environment: Mapping[str, str] = os.environ) -> tuple[str, ...] | None:
    """Return the command of the C++ compiler, None if there is none or none is wanted.

    Args:
        environment: TUBEPLANNER_BUILD is "zig" for that of the package ziglang, "none" for none;
            else CXX names it, and else it is the first of c++, g++ and clang++ that there is.

    Raises:
        ValueError: TUBEPLANNER_BUILD is neither of those.
    """
    wanted = environment.get("TUBEPLANNER_BUILD", "")
    if wanted == "zig":
        return (sys.executable, "-m", "ziglang", "c++")
    if wanted == "none":
        return None
    if wanted:
        raise ValueError(f"TUBEPLANNER_BUILD is {wanted!r}; give zig, none, or do not set it")
    if environment.get("CXX"):
        return tuple(shlex.split(environment["CXX"]))
    found = filter(None, (shutil.which(name) for name in _COMPILERS))
    return next(((path,) for path in found), None)


def source_files() -> list[Path]:
    """Return the sources that are compiled, each a job."""
    return sorted(SOURCES.glob("*.cpp"))


def source_key() -> str:
    """Return what tells these sources from others."""
    found = hashlib.sha256()
    for path in sorted(SOURCES.iterdir()):
        if path.suffix in (".cpp", ".h"):
            found.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]


def library_path(level: str, folder: Path = FOLDER) -> Path:
    """Return where the library of a level is."""
    return folder / f"numerics-{level}.so"


def build(folder: Path = FOLDER, environment: Mapping[str, str] = os.environ) -> list[Path]:
    """Compile the library for every level; return the files, none if there is no compiler.

    Args:
        folder: Where to.
        environment: As for `compiler`.

    Raises:
        RuntimeError: The compiler does not start, or refused the sources; the message is its own.
    """
    command = compiler(environment)
    if command is None:
        return []
    built = []
    for level in LEVELS:
        target = library_path(level, folder)
        partial = target.with_name(f".{target.name}.tmp")
        named = (f'-DTUBEPLANNER_SOURCES="{source_key()}"', f'-DTUBEPLANNER_LEVEL="{level}"')
        by = f'-DTUBEPLANNER_COMPILER="{_kind(command)}"'
        files = map(str, source_files())
        arguments = [
            *command,
            *_FLAGS,
            *_processor(command, level),
            *named,
            by,
            *files,
            "-o",
            str(partial),
        ]
        try:
            _run(arguments)
        except RuntimeError:
            partial.unlink(missing_ok=True)
            raise
        os.replace(partial, target)
        built.append(target)
    return built


def _run(arguments: list[str]) -> None:
    try:
        done = subprocess.run(arguments, capture_output=True, text=True)
    except OSError as error:
        raise RuntimeError(f"{arguments[0]} does not start: {error.strerror}") from None
    if done.returncode:
        raise RuntimeError(f"{shlex.join(arguments)}\n{done.stderr}")


def _processor(command: tuple[str, ...], level: str) -> tuple[str, ...]:
    """Return what a compiler is told about the processor."""
    if _kind(command) == "zig":  # its names are its own, and without one it takes this processor
        return (f"-mcpu={level.replace('-', '_')}",)
    return () if level == "baseline" else (f"-march={level}",)


def _kind(command: tuple[str, ...]) -> str:
    return "zig" if "ziglang" in command else Path(command[0]).name


if __name__ == "__main__":
    for path in build():
        print(path)  # noqa: T201
