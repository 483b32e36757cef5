"""Takes samples of a unit that is to be judged: rests in several attitudes and turns of both joints."""

from dataclasses import dataclass, field

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.estimation.common.samples import SampleBlock
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Move
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.control import Interruption
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.unit_stream import UnitStream
from calstation.sequencer.verification_moves import Leg, Turn, VerificationPath

#: Rest of a unit that no table turns, s.
REST = 10.0

#: Rest in each attitude on a table, s.
SHORT_REST = 3.0

#: IMU time taken after a move has settled, so that its last samples are there, s.
_BEHIND = 0.1

_ATTEMPTS = 3

#: About what it takes to look at a unit before and after its restart on a table, s.
DURATION = 72.0


@dataclass(frozen=True)
class Turned:
    """A turn of one joint.

    Attributes
    ----------
    turn : as it was planned
    angle : integral of the gyro's output over it, rad, shape (3,); seconds : it took
    """

    turn: Turn
    angle: FloatArray
    seconds: float


@dataclass(frozen=True)
class VerificationData:
    """Output of a unit.

    Attributes
    ----------
    rests : means at rest, gyro rad/s and accel m/s², each shape (6,); seconds : of each rest
    turns : on a table
    carried : output of every sample while the unit was carried from the first rest to the second, shape (n, 6), every
        `period` s; empty where a table turned it
    corrected : the unit's registers are in it
    reference : the same rests and turns as the unit gave them before, or without its registers; None where there is
        nothing to compare with
    """

    rests: tuple[FloatArray, ...]
    seconds: float
    turns: tuple[Turned, ...] = ()
    carried: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    period: float = 0.0
    corrected: bool = False
    reference: "VerificationData | None" = None


class Restarted(Interruption):
    """The unit restarted while it was looked at: what it showed before is not to be mixed with what it shows now."""


def verification_data(
    control_loop: ControlLoop,
    acquisition: Acquisition,
    runner: StepRunner,
    stream: UnitStream,
    path: VerificationPath,
    scale: FloatArray,
) -> VerificationData:
    """Rest and turn along a path and back to its start. The table must stand there, and `stream` be whole.

    `scale` : from counts to rad/s and m/s², shape (6,). Raises DeviceFaultError where data are missing, Restarted.
    """
    look = _Look(control_loop, acquisition, runner, stream, scale)
    rests = [look.rest()]
    parts: list[list[Turned]] = [[] for _ in path.turns]
    here = path.start
    for leg in path.legs:
        if leg.turn is None:
            runner.drive(leg.move)
        else:
            parts[leg.turn].append(look.turn(path.turns[leg.turn], leg, here))
        if leg.rest:
            rests.append(look.rest())
        here = leg.move.outer, leg.move.inner
    return VerificationData(tuple(rests), SHORT_REST, tuple(map(_summed, parts)))


@dataclass(frozen=True)
class _Look:
    """Rests and turns of which no sample is missing, of a unit that streams as it was told."""

    control_loop: ControlLoop
    acquisition: Acquisition
    runner: StepRunner
    stream: UnitStream
    scale: FloatArray

    def rest(self) -> FloatArray:
        """Mean over a rest, rad/s and m/s², shape (6,)."""
        for _ in range(_ATTEMPTS):
            self._mend()
            with self.acquisition.tap() as blocks:
                self.control_loop.rested(SHORT_REST)
            if self._whole(blocks):
                return mean_at_rest(np.concatenate([block.counts for block in blocks])) * self.scale
        raise self._lossy()

    def turn(self, turn: Turn, leg: Leg, start: tuple[float, float]) -> Turned:
        """One leg of a turn; where samples were lost the table goes back to where it began, and it is made again."""
        move = leg.move
        for attempt in range(_ATTEMPTS):
            self._mend()
            if attempt:
                self.runner.drive(Move(*start, move.rate, move.acceleration, ("return",)))
            with self.acquisition.tap() as blocks:
                self.control_loop.tick()  # a gap before the first block would not show
                self.runner.drive(move)
                self.control_loop.rested(_BEHIND)
            if self._whole(blocks):
                counts = np.concatenate([block.counts for block in blocks])
                period = float(blocks[-1].time[-1] - blocks[0].time[0]) / (len(counts) - 1)
                angle = (counts.sum(axis=0) * self.scale * period)[:3]
                return Turned(turn, angle, period * len(counts))
        raise self._lossy()

    def _mend(self) -> None:
        """Have the stream as it was asked for, where something came between. Raises Restarted."""
        if self.stream.broken and self.stream.mend():
            raise Restarted

    def _whole(self, blocks: list[SampleBlock]) -> bool:
        """Samples, none missing since the stream was mended and none that is saturated or no number."""
        count = sum(map(len, blocks))
        return count > 1 and not self.stream.broken and all(block.valid.all() for block in blocks)

    def _lossy(self) -> DeviceFaultError:
        self._mend()
        return DeviceFaultError(
            "IMU: samples are lost or spoilt again and again; check cable, baud and the load of this computer"
        )


def mean_at_rest(counts: FloatArray) -> FloatArray:
    """Weighted mean of samples at rest, shape (n, 6) to (6,).

    The weights are those of the slope of a line through the integral, so that the vibration of a base that goes
    nowhere, uncorrelated velocities of the same sigma, hurts least (Gauss-Markov); they rise and fall as a parabola.
    """
    n = len(counts)
    place = np.arange(n) + 0.5
    weight = place * (n - place)
    mean: FloatArray = (weight / weight.sum()) @ counts
    return mean


def _summed(parts: list[Turned]) -> Turned:
    angle: FloatArray = np.sum([part.angle for part in parts], axis=0)
    return Turned(parts[0].turn, angle, sum(p.seconds for p in parts))
