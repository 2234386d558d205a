"""Problems that misbehave in the processes that plan them, and plans to compare with."""

import os
import subprocess
import sys
from dataclasses import dataclass

from worker_calls import deadly, noted

from tubeplanner import PlanOptions, ProblemSpec

LINE = "example:two_link/paper_1_50mm"
FAST = PlanOptions(quality="fast", slack=0.0)
SCRIPT = """
import sys
from tubeplanner import PlanOptions, load_problem, plan
options = PlanOptions(quality="fast", slack=0.0)
for share in sys.argv[2:]:
    problem = load_problem(sys.argv[1], changes={"tube.radius": "x" + share})
    trajectory = plan(problem, options).trajectory
    print(trajectory.breakpoints.tobytes().hex(), trajectory.coefficients.tobytes().hex())
"""


@dataclass(frozen=True)
class DeadlyProblem(ProblemSpec):
    """Kills the process that reads it."""

    def load(self):
        deadly()


@dataclass(frozen=True)
class RaisingProblem(ProblemSpec):
    """Raises what reading must not raise."""

    def load(self):
        raise ZeroDivisionError("in a test")


@dataclass(frozen=True)
class SlowProblem(ProblemSpec):
    """Takes its time, and says in a file which process reads it."""

    noted_in: str = ""

    def load(self):
        noted(self.noted_in, 0.3)
        return super().load()


def planned_alone(name, fractions):
    """Return the bits of the trajectories of a problem with other shares of its radii.

    `plan` makes them in a process with one thread for linear algebra, as workers have.
    """
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, name, *map(str, fractions)],
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
