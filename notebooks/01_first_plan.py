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
# motors can produce, and proves that it satisfies every condition.
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
# ## State the problem
#
# - The **robot**: its URDF, and which frame is the tool. `example:ur5` is bundled; a path to your own file works as well
#   (notebook 3).
# - The **tube**: four points make three segments; each has its radius. `joint_signs` selects the arm configuration:
#   elbow up.
# - The **start**, in joint angles. The goal is open here: the planner chooses the joint angles that reach the last point fastest.
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
# optional: it receives the progress of planning.

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
# Every condition has a margin, the place where it is smallest, and the method of judgement. *For all t* means the whole
# trajectory, not only samples. A margin of zero is what a time-optimal trajectory looks like: it uses the
# limit, and does not exceed it.

# %%
for name, condition in result.certificate.conditions.items():
    if condition.margin is not None:
        print(f"{name:15} {condition.margin:10.2e} {condition.unit:9} {condition.coverage}")

# %% [markdown]
# ## What the trajectory looks like
#
# At the top, what binds when: a row per joint, one of the tool and one of the links, with a bar where one of their limits is used to
# 98 % or more. While some joint has a bar, there is nothing left to gain on this path. Below, the joints against their limits, the
# speed of the tool, how much of the tolerance it uses, and how near the links come to the wall and to each other; beside them the
# arm at the start, pale, and at the goal. The colours behind the curves mark the segments.

# %%
plot_trajectory(problem, result.trajectory)

# %% [markdown]
# ## How the answer was found
#
# Refinement starts from a trajectory that follows the route and shortens it step by step, first on few knots, then on finer
# ones (it jumps up where finer samples find a violated limit).

# %%
plot_convergence({"over the wall": steps})

# %% [markdown]
# ## What costs the time
#
# What would 10 % more of each limit save? The multipliers of the optimisation answer this without planning again (notebook 4
# checks them).

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
# that keep the limits when a controller joins them, and state what that costs. In Python, `save` writes the same files, the suffix
# chooses the format, and the notes say what the command would.

# %%
csv = Path(mkdtemp()) / "t.csv"
print(*result.trajectory.save(csv, problem))
print(csv.read_text()[:200], "...")
