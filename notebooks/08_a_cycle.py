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
# # A whole cycle
#
# An arm in a cell repeats one cycle: reach, grip, carry, release, return. How long does the cycle
# take, and where does the time go? This notebook plans a cycle from its file, measures the gain
# from choosing the configurations between moves together, and executes the cycle in simulation.
#
# The notebook takes one to two minutes. Its last part needs MuJoCo: `pip install -e '.[simulate]'`
# in a checkout.

# %%
# %matplotlib inline
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import (
    Attach,
    Draw,
    Event,
    Move,
    PlanOptions,
    Robustness,
    executed_cycle,
    judged_cycle,
    load_cycle,
    plan_cycle,
    plot_cycle,
    plot_cycle_execution,
    run_verdict,
    view_cycle,
)

plt.rcParams.update({"figure.dpi": 100, "axes.grid": True, "grid.alpha": 0.25})
QUICK = PlanOptions(quality="fast", slack=0.0)

# %% [markdown]
# ## The file
#
# A Panda takes a tray with a beaker out of one shelf and carries it level to the next shelf; the
# beaker must not slide on the tray. A cycle file has moves, each with its tube. Between the moves it has steps at rest: events with a
# duration, attached parts and detached parts.

# %%
tray = load_cycle("example:panda/tray_to_the_next_shelf")


def description(step):
    """Return the description of a step of a cycle."""
    if isinstance(step, Move):
        end = "open end" if step.ends_openly else "fixed end"
        begin = ", passes through" if step.passes_through else ""
        return f"move   {step.name}: {end}{begin}"
    if isinstance(step, Event):
        setting = "" if step.setting is None else f" {step.setting}"
        return f"event  {step.name}{setting}: {step.dwell:g} s"
    if isinstance(step, Attach):
        mass = 0.0 if step.payload is None else step.payload.mass
        return f"attach {step.name}: {mass:g} kg"
    return f"detach {step.name}"


print(tray)
for step in tray.steps:
    print("  ", description(step))

# %% [markdown]
# A move that passes through continues the move before it without a stop. Moves without stops
# between them are a *leg*; legs meet at *junctions*. An open end has only the pose of the tool and its
# tolerance: the planner chooses the configuration there. The cycle is closed: the last move ends at
# the start of the first.
#
# ## The plan
#
# `plan_cycle` first plans every move alone, in order, each from the end of the last one. Then it
# chooses the open configurations for the shortest sum. The certificate judges every leg with the
# parts that the tool carries. At the junctions it proves that no joint jumps and that the motors hold
# the arm at rest before and after each attached or detached part.

# %%
result = plan_cycle(tray, QUICK)
print(result.message)
for name, (begin, end) in result.motion.move_times.items():
    print(f"   {begin:.4f} s  {name}: {end - begin:.4f} s")

# %% [markdown]
# Which limit costs most? The sensitivities are those of the whole cycle. A limit of a joint counts
# in all moves, a tolerance in its own move. They hold with the configurations at the junctions as they
# are; if these change too, more time may be saved.

# %%
print("raising a limit by 10 % would save:")
for sensitivity in result.sensitivities[:6]:
    print("  ", sensitivity)

# %%
certificate = result.certificate
print(certificate)
for leg in tray.legs:
    tube = certificate.moves[leg.moves[0].name].conditions["tube"]
    print(f"   {leg.name}: tube {tube.margin:.2g} m, {tube.coverage}")
for junction, conditions in certificate.junctions.items():
    print(
        f"   {junction}:",
        *(
            f"{name} {each.margin:.2g}"
            for name, each in conditions.items()
            if each.margin is not None
        ),
    )

# %% [markdown]
# The moves of one leg are judged together. At a junction, continuity is minus the largest jump of a
# joint [rad], and dwell is the rest beyond the duration of the events [s]; both are rounding errors
# here. The margin of effort is the free fraction of the effort limit at rest. The line "closed"
# compares the end with the start.
#
# ## The motion
#
# The figure has all joints against the limits of their moves, the steps at rest, the tubes of all
# moves, and the arm.

# %% picture=[0.58,0.21,1.0,0.605]
plot_cycle(tray, result.motion)

# %% [markdown]
# `view_cycle` makes a page that plays the cycle in three dimensions. `save` writes it as one file,
# which opens in any browser without a network. In Jupyter, `view_cycle(...)` as the last line of a
# cell shows the page there.

# %%
page = Path(mkdtemp()) / "cycle.html"
view_cycle(tray, [result.motion], ["tray"]).save(page)
print(f"{page.name}: {page.stat().st_size / 1e6:.1f} MB")

# %% [markdown]
# ## Configurations chosen together
#
# Here is the same cycle with its moves planned alone. The first of two moves then ends in its own
# best configuration, even if the next move suffers.

# %%
alone = plan_cycle(tray, QUICK, shares_configurations=False)
motions = {"alone": alone.motion, "together": result.motion}
junctions = zip(*(motion.junctions for motion in motions.values()), strict=True)
changes = [abs(q_alone - q_together).max() for q_alone, q_together in junctions]
junction = int(np.argmax(changes))
names = [leg.name for leg in tray.legs]
print(f"largest change of a joint at each junction: {np.round(changes, 3)} rad")
print(f"largest between '{names[junction - 1]}' and '{names[junction]}':")
for name, motion in motions.items():
    print(f"   {name:9}", np.round(motion.junctions[junction], 3), "rad")

# %%


def joint_positions(robot, q):
    """Return the positions of n joints and the tool in a configuration (n,), (n + 1, 3) [m]."""
    _, position = robot.body_poses(q)
    return np.vstack([position, robot.tool_position(q)])


figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
for motion, color in zip(motions.values(), ("C1", "C0"), strict=True):
    joints = joint_positions(tray.robot, motion.junctions[junction])
    tool = tray.robot.tool_position(motion.trajectory.sample(rate=200).position)
    for axis, (i, j) in zip(axes, ((0, 1), (1, 2)), strict=True):
        axis.plot(joints[:, i], joints[:, j], "o-", color=color, linewidth=4, alpha=0.8)
        axis.plot(tool[:, i], tool[:, j], color=color, linewidth=1)
for axis, (x, y), side in zip(axes, ("xy", "yz"), ("above", "the side"), strict=True):
    axis.set(aspect="equal", xlabel=f"{x} [m]", ylabel=f"{y} [m]", title=f"seen from {side}")
figure.legend(axes[0].lines[::2], motions, loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# The tool has the same position both times and is level; the arm behind it differs. Where does the
# time go? The durations of the moves:

# %%
figure, axis = plt.subplots(figsize=(7, 3.2), layout="constrained")
moves = list(result.motion.move_times)
for k, (name, motion) in enumerate(motions.items()):
    durations = [end - begin for begin, end in motion.move_times.values()]
    height = np.arange(len(moves)) + 0.4 * k - 0.2
    label = f"{name}: {motion.trajectory.duration:.4f} s with rests"
    bars = axis.barh(height, durations, 0.4, color=("C1", "C0")[k], label=label)
    axis.bar_label(bars, fmt=" %.3f s", fontsize=8)
axis.set_yticks(range(len(moves)), moves)
axis.invert_yaxis()
axis.margins(x=0.12)
axis.set(xlabel="duration [s]")
axis.legend()
plt.show()

# %% [markdown]
# Choosing together saves most in `tray_into_the_shelf` and costs a little in the moves before it.
#
# ## Comparison with stops
#
# A usual cycle stops after every move. The next cell plans such a cycle ("stops") and compares the
# durations with those of the file, whose moves pass through where it says so ("through").


# %%
def with_stops(cycle):
    """Return a cycle with a stop after every move."""
    steps = [
        replace(step, passes_through=False) if isinstance(step, Move) else step
        for step in cycle.steps
    ]
    return replace(cycle, steps=steps)


def durations(motion):
    """Return the duration of each move [s]."""
    return {name: end - begin for name, (begin, end) in motion.move_times.items()}


stopping = plan_cycle(with_stops(tray), QUICK)
stops, through = durations(stopping.motion), durations(result.motion)
print(f"{'duration [s]':26} {'stops':>8} {'through':>8}")
for name in stops:
    print(f"{name:26} {stops[name]:8.4f} {through[name]:8.4f}")

# %% [markdown]
# The same for whole cycles, rests included, with configurations chosen one after the other
# ("alone") and together:

# %%
for label, plan in (("stops", stopping), ("through", result)):
    print(f"{label:8} alone {plan.greedy_duration:.4f} s, together {plan.duration:.4f} s")

# %% [markdown]
# The gain depends on the number of open ends and on the freedom of the tool there. An arm with
# seven joints has more choices than one with six.
#
# ## The executed cycle
#
# Ten arms with the errors of carefully built ones run the cycle without a break, under control at
# 500 Hz. Tray and beaker are in the simulated gripper from the instant of their attachment on, each
# with its own error of mass. Notebook 7 describes the simulation, and how to plan a motion that
# survives.

# %%
errors = Robustness(control_period=0.002)
execution = executed_cycle(result.motion, errors, Draw(10))
verdicts = judged_cycle(result.motion, execution)
print(run_verdict(verdicts.runs))
for names, runs in verdicts.legs.items():
    worst = 1000 * max(run.tube.value for run in runs)
    print(f"   {', '.join(names)}: at worst {worst:.2f} mm beyond the tube")
for handover in verdicts.handovers:
    distance, angle = 1000 * handover.distance.max(), np.degrees(handover.angle.max())
    print(
        f"   {handover.mark.kind} {handover.mark.name}: {distance:.2f} mm, {angle:.2f} degrees off"
    )

# %%
plot_cycle_execution(result.motion, execution, verdicts)

# %% [markdown]
# The shortest motion touches the borders of its tubes, so arms with errors cross them by some
# tenths of a millimetre. The bottom panel is empty: no motor is at its effort limit. At attachments and
# detachments the arm is at rest; the errors left there are those of its base, its tool and the
# feedback. The same on the command line:
#
# ```sh
# tubeplanner plan example:panda/tray_to_the_next_shelf -o tray.json --html tray.html
# tubeplanner check example:panda/tray_to_the_next_shelf tray.json
# tubeplanner simulate example:panda/tray_to_the_next_shelf tray.json --runs 10
# ```
