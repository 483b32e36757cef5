"""Excitation: revolutions about y, x, z, then z, x, y in quarter turns with rests; the 39-state filter estimates all.

The inner axis is horizontal when used, so that gravity observes its rotation. Joints unwind only if the travel ends.
"""

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from calstation.estimation import Method, RepeatedSchedule
from calstation.estimation.common import SolveContext
from calstation.estimation.navigation import NavigationStage
from calstation.physics import NAMES, Dwell, Move, RoundEnd, Step, TableGeometry

ORDER = "yxzzxy"
QUARTERS = 4


class Schedule(RepeatedSchedule):
    """Durations of rests (s), rate and acceleration of moves (°/s, °/s²), and the stop rule."""

    dwell_s: float = Field(20.0, ge=2.0, le=600.0, description="rest after every quarter turn")
    place_dwell_s: float = Field(5.0, ge=1.0, le=600.0, description="rest after an axis was brought into place")
    rate_dps: float = Field(20.0, gt=0.0, le=360.0, description="rate of every move")
    acceleration_dps2: float = Field(20.0, gt=0.0, le=1000.0, description="acceleration of every move")


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan endless rounds of y, x, z, z, x, y, each followed by `RoundEnd`."""
    rate, acceleration = np.deg2rad(schedule.rate_dps), np.deg2rad(schedule.acceleration_dps2)
    joints = [0.0, 0.0]
    yield Move(0.0, 0.0, rate, acceleration, ("start",))
    yield Dwell(schedule.dwell_s)
    rounds = 0
    while True:
        for name in ORDER:
            turn = geometry.body_turn(np.eye(3)["xyz".index(name)], joints[1])
            place = [joints[0], joints[1]]
            if turn.inner is None:
                place[0] = geometry.level_inner((joints[0], joints[1]))
            else:
                place[1] = turn.inner
            if max(abs(a - b) for a, b in zip(place, joints, strict=True)) > 1e-9:
                joints = place
                yield Move(joints[0], joints[1], rate, acceleration, ("into_place", name))
                yield Dwell(schedule.place_dwell_s)
            quarter = turn.sign * 0.5 * np.pi
            for _ in range(QUARTERS):
                if not geometry.limits.within(turn.joint, joints[turn.joint] + quarter):
                    joints[turn.joint] = _unwound(geometry, turn.joint, joints[turn.joint], turn.sign)
                    yield Move(joints[0], joints[1], rate, acceleration, ("unwind", name))
                    yield Dwell(schedule.place_dwell_s)
                joints[turn.joint] += quarter
                yield Move(joints[0], joints[1], rate, acceleration, ("turn_about", name, 90.0))
                yield Dwell(schedule.dwell_s)
        rounds += 1
        yield RoundEnd(rounds)


def _unwound(geometry: TableGeometry, joint: int, angle: float, sign: int) -> float:
    """Return the joint angle of the same attitude, as many full turns back as the travel allows, rad."""
    end = geometry.limits.low[joint] if sign > 0 else geometry.limits.high[joint]
    turns = np.floor(abs(end - angle) / (2.0 * np.pi) + 1e-9)
    return float(geometry.nearest(joint, angle, angle - sign * 2.0 * np.pi * max(turns, 1.0)))


def estimates(context: SolveContext) -> tuple[str, ...]:
    """Return the names of all 30 parameters, or of 27 without the outer lever if the table fixes it."""
    return tuple(n for n in NAMES if context.table.outer_lever == "estimated" or not n.startswith("outer"))


METHOD = Method(
    "excitation",
    Schedule,
    plan,
    solver=lambda context, prior, schedule: NavigationStage("excitation", context, prior, estimates(context)),
    estimates=estimates,
)
