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
# A tight tube is safe and slow, a wide one fast. How slow, how fast? This notebook sweeps the radius for the two-link arm of
# Suh & Bishop (1988), whose paper asked the same, and for a Panda between shelves. It takes about a minute.

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
# ## Minimum time against tolerance
#
# The tool goes straight up from (0.3, -0.5) to (0.3, 0.5) m, in a horizontal plane. The sweep plans every radius from scratch; the
# grey strokes are the slopes that each plan's sensitivities predict, from its multipliers alone.

# %%
problem = load_problem("example:two_link/paper_1_30mm")
radii = [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.04, 0.05]
durations = sweep(problem, radii)
plot_sweep(durations)

# %%
print("radius  duration  one mm more saves")
for row in durations.rows:
    print(f"{1000 * row.value:4.1f} mm  {row.duration:.4f} s  {-row.slope:6.2f} ms")

# %% [markdown]
# The first millimetres save most: some 3 ms each up to 2 mm, less than 1 ms each from 20 mm on. For this path the paper prints (from the computers of 1988) 0.90 s at 10 mm, 0.75 s at
# 30 mm, 0.73 s at 50 mm.
#
# ## Where the tool goes
#
# A trajectory gives samples, and the robot the tool's position in each of them. The tool cuts to the inside of the straight line,
# where the arm's inertia is small, as far as the tube allows. The horizontal scale is stretched.

# %%


def tool_path(problem, trajectory):
    """Return times (N,) [s], the tool's positions (N, 3) [m] and its speeds (N,) [m/s]."""
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
    xlabel="beside the reference [mm]",
    ylabel="y [m]",
    title="The tool's path, and the tube's walls",
)
axis.legend(fontsize=8, loc="center right")
plt.show()

# %% [markdown]
# ## How fast it goes

# %%
figure, axis = plt.subplots(figsize=(7, 3.5), layout="constrained")
for row, style in zip(shown, STYLES, strict=True):
    time, _, speed = tool_path(row.problem, row.result.trajectory)
    axis.plot(time, speed, label=f"{1000 * row.value:.0f} mm", **style)
axis.set(xlabel="time [s]", ylabel="tool speed [m/s]", ylim=(0, None))
axis.legend(fontsize=8)
plt.show()

# %% [markdown]
# ## From W to U: is the arm used?
#
# `b(t)` says how many times faster the arm could move at each instant; where it is 1, a motor is at its limit. The paper draws it for
# trajectories of few polynomials and finds two shapes. A **U** means that the motors work at their limits all the time, except at
# rest at both ends. A **W** means that something else limits the shape, and the motors idle in between: a tight tube, or too few
# polynomials to use the motors fully.
#
# The next cell shows the second cause: the paper's phase 1 (`branch-and-bound`) joins a handful of quartics, the default method many.

# %%


def times_faster(problem, trajectory):
    """Return b at 100 samples of every piece, and the share of the duration at which they lie."""
    samples = trajectory.per_piece(100)
    factor = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration)
    return samples.time / trajectory.duration, factor


figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True, layout="constrained")
for axis, radius in zip(axes, (0.01, 0.05), strict=True):
    case = problem.with_tube(problem.tube.with_radius(radius))
    for method, style in zip(("branch-and-bound", "refinement"), STYLES, strict=False):
        trajectory = plan(case, PlanOptions(method, slack=0)).trajectory
        pieces = len(trajectory.breakpoints) - 1
        label = f"{method}, {pieces} polynomials: {trajectory.duration:.3f} s"
        axis.plot(*times_faster(case, trajectory), label=label, **style)
    axis.set(xlabel="share of the duration [-]", ylim=(0.9, 3.1))
    title = f"radius {1000 * radius:.0f} mm"
    axis.legend(title=title, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0))
axes[0].set_ylabel("b(t), times faster [-]")
plt.show()

# %% [markdown]
# With few polynomials both tubes give a W: in between, the motors idle. With many, `b` is 1 in the tight tube as in the wide one, a U with
# steep sides: tube and motors alone determine the duration. Notebook 5 shows what the paper's phase 2 makes of few polynomials.
#
# ## The same for a Panda
#
# Three segments between shelves, each with its own radius: now the sweep scales all radii together.

# %%
shelves = load_problem("example:panda/between_shelves")
print("radii [mm]:", 1000 * shelves.tube.radius)
panda = sweep(shelves, scales=[1 / 60, 1 / 30, 0.1, 0.25, 0.5, 1.0, 1.5])
for row in panda.rows:
    print(
        f"{row.value:.3g}",
        row.message if row.duration is None else f"{row.duration:.4f} s",
        row.note or "",
    )
plot_sweep(panda)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
planned = [row for row in panda.rows if row.duration is not None]
for row, style in zip((planned[0], *planned[-2:]), STYLES, strict=False):
    time, tool, speed = tool_path(row.problem, row.result.trajectory)
    left.plot(time, speed, label=f"{row.value:.3g} times the radii", **style)
    right.plot(tool[:, 0], tool[:, 2], **style)
right.plot(*shelves.tube.points[:, [0, 2]].T, color="#444444", linestyle="--", linewidth=1)
left.set(xlabel="time [s]", ylabel="tool speed [m/s]", ylim=(0, None))
right.set(xlabel="x [m]", ylabel="z [m]", title="The tool from the side; dashed: the reference")
right.set_aspect("equal")
left.legend(fontsize=8)
plt.show()

# %% [markdown]
# On the command line:
# `tubeplanner sweep example:panda/between_shelves --radius-scale 0.1,0.5,1 -o sweep.csv --plot sweep.png`.
