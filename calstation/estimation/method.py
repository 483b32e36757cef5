"""The interface of a calibration method: its plan, its solver and the parameters it estimates."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Protocol

from pydantic import BaseModel, ConfigDict, Field

from calstation.estimation.common import Belief, Consistency, LatitudeEstimate, SampleBlock, SolveContext
from calstation.estimation.positions import Evidence
from calstation.physics import FloatArray, IntArray, Step, TableGeometry

#: Called with progress from 0 to 1, never falling.
Progress = Callable[[float], None]


@dataclass(frozen=True)
class Innovations:
    """Innovations of a stage's observations.

    Attributes
    ----------
    seq : sequence number at the end of each observation, shape (m,)
    normalised : decorrelated components in units of their sigmas, shape (m, 3)
    """

    seq: IntArray
    normalised: FloatArray


@dataclass(frozen=True)
class Estimate:
    """A value beyond the 30 parameters, SI; `determined` is False if the data did not determine it."""

    value: float
    sigma: float
    unit: str
    determined: bool = True


@dataclass(frozen=True)
class Solution:
    """Solution of a stage.

    Attributes
    ----------
    stage : name
    belief : joint posterior of the 30 parameters, the next stage's prior
    estimated : names of the parameters that the stage estimated
    consistency : innovation test of the stage
    gaps : number of gaps and resets
    observability : see `navigation.observability.observability_analysis`, JSON-ready
    details : further results such as residuals, JSON-ready
    messages : remarks for the user, (message id, values)
    innovations : for diagnosis; no part of a result
    found : values beyond the 30 parameters, by contract name
    evidence : rests and motions of its samples, if the product's checks need them
    latitude : from the gyros at all rests so far, if they are good enough
    """

    stage: str
    belief: Belief
    estimated: tuple[str, ...]
    consistency: Consistency
    gaps: int = 0
    observability: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)
    messages: tuple[tuple[str, Mapping[str, Any]], ...] = ()
    innovations: Innovations | None = None
    found: Mapping[str, Estimate] = field(default_factory=dict)
    evidence: Evidence | None = None
    latitude: LatitudeEstimate | None = None


class StageSolver(Protocol):
    """Consumes a stage's blocks; the solution does not depend on how samples are cut into blocks."""

    def feed(self, block: SampleBlock) -> None:
        """Take further samples of the stage."""

    def sigma(self) -> FloatArray:
        """Standard deviations of the 30 parameters so far, shape (30,), SI."""

    def finish(self, progress: Progress | None = None) -> Solution:
        """Solve the stored stage; slow solvers report `progress`. Raises InsufficientDataError."""


class RepeatedSchedule(BaseModel):
    """Stop rule of a repeated plan: the first of these conditions that is met.

    Attributes
    ----------
    rounds : complete rounds
    duration_s : of the stage, s
    targets : largest sigma per parameter or group, SI
    """

    model_config = ConfigDict(extra="forbid")
    rounds: int | None = Field(1, ge=1, description="complete rounds")
    duration_s: float | None = Field(None, gt=0.0, description="the round during which this is over is the last")
    targets: dict[str, Annotated[float, Field(gt=0.0)]] = Field(
        default_factory=dict, description="the round after which every sigma is below its target is the last"
    )


@dataclass(frozen=True)
class Method:
    """One calibration method, the object `METHOD` of a file in `procedures/`.

    Attributes
    ----------
    name : the contract's stage name
    schedule : pydantic model of the schedule's parameters with their defaults
    plan : (geometry, schedule) -> steps, in joint angles within the table's limits; a plan that repeats is
        endless and marks each round with `RoundEnd`
    solver : (context, prior, schedule) -> solver
    estimates : (context) -> names of the parameters that the stage estimates
    needs_no_table : the solver finds the steps in the data, so a recording whose column 'stage' does not name the
        method can be solved as a whole
    """

    name: str
    schedule: type[BaseModel]
    plan: Callable[[TableGeometry, Any], Iterator[Step]]
    solver: Callable[[SolveContext, Belief, Any], StageSolver]
    estimates: Callable[[SolveContext], tuple[str, ...]]
    needs_no_table: bool = False
