"""Compilation of the library by a system compiler or ziglang; stand-alone, for the wheel too.

    python -m tubeplanner.native.build

builds it for a checkout, beside this module; `pip install` does the same by itself. Nothing here
needs a library, so that a build can run it before there are any.
"""

import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Mapping
from pathlib import Path

FOLDER = Path(__file__).parent
SOURCES = FOLDER / "sources"
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
    """Return the command of the C++ compiler; None without a compiler, and on Windows.

    Args:
        environment: TUBEPLANNER_BUILD is "zig" for the compiler of the package ziglang, "none" for
            no compiler, "required" to fail without one; TUBEPLANNER_TARGET names another platform,
            for which ziglang compiles; else CXX names the compiler, and else it is the first of
            c++, g++ and clang++ on the path.

    Raises:
        RuntimeError: TUBEPLANNER_BUILD is "required" or "zig", and there is no compiler.
        ValueError: TUBEPLANNER_BUILD has another value.
    """
    value = environment.get("TUBEPLANNER_BUILD", "")
    if value not in ("", "zig", "none", "required"):
        message = "give zig, none or required, or do not set it"
        raise ValueError(f"TUBEPLANNER_BUILD is {value!r}; {message}")
    if value == "none":
        return None
    if sys.platform == "win32":
        if value:
            message = "no native library is built on Windows; do not set it for Python alone"
            raise RuntimeError(f"TUBEPLANNER_BUILD is {value!r}, but {message}")
        return None
    if value == "zig" or environment.get("TUBEPLANNER_TARGET"):
        return (sys.executable, "-m", "ziglang", "c++")
    if environment.get("CXX"):
        return tuple(shlex.split(environment["CXX"]))
    paths = filter(None, (shutil.which(name) for name in _COMPILERS))
    command = next(((path,) for path in paths), None)
    if command is None and value == "required":
        message = f"none of {', '.join(_COMPILERS)} is on the path; install one, or set CXX"
        raise RuntimeError(f"TUBEPLANNER_BUILD is 'required', but {message}")
    return command


def machines(environment: Mapping[str, str] = os.environ) -> tuple[str, ...]:
    """Return the kinds of processors that code is for; several in macOS's universal code.

    Args:
        environment: TUBEPLANNER_TARGET, or else what cross builds set: ARCHFLAGS on macOS, or
            _PYTHON_HOST_PLATFORM; without them it is the kind of this machine.
    """
    if target := environment.get("TUBEPLANNER_TARGET"):
        return (target.split("-")[0],)
    names = re.findall(r"-arch\s+(\S+)", environment.get("ARCHFLAGS", ""))
    if sys.platform != "darwin" or not names:
        host = environment.get("_PYTHON_HOST_PLATFORM") or platform.machine()
        names = [host.lower().split("-")[-1].replace("amd64", "x86_64")]
    return ("x86_64", "arm64") if "universal2" in names else tuple(names)


def levels(environment: Mapping[str, str] = os.environ) -> tuple[str, ...]:
    """Return the levels of processors that a library is built for; the loader prefers the last."""
    return ("baseline", "x86-64-v3") if "x86_64" in machines(environment) else ("baseline",)


def platform_tag(environment: Mapping[str, str] = os.environ) -> str:
    """Return the wheel's tag of the platform that the library runs on.

    Raises:
        ValueError: TUBEPLANNER_TARGET names no version of glibc or macOS.
    """
    target, kinds = environment.get("TUBEPLANNER_TARGET"), machines(environment)
    if not target and sys.platform != "darwin":
        host = environment.get("_PYTHON_HOST_PLATFORM") or sysconfig.get_platform()
        return re.sub(r"\W", "_", host)
    match = re.fullmatch(
        r"[^-]+-(linux-gnu|macos)\.(\d+)\.(\d+)",
        target or f"this-macos.{macos_version(environment)}",
    )
    if match is None:
        example = "aarch64-linux-gnu.2.28 or aarch64-macos.11.0"
        raise ValueError(f"TUBEPLANNER_TARGET is {target!r}; give a platform such as {example}")
    system, major, minor = match.groups()
    if system == "linux-gnu":
        return f"manylinux_{major}_{minor}_{kinds[0]}"
    kind = "universal2" if len(set(kinds)) > 1 else kinds[0].replace("aarch64", "arm64")
    return f"macosx_{major}_{0 if int(major) > 10 else minor}_{kind}"


def macos_version(environment: Mapping[str, str] = os.environ) -> str:
    """Return the oldest version of macOS that the library runs on, as in "11.0"."""
    host = re.match(r"macosx-([\d.]+)", environment.get("_PYTHON_HOST_PLATFORM", ""))
    configured = host[1] if host else sysconfig.get_config_var("MACOSX_DEPLOYMENT_TARGET")
    version = environment.get("MACOSX_DEPLOYMENT_TARGET") or configured or "11.0"
    major, minor = (*map(int, str(version).split(".")), 0)[:2]
    return f"{max(major, 11)}.0" if machines(environment) == ("arm64",) else f"{major}.{minor}"


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
            Or it is required, and there is none.
    """
    command = compiler(environment)
    if command is None:
        return []
    built = []
    for level in levels(environment):
        target = library_path(level, folder)
        partial = target.with_name(f".{target.name}.tmp")
        definitions = (
            f'-DTUBEPLANNER_SOURCES="{source_key()}"',
            f'-DTUBEPLANNER_LEVEL="{level}"',
            f'-DTUBEPLANNER_COMPILER="{_kind(command)}"',
        )
        flags = (*_FLAGS, *_processor(command, level, environment), *definitions)
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


def _processor(
    command: tuple[str, ...], level: str, environment: Mapping[str, str]
) -> tuple[str, ...]:
    """Return the compiler's flags for a platform and a level of its processors."""
    if _kind(command) == "zig":  # its names are its own, and without one it takes this processor
        target = environment.get("TUBEPLANNER_TARGET")
        names: tuple[str, ...] = ("-target", target) if target else ()
        return (*names, f"-mcpu={level.replace('-', '_')}")
    march = () if level == "baseline" else (f"-march={level}",)
    if sys.platform != "darwin":
        return march
    kinds = machines(environment) if level == "baseline" else ("x86_64",)
    names = tuple(word for kind in kinds for word in ("-arch", kind))
    return (*names, f"-mmacosx-version-min={macos_version(environment)}", *march)


def _kind(command: tuple[str, ...]) -> str:
    return "zig" if "ziglang" in command else Path(command[0]).name


if __name__ == "__main__":
    for path in build():
        print(path)  # noqa: T201
