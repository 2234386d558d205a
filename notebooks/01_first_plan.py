# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A first plan
#
# A UR5 has to lift something over a wall. You know a rough route for its tool, and how far the tool may stray from it: 30 mm
# beside the wall, 80 mm above it. That is a **tube**. tubeplanner finds the fastest smooth trajectory inside it that the
# motors can produce, and proves that it keeps what was asked.
#
# Run the cells from top to bottom; the whole notebook takes about ten seconds.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from tubeplanner import Obstacle, PlanningProblem, Tube, load_robot, placement_of, plan
from tubeplanner import plot_convergence, plot_trajectory

# %% [markdown]
# ## Say what is asked
#
# - The **robot**: its URDF, and which frame is the tool. `example:ur5` is bundled; a path to your own file works as well
#   (notebook 3).
# - The **tube**: four points make three segments; each has its radius. `joint_signs` says which arm configuration is meant:
#   elbow up.
# - The **start**, in joint angles. The goal is left open here: whichever joint angles reach the last point fastest.
# - The **wall**.

# %%
robot = load_robot("example:ur5", tool_frame="tool0")
points = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [0.45, 0.3, 0.5], [0.45, 0.3, 0.2]]
tube = Tube(points, radius=[0.03, 0.08, 0.03], joint_signs={"elbow_joint": "+"})
wall = Obstacle.box("wall", [0.6, 0.05, 0.44], placement_of([0.6, 0, 0.22]))
start = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
problem = PlanningProblem(robot, tube, start, obstacles=[wall], name="over the wall")

# %% [markdown]
# ## Plan
#
# `plan` returns the answer or the reason why there is none; it raises no exception for an impossible task. The callback is
# optional: it is told how far planning has come.

# %%
steps = []
result = plan(problem, progress=steps.append)
print(result.message)
print(
    f"planned in {result.planning_time:.2f} s, {result.certificate_time:.2f} s of it for the certificate"
)

# %% [markdown]
# ## What the certificate says
#
# Every condition has a margin, the place where it is smallest, and how it was judged. *For all t* means just that: not at
# samples, but on the whole trajectory. A margin of zero is what a time-optimal trajectory looks like: it uses the
# limit, and does not exceed it.

# %%
for name, condition in result.certificate.conditions.items():
    if condition.margin is not None:
        print(f"{name:15} {condition.margin:10.2e} {condition.unit:9} {condition.coverage}")

# %% [markdown]
# ## What the trajectory looks like
#
# Left: the joints against their limits, and `b(t)`, how many times faster each instant could be run. Where it is 1, some
# motor or velocity is at its limit: there is nothing left to gain on this path. Right: the tool in its tube, how much
# of the tolerance it uses, and its speed. Colours behind the curves are those of the segments.

# %%
plot_trajectory(problem, result.trajectory)

# %% [markdown]
# ## How the answer was found
#
# From a trajectory that follows the route, step by step shorter, on few knots first and then on finer ones (the jumps up are
# where finer samples find a limit broken).

# %%
plot_convergence({"over the wall": steps})

# %% [markdown]
# ## What costs the time
#
# What would 10 % more of each limit save? The multipliers of the optimisation tell, without planning again (notebook 4 shows that
# they can be trusted).

# %%
for sensitivity in result.sensitivities[:5]:
    print(sensitivity)

# %% [markdown]
# ## Use it
#
# The trajectory is a piecewise polynomial. `position`, `velocity` and `acceleration` take any times.

# %%
times = np.linspace(0, result.duration, 5)
print(np.round(result.trajectory.position(times), 3))

# %% [markdown]
# For a controller, write files. On the command line, this is
# `tubeplanner plan problem.yaml -o t.json --csv t.csv --ros t.yaml --plot t.png`. The JSON holds the polynomials themselves.
# The acceleration of such a trajectory has kinks that samples at 500 Hz cannot follow; the CSV and ROS files hold samples
# that keep the limits, however they are joined, and say what that costs.

# %%
from tubeplanner.files.export import trajectory_csv
from tubeplanner.files.export_samples import samples_for_export

sampled = samples_for_export(problem, result.trajectory, rate=500)
print(sampled.note)
csv = Path(mkdtemp()) / "t.csv"
csv.write_text(trajectory_csv(robot, sampled.samples))
print(csv.read_text()[:200], "...")
