"""Designed: a list of moves of both joints, each followed by a rest; the 39-state filter estimates all parameters.

After every rest, the stage ends if every sigma is below its limit times a margin. The sigmas depend on the motion and
on the noise in the profiles, not on the estimated values, so this rule does not bias the result.
"""

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from calstation.estimation import Method, RepeatedSchedule
from calstation.estimation.navigation import NavigationStage
from calstation.physics import Dwell, Move, RoundEnd, Step, TableGeometry
from procedures.excitation import estimates

#: Outer and inner angle, °, and rest, s, of every move, in order.
Moves = list[tuple[float, float, Annotated[float, Field(ge=0.0, le=3600.0)]]]

DEFAULT_MOVES: Moves = [
    (0.0, 0.0, 8.0),
    (90.0, 180.0, 2.0),
    (180.0, 0.0, 2.0),
    (90.0, -90.0, 2.0),
    (-90.0, 90.0, 2.0),
    (0.0, -90.0, 2.0),
    (-90.0, 0.0, 2.0),
    (90.0, 90.0, 2.0),
    (180.0, 270.0, 2.0),
    (0.0, 0.0, 5.0),
]


class Schedule(RepeatedSchedule):
    """Angles of the joints (°) and rests (s) in order, rate and acceleration of moves (°/s, °/s²), and the stop rule.

    A round is a move and its rest; `rounds` is at most the number of moves, and 0 means all.
    """

    moves: Moves = Field(DEFAULT_MOVES, min_length=2, description="outer angle, inner angle and rest of every move")
    rate_dps: float = Field(60.0, gt=0.0, le=1000.0, description="rate of every move")
    acceleration_dps2: float = Field(60.0, gt=0.0, le=1000.0, description="acceleration of every move")
    stop_at_limits: bool = Field(True, description="end when every sigma is below its limit times the margin")
    margin: float = Field(0.8, gt=0.0, le=1.0, description="fraction of its limit that every sigma must reach")
    least_moves: int = Field(1, ge=1, description="minimum number of moves before the stop rule may end the stage")
    rounds: int = Field(0, ge=0, description="largest number of moves; 0: all")

    @model_validator(mode="after")
    def _limit_rounds(self) -> "Schedule":
        count = len(self.moves)
        self.rounds = min(self.rounds or count, count)
        self.least_moves = min(self.least_moves, self.rounds)
        return self


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan every move and its rest, each followed by `RoundEnd` once the stage may end."""
    pairs = moves_and_rests(schedule.moves, schedule.rate_dps, schedule.acceleration_dps2)
    for number, (move, rest) in enumerate(pairs, start=1):
        yield move
        yield rest
        if number >= schedule.least_moves:
            yield RoundEnd(number)


def moves_and_rests(moves: Moves, rate_dps: float, acceleration_dps2: float) -> Iterator[tuple[Move, Dwell]]:
    """Yield every move with its rest.

    Parameters
    ----------
    moves : outer and inner angle, °, and rest, s, of every move
    rate_dps, acceleration_dps2 : rate, °/s, and acceleration, °/s², of every move
    """
    rate, acceleration = np.deg2rad(rate_dps), np.deg2rad(acceleration_dps2)
    for number, (outer, inner, rest) in enumerate(moves, start=1):
        label = ("start",) if number == 1 else ("position", outer, inner)
        yield Move(float(np.deg2rad(outer)), float(np.deg2rad(inner)), rate, acceleration, label), Dwell(rest)


METHOD = Method(
    "designed",
    Schedule,
    plan,
    lambda context, prior, schedule: NavigationStage("designed", context, prior, estimates(context), schedule.targets),
    estimates=estimates,
)
