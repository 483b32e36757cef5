"""Azimuth flips: half turns about the vertical (+, −, −, +) with long rests, which estimate the biases (12 states)."""

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from calstation.errors import ConfigurationError
from calstation.estimation import Method, RepeatedSchedule
from calstation.estimation.navigation import NavigationStage
from calstation.physics import JOINTS, Dwell, Move, RoundEnd, Step, TableGeometry

ESTIMATED = tuple(f"{group}_{axis}" for group in ("gyro_bias", "accel_bias") for axis in "xyz")
DIRECTIONS = (1.0, -1.0, -1.0, 1.0)


class Schedule(RepeatedSchedule):
    """Duration of rests, rate and acceleration of moves, and stop rule."""

    dwell_s: float = Field(60.0, ge=2.0, le=3600.0, description="rest after every half turn")
    rate_dps: float = Field(20.0, gt=0.0, le=360.0, description="rate of every move")
    acceleration_dps2: float = Field(20.0, gt=0.0, le=1000.0, description="acceleration of every move")
    rounds: int = Field(2, ge=0, description="complete rounds; 0: no limit")


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan endless rounds of four half turns and `RoundEnd`. Raises ConfigurationError if the travel is too short."""
    rate, acceleration = np.deg2rad(schedule.rate_dps), np.deg2rad(schedule.acceleration_dps2)
    joint, pose = geometry.vertical_joint((0.0, 0.0))
    joints = list(pose)
    if not all(geometry.limits.within(joint, joints[joint] + way * np.pi) for way in (1.0, -1.0)):
        raise ConfigurationError("plan.flips_exceed_travel", axis=JOINTS[joint])
    yield Move(joints[0], joints[1], rate, acceleration, ("start",))
    yield Dwell(schedule.dwell_s)
    rounds = 0
    while True:
        for way in DIRECTIONS:
            joints[joint] += way * np.pi
            yield Move(joints[0], joints[1], rate, acceleration, ("flip", 180.0 * way))
            yield Dwell(schedule.dwell_s)
        rounds += 1
        yield RoundEnd(rounds)


METHOD = Method(
    "azimuth_flip",
    Schedule,
    plan,
    lambda context, prior, schedule: NavigationStage("azimuth_flip", context, prior, ESTIMATED, schedule.targets),
    estimates=lambda context: ESTIMATED,
)
