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
# # When the arm differs from its model
#
# A certificate proves that the model keeps every limit. The real arm is a little lighter or heavier
# than the model, has friction outside the model, answers a millisecond late, and stands half a
# millimetre off. This notebook executes plans in MuJoCo on arms with such errors, finds where the
# tool leaves the tube, and plans a motion that all simulated arms survive. The results were
# **seen** in some runs. They prove nothing about other arms.
#
# The notebook takes one to two minutes. It needs MuJoCo: `pip install -e '.[simulate]'` in a
# checkout.

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
# `Robustness()` has the errors of a carefully built arm. Here the controller runs at 500 Hz instead
# of 1 kHz, which halves the time of a simulated run. `drawn_plants` draws arms with such errors,
# `executed` moves them along the plan under computed-torque control, and `judged_runs` judges each
# run.

# %%
wall = load_problem("example:ur5/over_the_wall")
usual = Robustness(control_period=0.002)
print(usual)

# %% picture=[0.48,0.08,0.96,0.418]
QUICK = PlanOptions(quality="fast", slack=0.0)
shortest = plan(wall, QUICK)


def run(trajectory, errors=usual, arms=10):
    """Return the execution of a trajectory by some arms, and the verdict on each run."""
    plants = drawn_plants(wall.robot, errors, Draw(arms))
    execution = executed(wall, trajectory, plants, errors.controller, errors.control_period)
    return execution, judged_runs(wall, trajectory, execution)


def farthest(verdicts):
    """Return the largest distance of the tool beyond the tube [mm]; negative: inside."""
    return 1000 * max(verdict.tube.value for verdict in verdicts)


execution, verdicts = run(shortest.trajectory)
plot_execution(wall, shortest.trajectory, execution, verdicts)

# %% [markdown]
# Nine of ten arms leave the tube. The plan touches the border of the tube, and one motor or another
# is at its limit, so feedback has no effort left. The bottom panel shows the motors at their
# limits: at 0.1 s, where the tool leaves the tube, it is the shoulder lift joint.
#
# ## A slower motion
#
# A slower motion needs less effort. It still touches the border of the tube, and no arm follows a
# plan to the micrometre.

# %%
print(f"{'':24}{'runs failed':>12}{'out of the tube':>18}{'motor at its limit':>20}")
for factor in (1.0, 1.1, 1.5, 2.0):
    slower = shortest.trajectory.scaled(factor)
    _, verdicts = run(slower)
    failed = sum(not verdict.survives for verdict in verdicts)
    saturated = np.median([verdict.saturated for verdict in verdicts])
    print(
        f"{factor:4g} times {slower.duration:8.4f} s {failed:8} of {len(verdicts)}"
        f"{farthest(verdicts):15.2f} mm{100 * saturated:15.0f} %"
    )

# %% [markdown]
# ## The motion that survives
#
# The field `robustness` of a problem asks for a motion that survives. The planner simulates arms
# and tightens the problem as far as the runs show to be necessary: lower efforts and velocities,
# smaller radii, more clearance. Then it plans again. In the end 200 fresh arms judge the motion.
# `sweep_field` plans for masses known to 5 % (the default) and to 15 %.
#
# The cell prints the first of the two answers. Its last lines have the tightening and its cost: the
# remaining fractions of efforts and velocities, the decrease of the radii and the increase of the
# clearance [m].

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
execution, verdicts = run(robust.trajectory)
plot_execution(wall, robust.trajectory, execution, verdicts)

# %% [markdown]
# The certificate still holds for the full limits. The reserves are left for the arms. None of 200
# arms failed: with 95 % confidence, at most 1.8 % of all arms with such errors fail. This is no
# proof. Another 200 arms may include one that fails, and arms with other errors may all fail.
#
# ## The effect of each error
#
# The next cell executes the shortest motion with one error at a time, on 5 arms each, and draws the
# largest distance beyond the tube.


# %%
def exact_but(**errors):
    """Return a Robustness without errors but for the given ones, under the usual control."""
    return Robustness.exact(**errors, control_period=usual.control_period)


names = [name for name, size in vars(Robustness.exact()).items() if size == 0]
sizes = {name: getattr(usual, name) for name in names}
alone = [
    farthest(run(shortest.trajectory, exact_but(**{name: size}), 5)[1])
    for name, size in sizes.items()
]
without_errors = farthest(run(shortest.trajectory, exact_but(), 1)[1])
figure, axis = plt.subplots(figsize=(8, 4.5), layout="constrained")
axis.barh([f"{name} {size:g}" for name, size in sizes.items()], alone, color="C0")
axis.axvline(without_errors, color="black", linewidth=1, label="without errors")
axis.axvline(0, color="C1", linestyle="--", label="border of the tube")
axis.invert_yaxis()
axis.set(xlabel="largest distance beyond the tube [mm]; negative: inside")
axis.legend()
plt.show()

# %% [markdown]
# This is the error budget: identify the error with the longest bar first. Here these are delay, lag
# and mass. Payload and friction have no effect, because the problem has neither. The bars do not
# add up: an arm has all errors at once, in random directions. Five arms give the order of the
# errors, not the last tenth of a millimetre.
#
# ## Duration against error
#
# How much time does a worse model cost?

# %%
for row in swept.rows:
    verdict = row.verdict
    print(f"{row.value:g}: {row.duration:.4f} s, {verdict.failed} of {verdict.runs} failed")
plot_field_sweep(swept)

# %% [markdown]
# Masses known to 15 % instead of 5 % cost 15 ms. Masses known better than to 5 % save at most 17
# ms, the whole cost of robustness. The page `docs/how_to/executed.md` says how to find the errors
# of your own arm.
