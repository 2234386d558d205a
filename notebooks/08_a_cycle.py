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
# An arm in a cell does the same over and over: it reaches, grips, carries, lets go and comes back. What does that take from start to start, and where does the
# time go? This notebook plans a cycle from its file, sees what it is worth to choose the configurations between moves together, and executes one from first
# to last. It takes one to two minutes, and MuJoCo for the last part: `pip install -e '.[simulate]'` in a checkout.

# %%
# %matplotlib inline
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from tubeplanner import (
    Attach,
    Draw,
    Event,
    Move,
    PlanOptions,
    Robustness,
    compare,
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
# ## What is in the file
#
# A Panda takes a tray with a beaker on it out of one shelf and carries it level to the next. A cycle file has moves, each with its tube, and between them what happens at
# rest: events that take time, and what the tool takes and lets go.

# %%
tray = load_cycle("example:panda/tray_to_the_next_shelf")


def told(step):
    """Return a step of a cycle in a few words."""
    if isinstance(step, Move):
        end = "its end left open" if step.ends_openly else "its end given"
        begin = ", no stop before it" if step.passes_through else ""
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
    print("  ", told(step))

# %% [markdown]
# A move that passes through goes on without a stop where the one before it ends. Moves without stops between them are a *leg*, and legs meet at *seams*. Where an end is left open, only the
# hand's place is given, and the tolerance of the tube: the configuration there is the planner's to choose. The cycle is closed: its last move ends where the first one begins.
#
# ## The plan
#
# `plan_cycle` first plans every move alone, in order, each from where the last one ended. Then it chooses the open configurations so that the sum is shortest. The
# certificate judges every leg with what it carries then, and what must hold at the seams: that joints do not jump, and that motors hold the arm at rest before and
# after something changes hands.

# %%
result = plan_cycle(tray, QUICK)
print(result.message)
for name, (begin, end) in result.motion.move_times.items():
    print(f"   {begin:.4f} s  {name}: {end - begin:.4f} s")

# %% [markdown]
# What would a better robot, or a wider tube, buy? The prices are those of the whole cycle: limits of joints count in all moves, tolerances in their own. They hold with
# the configurations at seams as they are; with these free to change, more may be saved.

# %%
print("10 % more would save:")
for price in result.sensitivities[:6]:
    print("  ", price)

# %%
certificate = result.certificate
print(certificate)
for leg in tray.legs:
    judged = certificate.moves[leg.moves[0].name]
    margins = {
        name: condition.margin
        for name, condition in judged.conditions.items()
        if name not in ("rest", "continuity")  # which are kept to rounding
        and condition.unit == "relative"
        and condition.margin is not None
    }
    tightest = min(margins, key=margins.get)
    print(f"   {leg.name}: nearest its limit is {tightest} ({judged.conditions[tightest].where})")
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
# Moves of one leg are judged together. At a seam, the margin of continuity is minus the largest jump of a joint [rad], nothing but rounding here, and that of effort is what the
# arm at rest leaves of its motors' torque, as a share. "closed" says how far the end is from the start.
#
# ## One look at everything
#
# The figure has all joints against the limits of their moves, with what happens at rest.

# %%
plot_cycle(tray, result.motion)

# %% [markdown]
# The page runs the cycle on one time line: drag it to turn it, and see how the tray is taken and let go. `view_cycle(...).save("cycle.html")` makes it a file that can be mailed and
# opened without a network.

# %%
view_cycle(tray, [result.motion], ["tray"])

# %% [markdown]
# ## What configurations in common change
#
# The same cycle again, its moves planned alone. The first of two moves ends where it is itself the quickest, whatever that means for the second.

# %%
alone = plan_cycle(tray, QUICK, shares_configurations=False)
motions = {"alone": alone.motion, "together": result.motion}
moved = [abs(q - p).max() for q, p in zip(*(m.junctions for m in motions.values()), strict=True)]
junction = int(np.argmax(moved))
names = [leg.name for leg in tray.legs]
print(f"largest change of a joint at every seam: {np.round(moved, 3)} rad")
print(f"most between '{names[junction - 1]}' and '{names[junction]}':")
for name, motion in motions.items():
    print(f"   {name:9}", np.round(motion.junctions[junction], 3), "rad")

# %%


def joint_places(robot, q):
    """Return the places of all joints and the tool in a configuration (n,), shape (n + 1, 3) [m]."""
    _, position = robot.body_poses(q)
    return np.vstack([position, robot.tool_position(q)])


figure, axes = plt.subplots(1, 2, figsize=(12, 5), layout="constrained")
for motion, color in zip(motions.values(), ("C1", "C0"), strict=True):
    places = joint_places(tray.robot, motion.junctions[junction])
    tool = tray.robot.tool_position(motion.trajectory.sample(rate=200).position)
    for axis, (i, j) in zip(axes, ((0, 1), (1, 2)), strict=True):
        axis.plot(places[:, i], places[:, j], "o-", color=color, linewidth=4, alpha=0.8)
        axis.plot(tool[:, i], tool[:, j], color=color, linewidth=1)
for axis, (x, y), side in zip(axes, ("xy", "yz"), ("above", "the side"), strict=True):
    axis.set(aspect="equal", xlabel=f"{x} [m]", ylabel=f"{y} [m]", title=f"seen from {side}")
figure.legend(axes[0].lines[::2], motions, loc="outside lower center", ncols=2)
plt.show()

# %% [markdown]
# The hand is in the same place, level both times; the arm that holds it is not. Where did the time go? Move by move:

# %%
figure, axis = plt.subplots(figsize=(8, 4), layout="constrained")
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
# A move may well become slower, where the next one gains more.
#
# ## Beside what is usual
#
# Usual is a stop after every move, or, along straight lines, even at every point. The first column, "lines", is TOPP-RA's scheme exactly solved: the fastest run along the tool's
# straight lines with a stop at every point, between the configurations that the plan with stops has at its seams. It may switch motors instantly, and knows neither jerk limits nor
# obstacles: what could really be driven along the lines is slower. In the last column moves pass through where the file says so.


# %%
def with_stops(cycle):
    """Return a cycle that stops after every move."""
    steps = [
        replace(step, passes_through=False) if isinstance(step, Move) else step
        for step in cycle.steps
    ]
    return replace(cycle, steps=steps)


def durations(motion):
    """Return how long every move takes [s]."""
    return {name: end - begin for name, (begin, end) in motion.move_times.items()}


stopping = plan_cycle(with_stops(tray), QUICK)
stops, through = durations(stopping.motion), durations(result.motion)
problems = stopping.motion.cycle.problems(stopping.motion.junctions)
blocked = []
print(f"{'duration [s]':26} {'lines':>8} {'stops':>8} {'through':>8}")
for name, problem in zip(stops, problems, strict=True):
    (lines,) = compare(problem, ["bang-bang"]).rows
    if lines.duration is None:
        blocked.append(f"{name}: {lines.message}")
    along = np.nan if lines.duration is None else lines.duration
    print(f"{name:26} {along:8.4f} {stops[name]:8.4f} {through[name]:8.4f}")
print(*blocked, sep="\n")

# %% [markdown]
# nan: some straight line cannot be run between the configurations that it is given, for the reason below the table. The whole cycle, rests included, with moves that are planned
# one after the other, and with configurations chosen in common:

# %%
for called, each in (("stops", stopping), ("through", result)):
    print(f"{called:8} alone {each.greedy_duration:.4f} s, together {each.duration:.4f} s")

# %% [markdown]
# How much sharing gains depends on how many ends are left open and how freely the hand may turn there; an arm of seven joints has more to choose than one of six. The README has
# the same of all bundled cycles.
#
# ## Executed as a whole
#
# Ten arms that differ from their model as carefully built ones do run the cycle without a break, under control at 500 Hz. The tray and the beaker are in the simulated hand from the
# instant on in which they are taken, each with an error of its own mass. `07_executed.py` says what is simulated, and how a single motion is planned that survives.

# %%
errors = Robustness(control_period=0.002)
execution = executed_cycle(result.motion, errors, Draw(10))
judged = judged_cycle(result.motion, execution)
print(run_verdict(judged.runs))
for names, runs in judged.legs.items():
    worst = 1000 * max(run.tube.value for run in runs)
    print(f"   {', '.join(names)}: {worst:.2f} mm beyond the tube at worst")
for handover in judged.handovers:
    distance, angle = 1000 * handover.distance.max(), np.degrees(handover.angle.max())
    print(
        f"   {handover.mark.kind} {handover.mark.name}: {distance:.2f} mm, {angle:.2f} degrees off"
    )

# %%
plot_cycle_execution(result.motion, execution, judged)

# %% [markdown]
# The shortest motion touches the borders of its tubes, and arms that differ cross them. Where something changes hands the arm is at rest: what remains there are errors of where
# it stands, of its tool, and what feedback leaves of the others. The same from a shell:
#
# ```sh
# tubeplanner plan example:panda/tray_to_the_next_shelf -o tray.json --html tray.html
# tubeplanner check example:panda/tray_to_the_next_shelf tray.json
# tubeplanner simulate example:panda/tray_to_the_next_shelf tray.json --runs 10
# ```
