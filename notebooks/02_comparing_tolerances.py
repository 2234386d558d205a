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
# Suh & Bishop (1988), whose paper asked the same, and for a Panda between shelves. It takes about half a minute.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt

from tubeplanner import load_problem, plan, plot_sweep, sweep
from tubeplanner.views.panels import draw_factor, line_style, trajectory_curves

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})

# %% [markdown]
# ## Minimum time against tolerance
#
# The tool goes straight up from (0.3, -0.5) to (0.3, 0.5) m, in a horizontal plane. The sweep plans every radius from scratch; the
# grey strokes are the slopes that each plan's sensitivities predict, from its multipliers alone.

# %%
problem = load_problem("example:two_link/paper_1_30mm")
radii = [0.002, 0.005, 0.01, 0.02, 0.03, 0.04, 0.05]
durations = sweep(problem, radii)
plot_sweep(durations)

# %%
print("radius  duration  one mm more saves")
for row in durations.rows:
    print(f"{1000 * row.value:4.0f} mm  {row.duration:.4f} s  {-row.slope:6.2f} ms")

# %% [markdown]
# The first millimetres save most. For this path the paper prints (from the computers of 1988) 0.90 s at 10 mm, 0.75 s at
# 30 mm, 0.73 s at 50 mm.
#
# ## Where the tool goes
#
# It cuts to the inside of the straight line, where the arm's inertia is small, as far as the tube allows. The horizontal scale is
# stretched.

# %%
figure, axis = plt.subplots(figsize=(5, 6), layout="constrained")
shown = [row for row in durations.rows if row.value in (0.005, 0.01, 0.03, 0.05)]
for number, row in enumerate(shown):
    style = line_style(number)
    curves = trajectory_curves(row.problem, row.result.trajectory)
    x = 1000 * (curves.tool[:, 0] - 0.3)
    axis.plot(
        x, curves.tool[:, 1], label=f"{1000 * row.value:.0f} mm: {row.duration:.3f} s", **style
    )
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
for number, row in enumerate(shown):
    curves = trajectory_curves(row.problem, row.result.trajectory)
    label = f"{1000 * row.value:.0f} mm"
    axis.plot(curves.samples.time, curves.speed, label=label, **line_style(number))
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
# The next cell shows both causes: it calls parts of refinement that are not public, to stop at few knots, then plans as usual.

# %%
from tubeplanner.branches.reference_branch import reference_branch, redundancy_rules
from tubeplanner.refinement.refinement import Refinement
from tubeplanner.refinement.spline_start import starting_spline
from tubeplanner.constraints.time_scaling import scaled_to_limits


def with_few_knots(case, intervals):
    """Return the fastest trajectory that refinement finds on this number of knot intervals."""
    branch = reference_branch(case, redundancy_rules(case)[0])
    refinement = Refinement(case, starting_spline(case, branch, intervals), ())
    refinement.run()
    return scaled_to_limits(case.robot, refinement.trajectory)


figure, axes = plt.subplots(1, 2, figsize=(11, 4), sharey=True, layout="constrained")
for axis, radius in zip(axes, (0.01, 0.05), strict=True):
    case = problem.with_tube(problem.tube.with_radius(radius))
    trajectories = {f"{count} knots": with_few_knots(case, count) for count in (6, 8)}
    trajectories["as planned"] = plan(case).trajectory
    for number, (label, trajectory) in enumerate(trajectories.items()):
        said = f"{label}: {trajectory.duration:.3f} s"
        draw_factor(axis, trajectory_curves(case, trajectory), said, number)
    axis.set(title=f"radius {1000 * radius:.0f} mm", ylim=(0.9, 3.1))
    axis.legend(fontsize=8, loc="upper right")
plt.show()

# %% [markdown]
# With 6 knots both tubes give a W, and in the tight one the motors idle longer; with 8 the U begins to show; and as planned, `b` is 1 in the
# tight tube too: tube and motors alone determine the duration.
#
# ## The same for a Panda
#
# Three segments between shelves, each with its own radius: now the sweep scales all radii together.

# %%
shelves = load_problem("example:panda/between_shelves")
print("radii [mm]:", 1000 * shelves.tube.radius)
panda = sweep(shelves, scales=[0.02, 0.1, 0.25, 0.5, 1.0, 1.5])
for row in panda.rows:
    print(
        row.value, row.message if row.duration is None else f"{row.duration:.4f} s", row.note or ""
    )
plot_sweep(panda)

# %%
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
planned = [row for row in panda.rows if row.duration is not None]
for number, row in enumerate((planned[0], *planned[-2:])):
    curves = trajectory_curves(row.problem, row.result.trajectory)
    style, label = line_style(number), f"{row.value:g} times the radii"
    left.plot(curves.samples.time, curves.speed, label=label, **style)
    right.plot(curves.tool[:, 0], curves.tool[:, 2], **style)
right.plot(*shelves.tube.points[:, [0, 2]].T, color="#444444", linestyle="--", linewidth=1)
left.set(xlabel="time [s]", ylabel="tool speed [m/s]", ylim=(0, None))
right.set(xlabel="x [m]", ylabel="z [m]", title="The tool from the side; dashed: the reference")
right.set_aspect("equal")
left.legend(fontsize=8)
plt.show()

# %% [markdown]
# On the command line:
# `tubeplanner sweep example:panda/between_shelves --radius-scale 0.1,0.5,1 -o sweep.csv --plot sweep.png`.
