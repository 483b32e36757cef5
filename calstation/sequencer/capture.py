"""Capture of the output of units for verification: rests in several attitudes and turns of both joints."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from calstation.errors import DeviceFaultError
from calstation.estimation.common import SampleBlock
from calstation.physics import FloatArray, ManualMove, Move
from calstation.sequencer.control import Interruption
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.units import Unit
from calstation.sequencer.verification_path import (
    Leg,
    Turn,
    TurnData,
    VerificationData,
    VerificationPath,
    overturned_angle,
)

_Value = TypeVar("_Value")

#: Duration of a rest on a manual rig, s.
REST = 10.0

#: Duration of a rest in each attitude on a table, s.
TABLE_REST = 1.8

#: IMU time recorded after a move has settled so that its last samples are included, s.
_AFTER_MOVE = 0.1

_ATTEMPTS = 3

#: Approximate total duration of the captures on a table before and after the restart of a unit, s.
DURATION = 45.0

#: Expected duration of turning a unit over manually, s.
_MANUAL_MOVE_TIME = 6.0


class UnitRestarted(Interruption):
    """Raised if a unit restarts during a capture, because samples before and after the restart cannot be combined."""

    def __init__(self, unit: Unit) -> None:
        super().__init__(unit)
        self.unit = unit


def verification_data(
    runner: StepRunner, path: VerificationPath, units: Iterable[Unit], *, is_reference: bool
) -> dict[Unit, VerificationData]:
    """Capture rests and turns of units along a path.

    The table must be at the start of the path. A reference contains no opposite rest, but returns to the start, where
    the next capture begins. The result has no entry for a unit that leaves the run during the capture.

    Raises DeviceFaultError, or UnitRestarted if a stream was interrupted.

    Parameters
    ----------
    runner : executes the moves
    path : path to follow
    units : units whose output is captured
    is_reference : whether the data are a reference for a later capture
    """
    units = tuple(units)
    rests, opposites = [_rest(runner, units)], []
    parts: list[list[dict[Unit, TurnData]]] = [[] for _ in path.turns]
    position = path.start
    for leg in path.reference if is_reference else path.measured:
        if leg.turn is None:
            runner.drive(leg.move)
        else:
            parts[leg.turn].append(_turn(runner, units, path.turns[leg.turn], leg, position))
        if leg.rest:
            rests.append(_rest(runner, units))
        elif leg.opposite and not is_reference:
            opposites.append(_rest(runner, units))
        position = leg.move.outer, leg.move.inner
    return {
        unit: VerificationData(
            tuple(rest[unit] for rest in (*rests, *opposites)),
            TABLE_REST,
            tuple(_joined_legs([part[unit] for part in turn]) for turn in parts),
            temperature=unit.temperature,
        )
        for unit in runner.units.of(units)
    }


def _joined_legs(legs: list[TurnData]) -> TurnData:
    """Return a turn with the sums over its measured legs."""
    return TurnData(legs[0].turn, np.sum([leg.integral for leg in legs], axis=0), sum(leg.seconds for leg in legs))


def _rest(runner: StepRunner, units: tuple[Unit, ...]) -> dict[Unit, FloatArray]:
    """Return the mean output of each unit over a rest, rad/s and m/s², shape (6,)."""

    def mean(unit: Unit, blocks: list[SampleBlock]) -> FloatArray:
        return mean_at_rest(np.concatenate([block.counts for block in blocks])) * unit.acquisition.scale

    return _capture_complete(runner, units, lambda: runner.control_loop.wait_for_samples(TABLE_REST), mean)


def _turn(
    runner: StepRunner, units: tuple[Unit, ...], turn: Turn, leg: Leg, start: tuple[float, float]
) -> dict[Unit, TurnData]:
    """Measure one leg of a turn from joint angles `start`, rad; if samples are lost, repeat the leg from its start."""
    move, loop = leg.move, runner.control_loop

    def integral(unit: Unit, blocks: list[SampleBlock]) -> TurnData:
        counts = np.concatenate([block.counts for block in blocks])
        period = float(blocks[-1].time[-1] - blocks[0].time[0]) / (len(counts) - 1)
        return TurnData(turn, counts.sum(axis=0) * unit.acquisition.scale * period, period * len(counts))

    def drive() -> None:
        loop.tick()  # without it, a gap before the first block would not be detected
        runner.drive(move)
        loop.wait_for_samples(_AFTER_MOVE)

    def back() -> None:
        runner.drive(Move(*start, move.rate, move.acceleration, ("return",)))

    return _capture_complete(runner, units, drive, integral, back)


def _capture_complete(
    runner: StepRunner,
    units: tuple[Unit, ...],
    record: Callable[[], None],
    measure: Callable[[Unit, list[SampleBlock]], _Value],
    before_repeat: Callable[[], None] = lambda: None,
) -> dict[Unit, _Value]:
    """Repeat a recording until every unit has complete samples; a unit without them after 3 attempts leaves the run."""
    measured: dict[Unit, _Value] = {}
    streams = runner.streams

    def restore(unit: Unit) -> None:
        if streams[unit].broken and streams[unit].restore():
            raise UnitRestarted(unit)

    for attempt in range(_ATTEMPTS):
        runner.units.each(restore, units)
        if attempt:
            before_repeat()
        with runner.units.taps() as blocks:
            record()
        for unit in runner.units.of(units):
            if unit not in measured and not streams[unit].broken and _is_complete(blocks[unit]):
                measured[unit] = measure(unit, blocks[unit])
        missing = [unit for unit in runner.units.of(units) if unit not in measured]
        if not missing:
            break
    else:
        runner.units.each(restore, missing)
        for unit in missing:
            runner.units.leave(unit, DeviceFaultError("stream.lossy"))
    return measured


def _is_complete(blocks: list[SampleBlock]) -> bool:
    """Return whether there is more than one sample and all samples are valid."""
    return sum(map(len, blocks)) > 1 and all(block.valid.all() for block in blocks)


def mean_at_rest(counts: FloatArray) -> FloatArray:
    """Return the weighted mean of samples at rest.

    `counts` has shape (n, 6), and the mean has shape (6,). The weights are parabolic, as they are for the slope of a
    line fitted to the integral. They minimise the effect of vibration of a stationary base whose velocities are
    uncorrelated and have equal sigmas (Gauss-Markov theorem).
    """
    n = len(counts)
    middle = np.arange(n) + 0.5
    weight = middle * (n - middle)
    mean: FloatArray = (weight / weight.sum()) @ counts
    return mean


def manual_rig_data(runner: StepRunner) -> VerificationData:
    """Capture a rest, let the operator turn the only unit over, and capture another rest.

    Raises DeviceFaultError on lost samples.
    """
    outer, inner = runner.guiding.requested
    acquisition = runner.units.first.acquisition
    over = overturned_angle(runner.control_loop.context.task.geometry, outer)
    for attempt in range(_ATTEMPTS):
        start, end = (outer, over) if attempt % 2 == 0 else (over, outer)
        runner.begin_stage()
        with acquisition.tap() as blocks:
            runner.run(ManualMove(start, inner, REST, _MANUAL_MOVE_TIME if attempt else 0.0, 1, 2))
            first = sum(map(len, blocks))
            runner.run(ManualMove(end, inner, REST, _MANUAL_MOVE_TIME, 2, 2))
        data = _manual_rig_data(blocks, first, acquisition.scale)
        if data is not None:
            return replace(data, temperature=runner.units.first.temperature)
    raise DeviceFaultError("stream.lossy")


def _manual_rig_data(blocks: list[SampleBlock], first: int, scale: FloatArray) -> VerificationData | None:
    """Return both rests, the first of `first` samples, and the samples between them; None if samples are missing."""
    seq = np.concatenate([np.empty(0, np.int64), *(block.seq for block in blocks)])
    if len(seq) < 2 or (np.diff(seq) != 1).any() or not all(block.valid.all() for block in blocks):
        return None
    values = np.concatenate([block.counts for block in blocks]) * scale
    period = float(blocks[-1].time[-1] - blocks[0].time[0]) / (len(seq) - 1)
    rest = round(REST / period)
    rests = mean_at_rest(values[first - rest : first]), mean_at_rest(values[-rest:])
    return VerificationData(rests, REST, carried=values[first:-rest], period=period)
