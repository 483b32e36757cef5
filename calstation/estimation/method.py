"""Interface of the calibration methods: plan, solver and estimated parameters."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from calstation.estimation.common import (
    Consistency,
    Diagnosis,
    LatitudeEstimate,
    ModelTest,
    Posterior,
    RestNoise,
    RestResiduals,
    SampleBlock,
    ScoreFunction,
    SolveContext,
    StageBuffer,
    StageData,
    StageResiduals,
    concentration,
    position_residuals,
    rest_residuals,
)
from calstation.estimation.effects import EffectTests, Sensitivity
from calstation.estimation.positions import Evidence
from calstation.estimation.temperature import TemperatureFit
from calstation.messages import Text
from calstation.physics import CHANNELS, NAMES, FloatArray, IntArray, Step, TableGeometry

#: Number of rests or moves that a message lists.
MAX_NAMED = 3

#: Callback with the progress from 0 to 1, which never decreases.
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Innovations:
    """Innovations of a stage's observations."""

    seq: IntArray  #: Sequence number at the end of each observation, shape (m,).
    normalised: FloatArray  #: Components in units of their sigmas, shape (m, 3); NaN if a component is not tested.
    white: bool = True  #: Whether the components are independent of each other.


@dataclass(frozen=True)
class Ranking:
    """Observability of the states of a stage so far, see `ObservabilityAnalysis`."""

    step: int  #: Number of the latest step.
    rank: int  #: Number of singular values of the stripped observability matrix above 1.
    strength: Mapping[str, float]  #: Prior sigma divided by the sigma from the observations, by state.


@dataclass(frozen=True)
class Estimate:
    """An estimate, SI, that is not one of the 30 parameters; `determined` is False if the data do not determine it."""

    value: float
    sigma: float
    unit: str
    determined: bool = True


@dataclass(frozen=True)
class Solution:
    """Result of solving a stage."""

    stage: str
    posterior: Posterior  #: Joint posterior of the 30 parameters; after `SolverChain`, it includes the gravity error.
    estimated: tuple[str, ...]  #: Names of the parameters that the stage estimated.
    consistency: Consistency  #: Innovation test of the stage.
    gaps: int = 0  #: Number of gaps and resets.
    observability: Mapping[str, Any] = field(default_factory=dict)  #: See `ObservabilityAnalysis.result`, JSON values.
    details: Mapping[str, Any] = field(default_factory=dict)  #: Other results such as residuals, JSON values.
    messages: tuple[tuple[str, Mapping[str, Any]], ...] = ()  #: Messages for the user, (message id, values).
    innovations: Innovations | None = None  #: Innovations for diagnostics, which are not part of a result file.
    estimates: Mapping[str, Estimate] = field(default_factory=dict)  #: Other estimated values, by parameter name.
    noise: RestNoise | None = None  #: Noise at the rests of the stage; None if it was not measured.
    evidence: Evidence | None = None  #: Rests and motions of the stage, if the product's checks require them.
    latitude: LatitudeEstimate | None = None  #: Latitude from the gyros at all rests so far, if accurate enough.
    sensitivity: Sensitivity | None = None  #: Sensitivity to effects outside the model; None if it is not known.
    tests: tuple[ModelTest, ...] = ()  #: Tests of the model; each becomes a check of the result.
    explanation: ModelTest | None = None  #: A failed but harmless test that may explain the failure of other checks.
    #: Parameters whose sigma depends on an assumed scatter, because the data have no redundancy.
    assumed: tuple[str, ...] = ()
    diagnosis: Diagnosis | None = None  #: Location of the excess if the innovations fail their test.
    temperature: TemperatureFit | None = None  #: Parameters over temperature, if the stage determined them.
    local_scores: ScoreFunction | None = None  #: Score tests for errors during parts of the stage, for diagnostics.


def stage_residuals(solution: Solution, data: StageData, rests: RestResiduals) -> StageResiduals:
    """Return the residuals of a solved stage by rest and move; empty if the method has no innovations."""
    innovations = solution.innovations
    if innovations is None:
        return StageResiduals()
    return position_residuals(
        data,
        rests,
        solution.posterior,
        innovations.seq,
        innovations.normalised,
        white=innovations.white,
        score=solution.local_scores,
    )


def with_diagnosis(solution: Solution, data: StageData, context: SolveContext) -> Solution:
    """Return the solution with the location of the excess if the innovations fail their test."""
    if not context.diagnostics or solution.innovations is None or solution.consistency.verdict is not False:
        return solution
    residuals = stage_residuals(solution, data, rest_residuals(data, context, solution.posterior))
    if not residuals.rows:
        return solution
    excess = concentration(residuals, white=solution.innovations.white)
    rows, scores = [residuals.rows[k] for k in excess.rows], residuals.scores
    named, by_row = [row.text for row in rows[:MAX_NAMED]], excess.location in ("rest", "move")
    axis = excess.axis.split("+") if rows[0].kind == "move" else excess.axis
    where = named if by_row else [Text(f"residual.{excess.location}", {"axis": axis, "worst": named})]
    values: dict[str, Any] = {"where": [text.to_json() for text in where], "percent": 100.0 * min(excess.share, 1.0)}
    if excess.signs is not None and scores is not None:
        channel, error, sigma = scores.single(excess.rows, excess.signs)
        shift = (
            error * scores.shift[:, [6 * k + channel for k in excess.rows]] @ excess.signs / solution.posterior.sigma
        )
        shifts = {name: float(shift[NAMES.index(name)]) for name in solution.estimated}
        values["channel"] = CHANNELS[channel]
        unit = "rad/s" if channel < 3 else "m/s²"
        return replace(solution, diagnosis=Diagnosis("excess_shift", error, sigma, unit, shifts, values))
    if excess.location == "stage":
        values["times"] = sum(row.total for row in rows) / max(sum(row.freedom for row in rows), 1)
        return replace(solution, diagnosis=Diagnosis("excess_spread", values=values))
    values["component"] = rows[0].component_name
    cause = "excess_scatter" if solution.innovations.white else "excess_there"
    return replace(solution, diagnosis=Diagnosis(cause, values=values))


class StageSolver(ABC):
    """Solves a stage; the solution does not depend on how the samples are divided into blocks.

    By default a solver only stores the samples until the stage ends.
    """

    def __init__(self, context: SolveContext, prior: Posterior) -> None:
        self.context, self.prior = context, prior
        #: All samples of the stage.
        self.buffer = StageBuffer(context.imu)
        #: Tests of the effects in the unit's model after the previous stages; None before the first one.
        self.effects: EffectTests | None = None

    def feed(self, block: SampleBlock) -> None:
        """Add samples of the stage."""
        self.buffer.append(block)

    def data(self) -> StageData:
        """Return the valid samples of the stage in physical units, as used by the tests of its solution."""
        return self.buffer.data()

    def sigma(self) -> FloatArray:
        """Return the current standard deviations of the 30 parameters, SI, shape (30,)."""
        return self.prior.sigma

    def ranking(self) -> Ranking | None:
        """Return the observability at the last call of `sigma`; None for a solver without the 39-state filter."""
        return None

    @abstractmethod
    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage; a slow solver calls `progress`. Raises InputError or InsufficientDataError."""


class BatchStage(StageSolver):
    """Solves a stage by one call of `solve` with its data, context, prior and schedule."""

    def __init__(
        self,
        solve: Callable[[StageData, SolveContext, Posterior, Any], Solution],
        context: SolveContext,
        prior: Posterior,
        schedule: BaseModel,
    ) -> None:
        super().__init__(context, prior)
        self._solve, self._schedule = solve, schedule

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage without progress reports."""
        data = self.buffer.data()
        solution = self._solve(data, self.context, self.prior, self._schedule)
        return with_diagnosis(solution, data, self.context)


class RepeatedSchedule(BaseModel):
    """Stop rule of a repeated plan, which ends when the first of these conditions is met or the operator ends it.

    An unset condition has no effect: without `rounds`, only a duration or targets end the plan. Without any condition,
    the plan ends after the default number of rounds.
    """

    model_config = ConfigDict(extra="forbid")
    rounds: int = Field(1, ge=0, description="complete rounds; 0: no limit")
    duration_s: float | None = Field(None, gt=0.0, description="the round during which this is over is the last")
    targets: dict[str, Annotated[float, Field(gt=0.0)]] = Field(
        default_factory=dict, description="the round after which every sigma is below its target is the last"
    )

    @model_validator(mode="before")
    @classmethod
    def _remove_default_rounds(cls, values: Any) -> Any:
        if isinstance(values, dict) and values.get("rounds") is None:
            others = values.get("duration_s") is not None or values.get("targets")
            return {**values, "rounds": 0} if others or "rounds" in values else values
        return values


@dataclass(frozen=True)
class Method:
    """A calibration method: the object `METHOD` of a file in `procedures/`."""

    name: str  #: Stage name in docs/contract.md, which is also the file name.
    schedule: type[BaseModel]  #: Pydantic model of the schedule, with defaults.
    #: (geometry, schedule) -> steps, with joint angles within the table's limits; a repeated plan is endless, with a
    #: `RoundEnd` after each round.
    plan: Callable[[TableGeometry, Any], Iterator[Step]]
    solver: Callable[[SolveContext, Posterior, Any], StageSolver]  #: (context, prior, schedule) -> solver
    #: (context) -> names of the parameters that the stage estimates
    estimates: Callable[[SolveContext], tuple[str, ...]]
    #: Whether the solver finds the steps in the data, so that it can solve a whole recording whose column 'stage' does
    #: not contain the method's name.
    needs_no_table: bool = False
    on_gimbal: bool = False  #: Whether the plan is for a gimbal instead of a table.
    without_gyros: bool = False  #: Whether the solver can use recordings of accelerometers alone.
