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
# # The paper of 1988, again
#
# Suh & Bishop, "Collision-avoidance trajectory planning using tube concept: analysis and simulation" (J. Robotic Systems 5(6)),
# planned with their own algorithm and with the default method. `tubeplanner reproduce` makes all of their tables and figures in two to
# three minutes; here a part of them, step by step. It takes about a minute.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import PlanOptions, compare, load_problem, plan, plot_comparison, scaling_factor

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})

# %% [markdown]
# ## The arm, and what the paper does not say
#
# Two links of 0.30 m and 14.6 kg in a horizontal plane, motors of 95 and 27 N m. The paper does not say where the masses are. With both at
# the ends of their links, bang-bang on the straight line of example 1 takes 0.721 s and on that of example 3 0.700 s; the paper prints 0.72
# and 0.70 s.
#
# ## Phase 1: knots on the reference path
#
# Thirty candidates on the line, 2^28 trajectories through some of them; branch and bound finds the fastest that stays in the tube.

# %%
problem = load_problem("example:two_link/paper_3_30mm")
published = plan(problem, PlanOptions("suh-bishop"))
print(f"phase 1: {published.phase1_duration:.3f} s (printed in Table II: 0.95 s)")
print(published.search)

# %% [markdown]
# ## Phase 2: knots moved, and doubled
#
# Every inner knot moves by an increment along one joint's axis or stays; the same branch and bound finds the best of all combinations,
# and a line search follows. Then every segment gets a knot in its middle, and so on, until the gain is small.

# %%
print(f"phase 2: {published.duration:.3f} s (printed in Table II: 0.83 s)")
print(published.phase_two)

# %% [markdown]
# ## What is left on the table
#
# A joint polynomial ties speed to path, and few knots leave torque unused: `b(t)`, how many times faster the arm could move at each
# instant, is above 1 where no motor is at its limit. The default method optimises path and speed over many control points; `slack=0` asks it for
# the shortest motion.

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
axes[1].set(xlabel="share of the duration [-]", ylabel="b(t), times faster [-]", ylim=(0.9, 3.1))
_ = axes[0].legend()

# %% [markdown]
# ## Against the schemes it replaces
#
# Straight lines with stops at trapezoidal speed, bang-bang on the reference path (TOPP-RA), its smoothed variants, arcs at corners,
# Taylor's bounded deviation: as ordinary trajectories, each with its certificate. `compare` without a list of methods adds the paper's
# whole algorithm, `suh-bishop`, which is above; its phase 1 is here.

# %%
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
# ## Where the paper contradicts itself
#
# - Example 2's goal is printed as (0.6, 0.3), out of the arm's reach; its conventional time of 1.00 s belongs to (0.6, 0).
# - Examples 3 and 4 print a conventional time of 1.93 s where the formula gives 1.82 s for the printed points.
# - Figure 7 is captioned example 2 and shows example 1.
# - Tables III and IV are about lines whose end points are lost with the figures. Table II and Table III disagree about example 1's
#   line, if it is the same line; and 0.42 s without a tube is less than the arm of Table I can do on any of the printed lines.
