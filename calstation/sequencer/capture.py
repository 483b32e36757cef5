"""Captures the output of a unit for verification: rests in several attitudes and turns of both joints."""

from dataclasses import dataclass, field

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.estimation.common import SampleBlock
from calstation.physics import OUTER, Carry, FloatArray, Move, TableGeometry
from calstation.sequencer.control import Interruption
from calstation.sequencer.gimbal import TurnDrift
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.verification_moves import Leg, Turn, VerificationPath

#: Duration of a rest on a manual rig, s.
REST = 10.0

#: Duration of a rest in each attitude on a table, s.
SHORT_REST = 3.0

#: IMU time recorded after a move has settled, so that its last samples are included, s.
_AFTER_MOVE = 0.1

_ATTEMPTS = 3

#: Approximate time to capture a unit's output on a table before and after its restart, s.
DURATION = 72.0

_HALF_TURN, _QUARTER_TURN = np.pi, 0.5 * np.pi

#: Expected time for turning a unit over manually, s.
_CARRY_TIME = 6.0


@dataclass(frozen=True)
class Turned:
    """A measured turn: the integral of the gyro output over its legs, rad, shape (3,), and its duration, s."""

    turn: Turn
    angle: FloatArray
    seconds: float


@dataclass(frozen=True)
class VerificationData:
    """Output of a unit, captured for verification.

    `rests` are means at rest over `seconds`, gyro rad/s and accel m/s², each of shape (6,). On a table there are
    `turns`; on a manual rig there is `carried`, the samples between two rests, shape (n, 6), at intervals of `period`,
    s; on a gimbal there are `drifts` only. `reference` is the same data before the transfer or without the registers
    applied, or None if there is no comparison.
    """

    rests: tuple[FloatArray, ...]
    seconds: float
    turns: tuple[Turned, ...] = ()
    carried: FloatArray = field(default_factory=lambda: np.empty((0, 6)))
    period: float = 0.0
    corrected: bool = False
    reference: "VerificationData | None" = None
    drifts: tuple[TurnDrift, ...] = ()


class Restarted(Interruption):
    """The unit restarted during a capture: samples before and after must not be mixed."""


def verification_data(runner: StepRunner, path: VerificationPath) -> VerificationData:
    """Capture rests and turns along a path that returns to its start.

    The table must be at the start, and the stream must not be broken. Raises DeviceFaultError or Restarted.
    """
    rests = [_rest(runner)]
    parts: list[list[Turned]] = [[] for _ in path.turns]
    here = path.start
    for leg in path.legs:
        if leg.turn is None:
            runner.drive(leg.move)
        else:
            parts[leg.turn].append(_turn(runner, path.turns[leg.turn], leg, here))
        if leg.rest:
            rests.append(_rest(runner))
        here = leg.move.outer, leg.move.inner
    turns = (Turned(p[0].turn, np.sum([q.angle for q in p], axis=0), sum(q.seconds for q in p)) for p in parts)
    return VerificationData(tuple(rests), SHORT_REST, tuple(turns))


def _rest(runner: StepRunner) -> FloatArray:
    """Return the mean output over a rest, rad/s and m/s², shape (6,)."""
    for _ in range(_ATTEMPTS):
        _restore(runner)
        with runner.acquisition.tap() as blocks:
            runner.control_loop.rested(SHORT_REST)
        if _is_complete(runner, blocks):
            counts = np.concatenate([block.counts for block in blocks])
            return mean_at_rest(counts) * runner.acquisition.scale
    raise _lossy_error(runner)


def _turn(runner: StepRunner, turn: Turn, leg: Leg, start: tuple[float, float]) -> Turned:
    """Measure one leg of a turn; if samples are lost, return to the start of the leg and repeat it."""
    move = leg.move
    for attempt in range(_ATTEMPTS):
        _restore(runner)
        if attempt:
            runner.drive(Move(*start, move.rate, move.acceleration, ("return",)))
        with runner.acquisition.tap() as blocks:
            runner.control_loop.tick()  # a gap before the first block would not be detected
            runner.drive(move)
            runner.control_loop.rested(_AFTER_MOVE)
        if _is_complete(runner, blocks):
            counts = np.concatenate([block.counts for block in blocks])
            period = float(blocks[-1].time[-1] - blocks[0].time[0]) / (len(counts) - 1)
            angle = (counts.sum(axis=0) * runner.acquisition.scale * period)[:3]
            return Turned(turn, angle, period * len(counts))
    raise _lossy_error(runner)


def _restore(runner: StepRunner) -> None:
    """Restore a broken stream. Raises Restarted."""
    if runner.stream.broken and runner.stream.restore():
        raise Restarted


def _is_complete(runner: StepRunner, blocks: list[SampleBlock]) -> bool:
    """Whether there is more than one sample, none is missing and all are valid."""
    count = sum(map(len, blocks))
    return count > 1 and not runner.stream.broken and all(block.valid.all() for block in blocks)


def _lossy_error(runner: StepRunner) -> DeviceFaultError:
    _restore(runner)
    return DeviceFaultError("stream.lossy")


def mean_at_rest(counts: FloatArray) -> FloatArray:
    """Return the weighted mean, shape (6,), of samples at rest, shape (n, 6).

    The weights are parabolic, those of the slope of a line fitted to the integral. They minimise the effect of
    vibration of a stationary base, modelled as uncorrelated velocities of equal sigma (Gauss-Markov).
    """
    n = len(counts)
    middle = np.arange(n) + 0.5
    weight = middle * (n - middle)
    mean: FloatArray = (weight / weight.sum()) @ counts
    return mean


def carried_data(runner: StepRunner) -> VerificationData:
    """Capture a rest, have the operator turn the unit over, capture a rest. Raises DeviceFaultError on lost samples."""
    outer, inner = runner.guiding.asked
    over = turned_over(runner.control_loop.context.task.geometry, outer)
    for attempt in range(_ATTEMPTS):
        start, end = (outer, over) if attempt % 2 == 0 else (over, outer)
        runner.begin_stage()
        with runner.acquisition.tap() as blocks:
            runner.run(Carry(start, inner, REST, _CARRY_TIME if attempt else 0.0, 1, 2))
            first = sum(map(len, blocks))
            runner.run(Carry(end, inner, REST, _CARRY_TIME, 2, 2))
        data = _carried(blocks, first, runner.acquisition.scale)
        if data is not None:
            return data
    raise DeviceFaultError("stream.lossy")


def turned_over(geometry: TableGeometry, outer: float) -> float:
    """Return the outer angle that turns a unit over from `outer`, rad: half a turn away, or what travel allows."""
    for turn in (_HALF_TURN, -_HALF_TURN, _QUARTER_TURN, -_QUARTER_TURN):
        if geometry.limits.within(OUTER, outer + turn):
            return outer + turn
    return geometry.limits.low[OUTER]


def _carried(blocks: list[SampleBlock], first: int, scale: FloatArray) -> VerificationData | None:
    """Return both rests, the first ending at sample `first`, and the samples between; None if samples are missing."""
    seq = np.concatenate([np.empty(0, np.int64), *(block.seq for block in blocks)])
    if len(seq) < 2 or (np.diff(seq) != 1).any() or not all(block.valid.all() for block in blocks):
        return None
    values = np.concatenate([block.counts for block in blocks]) * scale
    period = float(blocks[-1].time[-1] - blocks[0].time[0]) / (len(seq) - 1)
    rest = round(REST / period)
    rests = mean_at_rest(values[first - rest : first]), mean_at_rest(values[-rest:])
    return VerificationData(rests, REST, carried=values[first:-rest], period=period)
