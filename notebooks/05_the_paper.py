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
# # The paper of 1988
#
# Suh & Bishop, "Collision-avoidance trajectory planning using tube concept: analysis and
# simulation" (J. Robotic Systems 5(6)), planned with their own algorithm and with the default
# method. This notebook shows a part of their results. `tubeplanner reproduce` makes all of their
# tables and figures.
#
# The notebook takes about half a minute.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import PlanOptions, compare, load_problem, plan, plot_comparison, scaling_factor

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})

# %% [markdown]
# ## The arm
#
# Two links of 0.30 m and 14.6 kg move in a horizontal plane, with motors of 95 and 27 N m. The
# paper does not give the positions of the masses. With both masses at the ends of their links,
# bang-bang along the straight line takes 0.721 s in example 1 and 0.700 s in example 3. The paper
# prints 0.72 and 0.70 s.
#
# ## Phase 1: knots on the reference path
#
# Thirty candidates lie on the line. Branch and bound searches the 2^28 trajectories through some of
# them for the fastest one in the tube.

# %%
problem = load_problem("example:two_link/paper_3_30mm")
published = plan(problem, PlanOptions("suh-bishop"))
print(f"phase 1: {published.phase1_duration:.3f} s (printed in Table II: 0.95 s)")
print(published.search)

# %% [markdown]
# ## Phase 2: knots moved and doubled
#
# Every inner knot moves by an increment along the axis of one joint, or stays. The same branch and
# bound finds the best of all combinations, and a line search follows. Then every segment gets a
# knot in its middle. The phase ends when the gain is small.

# %%
print(f"phase 2: {published.duration:.3f} s (printed in Table II: 0.83 s)")
print(published.phase_two)

# %% [markdown]
# ## The time left by few polynomials
#
# A joint polynomial ties the speed to the path, and few knots leave torque unused. `b(t)` is the
# factor by which the arm could move faster at each instant: it is above 1 where no motor is at its
# limit. The default method optimises path and speed with many control points. `slack=0` selects its
# shortest motion.

# %%
default = plan(problem, PlanOptions(slack=0.0))
figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for result, dashes in ((published, "-"), (default, "--")):
    samples = result.trajectory.sample(rate=1000)
    q, v, a = samples.position, samples.velocity, samples.acceleration
    tool = problem.robot.tool_position(q)
    speed = np.linalg.norm(np.gradient(tool, samples.time, axis=0), axis=1)
    factor = scaling_factor(problem, q, v, a)
    label = f"{result.method}: {result.duration:.3f} s"
    axes[0].plot(samples.time, speed, dashes, label=label)
    axes[1].plot(samples.time / result.duration, factor, dashes)
axes[0].set(xlabel="time [s]", ylabel="tool speed [m/s]")
axes[1].set(xlabel="time / duration [-]", ylabel="b(t) [-]", ylim=(0.9, 3.1))
_ = axes[0].legend()

# %% [markdown]
# ## Other methods
#
# The comparison has straight lines with stops at trapezoidal speed (`conventional`), bang-bang on
# the reference path (TOPP-RA), its smoothed variant, arcs at corners and Taylor's bounded
# deviation. Each is an ordinary trajectory with its own certificate. `branch-and-bound` is phase 1
# of the paper. Without a list of methods, `compare` adds `suh-bishop`, the whole algorithm of the
# paper.

# %% picture=[0,0.08,0.61,1]
METHODS = ["refinement", "branch-and-bound", "stop-at-corners"]
SCHEMES = ["conventional", "bang-bang", "smoothed-bang-bang", "arc-corners", "smoothed-arc-corners"]
corners = load_problem("example:two_link/paper_5_30mm")
comparison = compare(corners, [*METHODS, *SCHEMES, "bounded-deviation"])
for row in comparison.rows:
    verdict = "certified" if row.certified else f"fails {', '.join(row.failures) or row.status}"
    duration = "    -  " if row.duration is None else f"{row.duration:.3f} s"
    print(f"{row.method:22} {duration}  {verdict}")
plot_comparison(comparison)

# %% [markdown]
# The default method is the fastest of all nine and certified. The failed methods switch their
# motors instantly: their accelerations jump.
#
# ## Contradictions in the paper
#
# - The goal of example 2 is printed as (0.6, 0.3), out of reach of the arm. Its conventional time
#   of 1.00 s belongs to (0.6, 0).
# - Examples 3 and 4 print a conventional time of 1.93 s; the formula gives 1.82 s for the printed
#   points.
# - Figure 7 has the caption of example 2 and shows example 1.
# - Tables III and IV are about lines whose end points are lost with the figures. If Table III has
#   the line of example 1, it contradicts Table II. And 0.42 s without a tube is less than the arm
#   of Table I needs for any printed line.
