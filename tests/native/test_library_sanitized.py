"""The native functions under the sanitizers of addresses and undefined behaviour.

`driver.cpp` calls them with `inputs.xz`, which `tests/record_native_inputs.py` made of plans and
edge cases.
"""

import lzma
import re
import subprocess
from pathlib import Path

import pytest

from native_exports import exports
from tubeplanner.native.build import SOURCES, compiler, source_files

HERE = Path(__file__).parent
FLAGS = ("-std=c++17", "-O1", "-g", "-fopenmp-simd", "-fsanitize=address,undefined")
FLAGS += ("-fno-sanitize-recover=all", '-DTUBEPLANNER_SOURCES=""', '-DTUBEPLANNER_LEVEL=""')
FLAGS += ('-DTUBEPLANNER_COMPILER=""',)
INPUTS = lzma.decompress((HERE / "inputs.xz").read_bytes())


def sanitized(folder, sources):
    """Run the driver with some sources; return how it ended."""
    known = exports().values()
    lines = ["#pragma once", '#include "convex_pairs.h"']
    lines += [export.declaration() for export in known]
    lines.append(f"#define EXPORTS(each) {' '.join(f'each({export.name})' for export in known)}")
    (folder / "exports.h").write_text("\n".join(lines) + "\n")
    (folder / "inputs").write_bytes(INPUTS)
    files = [HERE / "driver.cpp", *sources]
    includes = (f"-I{folder}", f"-I{SOURCES}")
    command = [*compiler(), *FLAGS, *includes, *map(str, files), "-o", str(folder / "driver")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return subprocess.run([folder / "driver", folder / "inputs"], capture_output=True, text=True)


@pytest.mark.skipif(compiler() is None, reason="there is no C++ compiler")
def test_recorded_calls_read_and_write_within_bounds(tmp_path):
    done = sanitized(tmp_path, source_files())
    assert done.returncode == 0, done.stderr
    assert int(re.fullmatch(r"(\d+) calls\n", done.stdout)[1]) > 300


@pytest.mark.skipif(compiler() is None, reason="there is no C++ compiler")
def test_a_read_out_of_bounds_is_noticed(tmp_path):
    sources = [path for path in source_files() if path.stem != "spline_basis"]
    wrong = (SOURCES / "spline_basis.cpp").read_text()
    right = "n < count; ++n, weights += POINTS"
    assert right in wrong
    (tmp_path / "spline_basis.cpp").write_text(wrong.replace(right, right.replace("<", "<=")))
    done = sanitized(tmp_path, [*sources, tmp_path / "spline_basis.cpp"])
    assert done.returncode != 0
    assert "heap-buffer-overflow" in done.stderr


def test_every_exported_function_is_called():
    uncalled = [name for name in exports() if name.encode() not in INPUTS]
    assert uncalled == [], "record inputs: python tests/record_native_inputs.py"
