"""Temperature: moves at several temperatures, or during ramps; every parameter is a function of the temperature.

At every temperature, the table rests until the temperature measured by each unit's sensor is steady. During a ramp from
one temperature to the next, the moves are repeated.
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from calstation.errors import ConfigurationError
from calstation.estimation import Method
from calstation.estimation.navigation import TemperatureStage
from calstation.physics import Dwell, Move, Ramp, RoundEnd, Soak, Step, TableGeometry, move_time
from calstation.schema import EntryError
from procedures.designed import DEFAULT_MOVES, Moves, moves_and_rests
from procedures.excitation import estimates

#: Moves, each with its rest.
Cycle = list[tuple[Move, Dwell]]

#: Assumed settling time after a move, s.
_SETTLE = 1.5


class SoakSchedule(BaseModel):
    """When the temperature of a unit is steady."""

    model_config = ConfigDict(extra="forbid")
    unit_rate_below_c_per_min: float = Field(default=0.05, gt=0.0, le=5.0)
    hold_s: float = Field(default=60.0, ge=20.0, le=86_400.0)
    at_most_s: float = Field(default=5400.0, ge=60.0, le=86_400.0)


class Schedule(BaseModel):
    """Temperatures in order (°C), or the rate of ramps between them, the soak, and the moves at every temperature."""

    model_config = ConfigDict(extra="forbid")
    points_c: list[Annotated[float, Field(ge=-100.0, le=200.0)]] = Field(
        default_factory=list, description="temperatures of the chamber, in order; of ramps: by default the range"
    )
    ramp_c_per_min: float | None = Field(None, gt=0.0, le=20.0, description="rate of ramps from one to the next")
    soak: SoakSchedule = Field(SoakSchedule(), description="when a unit is steady")
    moves: Moves = Field(DEFAULT_MOVES, min_length=2, description="outer angle, inner angle and rest of every move")
    rate_dps: float = Field(60.0, gt=0.0, le=1000.0, description="rate of every move")
    acceleration_dps2: float = Field(60.0, gt=0.0, le=1000.0, description="acceleration of every move")

    @model_validator(mode="after")
    def _check_durations(self) -> "Schedule":
        longest = max(_durations(self.cycle))
        if longest >= self.soak.hold_s:
            raise EntryError("temperature.rest_too_long", "moves", rest=longest, hold=self.soak.hold_s)
        if self.soak.at_most_s < self.soak.hold_s:
            values = {"at_most": self.soak.at_most_s, "hold": self.soak.hold_s}
            raise EntryError("temperature.soak_too_short", "soak", "at_most_s", **values)
        return self

    @property
    def cycle(self) -> Cycle:
        """The moves at a temperature, each with its rest."""
        return list(moves_and_rests(self.moves, self.rate_dps, self.acceleration_dps2))


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan a soak and the moves at every temperature, and ramps with moves between them.

    `RoundEnd` follows every temperature and the ramp after it. Raises ConfigurationError without temperatures.
    """
    if not schedule.points_c:
        raise ConfigurationError("temperature.no_points")
    soak, count = schedule.soak, len(schedule.points_c)
    moves: list[Move | Dwell] = [step for pair in schedule.cycle for step in pair]
    for index, temperature in enumerate(schedule.points_c, start=1):
        yield moves[0]
        yield Soak(temperature, soak.unit_rate_below_c_per_min, soak.hold_s, soak.at_most_s, index, count)
        yield from moves
        if schedule.ramp_c_per_min is not None and index < count:
            target = schedule.points_c[index]
            duration = 60.0 * abs(target - temperature) / schedule.ramp_c_per_min
            yield Ramp(target, schedule.ramp_c_per_min)
            yield from moves * int(np.ceil(duration / sum(_durations(schedule.cycle))))
        yield RoundEnd(index)


def _durations(cycle: Cycle) -> list[float]:
    """Return the duration of each move of a cycle with its rest, s."""
    starts = [(move.outer, move.inner) for move, _ in cycle]
    return [
        move_time(start, move) + _SETTLE + rest.duration
        for start, (move, rest) in zip([starts[-1], *starts[:-1]], cycle, strict=True)
    ]


METHOD = Method(
    "temperature",
    Schedule,
    plan,
    lambda context, prior, schedule: TemperatureStage(
        context,
        prior,
        estimates(context),
        schedule.soak.hold_s,
        len(schedule.moves),
        is_ramp=schedule.ramp_c_per_min is not None,
    ),
    estimates=estimates,
)
