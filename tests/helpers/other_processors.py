"""Run the tests of numerics as other processors round.

    python tests/helpers/other_processors.py "PYTEST COMMAND" [PROCESSOR ...]

OpenBLAS and NumPy choose their kernels by processor; both can be told to choose an older one's. A
processor that cannot run a newer one's kernels leaves these out, and says so. That the choice takes
effect is checked before the tests run. As the oldest one, the native library is the one that any
processor runs.
"""

import json
import os
import subprocess
import sys

FOLDERS = ("planning", "optimizer", "certificate", "trajectory", "limits")
# OpenBLAS's name of a processor, and NumPy's kernels that it lacks.
PROCESSORS = {
    "SkylakeX": ("AVX512_ICL", "AVX512_SPR"),
    "Haswell": ("X86_V4", "AVX512_ICL", "AVX512_SPR"),
    "Prescott": ("X86_V3", "X86_V4", "AVX512_ICL", "AVX512_SPR"),
}
OLDEST = "Prescott"
# Kernels that are one and the same are told by the name of the oldest processor that has them.
SAME = {"Katmai": "Prescott"}
ASK = """
import json, numpy, scipy.linalg
from tubeplanner.native.library import LIBRARY
from threadpoolctl import threadpool_info
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
blas = [one["architecture"] for one in threadpool_info() if one["internal_api"] == "openblas"]
print(json.dumps([blas, [name for name in __cpu_dispatch__ if __cpu_features__[name]],
                  LIBRARY.build]))
"""


def kernels(environment: dict[str, str]) -> tuple[list[str], list[str], str]:
    """Return the processors whose kernels OpenBLAS has chosen, those NumPy has, and the build."""
    command = [sys.executable, "-c", ASK]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    blas, numpy, build = json.loads(done.stdout)
    return [SAME.get(name, name) for name in blas], numpy, build


def environment_of(processor: str, has: list[str]) -> dict[str, str]:
    """Return the environment in which this processor rounds as another one does."""
    missing = [name for name in PROCESSORS[processor] if name in has]
    more = {"NPY_DISABLE_CPU_FEATURES": " ".join(missing)} if missing else {}
    if processor == OLDEST:
        more["TUBEPLANNER_BASELINE"] = "1"
    return {**os.environ, "OPENBLAS_CORETYPE": processor, **more}


def main(pytest: str, *processors: str) -> int:
    own, has, build = kernels(dict(os.environ))
    numpy = ", ".join(has) or "its baseline"
    print(f"this processor: OpenBLAS for {own[0]}, NumPy with {numpy}; {build}")
    failed = []
    for processor in processors or PROCESSORS:
        if processor == "SkylakeX" and "X86_V4" not in has:
            print(f"{processor}: left out, this processor has no AVX-512", flush=True)
            continue
        environment = environment_of(processor, has)
        blas, numpy, build = kernels(environment)
        assert set(blas) == {processor}, f"asked for {processor}, OpenBLAS has chosen {blas}"
        assert processor != OLDEST or "native" not in build or "baseline" in build, build
        print(f"{processor}: NumPy with {', '.join(numpy) or 'its baseline'}; {build}", flush=True)
        folders = " ".join(f"tests/{folder}" for folder in FOLDERS)
        command = f"{pytest} {folders}"
        if subprocess.run(command, shell=True, env=environment).returncode:
            failed.append(processor)
    print(f"failed: {', '.join(failed)}" if failed else "passed as all of them")
    return bool(failed)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
