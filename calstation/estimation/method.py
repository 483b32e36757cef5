"""The interface of a calibration method: its plan, its solver and the parameters it estimates."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Protocol

from pydantic import BaseModel, ConfigDict, Field

from calstation.estimation.common import (
    Belief,
    Consistency,
    LatitudeEstimate,
    SampleBlock,
    SolveContext,
    Spool,
    StageData,
    stage_data,
)
from calstation.estimation.positions import Evidence
from calstation.physics import FloatArray, IntArray, Step, TableGeometry

#: Called with progress from 0 to 1, never falling.
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Innovations:
    """Innovations of a stage's observations."""

    seq: IntArray  #: Sequence number at the end of each observation, shape (m,).
    normalised: FloatArray  #: Decorrelated components in units of their sigmas, shape (m, 3).


@dataclass(frozen=True)
class Estimate:
    """A value beyond the 30 parameters, SI; `determined` is False if the data did not determine it."""

    value: float
    sigma: float
    unit: str
    determined: bool = True


@dataclass(frozen=True)
class Solution:
    """Solution of a stage."""

    stage: str
    belief: Belief  #: Joint posterior of the 30 parameters, the next stage's prior.
    estimated: tuple[str, ...]  #: Names of the parameters that the stage estimated.
    consistency: Consistency  #: Innovation test of the stage.
    gaps: int = 0  #: Number of gaps and resets.
    observability: Mapping[str, Any] = field(default_factory=dict)  #: See `observability_analysis`, JSON-ready.
    details: Mapping[str, Any] = field(default_factory=dict)  #: Further results such as residuals, JSON-ready.
    messages: tuple[tuple[str, Mapping[str, Any]], ...] = ()  #: Remarks for the user, (message id, values).
    innovations: Innovations | None = None  #: For diagnosis; no part of a result.
    found: Mapping[str, Estimate] = field(default_factory=dict)  #: Values beyond the 30 parameters, by contract name.
    evidence: Evidence | None = None  #: Rests and motions of its samples, if the product's checks need them.
    latitude: LatitudeEstimate | None = None  #: From the gyros at all rests so far, if they are good enough.


class StageSolver(Protocol):
    """Consumes a stage's blocks; the solution does not depend on how samples are cut into blocks."""

    def feed(self, block: SampleBlock) -> None:
        """Take further samples of the stage."""

    def sigma(self) -> FloatArray:
        """Standard deviations of the 30 parameters so far, shape (30,), SI."""

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage; slow solvers report `progress`. Raises InsufficientDataError."""


class RepeatedSchedule(BaseModel):
    """Stop rule of a repeated plan: the first of these conditions that is met."""

    model_config = ConfigDict(extra="forbid")
    rounds: int | None = Field(1, ge=1, description="complete rounds")
    duration_s: float | None = Field(None, gt=0.0, description="the round during which this is over is the last")
    targets: dict[str, Annotated[float, Field(gt=0.0)]] = Field(
        default_factory=dict, description="the round after which every sigma is below its target is the last"
    )


@dataclass(frozen=True)
class Method:
    """One calibration method, the object `METHOD` of a file in `procedures/`."""

    name: str  #: The contract's stage name.
    schedule: type[BaseModel]  #: Pydantic model of the schedule's parameters with their defaults.
    #: (geometry, schedule) -> steps, in joint angles within the table's limits; a plan that repeats is endless
    #: and marks each round with `RoundEnd`.
    plan: Callable[[TableGeometry, Any], Iterator[Step]]
    solver: Callable[[SolveContext, Belief, Any], StageSolver]  #: (context, prior, schedule) -> solver
    #: (context) -> names of the parameters that the stage estimates
    estimates: Callable[[SolveContext], tuple[str, ...]]
    #: The solver finds the steps in the data, so a recording whose column 'stage' does not name the method can
    #: be solved as a whole.
    needs_no_table: bool = False


class BatchStage:
    """A `StageSolver` around one function of the whole stage's data, which may raise InsufficientDataError."""

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
        """The prior's standard deviations, SI, shape (30,)."""
        return self.prior.sigma

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage; too fast to report progress."""
        return self._solve(stage_data(list(self._spool.blocks()), self.context.imu), self.context, self.prior)


def batch_method(
    name: str,
    schedule: type[BaseModel],
    plan: Callable[[TableGeometry, Any], Iterator[Step]],
    solve: Callable[[StageData, SolveContext, Belief, Any], Solution],
    estimated: tuple[str, ...],
    needs_no_table: bool = False,
) -> Method:
    """A method that solves a whole stage at once: `solve` gets data, context, prior and schedule."""

    def solver(context: SolveContext, prior: Belief, chosen: Any) -> BatchStage:
        return BatchStage(context, prior, lambda data, context, prior: solve(data, context, prior, chosen))

    return Method(name, schedule, plan, solver, lambda context: estimated, needs_no_table)
