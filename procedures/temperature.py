"""Temperature: moves at several temperatures, or during a ramp; every parameter is a function of the temperature.

The program solves recordings of this stage. It does not drive a chamber, and refuses a run with this stage.
"""

from collections.abc import Iterator

from pydantic import BaseModel, ConfigDict, Field

from calstation.errors import ConfigurationError
from calstation.estimation import Method
from calstation.estimation.navigation import TemperatureStage
from calstation.physics import Step, TableGeometry
from procedures.excitation import estimates


class Schedule(BaseModel):
    """How the samples of the temperatures are told apart."""

    model_config = ConfigDict(extra="forbid")
    soak_s: float = Field(60.0, ge=20.0, le=86_400.0, description="rest that separates two temperatures")
    moves_of_cycle: int = Field(10, ge=2, le=1000, description="moves that are one point of a ramp without soaks")


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Refuse a run. Raises ConfigurationError."""
    raise ConfigurationError("temperature.no_chamber")


METHOD = Method(
    "temperature",
    Schedule,
    plan,
    lambda context, prior, schedule: TemperatureStage(
        context, prior, estimates(context), schedule.soak_s, schedule.moves_of_cycle
    ),
    estimates=estimates,
)
