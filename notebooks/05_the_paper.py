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

from tubeplanner import PlanOptions, compare, load_problem, plan, plot_comparison
from tubeplanner.studies.printed_results import TABLE_TWO
from tubeplanner.studies.reproduction import paper_problem
from tubeplanner.views.panels import draw_factor, line_style, trajectory_curves

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
problem = paper_problem(3, 0.03)
published = plan(problem, PlanOptions("suh-bishop"))
print(f"phase 1: {published.phase1_duration:.3f} s (printed: {TABLE_TWO[3].phases[0.03][0]} s)")
print(published.search)

# %% [markdown]
# ## Phase 2: knots moved, and doubled
#
# Every inner knot moves by an increment along one joint's axis or stays; the same branch and bound finds the best of all combinations,
# and a line search follows. Then every segment gets a knot in its middle, and so on, until the gain is small.

# %%
print(f"phase 2: {published.duration:.3f} s (printed: {TABLE_TWO[3].phases[0.03][1]} s)")
print(published.phase_two)

# %% [markdown]
# ## What is left on the table
#
# A joint polynomial ties speed to path, and few knots leave torque unused: `b(t)`, how many times faster the arm could move at each
# instant, is above 1 where no motor is at its limit. The default method optimises path and speed over many control points.

# %%
default = plan(problem)
figure, axes = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
for number, result in enumerate((published, default)):
    curves = trajectory_curves(problem, result.trajectory)
    label = f"{result.method}: {result.duration:.3f} s"
    axes[0].plot(curves.samples.time, curves.speed, label=label, **line_style(number))
    draw_factor(axes[1], curves, label, number)
axes[0].set(xlabel="time [s]", ylabel="tool speed [m/s]")
_ = axes[0].legend()

# %% [markdown]
# ## Against the schemes it replaces
#
# Straight lines with stops at trapezoidal speed, bang-bang on the reference path (TOPP-RA), its smoothed variants, arcs at corners,
# Taylor's bounded deviation: as ordinary trajectories, each with its certificate.

# %%
corners = load_problem("example:two_link/paper_5_30mm")
comparison = compare(corners)
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
