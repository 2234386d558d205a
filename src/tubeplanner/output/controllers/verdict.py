"""Verdict of a controller on a trajectory: findings and their effects."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class Effect(StrEnum):
    """Consequence of a finding.

    The controller refuses or aborts the motion; executes another motion than the file's; or accepts
    it, with a remark.
    """

    REFUSED = "refused"
    ALTERED = "altered"
    NOTED = "noted"


@dataclass(frozen=True)
class ControllerFinding:
    """A finding of a controller; fields that do not apply are None.

    Attributes:
        effect: Consequence of the finding.
        error: In the controller's words: the name of its error, or its action.
        message: One sentence.
        joint: Joint of the value.
        value: Of the joint or of the tool.
        limit: Limit of the value.
        unit: Of value and limit.
        time: Of the value [s].
        first_time: First time beyond the limit [s]; a refused motion ends there.
    """

    effect: Effect
    error: str
    message: str
    joint: str | None = None
    value: float | None = None
    limit: float | None = None
    unit: str | None = None
    time: float | None = None
    first_time: float | None = None


@dataclass(frozen=True)
class ControllerVerdict:
    """Findings of a controller on a trajectory.

    Attributes:
        name: Of the controller: one of `CONTROLLERS`.
        title: Description of the controller.
        refuses: Its action on a bad motion: "abort" or "refuse".
        findings: In the order of their effects.
    """

    name: str
    title: str
    refuses: str
    findings: tuple[ControllerFinding, ...]

    @property
    def accepted(self) -> bool:
        """True if the controller executes the trajectory unchanged."""
        return self.gravest is None

    @property
    def gravest(self) -> ControllerFinding | None:
        """First finding that prevents acceptance, refusals before others; None if accepted."""
        for effect in (Effect.REFUSED, Effect.ALTERED):
            for finding in self.findings:
                if finding.effect is effect:
                    return finding
        return None

    @property
    def summary(self) -> str:
        """Action of the controller, in a few words."""
        gravest = self.gravest
        return "accepted" if gravest is None else self._begins[gravest.effect]

    @property
    def _begins(self) -> dict[Effect, str]:
        """Begin of the line of a finding, by its effect."""
        return {
            Effect.REFUSED: f"would {self.refuses}",
            Effect.ALTERED: "would run otherwise",
            Effect.NOTED: "note",
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {"accepted": self.accepted, **asdict(self)}

    def lines(self) -> list[str]:
        """Return a heading with the verdict, then a line per finding."""
        return [
            f"{self.name} ({self.title}): {self.summary}",
            *(
                f"  {self._begins[each.effect]}: {each.error}: {each.message}"
                for each in self.findings
            ),
        ]
