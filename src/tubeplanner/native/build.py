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
    """Return the command of the C++ compiler; None without a compiler.

    Args:
        environment: TUBEPLANNER_BUILD is "zig" for the compiler of the package ziglang, "none" for
            no compiler; else CXX names it, and else it is the first of c++, g++ and clang++ on the
            path.

    Raises:
        ValueError: TUBEPLANNER_BUILD has another value.
    """
    value = environment.get("TUBEPLANNER_BUILD", "")
    if value == "zig":
        return (sys.executable, "-m", "ziglang", "c++")
    if value == "none":
        return None
    if value:
        raise ValueError(f"TUBEPLANNER_BUILD is {value!r}; give zig, none, or do not set it")
    if environment.get("CXX"):
        return tuple(shlex.split(environment["CXX"]))
    paths = filter(None, (shutil.which(name) for name in _COMPILERS))
    return next(((path,) for path in paths), None)


def source_files() -> list[Path]:
    """Return the compiled source files."""
    return sorted(SOURCES.glob("*.cpp"))


def source_key() -> str:
    """Return a hash of the sources, headers included."""
    key = hashlib.sha256()
    for path in sorted(SOURCES.iterdir()):
        if path.suffix in (".cpp", ".h"):
            key.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return key.hexdigest()[:16]


def library_path(level: str, folder: Path = FOLDER) -> Path:
    """Return the path of the library for a level of processors."""
    return folder / f"numerics-{level}.so"


def build(folder: Path = FOLDER, environment: Mapping[str, str] = os.environ) -> list[Path]:
    """Compile the library for every level; return the files, none without a compiler.

    Raises:
        RuntimeError: The compiler does not start, or failed; the message is the compiler's.
    """
    command = compiler(environment)
    if command is None:
        return []
    built = []
    for level in LEVELS:
        target = library_path(level, folder)
        partial = target.with_name(f".{target.name}.tmp")
        definitions = (
            f'-DTUBEPLANNER_SOURCES="{source_key()}"',
            f'-DTUBEPLANNER_LEVEL="{level}"',
            f'-DTUBEPLANNER_COMPILER="{_kind(command)}"',
        )
        flags = (*_FLAGS, *_processor(command, level), *definitions)
        arguments = [*command, *flags, *map(str, source_files()), "-o", str(partial)]
        try:
            compilation = subprocess.run(arguments, capture_output=True, text=True)
        except OSError as error:
            partial.unlink(missing_ok=True)
            raise RuntimeError(f"{arguments[0]} does not start: {error.strerror}") from None
        if compilation.returncode:
            partial.unlink(missing_ok=True)
            raise RuntimeError(f"{shlex.join(arguments)}\n{compilation.stderr}")
        os.replace(partial, target)
        built.append(target)
    return built


def _processor(command: tuple[str, ...], level: str) -> tuple[str, ...]:
    """Return the compiler's flags for a level of processors."""
    if _kind(command) == "zig":  # its names are its own, and without one it takes this processor
        return (f"-mcpu={level.replace('-', '_')}",)
    return () if level == "baseline" else (f"-march={level}",)


def _kind(command: tuple[str, ...]) -> str:
    return "zig" if "ziglang" in command else Path(command[0]).name


if __name__ == "__main__":
    for path in build():
        print(path)  # noqa: T201
