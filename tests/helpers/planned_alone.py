"""Plans by `plan` alone, in a process with one thread for linear algebra: others must be them."""

import os
import subprocess
import sys

SCRIPT = """
import sys
from tubeplanner import PlanOptions, load_problem, plan
options = PlanOptions(quality="fast", slack=0.0)
for share in sys.argv[2:]:
    problem = load_problem(sys.argv[1], changes={"tube.radius": "x" + share})
    trajectory = plan(problem, options).trajectory
    print(trajectory.breakpoints.tobytes().hex(), trajectory.coefficients.tobytes().hex())
"""


def planned_alone(name, shares):
    """Return the bits of the trajectories of a problem with other shares of its radii."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, name, *map(str, shares)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    return done.stdout.splitlines()


def bits(result):
    """Return the bits of a result's trajectory."""
    trajectory = result.trajectory
    return f"{trajectory.breakpoints.tobytes().hex()} {trajectory.coefficients.tobytes().hex()}"
