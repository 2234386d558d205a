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
# A UR5 lifts a part over a wall. You know a rough route for the tool and its tolerance: 30 mm
# beside the wall, 80 mm above it. Route and tolerance are a **tube**. tubeplanner plans the fastest
# smooth trajectory inside the tube that the motors can produce. A **certificate** proves that the
# trajectory satisfies every condition.
#
# Run the cells from top to bottom. The notebook takes about ten seconds.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from tubeplanner import Obstacle, PlanningProblem, Tube, load_robot, placement_of, plan
from tubeplanner import plot_convergence, plot_trajectory

# %% [markdown]
# ## The problem
#
# - The **robot**: its URDF and its tool frame. `example:ur5` is bundled; a path to your own file
#   works as well (notebook 3).
# - The **tube**: four points make three segments, each with a radius. `joint_signs` selects the arm
#   configuration: elbow up.
# - The **start**, as joint angles. The goal is open here: the planner chooses the joint angles that
#   reach the last point soonest.
# - The **wall**, a box of 0.6 x 0.05 x 0.44 m.

# %%
robot = load_robot("example:ur5", tool_frame="tool0")
points = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [0.45, 0.3, 0.5], [0.45, 0.3, 0.2]]
tube = Tube(points, radius=[0.03, 0.08, 0.03], joint_signs={"elbow_joint": "+"})
wall = Obstacle.box("wall", [0.6, 0.05, 0.44], placement_of([0.6, 0, 0.22]))
start = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
problem = PlanningProblem(robot, tube, start, obstacles=[wall], name="over the wall")

# %% [markdown]
# ## The plan
#
# `plan` returns a trajectory, or the reason why there is none. An infeasible task raises no
# exception. The callback `progress` is optional and receives the steps of planning.

# %%
steps = []
result = plan(problem, progress=steps.append)
print(result.message)

# %% [markdown]
# ## The certificate
#
# Every condition has a margin, at the instant where it is smallest, and a coverage. *For all t*
# means the whole trajectory, not only samples. The margins of velocity, effort and tube are nearly
# zero: the trajectory uses these limits fully and exceeds none. The margins of goal, rest and
# continuity are rounding errors.

# %%
for name, condition in result.certificate.conditions.items():
    if condition.margin is not None:
        print(f"{name:15} {condition.margin:10.2e} {condition.unit:9} {condition.coverage}")

# %% [markdown]
# ## The trajectory
#
# - The strip at the top has a row for each joint, for the tool and for the links. A bar marks a
#   limit in use to 98 % or more. As long as some joint has a bar, no motion along this path is
#   faster.
# - Below the strip are the joints against their limits, the tool speed, the used part of the
#   tolerance, and the clearance from the wall and between links. Background colours mark the
#   segments.
# - The drawing shows the arm at the start (pale) and at the goal, the tube and the path of the
#   tool.

# %% picture=[0.56,0.27,1.0,0.636]
plot_trajectory(problem, result.trajectory)

# %% [markdown]
# ## The convergence
#
# Refinement starts from a trajectory along the route and shortens it step by step, first on few
# knots, then on finer ones. The duration jumps up where finer samples find a violated limit. The
# last steps spend 0.5 % of the duration on smoother efforts; `PlanOptions(slack=0)` skips them.

# %%
plot_convergence({"over the wall": steps})

# %% [markdown]
# ## The cost of each limit
#
# How much time would 10 % more of each limit save? The multipliers of the optimisation answer this
# without a second plan (notebook 4 checks them).

# %%
for sensitivity in result.sensitivities[:5]:
    print(sensitivity)

# %% [markdown]
# ## The output
#
# The trajectory is a piecewise polynomial. `position`, `velocity` and `acceleration` take any
# times.

# %%
times = np.linspace(0, result.duration, 5)
print(np.round(result.trajectory.position(times), 3))

# %% [markdown]
# Controllers read files. The command line writes them all at once: `tubeplanner plan problem.yaml
# -o t.json --csv t.csv --ros t.yaml --plot t.png`. In Python, `save` writes the format of the
# suffix and returns the notes of the command.
#
# The JSON file holds the polynomials. Samples at 500 Hz cannot follow the kinks of their
# acceleration. The CSV and ROS files therefore hold averaged samples, which keep the limits when a
# controller joins them. The note states their duration.

# %%
csv = Path(mkdtemp()) / "t.csv"
print(*result.trajectory.save(csv, problem))
header, *samples = csv.read_text().splitlines()
print(f"{len(samples)} samples of {', '.join(header.split(',')[:3])}, ...")
