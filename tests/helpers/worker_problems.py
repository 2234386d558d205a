"""Problems that misbehave in the processes that plan them."""

from dataclasses import dataclass

from worker_calls import deadly, noted

from tubeplanner import PosedProblem


@dataclass(frozen=True)
class DeadlyProblem(PosedProblem):
    """Kills the process that reads it."""

    def load(self):
        deadly()


@dataclass(frozen=True)
class RaisingProblem(PosedProblem):
    """Raises what reading must not raise."""

    def load(self):
        raise ZeroDivisionError("in a test")


@dataclass(frozen=True)
class SlowProblem(PosedProblem):
    """Takes its time, and says in a file which process reads it."""

    noted_in: str = ""

    def load(self):
        noted(self.noted_in, 0.3)
        return super().load()
