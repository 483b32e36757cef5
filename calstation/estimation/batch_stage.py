"""The solver that stages of single rests and turns share: collects a stage, solves it in one batch at its end."""

from collections.abc import Callable

from calstation.estimation.common.context import Belief, SolveContext
from calstation.estimation.common.samples import SampleBlock, Spool
from calstation.estimation.common.stage_data import StageData, stage_data
from calstation.estimation.method import Progress, Solution
from calstation.physics.arrays import FloatArray


class BatchStage:
    """A `StageSolver` around one function of the whole stage's data.

    Parameters
    ----------
    solve : (data, context, prior) -> solution; raises InsufficientDataError saying what is missing
    """

    def __init__(
        self,
        context: SolveContext,
        prior: Belief,
        solve: Callable[[StageData, SolveContext, Belief], Solution],
    ) -> None:
        self.context, self.prior = context, prior
        self._solve = solve
        self._spool = Spool()

    def feed(self, block: SampleBlock) -> None:
        """Take further samples of the stage."""
        self._spool.append(block)

    def sigma(self) -> FloatArray:
        """The prior's sigmas until the stage is solved, SI, shape (30,)."""
        return self.prior.sigma

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage, which takes no time worth telling."""
        return self._solve(stage_data(list(self._spool.blocks()), self.context.imu), self.context, self.prior)
