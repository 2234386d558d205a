"""What steps are to gain in a given duration: less of what motions are measured by.

The measures' logarithms are added, so that scales do not matter.
"""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.control_variables import ControlVariables
from tubeplanner.refinement.interval_blocks import IntervalBlocks
from tubeplanner.refinement.interval_motion import POINTS, IntervalMotion
from tubeplanner.refinement.measure import MeasureModel, Weighted
from tubeplanner.refinement.spline_constraints import Iterate
from tubeplanner.refinement.step_block import Quadratic, Step

_NOTHING = 1e-12  # beside measures that may vanish
# What the sum of logarithms is worth at first, and at least, in shares of T^2: halved while steps
# would make the motion longer than it may be.
_FIRST_WORTH, _LEAST_WORTH = 5e-3, 5e-4
_LONGER = 1e-4


class MeasuredObjective:
    """The `StepObjective` of a motion that measures less, within a duration."""

    least_duration_step = 0.0
    ignored_excess = 0.0  # gains are large here, beside what curvature brings

    def __init__(self, measures: Weighted, run_in: float) -> None:
        """Take what counts.

        Args:
            measures: The measures, with the weights of their logarithms.
            run_in: The duration [s].
        """
        self.run_in = run_in
        self._worth = _FIRST_WORTH
        self._weights = np.array([weight for weight, _ in measures])
        self._measures = tuple(measure for _, measure in measures)
        self._blocks: IntervalBlocks | None = None
        self._last: tuple[Iterate, Quadratic] | None = None
        self._measured: list[tuple[Iterate, IntervalMotion, FloatArray]] = []

    def value(self, current: Iterate) -> float:
        """Return the weighted sum of the measures' logarithms: the less, the better."""
        return float(np.log(self._measure(current)[1]) @ self._weights)

    def cost(
        self, current: Iterate, variables: ControlVariables, regularization: Quadratic
    ) -> Quadratic:
        """Return the cost: convex quadratics of the measures, and eta."""
        own = self._model(current, variables).times(self._worth)
        self._last = current, own
        hessian = own.hessian.plus(regularization.hessian)
        return Quadratic(hessian, own.gradient + regularization.gradient)

    def predicted_gain(self, current: Iterate, step: Step) -> float:
        """Return what a step should gain, of the cost that was asked for last."""
        assert self._last is not None
        change = np.concatenate([step.control.ravel(), step.switching])
        padded = np.append(change, [0.0, 0.0])
        own = self._last[1]
        less = -(own.gradient @ change) - padded @ own.hessian.product(padded) / 2
        return float(less + self._longer(current) - max(step.duration, 0.0))

    def gain(self, current: Iterate, trial: Iterate) -> float:
        """Return what measuring less is worth, less the share by which T^2 is longer."""
        if not np.isfinite(trial.squared_duration):
            return -np.inf
        longer = self._longer(trial) - self._longer(current)
        return self._worth * (self.value(current) - self.value(trial)) - longer

    def after(self, step: Step) -> None:
        """Let measures be worth less if the step would make the motion longer than it may be."""
        if step.duration > _LONGER:
            self._worth = max(self._worth / 2, _LEAST_WORTH)

    def _longer(self, iterate: Iterate) -> float:
        """Return by which share T^2 would have to be longer."""
        return max(iterate.squared_duration / self.run_in**2 - 1, 0.0)

    def _measure(self, current: Iterate) -> tuple[IntervalMotion, FloatArray]:
        """Return a motion in the duration, and its measures."""
        for known, motion, totals in self._measured:
            if known is current:
                return motion, totals
        motion = IntervalMotion(current, self.run_in)
        totals = np.array([measure.total(motion) for measure in self._measures]) + _NOTHING
        self._measured = [*self._measured[-2:], (current, motion, totals)]
        return motion, totals

    def _model(self, current: Iterate, variables: ControlVariables) -> Quadratic:
        """Return a convex quadratic of the value near a trajectory: that of Gauss and Newton."""
        motion, totals = self._measure(current)
        shares = (self._weights / totals).tolist()
        models = zip(self._measures, shares, strict=True)
        model = MeasureModel.stacked([measure.model(motion, share) for measure, share in models])
        control, switching = model.control, model.switching
        weighted = control * model.curvature[:, :, None]
        blocks = np.swapaxes(control, 1, 2) @ weighted
        mixed = np.swapaxes(weighted, 1, 2) @ switching
        corner = np.einsum("mri,mr,mrk->ik", switching, model.curvature, switching)
        gradient = np.einsum("mrv,mr->mv", control, model.slope)
        by_switching = np.einsum("mri,mr->i", switching, model.slope)
        if self._blocks is None:
            intervals, _, switches = switching.shape
            self._blocks = IntervalBlocks(variables, intervals, POINTS, switches)
        return Quadratic(
            self._blocks.matrix(blocks, mixed, corner), self._blocks.vector(gradient, by_switching)
        )
