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
# # How much time does a tolerance buy?
#
# A narrow tube is safe and slow, a wide tube is fast. This notebook sweeps the radius of the tube
# for two arms:
#
# - The two-link arm of Suh & Bishop (1988) moves up a straight line. From 0.5 to 50 mm its duration
#   falls by 7 %.
# - A Panda moves between two shelves. From 1/60 to 3/2 of its radii its duration falls by a third.
#
# The sweeps take about half a minute.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import PlanOptions, load_problem, plan, plot_sweep, scaling_factor, sweep

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})
STYLES = [
    {"color": f"C{k}", "linestyle": dashes} for k, dashes in enumerate(("-", "--", "-.", ":"))
]

# %% [markdown]
# ## Duration against tolerance
#
# The tool of the two-link arm moves from (0.3, -0.5) to (0.3, 0.5) m in a horizontal plane. The
# sweep plans every radius from scratch. The grey strokes are the slopes that the sensitivities of
# each plan predict.

# %% picture=[0,0,1,1]
problem = load_problem("example:two_link/paper_1_30mm")
radii = [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.04, 0.05]
durations = sweep(problem, radii)
plot_sweep(durations)

# %%
print("radius  duration  one mm more saves")
for row in durations.rows:
    print(f"{1000 * row.value:4.1f} mm  {row.duration:.4f} s  {-row.slope:6.2f} ms")

# %% [markdown]
# The first millimetres save most: about 3 ms each up to 2 mm, less than 1 ms each from 20 mm on.
# The paper of 1988 prints 0.90 s at 10 mm, 0.75 s at 30 mm and 0.73 s at 50 mm for this path.
#
# ## The path of the tool
#
# At 30 and 50 mm the tool stays on the inside of the straight line nearly all the way: the inertia
# of the arm is smaller there. At 5 and 10 mm it crosses the line. Every path touches the walls of
# its tube (thin lines). The horizontal scale is stretched.

# %%


def tool_path(problem, trajectory):
    """Return times (N,) [s], tool positions (N, 3) [m] and tool speeds (N,) [m/s]."""
    samples = trajectory.sample(rate=500)
    tool = problem.robot.tool_position(samples.position)
    speed = np.linalg.norm(np.gradient(tool, samples.time, axis=0), axis=1)
    return samples.time, tool, speed


figure, axis = plt.subplots(figsize=(5, 6), layout="constrained")
shown = [row for row in durations.rows if row.value in (0.005, 0.01, 0.03, 0.05)]
for row, style in zip(shown, STYLES, strict=True):
    _, tool, _ = tool_path(row.problem, row.result.trajectory)
    label = f"{1000 * row.value:.0f} mm: {row.duration:.3f} s"
    axis.plot(1000 * (tool[:, 0] - 0.3), tool[:, 1], label=label, **style)
    for side in (-1, 1):
        axis.axvline(side * 1000 * row.value, color=style["color"], linewidth=0.7, alpha=0.6)
axis.axvline(0, color="#444444", linestyle="--", linewidth=1)
axis.set(
    xlabel="x - 0.3 m [mm]",
    ylabel="y [m]",
    title="Path of the tool, walls of the tube",
)
axis.legend(fontsize=8, loc="center right")
plt.show()

# %% [markdown]
# ## The speed of the tool

# %%
figure, axis = plt.subplots(figsize=(7, 3.5), layout="constrained")
for row, style in zip(shown, STYLES, strict=True):
    time, _, speed = tool_path(row.problem, row.result.trajectory)
    axis.plot(time, speed, label=f"{1000 * row.value:.0f} mm", **style)
axis.set(xlabel="time [s]", ylabel="tool speed [m/s]", ylim=(0, None))
axis.legend(fontsize=8)
plt.show()

# %% [markdown]
# ## W or U: are the motors used?
#
# `b(t)` is the factor by which the arm could move faster at each instant. At b = 1 a motor is at
# its limit. The paper finds two shapes:
#
# - A **U**: the motors work at their limits all the time, except near rest at both ends.
# - A **W**: the motors idle in between, because something else limits the motion: a narrow tube, or
#   too few polynomials.
#
# The next cell shows the effect of too few polynomials. Phase 1 of the paper (`branch-and-bound`)
# joins a handful of quartics, the default method many.

# %%


def times_faster(problem, trajectory):
    """Return the times of 100 samples of every piece, relative to the duration, and b there."""
    samples = trajectory.per_piece(100)
    factor = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration)
    return samples.time / trajectory.duration, factor


figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True, layout="constrained")
for axis, radius in zip(axes, (0.01, 0.05), strict=True):
    case = problem.with_tube(problem.tube.with_radius(radius))
    for method, style in zip(("branch-and-bound", "refinement"), STYLES, strict=False):
        trajectory = plan(case, PlanOptions(method, slack=0.0)).trajectory
        pieces = len(trajectory.breakpoints) - 1
        label = f"{method}, {pieces} polynomials: {trajectory.duration:.3f} s"
        axis.plot(*times_faster(case, trajectory), label=label, **style)
    axis.set(xlabel="time / duration [-]", ylim=(0.9, 3.1))
    title = f"radius {1000 * radius:.0f} mm"
    axis.legend(title=title, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
axes[0].set_ylabel("b(t) [-]")
plt.show()

# %% [markdown]
# With few polynomials both tubes give a W. With many, `b` is nearly 1 in the narrow tube and in the
# wide one: a U with steep sides. There, only tube and motors limit the duration. Notebook 5 shows
# phase 2 of the paper.
#
# ## A Panda between shelves
#
# The path has three segments, each with its own radius. The sweep scales all radii by one factor.

# %%
shelves = load_problem("example:panda/between_shelves")
print("radii [mm]:", 1000 * shelves.tube.radius)
panda = sweep(shelves, scales=[1 / 60, 1 / 30, 0.1, 0.25, 0.5, 1.0, 1.5])
for row in panda.rows:
    outcome = row.message if row.duration is None else f"{row.duration:.4f} s"
    print(*filter(None, (f"radii x {row.value:5.3f}: {outcome}", row.note)))
plot_sweep(panda)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
planned = [row for row in panda.rows if row.duration is not None]
for row, style in zip((planned[0], *planned[-2:]), STYLES, strict=False):
    time, tool, speed = tool_path(row.problem, row.result.trajectory)
    left.plot(time, speed, label=f"radii x {row.value:.3g}", **style)
    right.plot(tool[:, 0], tool[:, 2], **style)
reference = {"color": "#444444", "linestyle": "--", "linewidth": 1, "label": "reference"}
right.plot(*shelves.tube.points[:, [0, 2]].T, **reference)
left.set(xlabel="time [s]", ylabel="tool speed [m/s]", ylim=(0, None))
right.set(xlabel="x [m]", ylabel="z [m]", title="Tool path, side view")
right.set_aspect("equal")
right.legend(fontsize=8, loc="center right")
left.legend(fontsize=8)
plt.show()

# %% [markdown]
# The same sweep on the command line: `tubeplanner sweep example:panda/between_shelves
# --radius-scale 0.1,0.5,1 -o sweep.csv --plot sweep.png`.
