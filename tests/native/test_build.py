"""Which compiler builds the native library, for which processors, and what becomes of failures."""

import ctypes
import os
import shutil
import sys
from pathlib import Path

import pytest

from tubeplanner.native import build as building
from tubeplanner.native.build import (
    build,
    compiler,
    levels,
    library_path,
    machines,
    platform_tag,
    source_key,
)


def command_in(folder, name, text="exit 0"):
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


def test_the_first_compiler_of_the_path_is_taken(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert compiler({}) is None
    for name in ("clang++", "g++", "c++"):
        path = command_in(tmp_path, name)
        assert compiler({}) == (str(path),)


def test_what_the_environment_names_comes_first():
    assert compiler({"CXX": "ccache 'my g++' -m64"}) == ("ccache", "my g++", "-m64")
    zig = compiler({"CXX": "g++", "TUBEPLANNER_BUILD": "zig"})
    assert zig == (sys.executable, "-m", "ziglang", "c++")
    assert compiler({"CXX": "g++", "TUBEPLANNER_BUILD": "none"}) is None


def test_another_build_is_refused_and_without_a_compiler_nothing_is_built(tmp_path):
    with pytest.raises(
        ValueError, match="TUBEPLANNER_BUILD is 'gcc'; give zig, none or required, or do not"
    ):
        compiler({"TUBEPLANNER_BUILD": "gcc"})
    assert build(tmp_path, {"TUBEPLANNER_BUILD": "none"}) == []
    assert list(tmp_path.iterdir()) == []


def test_a_compiler_that_refuses_is_quoted_and_leaves_the_old_library(tmp_path):
    refusing = command_in(tmp_path, "refusing", "echo no such flag >&2\nexit 1")
    old = library_path("baseline", tmp_path)
    old.write_text("old")
    with pytest.raises(RuntimeError, match=r"-std=c\+\+17 (.|\n)*no such flag"):
        build(tmp_path, {"CXX": str(refusing)})
    assert old.read_text() == "old"
    assert sorted(tmp_path.iterdir()) == sorted([old, refusing])
    with pytest.raises(RuntimeError, match="/no/such/compiler does not start: No such file"):
        build(tmp_path, {"CXX": "/no/such/compiler"})


def test_each_compiler_is_told_the_processor_in_its_own_words():
    def told(*command):
        return [[*building._processor(command, level, {})] for level in ("baseline", "x86-64-v3")]

    assert told("/usr/bin/g++") == [[], ["-march=x86-64-v3"]]
    zig = told("python3", "-m", "ziglang", "c++")
    assert zig == [["-mcpu=baseline"], ["-mcpu=x86_64_v3"]]


def test_a_release_without_a_compiler_or_on_windows_fails(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match=r"required', but none of c\+\+, g\+\+, clang\+\+ is on"):
        build(tmp_path, {"TUBEPLANNER_BUILD": "required"})
    monkeypatch.setattr(sys, "platform", "win32")
    assert build(tmp_path, {"CXX": "g++"}) == []
    with pytest.raises(RuntimeError, match="'zig', but no native library is built on Windows"):
        build(tmp_path, {"TUBEPLANNER_BUILD": "zig"})


APPLE = {"MACOSX_DEPLOYMENT_TARGET": "10.13"}


@pytest.mark.parametrize(
    ("system", "environment", "kinds", "tag"),
    [
        ("linux", {"_PYTHON_HOST_PLATFORM": "linux-aarch64"}, "aarch64", "linux_aarch64"),
        (
            "linux",
            {"TUBEPLANNER_TARGET": "aarch64-linux-gnu.2.28"},
            "aarch64",
            "manylinux_2_28_aarch64",
        ),
        ("linux", {"TUBEPLANNER_TARGET": "aarch64-macos.11.0"}, "aarch64", "macosx_11_0_arm64"),
        ("darwin", APPLE | {"ARCHFLAGS": "-arch x86_64"}, "x86_64", "macosx_10_13_x86_64"),
        ("darwin", APPLE | {"ARCHFLAGS": "-arch arm64"}, "arm64", "macosx_11_0_arm64"),
        (
            "darwin",
            APPLE | {"ARCHFLAGS": "-arch arm64 -arch x86_64"},
            "arm64 x86_64",
            "macosx_10_13_universal2",
        ),
        ("darwin", {"_PYTHON_HOST_PLATFORM": "macosx-13.3-arm64"}, "arm64", "macosx_13_0_arm64"),
    ],
)
def test_a_build_for_another_platform_has_its_levels_and_tag(
    system, environment, kinds, tag, monkeypatch
):
    monkeypatch.setattr(sys, "platform", system)
    assert machines(environment) == tuple(kinds.split())
    assert ("x86-64-v3" in levels(environment)) == ("x86_64" in kinds)
    assert platform_tag(environment) == tag


def test_apples_compiler_gets_processors_and_oldest_system(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    both = APPLE | {"ARCHFLAGS": "-arch arm64 -arch x86_64"}
    oldest = "-mmacosx-version-min=10.13"
    flags = [building._processor(("c++",), level, both) for level in ("baseline", "x86-64-v3")]
    assert flags[0] == ("-arch", "arm64", "-arch", "x86_64", oldest)
    assert flags[1] == ("-arch", "x86_64", oldest, "-march=x86-64-v3")


def test_another_platform_is_compiled_for_by_zig_and_needs_its_version():
    environment = {"CXX": "g++", "TUBEPLANNER_TARGET": "aarch64-linux-gnu"}
    command = compiler(environment)
    assert command == (sys.executable, "-m", "ziglang", "c++")
    flags = building._processor(command, "baseline", environment)
    assert flags == ("-target", "aarch64-linux-gnu", "-mcpu=baseline")
    with pytest.raises(ValueError, match=r"'aarch64-linux-gnu'; give .* aarch64-linux-gnu\.2\.28"):
        platform_tag(environment)


@pytest.mark.skipif(compiler() is None, reason="there is no C++ compiler")
def test_a_library_knows_its_sources_level_and_compiler(tmp_path, monkeypatch):
    sources = tmp_path / "sources"
    sources.mkdir()
    for name in ("version.cpp", "numerics.h"):
        shutil.copy(building.SOURCES / name, sources)
    monkeypatch.setattr(building, "SOURCES", sources)
    built = build(tmp_path, os.environ)
    assert built == [library_path(level, tmp_path) for level in levels()]
    for level, path in zip(levels(), built, strict=True):
        library = ctypes.CDLL(str(path))
        answers = []
        for name in ("sources", "level", "compiler"):
            function = getattr(library, f"tubeplanner_{name}")
            function.restype = ctypes.c_char_p
            answers.append(function().decode())
        assert answers[:2] == [source_key(), level]
        assert answers[2] in ("zig", Path(compiler()[0]).name)


def test_any_change_of_a_source_or_header_gives_another_key(tmp_path, monkeypatch):
    monkeypatch.setattr(building, "SOURCES", tmp_path)
    keys = []
    for name, text in (("a.cpp", "1"), ("a.cpp", "2"), ("b.h", ""), ("b.h", "2")):
        (tmp_path / name).write_text(text)
        keys.append(source_key())
    assert len(set(keys)) == 4
    (tmp_path / "notes.txt").write_text("no source")
    assert source_key() == keys[-1]
