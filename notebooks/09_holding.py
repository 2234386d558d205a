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
# # What it costs to hold a part
#
# A glass stands on a tray, a part hangs from a suction cup. How fast may the arm be so that
# neither is lost, and what are 1 degree of tilt, 1 mm of foot and 1 N of force worth? This
# notebook plans with the field `holding`, beside the usual remedy: the same motion, slowed down
# until it holds.
#
# The notebook takes one to two minutes.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import PlanOptions, load_problem, plan, plot_trajectory, scaling_factor

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})
QUICK = PlanOptions(quality="fast", slack=0.0)

# %% [markdown]
# ## A waiter
#
# A UR5 carries a tray over a wall. On the tray stands a glass of 0.5 kg, 10 cm high, with a foot
# of 4 x 4 cm. The friction coefficient is 0.3, and the tray may lean by 15 degrees.

# %%
waiter = load_problem("example:ur5/waiter")
(holding,) = waiter.holding
print(holding.contact)
print(f"{holding.part.mass} kg")

without = plan(load_problem("example:ur5/waiter", changes={"holding": None}), QUICK)
held = plan(waiter, QUICK)
print(f"without holding {without.duration:.3f} s, held {held.duration:.3f} s")
print(f"held for all t: {held.certificate.passed}")

# %% [markdown]
# The certificate proves for all t that the glass neither slides nor tips, at this speed and at
# every lower one. The default safety of a tray is 1.2: friction and foot are divided by it, and a
# sixth of the weight stays on the tray.
#
# How would the glass fare in the faster motion? `scaling_factor` says by how much a trajectory
# may run faster at every instant: below 1, it runs too fast there.


# %%
def factors(problem, trajectory):
    """Return times and the factors by which a trajectory may run faster there."""
    samples = trajectory.sample(rate=2000)
    state = samples.position, samples.velocity, samples.acceleration
    return samples.time, scaling_factor(problem, *state)


_, factor = factors(waiter, without.trajectory)
lost = np.mean(factor < 0.999)
print(f"beyond what the tray carries for {100 * lost:.0f} % of the time")

# %% [markdown]
# ## How far it leans
#
# Where friction must push the glass sideways, the tray leans into the motion. For the glass,
# gravity and the acceleration of its centre of mass are one force. The angle between this force
# and the tray's normal is what counts: with a friction coefficient of 0.3 and the safety of 1.2
# it may be 14 degrees, less where the glass nearly lifts off.


# %%
def angles(problem, trajectory):
    """Return times, the lean of the tray and the angle of the force on the glass [deg]."""
    t = np.linspace(0, trajectory.duration, 801)
    rotation, tool = problem.robot.tool_pose(trajectory.position(t))
    normal = rotation[:, :, 2]
    glass = tool + rotation @ np.array(holding.part.com)
    acceleration = np.gradient(np.gradient(glass, t, axis=0), t, axis=0)
    force = acceleration - problem.robot.gravity
    force /= np.linalg.norm(force, axis=1)[:, None]
    lean = np.degrees(np.arccos(np.clip(normal[:, 2], -1, 1)))
    return t, lean, np.degrees(np.arccos(np.clip(np.sum(normal * force, axis=1), -1, 1)))


# %% picture=[0,0,1,1]
figure, axes = plt.subplots(1, 2, figsize=(10, 3.8), sharey=True, layout="constrained")
for axis, (title, result) in zip(
    axes, {"without holding": without, "held": held}.items(), strict=True
):
    t, lean, angle = angles(waiter, result.trajectory)
    axis.plot(t, lean, color="C0", label="lean of the tray")
    axis.plot(t[2:-2], angle[2:-2], color="C1", label="force on the glass to the tray's normal")
    axis.axhline(np.degrees(np.arctan(0.3 / 1.2)), color="0.3", linestyle="--", linewidth=1)
    axis.set(xlabel="t [s]", title=f"{title}: {result.duration:.2f} s", ylim=(0, 90))
axes[0].set_ylabel("angle [degrees]")
figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# Without holding, the tray leans as well, but not for the glass. The dashed line is the angle of
# friction: held, the force stays below it.
#
# ## What 1 degree is worth
#
# The next cell plans with four tolerances of the tilt, each without holding and with it. The
# usual remedy is between them: the motion without holding is slowed down until the glass stays.
# Its path does not change, so every instant runs at the pace of the worst one.

# %%
FREE = float("inf")


def tilted(degrees, **changes):
    """Return the waiter's problem with another tolerance of the tilt."""
    angle = float(np.radians(degrees))
    tolerance = {"tube.rotation_tolerance": [[angle, angle, FREE]] * 3}
    return load_problem("example:ur5/waiter", changes={**tolerance, **changes})


def slowed(problem, trajectory):
    """Return the duration of a trajectory that is slowed down until it holds [s]."""
    least = factors(problem, trajectory)[1].min()
    return trajectory.duration / least if least > 0 else np.inf


tilts, rows = (0.2, 3, 5, 15), []
print("tilt      without   slowed  planned")
for degrees in tilts:
    problem = tilted(degrees)
    fast = without if degrees == 15 else plan(tilted(degrees, holding=None), QUICK)
    planned = held if degrees == 15 else plan(problem, QUICK)
    rows.append((fast.duration, slowed(problem, fast.trajectory), planned.duration))
    text = [f"{value:7.3f} s" if np.isfinite(value) else "    never" for value in rows[-1]]
    print(f"{degrees:4g} deg", *text)

# %%
figure, axis = plt.subplots(figsize=(8, 3.6), layout="constrained")
for k, (label, color) in enumerate(
    {"without holding": "0.6", "slowed": "C1", "planned": "C0"}.items()
):
    values = [row[k] if np.isfinite(row[k]) else 0 for row in rows]
    bars = axis.bar(np.arange(len(rows)) + 0.28 * (k - 1), values, 0.26, color=color, label=label)
    axis.bar_label(bars, [f"{value:.2f}" if value else "never" for value in values], fontsize=8)
axis.set_xticks(range(len(rows)), [f"{degrees:g} degrees" for degrees in tilts])
axis.set(xlabel="tilt that the tube allows", ylabel="duration [s]")
axis.legend()
plt.show()

# %% [markdown]
# Planned takes a quarter of the time of slowed. The slowed motion runs all along at the pace of
# its worst instant, and it leans where its joints like it, not where the glass needs it. With 15
# degrees it leans somewhere by more than the angle of friction: the glass slides off at rest, and
# no slowing saves it. From 3 to 15 degrees, each degree saves about 17 ms. Beyond the angle of
# friction little is left to win, as the glass must stay at rest, too.
#
# ## What 1 mm is worth
#
# The report of a plan has the prices of the contact: what one more unit of a number saves.

# %%
for price in held.sensitivities:
    if price.limit == "holding" and price.saved_per_unit > 1e-6:
        print(f"{price.field}: {1000 * price.saved_per_unit:.3g} ms per {price.unit}")

feet, durations = (20, 30, 40, 60), []
for foot in feet:
    problem = load_problem("example:ur5/waiter", changes={"holding.tray.foot": [foot / 1000] * 2})
    durations.append(held.duration if foot == 40 else plan(problem, QUICK).duration)
    print(f"foot of {foot} mm: {durations[-1]:.3f} s")

# %% [markdown]
# With a foot of 40 mm, the glass slides before it tips, so a larger foot saves little. At 20 mm
# it tips first, and each millimetre is worth some 6 ms. A heavier glass costs nothing: friction
# grows with its weight.
#
# ## What 1 N is worth
#
# A UR10 lifts a part of 1 kg with a suction cup. The cup of the file has a diameter of 30 mm and
# works at 0.6 bar: 42.4 N. With the default safety of 1.5, 28 N are left.

# %%
forces, cups = (30.0, 42.4, 60.0, 90.0), []
for force in forces:
    problem = load_problem("example:ur10/suction_cup", changes={"holding.cup.force": force})
    cups.append(plan(problem, QUICK))
    prices = {price.field: price for price in cups[-1].sensitivities}
    saved = 1000 * prices["holding.cup.force"].saved_per_unit
    print(f"{force:5.1f} N: {cups[-1].duration:.3f} s, one more N saves {saved:.1f} ms")

# %%
figure, axis = plt.subplots(figsize=(8, 3.6), layout="constrained")
axis.plot(forces, [cup.duration for cup in cups], "o-", color="C0")
for force, cup in zip(forces, cups, strict=True):
    prices = {price.field: price for price in cup.sensitivities}
    slope = -prices["holding.cup.force"].saved_per_unit
    near = np.array([-4.0, 4.0])
    axis.plot(force + near, cup.duration + slope * near, color="C1", linewidth=2)
axis.set(xlabel="force of the cup [N]", ylabel="duration [s]")
plt.show()

# %% [markdown]
# The orange lines are the prices, from one plan each. A weak cup is dear: from 30 to 42 N each
# newton saves about 14 ms, from 60 to 90 N only 2 ms.
#
# ## The figure
#
# `plot_trajectory` has a panel of what the contact carries: in percent of what is there after the
# safety, dashed at rest.

# %%
plot_trajectory(waiter, held.trajectory)

# %% [markdown]
# The same on the command line:
#
# ```sh
# tubeplanner plan example:ur5/waiter --plot waiter.png --html waiter.html
# tubeplanner sweep example:ur10/suction_cup --vary holding.cup.force=30,42.4,60,90
# ```
#
# What is modelled and what is not: [Holding the part](../docs/concepts/holding.md).
