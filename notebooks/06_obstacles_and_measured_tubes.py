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
# # Obstacles and measured tubes
#
# A tube makes a promise: with the tool in the tube and the arm in the configuration of the tube,
# nothing collides. Does the promise hold, and how wide may the tube be? This notebook measures a
# tube for the two-link arm. Then it finds a tube from a start and a goal alone.
#
# The notebook takes about half a minute.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Polygon
from scipy.spatial import ConvexHull

from tubeplanner import (
    MeasureOptions,
    RouteOptions,
    find_route,
    load_problem,
    measure_tube,
    plan,
    survey_patterns,
)

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})


# %%
def draw_cell(axis, problem):
    """Draw the obstacles, the tube and the reference path from above."""
    for obstacle in problem.obstacles:
        for shape in obstacle.shapes:
            corners = shape.vertices[:, :2]
            axis.add_patch(Polygon(corners[ConvexHull(corners).vertices], color="#777777"))
    turn = np.linspace(0, 2 * np.pi, 60)
    tube = problem.tube
    for k in range(tube.segment_count):
        begin, end = tube.points[k : k + 2, :2]
        along = np.arctan2(*(end - begin)[::-1])
        ends = np.where(np.cos(turn - along)[:, None] > 0, end, begin)
        outline = ends + tube.effective_radius[k] * np.column_stack([np.cos(turn), np.sin(turn)])
        axis.add_patch(Polygon(outline, color=f"C{k}", alpha=0.3))
    axis.plot(*tube.points[:, :2].T, "k--", linewidth=1, label="reference path")
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")


def draw_arm(axis, q, label, **style):
    """Draw the two links in each of N configurations (N, 2)."""
    elbow = 0.3 * np.column_stack([np.cos(q[:, 0]), np.sin(q[:, 0])])
    both = q.sum(axis=1)
    tool = elbow + 0.3 * np.column_stack([np.cos(both), np.sin(both)])
    for (x, y), (x_tool, y_tool) in zip(elbow, tool, strict=True):
        axis.plot([0, x, x_tool], [0, y, y_tool], label=label, **style)
        label = None  # one entry in the legend for all configurations


def draw_motion(axis, problem, trajectory):
    """Draw the cell, the arm at every 25 ms and the path of the tool."""
    draw_cell(axis, problem)
    poses = trajectory.sample(rate=40).position
    draw_arm(axis, poses, "arm every 25 ms", color="#0072B2", linewidth=0.5)
    tool = problem.robot.tool_position(trajectory.sample(rate=500).position)
    axis.plot(*tool[:, :2].T, color="#D55E00", linewidth=2, label="path of the tool")


# %% [markdown]
# ## The largest radii
#
# The file gives 30, 50 and 50 mm. `measure_tube` finds the largest radii without a collision:

# %%
written = load_problem("example:two_link/around_a_post")
measured = measure_tube(written)
for k, segment in enumerate(measured.segments):
    print(f"segment {k}: {1000 * segment.radius:.1f} mm, signs and ranges {segment.joint_ranges}")
    for end in segment.bindings:
        print(f"   {end.bound}: {end.location}")

# %% [markdown]
# The arm has as many joints as its tool has coordinates, so the sign of the elbow fixes the
# configuration. One configuration limits each radius: the tool is at the edge of the capsule and a
# link touches the post.

# %% picture=[0,0,1,1]
before, after = plan(written), plan(measured.problem)
figure, axes = plt.subplots(1, 2, figsize=(9, 6), layout="constrained", sharex=True, sharey=True)
for axis, problem, result in zip(axes, (written, measured.problem), (before, after), strict=True):
    draw_motion(axis, problem, result.trajectory)
    radii = ", ".join(f"{1000 * radius:.0f}" for radius in problem.tube.radius)
    axis.set_title(f"radii {radii} mm: {result.duration:.3f} s")
limiting = [end.configuration for segment in measured.segments for end in segment.bindings]
draw_arm(axes[1], np.array(limiting), "limits a radius", color="#CC79A7", linewidth=2)
figure.legend(*axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=4)
plt.show()

# %% [markdown]
# ## A search for counterexamples
#
# The next cell draws random configurations with the tool in the tube and the right sign of the
# elbow. It computes the distance of each one from the post. Only the robot and the distances are
# common with `measure_tube`.

# %%
rng = np.random.default_rng(0)
problem = measured.problem
q = rng.uniform([-np.pi, -np.pi], [np.pi, 0.0], (400_000, 2))
inside = (
    problem.tube.distance(problem.robot.tool_position(q)) <= problem.tube.effective_radius
).any(axis=1)
sample = q[inside][:3000]
rotation, position = problem.robot.body_poses(sample)
distances = [
    problem.collision.distances(*pose, problem.collision.obstacle_pairs).min()
    for pose in zip(rotation, position, strict=True)
]
print(
    f"{len(sample)} configurations in the tube, at least {1000 * min(distances):.1f} mm from the post"
)

# %% [markdown]
# ## The possible configurations

# %%
survey = survey_patterns(written, MeasureOptions(samples=1000))
for row in survey.rows:
    verdict = "not reachable" if not row.reachable else "free" if row.free else "collides"
    width = "" if row.radius is None else f", up to {1000 * row.radius:.0f} mm"
    print(f"segment {row.segment}: {row.signs} {verdict}{width}")
print("suggested:", survey.suggested)

# %% [markdown]
# ## From start and goal alone
#
# The paper does not say where tubes come from. Here the arm reaches into one gap, has to fold to
# leave it, and reaches into another gap. `find_route` finds the fastest motion, whose tool may be
# anywhere, and a joint route from which `plan` makes the same motion.

# %%
task = load_problem("example:two_link/through_the_gap", reads_tube=False)
result = find_route(task, RouteOptions(seed=1))
print(result.message)

# %%
route = result.answer
figure, axis = plt.subplots(figsize=(7, 7), layout="constrained")
draw_motion(axis, route.problem, route.result.trajectory)
axis.legend(loc="lower left")
axis.set_title(f"from start and goal alone: {route.duration:.3f} s")
plt.show()
