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
# # When the arm is not its model
#
# A certificate proves that the model keeps every limit. The arm in the cell weighs a little more or less, has friction that nobody gave, answers a millisecond
# late, and stands half a millimetre from where it should. This notebook executes plans in MuJoCo with arms that differ so, sees where they leave the tube,
# and plans a motion that they survive. What it shows of them was **seen** in some runs; it proves nothing of others. It takes one to two minutes, and
# MuJoCo: `pip install -e '.[simulate]'` in a checkout.

# %%
# %matplotlib inline
import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import (
    Draw,
    PlanOptions,
    Robustness,
    drawn_plants,
    executed,
    judged_runs,
    load_problem,
    plan,
    plot_execution,
    plot_field_sweep,
    sweep_field,
)

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})

# %% [markdown]
# ## The shortest motion, executed
#
# `Robustness()` has the errors that a carefully built arm may still have; here its control runs at 500 Hz instead of 1 kHz, which halves what a simulated run takes.
# `drawn_plants` draws arms with them, `executed` moves these along the plan under control by computed torque, and `judged_runs` says what they kept.

# %%
wall = load_problem("example:ur5/over_the_wall")
usual = Robustness(control_period=0.002)
print(usual)

# %%
QUICK = PlanOptions(quality="fast", slack=0.0)
shortest = plan(wall, QUICK)


def run(trajectory, errors=usual, arms=10):
    """Return what arms with some errors did along a trajectory, and what they kept."""
    plants = drawn_plants(wall.robot, errors, Draw(arms))
    execution = executed(wall, trajectory, plants, errors.controller, errors.control_period)
    return execution, judged_runs(wall, trajectory, execution)


def farthest(judged):
    """Return how far beyond the tube the tool was at worst [mm]; below zero: inside."""
    return 1000 * max(run.tube.value for run in judged)


execution, judged = run(shortest.trajectory)
figure = plot_execution(wall, shortest.trajectory, execution, judged)
figure

# %% [markdown]
# Most of them leave the tube: the plan touches its border and takes all that some motor has, so that nothing is left for feedback. The bottom panel shows which
# motor it is.
#
# ## Slower does not help
#
# Run slower, the motion needs less of its motors. It still touches the border of its tube, and no arm follows it to the micrometre.

# %%
print(f"{'':24}{'runs failed':>12}{'out of the tube':>18}{'motor at its limit':>20}")
for factor in (1.0, 1.1, 1.5, 2.0):
    slower = shortest.trajectory.scaled(factor)
    _, judged = run(slower)
    failed = sum(not one.survives for one in judged)
    saturated = np.median([one.saturated for one in judged])
    print(
        f"{factor:4g} times {slower.duration:8.4f} s {failed:8} of {len(judged)}"
        f"{farthest(judged):15.2f} mm{100 * saturated:15.0f} %"
    )

# %% [markdown]
# ## The motion that survives
#
# The field `robustness` of a problem asks for it. Efforts, velocities, radii and clearance are kept back, as much as simulated runs show to be needed, and the
# motion is planned again. In the end 200 fresh arms judge it, with which nothing was chosen. `sweep_field` plans for masses that are known to the usual 5 % and to 15 %, with the other errors
# as usual; here is the first answer.

# %%
control = {"robustness.control_period": usual.control_period}
swept = sweep_field(
    "example:ur5/over_the_wall", "robustness.mass", [0.05, 0.15], changes=control, options=QUICK
)
robust = swept.rows[0].result
survival = robust.survival
print(f"{shortest.duration:.4f} s -> {robust.duration:.4f} s")
print("the model, for all t:", "certified" if robust.certificate.passed else "fails")
print(survival.seen)
for part, cost in survival.costs.items():
    print(f"   {part}: {np.round(getattr(survival.tightening, part), 4)}, {1000 * cost:.1f} ms")

# %%
execution, judged = run(robust.trajectory)
figure = plot_execution(wall, robust.trajectory, execution, judged)
figure

# %% [markdown]
# The certificate still holds for the whole limits; what is kept back of them is left for the arms. None of 200 failed: with 95 % confidence, at most 1.8 % of all arms
# with such errors do. It is no proof: another 200 may have one that fails, and arms with other errors than these may all do.
#
# ## Whose fault is it?
#
# Each error alone, on the shortest motion: how far beyond the tube the worst of 5 arms comes.

# %%


def exact_but(**errors):
    """Return no errors but some, under the usual control."""
    return Robustness.exact(**errors, control_period=usual.control_period)


names = [name for name, size in vars(Robustness.exact()).items() if size == 0]
sizes = {name: getattr(usual, name) for name in names}
alone = [
    farthest(run(shortest.trajectory, exact_but(**{name: size}), 5)[1])
    for name, size in sizes.items()
]
without_any = farthest(run(shortest.trajectory, exact_but(), 1)[1])
figure, axis = plt.subplots(figsize=(8, 4.5), layout="constrained")
axis.barh([f"{name} {size:g}" for name, size in sizes.items()], alone, color="C0")
axis.axvline(without_any, color="black", linewidth=1, label="without any error")
axis.axvline(0, color="C1", linestyle="--", label="border of the tube")
axis.invert_yaxis()
axis.set(xlabel="farthest beyond the tube [mm]; below zero: inside")
axis.legend()
plt.show()

# %% [markdown]
# This is the tolerance budget: what makes the longest bar is worth identifying better. Payload and friction do nothing because this problem gives neither. Bars do not
# add up, for arms have all errors at once, in random directions; and five arms find the order, not the last tenth of a millimetre.
#
# ## Duration against error
#
# How much time does a worse model cost?

# %%
for row in swept.rows:
    seen = row.verdict
    print(f"{row.value:g}: {row.duration:.4f} s, {seen.failed} of {seen.runs} failed")
plot_field_sweep(swept)

# %% [markdown]
# Masses that are known three times worse cost some milliseconds. To know them better than to 5 % can save no more than what surviving costs there: it hardly pays here. Where it does, and how to find
# the numbers of your own arm: `docs/how_to/executed.md`.
