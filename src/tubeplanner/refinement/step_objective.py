"""What steps of the optimiser are to gain: by default, a shorter duration."""

from typing import Protocol

from tubeplanner.refinement.control_variables import ControlVariables
from tubeplanner.refinement.linear_rows import MERIT_TOLERANCE
from tubeplanner.refinement.spline_constraints import Iterate
from tubeplanner.refinement.step_block import Quadratic, Step


class StepObjective(Protocol):
    """What steps are to gain."""

    @property
    def run_in(self) -> float | None:
        """The duration in which splines are run [s]; None: the least that limits allow."""
        ...

    @property
    def least_duration_step(self) -> float:
        """The smallest eta of a step."""
        ...

    @property
    def ignored_excess(self) -> float:
        """The part of an iterate's excess that does not count."""
        ...

    def cost(
        self, current: Iterate, variables: ControlVariables, regularization: Quadratic
    ) -> Quadratic:
        """Return what a step costs, with what keeps it regular.

        Args:
            current: Where it begins.
            variables: What may change.
            regularization: The cost of all steps, whatever they are to gain.
        """
        ...

    def predicted_gain(self, current: Iterate, step: Step) -> float:
        """Return what a step should gain, of the cost that was asked for last."""
        ...

    def gain(self, current: Iterate, trial: Iterate) -> float:
        """Return what was gained."""
        ...

    def after(self, step: Step) -> None:
        """Take note of a step that the program found."""
        ...


class ShortestDuration:
    """The `StepObjective` of a shorter duration: the relative change of T^2."""

    run_in = None
    least_duration_step = -0.5
    ignored_excess = MERIT_TOLERANCE

    def cost(
        self, current: Iterate, variables: ControlVariables, regularization: Quadratic
    ) -> Quadratic:
        """Return the cost: eta, and what keeps steps regular."""
        return regularization

    def predicted_gain(self, current: Iterate, step: Step) -> float:
        """Return by which share of T^2 a step should be shorter."""
        return -step.duration

    def gain(self, current: Iterate, trial: Iterate) -> float:
        """Return by which share of T^2 a trial is shorter."""
        return 1 - trial.squared_duration / current.squared_duration

    def after(self, step: Step) -> None:
        """Take no note: durations need no weight."""
