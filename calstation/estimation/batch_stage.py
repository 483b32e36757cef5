"""Solver of stages that are collected and then solved in one batch."""

from collections.abc import Callable

from calstation.estimation.common import Belief, SampleBlock, SolveContext, Spool, StageData, stage_data
from calstation.estimation.method import Progress, Solution
from calstation.physics import FloatArray


class BatchStage:
    """A `StageSolver` around one function of the whole stage's data, which may raise InsufficientDataError."""

    def __init__(
        self, context: SolveContext, prior: Belief, solve: Callable[[StageData, SolveContext, Belief], Solution]
    ) -> None:
        self.context, self.prior = context, prior
        self._solve = solve
        self._spool = Spool()

    def feed(self, block: SampleBlock) -> None:
        """Take further samples of the stage."""
        self._spool.append(block)

    def sigma(self) -> FloatArray:
        """The prior's standard deviations, SI, shape (30,)."""
        return self.prior.sigma

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage; too fast to report progress."""
        return self._solve(stage_data(list(self._spool.blocks()), self.context.imu), self.context, self.prior)
