"""What a motion in a given duration is measured by, and what a step makes of that."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.interval_motion import IntervalMotion


@dataclass(frozen=True, eq=False)
class MeasureModel:
    """A share of a measure near a motion, as a function of R residuals in each knot interval.

    Attributes:
        curvature: Its second derivatives by the residuals, >= 0, shape (M, R).
        slope: Its first ones, shape (M, R).
        control: The residuals' by the control points of the interval and the next, (M, R, 5 n).
        switching: Theirs by the switching times, shape (M, R, S).
    """

    curvature: FloatArray
    slope: FloatArray
    control: FloatArray
    switching: FloatArray

    @staticmethod
    def of(
        curvature: FloatArray, slope: FloatArray, control: FloatArray, switching: FloatArray
    ) -> "MeasureModel":
        """Return that of residuals (M, ...) with derivatives (M, ..., 5, n) and (M, ..., S)."""
        rows = len(curvature), curvature[0].size
        return MeasureModel(
            curvature.reshape(rows),
            slope.reshape(rows),
            control.reshape(*rows, -1),
            switching.reshape(*rows, switching.shape[-1]),
        )

    @staticmethod
    def stacked(models: "list[MeasureModel]") -> "MeasureModel":
        """Return the sum of models, with the residuals of all."""
        parts = ("curvature", "slope", "control", "switching")
        return MeasureModel(
            *(np.concatenate([getattr(model, part) for model in models], axis=1) for part in parts)
        )


class Measure(Protocol):
    """One measure of motions: the sum of what every knot interval adds to it."""

    def total(self, motion: IntervalMotion) -> float:
        """Return the measure, >= 0."""
        ...

    def model(self, motion: IntervalMotion, share: float) -> MeasureModel:
        """Return a share of the measure near a motion."""
        ...


# Measures with the weights of their logarithms.
Weighted = tuple[tuple[float, Measure], ...]
