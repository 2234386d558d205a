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
# # Obstacles, and measured tubes
#
# A tube says: with the tool in here, and the arm in this configuration, nothing collides. Is that true? This notebook measures a
# tube for the two-link arm, where it can draw everything, and finds a tube from a start and a goal alone. It takes about a
# minute.

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
    """Draw obstacles, tube and reference points from above."""
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
    axis.plot(*tube.points[:, :2].T, "k--", linewidth=1)
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")


def draw_arm(axis, q, **style):
    """Draw the two links of configurations (N, 2)."""
    elbow = 0.3 * np.column_stack([np.cos(q[:, 0]), np.sin(q[:, 0])])
    both = q.sum(axis=1)
    tool = elbow + 0.3 * np.column_stack([np.cos(both), np.sin(both)])
    for one, other in zip(elbow, tool, strict=True):
        axis.plot([0, one[0], other[0]], [0, one[1], other[1]], **style)


# %% [markdown]
# ## The radii in the file, and the largest ones

# %%
written = load_problem("example:two_link/around_a_post")
measured = measure_tube(written)
for k, segment in enumerate(measured.segments):
    print(f"segment {k}: {1000 * segment.radius:.1f} mm, signs and ranges {segment.joint_ranges}")
    for end in segment.bindings:
        print(f"   {end.bound}: {end.place}")

# %% [markdown]
# The arm has as many joints as the position of its tool needs, so the sign of the elbow is enough. A configuration limits each
# radius: there a link touches the post while the tool is at the edge of the capsule.

# %%
before, after = plan(written), plan(measured.problem)
figure, axes = plt.subplots(1, 2, figsize=(12, 6), layout="constrained", sharey=True)
for axis, problem, result in zip(axes, (written, measured.problem), (before, after), strict=True):
    draw_cell(axis, problem)
    q = result.trajectory.sample(rate=40).position
    draw_arm(axis, q, color="#0072B2", linewidth=0.5)
    tool = problem.robot.tool_position(result.trajectory.sample(rate=500).position)
    axis.plot(*tool[:, :2].T, color="#D55E00", linewidth=2)
    radii = ", ".join(f"{1000 * radius:.0f}" for radius in problem.tube.radius)
    axis.set_title(f"radii {radii} mm: {result.duration:.3f} s")
for segment in measured.segments:
    for end in segment.bindings:
        draw_arm(axes[1], end.configuration[None], color="#CC79A7", linewidth=2)

# %% [markdown]
# ## Counterexamples
#
# Draw random configurations until many have their tool in the tube and the right sign of the elbow, and compute how near they come to
# the post. This shares only the robot and the distances with `measure_tube`.

# %%
rng = np.random.default_rng(0)
problem = measured.problem
q = rng.uniform([-np.pi, -np.pi], [np.pi, 0.0], (400_000, 2))
inside = (
    problem.tube.distance(problem.robot.tool_position(q)) <= problem.tube.effective_radius
).any(axis=1)
near = q[inside][:3000]
rotation, position = problem.robot.body_poses(near)
distances = [
    problem.collision.distances(*pose, problem.collision.obstacle_pairs).min()
    for pose in zip(rotation, position, strict=True)
]
print(
    f"{len(near)} configurations in the tube, the post {1000 * min(distances):.1f} mm away or more"
)

# %% [markdown]
# ## Which configurations are possible?

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
# The paper leaves open where tubes come from. Here the arm reaches into one gap, must fold to leave it, and reaches into another. OMPL
# finds routes, `find_route` turns the tool's path into a few reference points, and measures the tube around them.

# %%
task = load_problem("example:two_link/through_the_gap", reads_tube=False)
answer = find_route(task, RouteOptions(seed=1))
print(answer.message)

# %%
found = answer.found
figure, axis = plt.subplots(figsize=(7, 7), layout="constrained")
draw_cell(axis, found.problem)
draw_arm(axis, found.result.trajectory.sample(rate=40).position, color="#0072B2", linewidth=0.5)
tool = found.problem.robot.tool_position(found.result.trajectory.sample(rate=500).position)
axis.plot(*tool[:, :2].T, color="#D55E00", linewidth=2)
_ = axis.set_title(f"{len(found.problem.tube.points)} reference points: {found.duration:.3f} s")
