"""Files beside a URDF: xacro sources, expanded in a process of their own; SRDF files."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import CodeType, ModuleType

from tubeplanner.documents import DocumentError, read_bytes, require_regular
from tubeplanner.errors import RobotError, not_installed, shown, unknown_name
from tubeplanner.resources import PackageDirs, find_package
from tubeplanner.robot.urdf_elements import read_name

# ---- Macro files of robots, `.xacro`.

XACRO_ENDING = ".xacro"
_NAMESPACE = "/xacro"  # end of the namespaces in use: www.ros.org/wiki/xacro, wiki.ros.org/xacro
_MAX_BYTES = 50_000_000
_TIME_LIMIT = 10.0  # [s]: robots of hundreds of links take one
_PROGRAM = """import sys
sys.path[:] = {path!r}
from tubeplanner.robot.ros_files import serve
serve()
"""


def contents(path: Path) -> bytes:
    """Return the contents of a file of a robot; raise RobotError if it cannot be read."""
    try:
        return read_bytes(path, _MAX_BYTES)
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from error


def parsed_robot(path: Path, xml: bytes, kind: str) -> ElementTree.Element:
    """Return the <robot> of a URDF or SRDF; raise RobotError without, or if it has xacro's tags."""
    try:
        root = ElementTree.fromstring(xml)
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} cannot be read as {kind}: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: the root element is <{root.tag}>, not <robot>")
    for element in root.iter():
        namespace, _, tag = str(element.tag).rpartition("}")
        if namespace.endswith(_NAMESPACE):
            stem, _, ending = path.name.partition(".")
            raise RobotError(
                f"{path} holds <xacro:{tag}>: it must be expanded first, by "
                f"xacro {path.name} > {stem}.expanded.{ending or 'urdf'}; a file named "
                f"{stem}.{ending or 'urdf'}{XACRO_ENDING} is expanded when it is read"
            )
    return root


def expanded(
    path: Path, arguments: Mapping[str, object], package_dirs: PackageDirs, uses_all: bool = True
) -> bytes:
    """Return the URDF or SRDF of a macro file, expanded in a process of its own.

    Includes are relative to the file that names them; truth values are written true and false. With
    `uses_all` the file must use every argument.
    """
    try:
        import xacro  # noqa: F401
    except ImportError:
        raise RobotError(not_installed("xacro", str(path), "xacro")) from None
    try:
        require_regular(path, _MAX_BYTES)
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from None
    folders = [
        [each[0], str(each[1])] if isinstance(each, tuple) else str(each) for each in package_dirs
    ]
    request = {
        "path": str(path),
        "arguments": dict(arguments),
        "package_dirs": folders,
        "uses_all": uses_all,
    }
    remedy = "simplify it, or expand it yourself and name the URDF"
    try:
        process = subprocess.run(
            [sys.executable, "-c", _PROGRAM.format(path=sys.path)],
            input=json.dumps(request).encode(),
            capture_output=True,
            timeout=_TIME_LIMIT,
        )
        answer: dict[str, str] = json.loads(process.stdout)
    except subprocess.TimeoutExpired:
        raise RobotError(
            f"{path}: xacro cannot expand it within {_TIME_LIMIT:g} s; {remedy}"
        ) from None
    except ValueError:
        raise RobotError(f"{path}: xacro ended without an answer; {remedy}") from None
    if "fault" in answer:
        raise RobotError(answer["fault"])
    xml = answer["xml"].encode()
    if len(xml) > _MAX_BYTES:
        raise RobotError(f"{path}: what it stands for is larger than {_MAX_BYTES / 1e6:g} MB")
    return bytes(xml)


# ---- The process in which the package xacro expands a macro file, as `ros2 run xacro` does.
#
# Macro files are programs: in a process of its own, an endless or greedy file can be stopped.

_INDEX = "ament_index_python"
_MAX_MEMORY = 1_000_000_000  # [bytes] of addresses
_FRAMES = ("gi_frame", "cr_frame", "ag_frame", "tb_frame")  # lead to the callers' names


def serve() -> None:
    """Answer the JSON request on standard input by JSON on standard output.

    The request has path, arguments, package_dirs, uses_all; the answer has either xml or a fault.
    Windows and macOS do not limit the memory.
    """
    try:
        resource = import_module("resource")
        resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY, _MAX_MEMORY))
    except (ImportError, ValueError, OSError):
        if sys.platform == "linux":
            raise
    request = json.load(sys.stdin)
    sys.addaudithook(_refuse_programs)
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # its warnings are for authors
        try:
            folders = tuple(
                (each[0], Path(each[1])) if isinstance(each, list) else Path(each)
                for each in request["package_dirs"]
            )
            parts = Path(request["path"]), request["arguments"], folders, request["uses_all"]
            answer = {"xml": _expanded(*parts)}
        except RobotError as error:
            answer = {"fault": str(error)}
    json.dump(answer, sys.stdout)


def _refuse_programs(event: str, values: tuple[object, ...]) -> None:
    """Refuse the ways from xacro's expressions to Python's own names, and to programs."""
    codes = [values[0]] if event == "exec" else []
    for code in codes:
        if not isinstance(code, CodeType) or code.co_filename != "<expression>":
            continue
        codes += code.co_consts  # lambdas and generators, which xacro does not look into
        for name in code.co_names:
            if name.startswith("__") or name in _FRAMES:
                raise PermissionError(f"a macro file may not use {name}")
    if event.startswith(
        ("subprocess.", "os.system", "os.exec", "os.fork", "os.posix_spawn", "socket.", "ctypes.")
    ):
        raise PermissionError(f"a macro file may not use {event}")


def _expanded(
    path: Path, arguments: Mapping[str, object], package_dirs: PackageDirs, uses_all: bool
) -> str:
    """Return the XML of a macro file, expanded in this process."""
    import xacro

    mappings = _Arguments(
        (name, str(value).lower() if isinstance(value, bool) else str(value))
        for name, value in arguments.items()
    )
    try:
        with _package_index(lambda package: find_package(package, path, package_dirs)):
            document = xacro.process_file(str(path), mappings=mappings)
        # Without xacro's own comments, which hold the path.
        expanded: str = document.documentElement.toxml()
    except Exception as error:  # expressions of the file may raise anything
        files = [file for file in xacro.filestack or () if file]
        included = f" (in {files[-1]})" if files and files[-1] != str(path) else ""
        reason = f"{_reason(error)}{included}"
        if "Undefined substitution argument" in reason:
            arguments_of_file: list[str] = []  # none if the file is no XML
            with suppress(ElementTree.ParseError, OSError):
                every = ElementTree.parse(path).iter()
                elements = [each for each in every if str(each.tag).endswith(f"{_NAMESPACE}}}arg")]
                arguments_of_file = [str(element.get("name")) for element in elements]
            names = ", ".join(dict.fromkeys(arguments_of_file)) or "none"
            reason += f"; give it in robot.xacro_args or by --xacro-arg (its <xacro:arg>: {names})"
        raise RobotError(f"{path}: xacro cannot expand it: {reason}") from None
    unused = [name for name in arguments if name not in mappings.requested]
    if unused and uses_all:
        message = unknown_name("argument", unused[0], sorted(mappings.requested))
        raise RobotError(f"{path}: robot.xacro_args: {message}")
    return expanded


class _Arguments(dict[str, str]):
    """Arguments that record the names that a file requests."""

    def __init__(self, values: Iterable[tuple[str, str]]) -> None:
        super().__init__(values)
        self.requested: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.requested.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.requested.add(name)
        return super().__getitem__(name)


@contextmanager
def _package_index(find: Callable[[str], Path]) -> Iterator[None]:
    """Put a function that finds packages in place of ROS's index, which xacro imports."""
    index, packages = ModuleType(_INDEX), ModuleType(f"{_INDEX}.packages")
    vars(packages)["get_package_share_directory"] = lambda package: str(find(package))
    vars(index)["packages"] = packages
    replacements = {_INDEX: index, f"{_INDEX}.packages": packages}
    originals = {name: sys.modules.get(name) for name in replacements}
    sys.modules.update(replacements)
    try:
        yield
    finally:
        for name, module in originals.items():
            del sys.modules[name]
            if module is not None:
                sys.modules[name] = module


def _reason(error: BaseException) -> str:
    """Return the reason of xacro's error, on a single line."""
    inner = getattr(error, "exc", None)
    if isinstance(inner, RobotError):
        return str(inner)
    if isinstance(error, MemoryError) or isinstance(inner, MemoryError):
        return f"it takes more than {_MAX_MEMORY / 1e9:g} GB"
    if isinstance(error, RecursionError):
        return "it includes or calls itself without end"
    return " ".join(str(error).split()) or type(error).__name__


# ---- SRDF files: pairs of links that may touch, and named configurations.

# Tags by which MoveIt allows and forbids contacts, in the order in which it reads them.
_DEFAULTS, _ENABLED, _DISABLED = (
    *("disable_default_collisions", "enable_collisions"),
    "disable_collisions",
)
_OTHER_TAGS = (
    *("group", "group_state", "end_effector", "virtual_joint", "passive_joint"),
    *("joint_property", "link_sphere_approximation"),
)
_MAX_NAMES = 8  # of links in a note


@dataclass(frozen=True, eq=False)
class Srdf:
    """An SRDF."""

    path: Path
    root: ElementTree.Element  # its <robot>

    def allowed_pairs(self, links: Sequence[str]) -> list[tuple[str, str]]:
        """Return the pairs of a robot's links that may touch, each once.

        As in MoveIt: a link of <disable_default_collisions> may touch all others but those of its
        <enable_collisions>; <disable_collisions> holds in any case.
        """
        names = set(links)
        checked = {frozenset(pair) for pair in self._pairs[_ENABLED]}
        default = [
            (link, other)
            for link in self._links
            for other in links
            if other != link and frozenset((link, other)) not in checked
        ]
        pairs = [pair for pair in (*self._pairs[_DISABLED], *default) if names.issuperset(pair)]
        return list({frozenset(pair): pair for pair in reversed(pairs)}.values())[::-1]

    @cached_property
    def passive_joints(self) -> list[str]:
        """Names of the joints without a motor."""
        return [read_name(str(self.path), e, "name") for e in self.root.findall("passive_joint")]

    def notes(self, links: Sequence[str]) -> tuple[str, ...]:
        """Return sentences on links that a robot lacks, and on tags that SRDF does not define."""
        paired = (link for pairs in self._pairs.values() for pair in pairs for link in pair)
        named = [*self._links, *paired]
        unknown = [name for name in dict.fromkeys(named) if name not in links]
        defined = (*self._pairs, _DEFAULTS, *_OTHER_TAGS)
        tags = {str(element.tag): None for element in self.root if element.tag not in defined}
        notes = []
        if unknown:
            more = len(unknown) - _MAX_NAMES
            listed = ", ".join(unknown[:_MAX_NAMES]) + f" and {more} more" * (more > 0)
            notes.append(
                f"{self.path}: the URDF has no link {listed}; pairs with such a name "
                "count for nothing: another robot's SRDF, or another spelling?"
            )
        if tags:
            notes.append(
                f"{self.path}: SRDF does not define, and nothing here uses: "
                + ", ".join(f"<{tag}>" for tag in tags)
            )
        return tuple(notes)

    @cached_property
    def _links(self) -> list[str]:
        """Names of the links whose contacts are allowed by default."""
        return [read_name(str(self.path), e, "link") for e in self.root.findall(_DEFAULTS)]

    @cached_property
    def _pairs(self) -> dict[str, list[tuple[str, str]]]:
        where = str(self.path)
        return {
            tag: [
                (read_name(where, entry, "link1"), read_name(where, entry, "link2"))
                for entry in self.root.findall(tag)
            ]
            for tag in (_ENABLED, _DISABLED)
        }

    def group_state(self, name: str, joint_names: Sequence[str]) -> list[float]:
        """Return a named configuration, n values [rad or m].

        Other joints of the state do not count. If several groups have the name, the first group
        with all n joints counts.
        """
        states = self.root.findall("group_state")
        named = [state for state in states if state.get("name") == name]
        if not named:
            names = sorted({state.get("name", "") for state in states})
            raise RobotError(f"{self.path}: {unknown_name('group_state', name, names)}")
        values = [self._texts(state) for state in named]
        missing = [[joint for joint in joint_names if joint not in texts] for texts in values]
        best = min(range(len(named)), key=lambda k: len(missing[k]))
        if missing[best]:
            group = named[best].get("group", "")
            raise RobotError(
                f"{self.path}: group_state '{name}' of group '{group}' has no value for joint "
                f"{', '.join(missing[best])}; its joints are {', '.join(values[best]) or 'none'}"
            )
        return [self._number(name, joint, values[best][joint]) for joint in joint_names]

    def group_states(self) -> dict[str, dict[str, float]]:
        """Return the positions of joints in every <group_state>, by its name; the last of equals.

        Joints of several values are left out.
        """
        return {
            name: {
                joint: self._number(name, joint, text)
                for joint, text in self._texts(state).items()
                if len(text.split()) == 1
            }
            for state in self.root.findall("group_state")
            for name in [read_name(str(self.path), state, "name")]
        }

    def _texts(self, state: ElementTree.Element) -> dict[str, str]:
        """Return the texts of a state's values, by joint."""
        return {
            read_name(str(self.path), joint, "name"): joint.get("value", "")
            for joint in state.findall("joint")
        }

    def _number(self, state: str, joint: str, text: str) -> float:
        try:
            return float(text)
        except ValueError:
            raise RobotError(
                f"{self.path}: group_state '{state}' has {shown(text)} for joint '{joint}'; it "
                "must be a number"
            ) from None


def read_srdf(
    path: Path,
    xacro_args: Mapping[str, object] | None = None,
    package_dirs: PackageDirs = (),
    uses_all: bool = False,
) -> Srdf:
    """Read an SRDF; arguments as of `expanded`, for a file that ends in .xacro.

    Raises:
        RobotError: The file cannot be read or expanded, or is no SRDF.
    """
    is_macro = path.suffix == XACRO_ENDING
    xml = expanded(path, xacro_args or {}, package_dirs, uses_all) if is_macro else contents(path)
    return Srdf(path, parsed_robot(path, xml, "SRDF"))
