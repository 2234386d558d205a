"""The library as built, argument types of its functions; None without a build."""

import ast
import ctypes
import lzma
import os
import re
import subprocess
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from native_exports import exports

from tubeplanner.native import library
from tubeplanner.native.build import SOURCES, compiler, levels, library_path, source_key
from tubeplanner.native.library import LIBRARY, Bytes, Doubles, Integers, NativeLibrary

IS_BUILT = pytest.mark.skipif(not library_path("baseline").exists(), reason="it is not built")


def loaded(monkeypatch, **environment):
    for name in ("TUBEPLANNER_PURE", "TUBEPLANNER_BASELINE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    return NativeLibrary.load()


def elsewhere(monkeypatch, folder):
    """Let libraries be looked for in a folder."""
    monkeypatch.setattr(library, "library_path", lambda level: library_path(level, folder))


def test_without_a_library_it_is_pure_python_and_says_so(monkeypatch, tmp_path):
    elsewhere(monkeypatch, tmp_path)
    reason = "no native library was compiled at the installation"
    assert loaded(monkeypatch) == NativeLibrary(None, f"pure Python ({reason})")
    library_path("baseline", tmp_path).write_bytes(b"no library")
    result = loaded(monkeypatch)
    assert result.functions is None
    assert result.build.startswith("pure Python (the library does not load: ")


@pytest.mark.parametrize(("value", "is_left_out"), [("yes", True), ("0", False)])
def test_the_environment_leaves_it_out(value, is_left_out, monkeypatch):
    result = loaded(monkeypatch, TUBEPLANNER_PURE=value)
    pure = NativeLibrary(None, "pure Python (TUBEPLANNER_PURE is set)")
    assert (result == pure) == is_left_out


@IS_BUILT
def test_the_newest_level_that_the_processor_runs_is_loaded(monkeypatch):
    baseline = ctypes.CDLL(str(library_path("baseline")))
    expected = levels()[-1] if baseline.tubeplanner_runs_v3() else "baseline"
    assert re.fullmatch(rf"native \(\S+, {expected}\)", loaded(monkeypatch).build)
    older = loaded(monkeypatch, TUBEPLANNER_BASELINE="1")
    assert re.fullmatch(r"native \(\S+, baseline\)", older.build)


@pytest.mark.skipif(not os.path.exists("/proc/cpuinfo"), reason="the system does not tell")
@pytest.mark.skipif("x86-64-v3" not in levels(), reason="of another kind")
@IS_BUILT
def test_the_processor_is_asked_as_the_system_does():
    with open("/proc/cpuinfo") as file:
        flags = set(re.search(r"flags\s*:(.*)", file.read())[1].split())
    needed = {"avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe"}
    baseline = ctypes.CDLL(str(library_path("baseline")))
    assert bool(baseline.tubeplanner_runs_v3()) == (needed <= flags)


@IS_BUILT
def test_changed_sources_leave_it_out_and_name_the_command(monkeypatch):
    monkeypatch.setattr(library, "source_key", lambda: "other")
    assert loaded(monkeypatch) == NativeLibrary(
        None, "pure Python (native sources have changed: python -m tubeplanner.native.build)"
    )


@IS_BUILT
def test_the_library_of_another_level_must_be_of_these_sources_too(monkeypatch, tmp_path):
    elsewhere(monkeypatch, tmp_path)
    for level in levels():
        data = library_path(level).read_bytes()
        if level != "baseline":
            data = data.replace(source_key().encode(), b"0" * 16)
        library_path(level, tmp_path).write_bytes(data)
    is_newest = ctypes.CDLL(str(library_path("baseline"))).tubeplanner_runs_v3()
    assert (loaded(monkeypatch).functions is None) == bool(is_newest)
    assert loaded(monkeypatch, TUBEPLANNER_BASELINE="1").functions is not None


C_TYPES = {"integer": ctypes.c_int64, "int": ctypes.c_int, "double": ctypes.c_double}
C_TYPES |= {"void*": ctypes.c_void_p, "void": None, "const Shapes*": ctypes.c_void_p}
C_TYPES |= {"double*": Doubles, "integer*": Integers, "bool*": Bytes}


@pytest.mark.parametrize(
    ("kind", "array"), [(Doubles, np.zeros(3, dtype=np.float32)), (Doubles, np.zeros((3, 3)).T[:2])]
)
def test_arrays_of_other_types_or_with_gaps_are_refused(kind, array):
    with pytest.raises(TypeError, match="is not a contiguous one of"):
        kind.from_param(array)


@pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")
def is_binding(node):
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "native_function"


def test_python_declares_all_functions_as_the_sources_do():
    declared = {}
    for name, export in exports().items():
        types = tuple(one.type.removeprefix("const ") for one in export.arguments)
        types = tuple(C_TYPES["void*" if one == "Shapes*" else one] for one in types)
        declared[name] = types, C_TYPES.get(export.returns, export.returns)
    signatures = {}

    def note(name, *arguments, returns=None):
        signatures[name] = arguments, returns

    package = SOURCES.parents[1]
    for path in package.rglob("*.py"):
        calls = [node for node in ast.walk(ast.parse(path.read_text())) if is_binding(node)]
        name = ".".join(["tubeplanner", *path.relative_to(package).with_suffix("").parts])
        names = {**vars(import_module(name)), "native_function": note} if calls else {}
        for call in calls:
            eval(compile(ast.Expression(call), name, "eval"), names)
    texts = {f"tubeplanner_{name}" for name in ("sources", "level", "compiler", "runs_v3")}
    assert signatures == {name: each for name, each in declared.items() if name not in texts}


HERE = Path(__file__).parent
FLAGS = ("-std=c++17", "-g", "-fopenmp-simd", "-fsanitize=address,undefined")
FLAGS += ("-fno-sanitize-recover=all", '-DTUBEPLANNER_SOURCES=""', '-DTUBEPLANNER_LEVEL=""')
FLAGS += ('-DTUBEPLANNER_COMPILER=""',)
INPUTS = lzma.decompress((HERE / "inputs.xz").read_bytes())


def compiled(folder, *arguments):
    command = [*compiler(), *FLAGS, f"-I{folder}", f"-I{SOURCES}", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr


# Compiling all sources for the sanitizers takes ten seconds; all recorded calls, a few hundredths.
@pytest.mark.slow
@pytest.mark.skipif(compiler() is None, reason="there is no C++ compiler")
def test_recorded_calls_read_and_write_within_bounds(tmp_path):
    known = exports().values()
    lines = ["#pragma once", '#include "convex_pairs.h"']
    lines += [export.declaration() for export in known]
    lines.append(f"#define EXPORTS(each) {' '.join(f'each({export.name})' for export in known)}")
    (tmp_path / "exports.h").write_text("\n".join(lines) + "\n")
    (tmp_path / "inputs").write_bytes(INPUTS)
    compiled(tmp_path, "-c", HERE / "driver.cpp")
    compiled(tmp_path, "-O1", "-c", *SOURCES.glob("*.cpp"))
    compiled(tmp_path, *tmp_path.glob("*.o"), "-o", "driver")
    command = [tmp_path / "driver", tmp_path / "inputs"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(re.fullmatch(r"(\d+) calls\n", done.stdout)[1]) > 300


def test_every_exported_function_is_called():
    uncalled = [name for name in exports() if name.encode() not in INPUTS]
    assert uncalled == [], (
        "record inputs: PYTHONPATH=src:tests/helpers python tests/native/record_inputs.py"
    )
