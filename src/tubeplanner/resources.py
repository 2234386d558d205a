"""Search for robots, problems, presets and meshes on this machine; the user's cache folder.

`example:` names come first from the robots bundled with this package, then from the installed
distribution example-robot-data.
"""

import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TypeAlias
from urllib.parse import unquote

from tubeplanner.documents import DocumentError, read_text
from tubeplanner.errors import ProblemError, RobotError, shown, unknown_name

# Folders that hold packages, or the name and the folder of a package.
PackageDirs: TypeAlias = tuple[Path | tuple[str, Path], ...]
GivenPackageDirs: TypeAlias = Sequence[str | Path] | Mapping[str, str | Path]
EXAMPLE_PREFIX = "example:"
CACHE_VARIABLE = "TUBEPLANNER_CACHE"  # a folder, or "off"
_PACKAGE_PREFIX = "package://"
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:")
_URI = re.compile(_SCHEME.pattern + "/")  # without the slash it may be the name of a file
# file:PATH, file:/PATH, file://PATH (relative, as ROS reads it), file:///PATH,
# file://localhost/PATH
_FILE_SCHEME = re.compile(r"file:(//(localhost(?=/))?)?")
_DRIVE = re.compile(r"(file:/*)?([A-Za-z]:)")
_SUBSTITUTION = re.compile(r"\$[({A-Za-z][^)}/\\]*[)}]?")
_PACKAGE_NAME = re.compile(r"<name\s*>\s*([^<]*?)\s*</name\s*>")
_COMMENT = re.compile(r"<!--.*?-->", re.S)
_MAX_PACKAGE_FILE = 1_000_000  # [bytes]
_PRESETS = "presets"  # the bundled folder that holds limits and motors alone
PRESET_ENDINGS = (".yaml", ".yml", ".json")
# The line by which a bundled file is a cycle or study; every other file is a problem.
_FORMAT = re.compile(r"^format: *tubeplanner/(cycle|study)\b", re.M)


@cache
def _example_robots() -> dict[str, str]:
    """Return the URDFs of example-robot-data, below its folder `robots`, by the name of `example:`.

    The names are those of its former loaders; the distribution itself has data only. Releases 5.0
    and 6.0 are covered; not every robot is in both.
    """
    table: dict[str, str] = json.loads(Path(__file__).with_name("example_robots.json").read_text())
    return table


def bundled_folder() -> Path:
    """Return the folder `robots`: inside the installed package, or at the root of a checkout."""
    installed = Path(__file__).parent / "robots"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "robots"


def bundled_robots() -> dict[str, Path]:
    """Return the bundled URDFs, by name of the robot."""
    return {path.stem: path for path in sorted(bundled_folder().glob("*/*.urdf"))}


def bundled_problems() -> dict[str, Path]:
    """Return every bundled problem file by its name `ROBOT/NAME`."""
    return _bundled_of("problem")


def bundled_cycles() -> dict[str, Path]:
    """Return every bundled cycle file by its name `ROBOT/NAME`."""
    return _bundled_of("cycle")


def bundled_studies() -> dict[str, Path]:
    """Return every bundled study file by its name `ROBOT/NAME`."""
    return _bundled_of("study")


def _bundled_of(kind: str) -> dict[str, Path]:
    files = {}
    for name, path in _bundled_files().items():
        match = _FORMAT.search(path.read_text("utf-8"))
        if kind == ("problem" if match is None else match[1]):
            files[name] = path
    return files


def _bundled_files() -> dict[str, Path]:
    """Return every bundled problem, cycle and study file by its name."""
    paths = sorted(bundled_folder().glob("*/*.yaml"))
    return {
        f"{path.parent.name}/{path.stem}": path for path in paths if path.parent.name != _PRESETS
    }


def bundled_presets() -> dict[str, Path]:
    """Return every bundled preset by its name."""
    return {path.stem: path for path in sorted((bundled_folder() / _PRESETS).glob("*.yaml"))}


def example_robot_names() -> list[str]:
    """Return every NAME for which `example:NAME` has a URDF on this machine."""
    installed = {name for name in _example_robots() if _example_robot_path(name).is_file()}
    return sorted({*bundled_robots(), *installed})


def cache_folder() -> Path | None:
    """Return the folder for what is computed from meshes; None: nothing is kept."""
    variable = os.environ.get(CACHE_VARIABLE)
    if variable == "off":
        return None
    if variable:
        return Path(variable)
    import platformdirs

    folder = platformdirs.user_cache_path("tubeplanner", appauthor=False)
    return folder if folder.is_absolute() else None  # of a user without a home, it begins with ~


def find_problem(name: str | Path, directory: Path) -> Path:
    """Return the path of a problem, cycle or study file by its path or `example:ROBOT/NAME`.

    Raises:
        ProblemError: The file, or the bundled one, does not exist.
    """
    text = str(name)
    if text.startswith(EXAMPLE_PREFIX):
        files = _bundled_files()
        key = text.removeprefix(EXAMPLE_PREFIX)
        if key not in files:
            raise ProblemError(unknown_name("bundled problem", key, files))
        return files[key]
    path = directory / text
    if not _exists(path):
        raise ProblemError(f"problem file {path} does not exist")
    if path.is_dir():
        raise ProblemError(f"{path} is a folder; name a problem file")
    return path


def find_preset(name: str | Path, directory: Path) -> Path:
    """Return the path of a preset by its bundled name or the path of a YAML or JSON file.

    Raises:
        RobotError: The preset does not exist.
    """
    presets = bundled_presets()
    if str(name) in presets:
        return presets[str(name)]
    path = directory / name
    if path.suffix not in PRESET_ENDINGS:
        message = unknown_name("preset", str(name), presets)
        raise RobotError(f"{message}, or the path of a YAML file")
    if not _exists(path) or path.is_dir():
        raise RobotError(f"preset {path} does not exist; bundled are {', '.join(presets)}")
    return path


def find_limits_file(name: str, directory: Path, package_dirs: PackageDirs = ()) -> Path:
    """Return the path of a file of joint limits: a path, `file://`, or `package://PACKAGE/...`."""
    return _find_named("robot.limits_file", name, directory, package_dirs)


def find_description(name: str | Path, directory: Path, package_dirs: PackageDirs = ()) -> Path:
    """Return the path of a URDF by a path, `file://`, `package://PACKAGE/...` or `example:NAME`.

    Raises:
        RobotError: The file or the name does not exist.
    """
    text = str(name)
    if text.startswith(EXAMPLE_PREFIX):
        return _find_example_urdf(text.removeprefix(EXAMPLE_PREFIX))
    path = _find_named("robot description", text, directory, package_dirs)
    return path if text.startswith(_PACKAGE_PREFIX) else path.resolve()


def find_mesh(filename: str, urdf: Path, package_dirs: PackageDirs = ()) -> Path:
    """Return the path of a mesh named in a URDF, the same for every reader of the URDF.

    The name is `package://`, `file:`, absolute, or relative to the URDF; `%20` stands for a blank
    unless a file has that very name.

    Raises:
        RobotError: The mesh does not exist; every folder that was tried is listed.
    """
    return _find_named("mesh", filename, urdf.parent, package_dirs, urdf)


def find_package(package: str, file: Path, package_dirs: PackageDirs = ()) -> Path:
    """Return the folder of a package that a file names; folders above the file are searched.

    Raises:
        RobotError: No folder has the package; every folder that was tried is listed.
    """
    roots = (*package_dirs, *file.resolve().parents, *_environment_roots())
    existing = list(_package_folders(package, roots, package_dirs))
    declared = [folder for folder in existing if (folder / "package.xml").is_file()]
    for folder in (*declared, *existing):
        return folder.resolve()
    raise RobotError(_not_found(f"package '{package}'", package, roots))


def rebased(name: str, before: Path, after: Path) -> str:
    """Return the name of a file relative to another folder; absolute names and URIs stay."""
    head, tail = _without_file_scheme(name)
    if name.startswith(EXAMPLE_PREFIX) or tail.startswith("/") or _URI.match(tail):
        return name
    return head + os.path.relpath((before / tail).resolve(), after.resolve())


def _exists(path: Path) -> bool:
    """Return True if a path exists; a path that is too long for the system does not."""
    try:
        return path.exists()
    except OSError:
        return False


@cache
def _example_robot_data_share() -> Path:
    """Return the folder that holds the package example-robot-data, of pip or of conda."""
    prefixes = [Path(entry) / "cmeel.prefix" for entry in sys.path]
    prefixes += [Path(sys.prefix), Path(sys.prefix) / "Library"]
    for prefix in prefixes:
        if (prefix / "share" / "example-robot-data" / "package.xml").is_file():
            return (prefix / "share").resolve()
    raise RobotError("example-robot-data is not installed: pip install example-robot-data")


def _find_example_urdf(name: str) -> Path:
    bundled = bundled_robots()
    if name in bundled:
        return bundled[name]
    if name not in _example_robots():
        raise RobotError(unknown_name("example robot", name, example_robot_names()))
    path = _example_robot_path(name)
    if not path.is_file():
        raise RobotError(
            f"example robot '{name}' is not in the installed example-robot-data ({path}); it comes "
            "with another release"
        )
    return path


def _example_robot_path(name: str) -> Path:
    robots = _example_robot_data_share() / "example-robot-data" / "robots"
    return robots / _example_robots()[name]


def _environment_roots() -> list[Path]:
    """Return the folders that hold packages: of example-robot-data, then of a ROS setup."""
    roots = [Path(entry) for entry in _environment_paths("ROS_PACKAGE_PATH")]
    roots += [Path(entry) / "share" for entry in _environment_paths("AMENT_PREFIX_PATH")]
    try:
        return [_example_robot_data_share(), *roots]
    except RobotError:
        return roots


def _environment_paths(variable: str) -> list[str]:
    return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _find_named(
    label: str, name: str, directory: Path, package_dirs: PackageDirs, urdf: Path | None = None
) -> Path:
    """Return the file of a path or URI; with a URDF, the folders above it may hold packages."""
    if name.startswith(_PACKAGE_PREFIX):
        above = () if urdf is None else urdf.absolute().parents
        return _find_in_packages(name, (*package_dirs, *above, *_environment_roots()), package_dirs)
    head, tail = _without_file_scheme(name)
    paths = [directory / each for each in dict.fromkeys((tail, unquote(tail)))]
    for path in paths:
        if _URI.match(tail) is None and os.path.isfile(path):
            return path
    named = "" if urdf is None else f", named in {urdf},"
    if fault := _fault_of_name(name):
        raise RobotError(f"{label} {shown(name)}{named} {fault}")
    hint = _other_case(paths)
    if not hint and head and not tail.startswith("/"):
        hint = f" ({head} without a third slash is relative)"
    raise RobotError(f"{label} {paths[0]}{named} does not exist{hint}")


def _without_file_scheme(name: str) -> tuple[str, str]:
    """Return the scheme `file:` of a name with its slashes and host, and the path after it."""
    scheme = _FILE_SCHEME.match(name)
    head, tail = ("", name) if scheme is None else (scheme[0], name[scheme.end() :])
    return head, "/" + tail.lstrip("/") if tail.startswith("//") else tail


def _fault_of_name(name: str) -> str | None:
    """Return the reason why a name can lead to no file; None without a reason."""
    if name != name.strip():
        return "begins or ends with blanks; remove them"
    if match := _SUBSTITUTION.search(name):
        return f"holds {match[0]}, which xacro or a shell replaces; write what it stands for"
    if match := _DRIVE.match(name):
        return f"is on the Windows drive {match[2]}; name it by package:// or relative to its file"
    if "\\" in name:
        return "has backslashes; write / instead"
    if name.removeprefix("file://").startswith("~"):
        return "begins with ~, which only a shell replaces; write the folder"
    scheme = _SCHEME.match(name)
    if name.startswith(_PACKAGE_PREFIX + "/"):
        return "names no package; write package://PACKAGE/PATH"
    if scheme is None or name.startswith((_PACKAGE_PREFIX, "file:")):
        return None
    if scheme[0].lower() in ("package:", "file:"):
        return f"begins with {scheme[0]}; write {scheme[0].lower()}//"
    return f"has the unknown scheme {scheme[0]}; known are package:// and file://"


def _other_case(paths: list[Path]) -> str:
    """Return a half sentence on a file whose path differs in upper and lower case alone."""
    for path in paths:
        here = Path("/")
        try:
            for part in Path(os.path.abspath(path)).parts[1:]:
                if not (here / part).exists():
                    part = {each.casefold(): each for each in os.listdir(here)}[part.casefold()]
                here /= part
        except (OSError, ValueError, KeyError):
            continue
        if here.is_file():
            return f"; there is {here} (upper and lower case count)"
    return ""


def _find_in_packages(uri: str, roots: PackageDirs, package_dirs: PackageDirs) -> Path:
    """Return the file of a `package://` URI, in a folder of the package."""
    paths, package = [], ""
    for text in dict.fromkeys((uri, unquote(uri))):
        package, _, tail = text.removeprefix(_PACKAGE_PREFIX).partition("/")
        # Dots are taken out before the path meets the disk, as in every URI: `..` behind a
        # symbolic link would lead elsewhere. Links themselves may leave the package.
        first, *inside = os.path.normpath(f"./{package}/{tail}").split("/")
        if not package:
            first, inside = "", [first, *inside]
        if first != package or ".." in (first, *inside) or not inside:
            reason = f"leads out of the package '{package}', or to nothing in it"
            raise RobotError(f"{uri} {_fault_of_name(uri) or reason}")
        for folder in _package_folders(package, roots, package_dirs):
            path = folder.joinpath(*inside)
            if os.path.isfile(path):
                return path
            paths.append(path)
    if fault := _fault_of_name(uri):
        raise RobotError(f"{shown(uri)} {fault}")
    if paths:
        raise RobotError(
            f"{uri} was not found: the package has no file {paths[0]}{_other_case(paths)}. If this "
            "is another package of that name, add the folder of the right one to package_dirs"
        )
    raise RobotError(_not_found(uri, package, roots))


def _package_folders(package: str, roots: PackageDirs, package_dirs: PackageDirs) -> Iterator[Path]:
    """Yield the folders of a package by their names, or by the names in their package.xml.

    A root holds the package or is the package. Under another name it is looked for in the package
    folders of the user alone: others may hold thousands of folders.
    """
    for root in roots:
        if isinstance(root, tuple):
            if root[0] == package:
                yield root[1]
        elif os.path.isdir(root / package):
            yield root / package
        elif root in package_dirs:
            files = sorted(root.glob("*/package.xml"))
            yield from (file.parent for file in files if _package_name(file.parent) == package)
        if isinstance(root, Path) and package in (root.name, _package_name(root)):
            yield root


def _package_name(folder: Path) -> str | None:
    """Return the name in the package.xml of a folder; None without such a file or name."""
    try:
        text = read_text(folder / "package.xml", _MAX_PACKAGE_FILE)
    except DocumentError:
        return None
    match = _PACKAGE_NAME.search(_COMMENT.sub("", text))
    return None if match is None else match[1]


def _not_found(what: str, package: str, roots: PackageDirs) -> str:
    folders = [root if isinstance(root, Path) else root[1] for root in roots]
    searched = ", ".join(map(str, dict.fromkeys(folders)))
    names = {name for each in folders for name in (each.name, _package_name(each)) if name}
    near = sorted(name for name in names if name.casefold() == package.casefold())
    case = f"; there is '{near[0]}' (upper and lower case count)" if near else ""
    return (
        f"{what} was not found{case}; folders tried: {searched}. "
        f"Add the folder that holds '{package}' to package_dirs"
    )
