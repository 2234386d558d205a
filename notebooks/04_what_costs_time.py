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
# # What costs the time?
#
# A trajectory takes half a second. Would a stronger motor help, and which one? A faster gear? A wider tube? Every plan comes with a
# **list of sensitivities** that answers without planning again. This notebook reads it for two arms, then checks it by planning
# again with 10 % more. It takes about a minute.

# %%
# %matplotlib inline
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import LimitOverrides, PlanOptions, load_problem, load_robot, plan

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})

# %% [markdown]
# ## Read the sensitivities
#
# Each entry is the *elasticity* d ln T / d ln limit: the relative fall of the duration per relative rise of the limit. Most
# limits cost nothing, because another limit applies first.

# %%


def name(sensitivity):
    """Return the limit of an entry, and its joint or segment."""
    return f"{sensitivity.limit}, {sensitivity.joint or f'segment {sensitivity.segment}'}"


def show(result, title, most=8):
    """Draw the entries that would save most."""
    sensitivities = result.sensitivities[:most][::-1]
    _, axis = plt.subplots(figsize=(8, 0.4 * most + 0.9), layout="constrained")
    saved = [1000 * sensitivity.saved for sensitivity in sensitivities]
    axis.barh([name(sensitivity) for sensitivity in sensitivities], saved, color="C0")
    axis.set(xlabel="10 % more saves [ms]", title=f"{title}: {result.duration:.4f} s")
    plt.show()


wall = load_problem("example:ur5/over_the_wall")
shortest = PlanOptions(slack=0)  # what a limit costs is said of the shortest motion
over_the_wall = plan(wall, shortest)
show(over_the_wall, "UR5 over the wall")

# %%
post = load_problem("example:two_link/around_a_post")
around = plan(post, shortest)
show(around, "Two-link arm around a post", most=5)

# %% [markdown]
# The velocity of the base joint slows the UR5 more than any motor does. The two-link arm has no velocity limits: its second
# motor counts most, and the radius of the short segment in the middle nearly as much.
#
# ## Is the prediction right?
#
# Raise one limit by 10 %, plan again, and compare. For the radii, a problem takes another tube. For motors and velocities, it takes
# another robot, loaded with a limit that replaces the URDF's.

# %%


def ur5(**limits):
    """Return the robot of the first problem, with other limits."""
    return load_robot("example:ur5", "tool0", limits=LimitOverrides(**limits))


def two_link(**limits):
    """Return the robot of the second problem, which has no velocity limits, with other limits."""
    free = {"joint1": np.inf, "joint2": np.inf}
    overrides = LimitOverrides(velocity=free, **limits)
    return load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=overrides)


def with_more(problem, arm, sensitivity, more=0.1):
    """Return the problem with one limit raised."""
    if sensitivity.limit == "radius":
        radius = problem.tube.radius.copy()
        radius[sensitivity.segment] *= 1 + more
        return problem.with_tube(problem.tube.with_radius(radius))
    joint = problem.robot.joint_names.index(sensitivity.joint)
    value = getattr(problem.robot.limits, sensitivity.limit)[joint]
    raised = {sensitivity.limit: {sensitivity.joint: (1 + more) * value}}
    return replace(problem, robot=arm(**raised))


def checked(problem, arm, result, most):
    """Return entries with what they predict and what planning again saves [ms]."""
    rows = []
    for sensitivity in result.sensitivities[:most]:
        again = plan(with_more(problem, arm, sensitivity), shortest)
        rows.append(
            (
                f"{arm.__name__}: {name(sensitivity)}",
                1000 * sensitivity.saved,
                1000 * (result.duration - again.duration),
            )
        )
    return rows


table = checked(post, two_link, around, 4)
table += checked(wall, ur5, over_the_wall, 6)
print(f"{'10 % more of':36} predicted    saved")
for what, predicted, saved in table:
    print(f"{what:36} {predicted:6.1f} ms {saved:6.1f} ms")

# %%
figure, axis = plt.subplots(figsize=(8, 4.2), layout="constrained")
places = np.arange(len(table))[::-1]
axis.barh(places + 0.2, [row[1] for row in table], 0.38, color="C0", label="predicted")
axis.barh(
    places - 0.2,
    [row[2] for row in table],
    0.38,
    color="C1",
    hatch="//",
    label="planned again",
)
axis.set_yticks(places, [row[0] for row in table])
axis.set(xlabel="saved by 10 % more [ms]")
axis.legend()
plt.show()

# %% [markdown]
# The entries are derivatives, so 10 % more saves a little less or more than predicted: less where the next limit soon takes over
# (the two-link arm's first motor), more where one limit lets the arm use another. The order is right, and the order decides what to
# buy.
