"""What happens at rest, in words."""

from tubeplanner.cycle.leg import Rest, RestStep
from tubeplanner.cycle.steps import Event
from tubeplanner.errors import shown


def rest_text(rest: Rest) -> str:
    """Return what happens in a rest, such as "gripper 'close' (0.15 s), attach part"."""
    return ", ".join(map(step_text, rest.steps)) or "nothing"


def step_text(step: RestStep) -> str:
    """Return what happens in one step of a rest, likewise."""
    if not isinstance(step, Event):
        return f"{type(step).__name__.lower()} {step.name}"
    setting = "" if step.setting is None else f" {shown(step.setting)}"
    return f"{step.name}{setting}" + (f" ({step.dwell:g} s)" if step.dwell else "")
