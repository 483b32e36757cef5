"""Excitation: revolutions about y, x, z, then z, x, y in quarter turns with rests; all parameters are estimated.

The inner axis is horizontal while its joint turns, so that the rotation is observable from gravity. A joint reverses
its direction from one revolution to the next, so that its angle is bounded. Every second move is slower, and in the
rests of every second revolution, gravity is between two body axes: the second rate and the other components of gravity
make errors outside the model observable.
"""

from collections.abc import Iterator

import numpy as np
from pydantic import Field

from calstation.errors import ConfigurationError
from calstation.estimation import Method, RepeatedSchedule
from calstation.estimation.common import SolveContext
from calstation.estimation.navigation import NavigationStage
from calstation.physics import INNER, JOINTS, NAMES, OUTER, Dwell, JointLimits, Move, RoundEnd, Step, TableGeometry

ORDER = "yxzzxy"
QUARTERS = 4
QUARTER = 0.5 * np.pi


class Schedule(RepeatedSchedule):
    """Durations of rests (s), rate and acceleration of moves (°/s, °/s²), and the stop rule."""

    dwell_s: float = Field(20.0, ge=2.0, le=600.0, description="rest after every quarter turn")
    place_dwell_s: float = Field(5.0, ge=1.0, le=600.0, description="rest after an axis was brought into place")
    rate_dps: float = Field(20.0, gt=0.0, le=360.0, description="rate of moves")
    second_rate: float = Field(
        0.5, gt=0.0, le=1.0, description="rate of every second move of a revolution, times the rate"
    )
    acceleration_dps2: float = Field(20.0, gt=0.0, le=1000.0, description="acceleration of every move")


def plan(geometry: TableGeometry, schedule: Schedule) -> Iterator[Step]:
    """Plan endless rounds of y, x, z, z, x, y, each followed by `RoundEnd`.

    Raises ConfigurationError if the travel of a joint is too short for four quarter turns.
    """
    fast, acceleration = np.deg2rad(schedule.rate_dps), np.deg2rad(schedule.acceleration_dps2)
    rest, short = schedule.dwell_s, schedule.place_dwell_s
    revolution = QUARTERS * ((QUARTER, rest),)
    oblique_revolution = ((0.5 * QUARTER, rest), *revolution[1:], (0.5 * QUARTER, short))
    joints = [0.0, 0.0]
    last: dict[int, int] = {}
    yield Move(0.0, 0.0, fast, acceleration, ("start",))
    yield Dwell(rest)
    rounds = 0
    while True:
        for number, name in enumerate(ORDER):
            turn = geometry.body_turn(np.eye(3)["xyz".index(name)], joints[INNER])
            target = [joints[OUTER], joints[INNER]]
            if turn.inner is None:
                target[OUTER] = geometry.level_inner((joints[OUTER], joints[INNER]))
            else:
                target[INNER] = turn.inner
            way = -last.get(turn.joint, -turn.sign)
            target[turn.joint], way = _revolution(geometry.limits, turn.joint, target[turn.joint], way)
            last[turn.joint] = way
            if max(abs(a - b) for a, b in zip(target, joints, strict=True)) > 1e-9:
                joints = target
                yield Move(joints[0], joints[1], fast, acceleration, ("into_place", name))
                yield Dwell(short)
            for k, (angle, dwell) in enumerate(oblique_revolution if number % 2 else revolution):
                rate = fast * schedule.second_rate if k % 2 else fast
                joints[turn.joint] += way * angle
                label = ("turn_about", name, float(np.rad2deg(angle)) * way * turn.sign)
                yield Move(joints[0], joints[1], rate, acceleration, label)
                yield Dwell(dwell)
        rounds += 1
        yield RoundEnd(rounds)


def _revolution(limits: JointLimits, joint: int, start_angle: float, way: int) -> tuple[float, int]:
    """Return the start angle, rad, and direction of a revolution: `start_angle` and `way`, if possible.

    Otherwise the revolution starts a few quarter turns away, in the other direction, or at the nearest possible angle.
    Raises ConfigurationError if the travel is too short.
    """
    last = limits.high[joint] - QUARTERS * QUARTER
    nearest = float(np.clip(start_angle, limits.low[joint], last))
    starts = [(start_angle + quarters * QUARTER, sign) for quarters in (0, 1, -1, 2, -2) for sign in (way, -way)]
    for start, sign in (*starts, (nearest, 1)):
        if limits.within(joint, start) and limits.within(joint, start + sign * QUARTERS * QUARTER):
            return start, sign
    raise ConfigurationError(
        "plan.revolution_exceeds_travel",
        axis=JOINTS[joint],
        low_deg=float(np.rad2deg(limits.low[joint])),
        high_deg=float(np.rad2deg(limits.high[joint])),
    )


def estimates(context: SolveContext) -> tuple[str, ...]:
    """Return the names of all 30 parameters, without the outer lever arm if the table model fixes it."""
    return tuple(n for n in NAMES if context.table.outer_lever == "estimated" or not n.startswith("outer"))


METHOD = Method(
    "excitation",
    Schedule,
    plan,
    lambda context, prior, schedule: NavigationStage(
        "excitation", context, prior, estimates(context), schedule.targets
    ),
    estimates=estimates,
)
