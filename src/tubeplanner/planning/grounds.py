"""How sure it is that there is no answer: proved, or looked for in vain."""

from dataclasses import replace

from tubeplanner.planning.plan_result import PlanResult


def with_grounds(result: PlanResult) -> PlanResult:
    """Return a result whose message says so, if it is a refusal.

    What stopped planning proves nothing, and says so itself.
    """
    if result.proved is None:
        return result
    return replace(result, message=f"{result.message}; {_grounds(result)}")


def _grounds(result: PlanResult) -> str:
    if result.proved:
        return "proved: there is no motion"
    if not result.starts_tried:
        return "not found"
    plural = "s" if result.starts_tried > 1 else ""
    return f"not found, {result.starts_tried} start{plural} tried"
