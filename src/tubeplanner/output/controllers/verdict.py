"""ControllerVerdict: findings and effects."""

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any


class Effect(StrEnum):
    """What comes of a finding.

    The controller refuses or aborts the motion; runs another one than the file's; or accepts it,
    and the finding is worth knowing.
    """

    REFUSED = "refused"
    ALTERED = "altered"
    NOTED = "noted"


@dataclass(frozen=True)
class ControllerFinding:
    """One thing that a controller finds; fields that do not apply are None.

    Attributes:
        effect: What comes of it.
        error: In the controller's words: the name of its error, or what it does.
        message: One sentence.
        joint: Whose value it is.
        value: The value.
        limit: What it is compared with.
        unit: Of both.
        time: When [s]; of the value farthest beyond its limit.
        first_time: When a limit is exceeded first [s]: where the motion ends.
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
    """What a controller finds in a trajectory.

    Attributes:
        name: Of the controller: one of `CONTROLLERS`.
        title: What it is, in words.
        refuses: What it does to a motion: "abort" or "refuse".
        findings: In the order of their effects.
    """

    name: str
    title: str
    refuses: str
    findings: tuple[ControllerFinding, ...]

    @property
    def accepted(self) -> bool:
        """Whether the controller takes the trajectory, and runs the one that the file says."""
        return self.gravest is None

    @property
    def gravest(self) -> ControllerFinding | None:
        """The first finding for which the trajectory is not accepted, refusals before others."""
        for effect in (Effect.REFUSED, Effect.ALTERED):
            for finding in self.findings:
                if finding.effect is effect:
                    return finding
        return None

    @property
    def summary(self) -> str:
        """What the controller does, in a few words."""
        gravest = self.gravest
        if gravest is None:
            return "accepted"
        return self._begins[gravest.effect]

    @property
    def _begins(self) -> dict[Effect, str]:
        """How a line on a finding begins."""
        return {
            Effect.REFUSED: f"would {self.refuses}",
            Effect.ALTERED: "would run otherwise",
            Effect.NOTED: "note",
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return {"accepted": self.accepted, **asdict(self)}

    def lines(self) -> list[str]:
        """Return the findings as text, one line each, and that it is accepted, if it is."""
        return [
            f"{self.name} ({self.title}): {self.summary}",
            *(
                f"  {self._begins[each.effect]}: {each.error}: {each.message}"
                for each in self.findings
            ),
        ]
