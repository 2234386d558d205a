"""Files beside a URDF: xacro sources, expanded in a process of their own; SRDF files."""

import json
import resource
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any

from tubeplanner.documents import DocumentError, read_bytes, require_regular
from tubeplanner.errors import RobotError, not_installed, shown, unknown_name
from tubeplanner.resources import find_package
from tubeplanner.robot.urdf_elements import read_name

# ---- Macro files of robots, `.xacro`, expanded in a process of their own.

XACRO_ENDING = ".xacro"
_MAX_BYTES = 50_000_000
_TIME_LIMIT = 10.0  # [s]: robots of hundreds of links take one
_PROGRAM = """import sys
sys.path[:] = {path!r}
from tubeplanner.robot.ros_files import serve
serve()
"""


def expanded(path: Path, arguments: Mapping[str, object], package_dirs: tuple[Path, ...]) -> bytes:
    """Return the URDF that a macro file stands for.

    Args:
        path: The file; includes are relative to the file that names them.
        arguments: Values of its `<xacro:arg>`, by name; truth values are written true and false.
        package_dirs: Further folders that hold the packages of `$(find PACKAGE)`.

    Raises:
        RobotError: xacro is not installed or cannot expand the file, with its reason; it takes too
            long or too much memory; or the file does not ask for an argument.
    """
    try:
        import xacro  # noqa: F401
    except ImportError:
        raise RobotError(not_installed("xacro", str(path), "xacro")) from None
    try:
        require_regular(path, _MAX_BYTES)
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from None
    folders = [str(folder) for folder in package_dirs]
    asked = {"path": str(path), "arguments": dict(arguments), "package_dirs": folders}
    answer = _answer(path, asked)
    if "fault" in answer:
        raise RobotError(answer["fault"])
    xml = answer["xml"].encode()
    if len(xml) > _MAX_BYTES:
        raise RobotError(f"{path}: what it stands for is larger than {_MAX_BYTES / 1e6:g} MB")
    return bytes(xml)


def _answer(path: Path, asked: Mapping[str, Any]) -> dict[str, str]:
    """Return what the process answers."""
    remedy = "simplify it, or expand it yourself and name the URDF"
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROGRAM.format(path=sys.path)],
            input=json.dumps(asked).encode(),
            capture_output=True,
            timeout=_TIME_LIMIT,
        )
        answer: dict[str, str] = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise RobotError(
            f"{path}: xacro cannot expand it within {_TIME_LIMIT:g} s; {remedy}"
        ) from None
    except ValueError:
        raise RobotError(f"{path}: xacro ended without an answer; {remedy}") from None
    return answer


# ---- The process in which the package xacro expands a macro file, as `ros2 run xacro` does.
#
# Macro files are programs: in a process of its own, one that never ends or takes all memory can be
# ended.

_INDEX = "ament_index_python"
_MAX_MEMORY = 1_000_000_000  # [bytes] of addresses


def serve() -> None:
    """Answer the one request on standard input, on standard output, both JSON.

    The request has path, arguments and package_dirs; the answer has either xml or a fault.
    """
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY, _MAX_MEMORY))
    asked = json.load(sys.stdin)
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # its warnings are for authors
        try:
            folders = tuple(map(Path, asked["package_dirs"]))
            answer = {"xml": _expanded(Path(asked["path"]), asked["arguments"], folders)}
        except RobotError as error:
            answer = {"fault": str(error)}
    json.dump(answer, sys.stdout)


def _expanded(path: Path, arguments: Mapping[str, object], package_dirs: tuple[Path, ...]) -> str:
    """Return the URDF that a macro file stands for.

    Raises:
        RobotError: xacro cannot expand it, or it does not ask for an argument.
    """
    import xacro

    asked = _Arguments({name: _written(value) for name, value in arguments.items()})
    try:
        with _packages_found_by(lambda package: find_package(package, path, package_dirs)):
            document = xacro.process_file(str(path), mappings=asked)
        # Without xacro's own comments, which hold the path.
        expanded: str = document.documentElement.toxml()
    except Exception as error:  # expressions of the file may raise anything
        reason = _reason(error)
        raise RobotError(f"{path}: xacro cannot expand it: {reason}{_place(xacro, path)}") from None
    unasked = [name for name in arguments if name not in asked.asked]
    if unasked:
        message = unknown_name("argument", unasked[0], sorted(asked.asked))
        raise RobotError(f"{path}: robot.xacro_args: {message}")
    return expanded


class _Arguments(dict[str, str]):
    """Arguments that remember which of them a file asked for."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def _written(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


@contextmanager
def _packages_found_by(find: Any) -> Iterator[None]:
    """Answer xacro's questions for the folders of packages, which it asks of ROS's index."""
    index, packages = ModuleType(_INDEX), ModuleType(f"{_INDEX}.packages")
    vars(packages)["get_package_share_directory"] = lambda package: str(find(package))
    vars(index)["packages"] = packages
    ours = {_INDEX: index, f"{_INDEX}.packages": packages}
    before = {name: sys.modules.get(name) for name in ours}
    sys.modules.update(ours)
    try:
        yield
    finally:
        for name, module in before.items():
            del sys.modules[name]
            if module is not None:
                sys.modules[name] = module


def _reason(error: BaseException) -> str:
    """Return why xacro gave up, on one line."""
    inner = getattr(error, "exc", None)
    if isinstance(inner, RobotError):
        return str(inner)
    if isinstance(error, MemoryError) or isinstance(inner, MemoryError):
        return f"it takes more than {_MAX_MEMORY / 1e9:g} GB"
    if isinstance(error, RecursionError):
        return "it includes or calls itself without end"
    return " ".join(str(error).split()) or type(error).__name__


def _place(xacro: Any, path: Path) -> str:
    """Return which included file xacro was in, if it was in one."""
    files = [file for file in xacro.filestack or () if file]
    return f" (in {files[-1]})" if files and files[-1] != str(path) else ""


# ---- SRDF files: which pairs of links may touch, and named configurations.


def read_allowed_pairs(path: Path) -> list[tuple[str, str]]:
    """Return the pairs of links whose collisions an SRDF disables.

    Args:
        path: The file.

    Raises:
        RobotError: The file cannot be read, is no SRDF, or an entry names no link.
    """
    return [
        (read_name(str(path), entry, "link1"), read_name(str(path), entry, "link2"))
        for entry in _root(path).findall("disable_collisions")
    ]


def read_group_state(path: Path, name: str, joint_names: Sequence[str]) -> list[float]:
    """Return the configuration (n,) that an SRDF has under a name [rad or m].

    Other joints of the state do not count. Of groups that share the name, the first one counts that
    has all the joints.

    Args:
        path: The file.
        name: The attribute `name` of a `<group_state>`.
        joint_names: The n joints.

    Raises:
        RobotError: As `read_allowed_pairs`; or there is no such state, it lacks a joint, or a value
            is no number.
    """
    states = _root(path).findall("group_state")
    named = [state for state in states if state.get("name") == name]
    if not named:
        known = sorted({state.get("name", "") for state in states})
        raise RobotError(f"{path}: {unknown_name('group_state', name, known)}")
    values = [_texts(path, state) for state in named]
    missing = [[joint for joint in joint_names if joint not in texts] for texts in values]
    best = min(range(len(named)), key=lambda k: len(missing[k]))
    if missing[best]:
        group = named[best].get("group", "")
        raise RobotError(
            f"{path}: group_state '{name}' of group '{group}' has no value for joint "
            f"{', '.join(missing[best])}; its joints are {', '.join(values[best]) or 'none'}"
        )
    return [_number(path, name, joint, values[best][joint]) for joint in joint_names]


def read_group_states(path: Path) -> dict[str, dict[str, float]]:
    """Return the positions of joints in every <group_state>, by its name; the last of equal names.

    Joints of several values are left out.

    Args:
        path: The file.

    Raises:
        RobotError: As `read_allowed_pairs`, or a value is no number.
    """
    return {
        name: {
            joint: _number(path, name, joint, text)
            for joint, text in _texts(path, state).items()
            if len(text.split()) == 1
        }
        for state in _root(path).findall("group_state")
        for name in [read_name(str(path), state, "name")]
    }


def _root(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(read_bytes(path, _MAX_BYTES))
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} cannot be read as SRDF: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: the root element is <{root.tag}>, not <robot>")
    return root


def _texts(path: Path, state: ElementTree.Element) -> dict[str, str]:
    """Return the values of a state by joint, as they are written."""
    return {
        read_name(str(path), joint, "name"): joint.get("value", "")
        for joint in state.findall("joint")
    }


def _number(path: Path, state: str, joint: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RobotError(
            f"{path}: group_state '{state}' has {shown(text)} for joint '{joint}'; it must be a "
            "number"
        ) from None
