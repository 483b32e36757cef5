"""Takes samples of a unit that was just restarted: two rests upside down to each other, and a turn of each joint."""

from dataclasses import dataclass, field

import numpy as np

from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation.samples import SampleBlock
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Move
from calstation.physics.rotation import rotation_vector
from calstation.physics.table import JointLimits, TableGeometry
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.guard import JOINTS
from calstation.sequencer.pulse import Pulse
from calstation.sequencer.steps import StepRunner

REST = 10.0
"""Rest over which output is averaged, s."""

_TURNS = (np.deg2rad(180.0), np.deg2rad(30.0))
"""Of the outer joint, which turns the unit over where travel allows, and of the inner one, rad."""

_SHORT = np.deg2rad(30.0)
_RATE, _ACCELERATION = np.deg2rad(40.0), np.deg2rad(40.0)
_READY_WITHIN = 60.0
_ATTEMPTS = 3


DURATION = 2.0 * REST + 12.0
"""About what it takes with turns and restart, s."""


@dataclass(frozen=True)
class Turned:
    """A turn of one joint.

    expected : by the encoders, as a rotation vector in b at its start, rad, shape (3,)
    rate : mean output of the gyro, rad/s, shape (3,); seconds : it took
    """

    expected: FloatArray
    rate: FloatArray
    seconds: float


@dataclass(frozen=True)
class FreshData:
    """Output of the restarted unit.

    rests : means at rest, gyro rad/s and accel m/s², each shape (6,); seconds : of each rest; turns : one per joint
    carried : output of every sample while the unit was carried from the first rest to the second, shape (n, 6), every
        `period` s; empty where a table turned it
    """

    rests: tuple[FloatArray, ...]
    seconds: float
    turns: tuple[Turned, ...] = ()
    carried: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    period: float = 0.0


def fresh_data(
    pulse: Pulse, acquisition: Acquisition, runner: StepRunner, geometry: TableGeometry, scale: FloatArray
) -> FreshData:
    """Rest, turn the unit over, rest, turn it a little.

    `scale` : from counts to rad/s and m/s², shape (6,). Raises DeviceFaultError where data are missing,
    ConfigurationError where a joint cannot turn.
    """
    over, little = turns(runner.position(), geometry.limits, pulse.status.limits)
    first = _rest(pulse, acquisition) * scale
    outer = _turn(over, acquisition, runner, geometry, scale)
    second = _rest(pulse, acquisition) * scale
    return FreshData((first, second), REST, (outer, _turn(little, acquisition, runner, geometry, scale)))


def turns(start: tuple[float, float], profile: JointLimits, own: JointLimits) -> tuple[Move, Move]:
    """The turn of the outer joint, then that of the inner one, within the profile's travel and the table's own.

    `start` : joint angles, rad. Raises ConfigurationError where a joint cannot turn.
    """
    rate, acceleration = min(_RATE, *profile.rate), min(_ACCELERATION, *profile.acceleration)
    target = list(start)
    moves = []
    for joint, name in enumerate(JOINTS):
        angles = [start[joint] + by for by in (_TURNS[joint], -_TURNS[joint], _SHORT, -_SHORT)]
        reachable = [a for a in angles if profile.within(joint, a) and own.within(joint, a)]
        if not reachable:
            raise ConfigurationError(
                f"table: its {name} axis cannot turn by {np.rad2deg(_SHORT):.0f}° to either side, so no turn can prove"
                " the unit's output; widen its travel"
            )
        target[joint] = reachable[0]
        moves.append(Move(target[0], target[1], rate, acceleration, ("verify",)))
    return moves[0], moves[1]


def await_restart(pulse: Pulse, acquisition: Acquisition) -> None:
    """Take samples aside and wait until the unit is ready. Raises DeviceFaultError where it does not come up."""
    acquisition.aside = True
    pulse.tick()
    pulse.wait(
        lambda: pulse.flow.ready,
        _READY_WITHIN,
        f"IMU: not ready {_READY_WITHIN:g} s after its restart; switch it off and on",
    )


def _rest(pulse: Pulse, acquisition: Acquisition) -> FloatArray:
    """Mean counts over a rest without a gap, shape (6,)."""
    for _ in range(_ATTEMPTS):
        with acquisition.tap() as blocks:
            pulse.rest(REST)
        if _whole(blocks):
            mean: FloatArray = np.concatenate([block.counts for block in blocks]).mean(axis=0)
            return mean
    raise DeviceFaultError(
        "IMU: samples are lost or spoilt again and again; check cable, baud and the load of this computer"
    )


def _turn(
    move: Move, acquisition: Acquisition, runner: StepRunner, geometry: TableGeometry, scale: FloatArray
) -> Turned:
    start = runner.position()
    with acquisition.tap() as blocks:
        runner.drive(move)
    if not _whole(blocks):
        raise DeviceFaultError("IMU: no data during a turn; check cable, power and port")
    counts = np.concatenate([block.counts for block in blocks])
    period = (blocks[-1].time[-1] - blocks[0].time[0]) / (len(counts) - 1)
    # Twice half the turn: of half a revolution nobody could tell which way round it went.
    half = [0.5 * (a + b) for a, b in zip(start, runner.position(), strict=True)]
    turned = 2.0 * rotation_vector(geometry.body_to_home(*start).T @ geometry.body_to_home(*half))
    return Turned(turned, counts[:, :3].mean(axis=0) * scale[:3], float(period * len(counts)))


def _whole(blocks: list[SampleBlock]) -> bool:
    """Samples, none missing among them and none that is saturated or no number."""
    seq = np.concatenate([np.empty(0, np.int64), *(block.seq for block in blocks)])
    return len(seq) > 1 and bool((np.diff(seq) == 1).all()) and all(block.valid.all() for block in blocks)
