"""Checks before the first stage, while the unit warms up: identity, power, homing, data flow, gravity and signs."""

import re
from collections.abc import Mapping
from functools import partial

import numpy as np

from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation.common import SampleBlock
from calstation.physics import AXES, JOINTS, UP, FloatArray, Move, rotation_vector
from calstation.sequencer.context import UnitTask
from calstation.sequencer.events import Message
from calstation.sequencer.guard import check_power
from calstation.sequencer.soaking import TemperatureTrack
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.unit_stream import check_unit
from calstation.sequencer.units import Unit

#: Period over which the temperature slope is computed, s, and minimum time at rest before it is computed, s.
_SLOPE_PERIOD, _MIN_SLOPE_TIME = 60.0, 20.0


class Preflight:
    """Performs the checks in an order in which each check can rely on the previous ones.

    The warm-up begins with the first check, so that an incorrectly mounted unit is refused before it is warm. A unit
    that fails a check leaves the batch, and the other units continue.
    """

    def __init__(self, runner: StepRunner) -> None:
        self._runner = runner
        self._control_loop = runner.control_loop
        self._units = runner.units
        self._context = runner.control_loop.context
        #: The motion limits of the table are the same for all units.
        self._limits = self._context.slot.unit.preflight

    def run(self) -> None:
        """Perform all checks. Raises DeviceFaultError or ConfigurationError."""
        begin = self._context.clock.now()
        self._identify()
        self._wait_until_ready()
        if self._limits.output:
            self._check_flow()
        self._check_mounting()
        self._warm_up(begin)

    def _check_mounting(self) -> None:
        """Switch the axes on, move home, and check gravity and signs."""
        if self._context.task.by_hand:
            self._check_gravity()
            return
        check_power(self._control_loop.status)
        self._context.table.enable()
        self._control_loop.wait(
            lambda: self._control_loop.status.enabled, 5.0, DeviceFaultError("motion.enable_timeout")
        )
        self._control_loop.powered = True
        self._home()
        if self._context.task.gimbal:
            self._runner.gimbal.home()
            self._check_gravity()
            return
        if not self._runner.arrived((0.0, 0.0)):
            self._runner.drive(self._turn_to(0.0, 0.0))
        if self._limits.output:
            self._check_signs(self._check_gravity())

    def _identify(self) -> None:
        table = self._context.table.identify()

        def identify(unit: Unit) -> None:
            imu, task = unit.slot.imu.identify(), unit.slot.unit
            identities = {"table": table.model, "table_serial": table.serial, "imu": imu.model, "serial": imu.serial}
            unit.emit(Message("identified", identities))
            check_unit(imu, task.serial)
            pattern = task.preflight.serial_pattern
            if not re.fullmatch(pattern, imu.serial):
                raise ConfigurationError("preflight.serial_pattern", serial=imu.serial, pattern=pattern)

        self._units.each(identify)

    def _wait_until_ready(self) -> None:
        self._context.emit(Message("waiting_ready"))
        timeout = self._limits.ready_timeout
        # For each unit that has been ready, whether its self-test failed; units may become ready in different ticks.
        failed: dict[Unit, bool] = {}

        def was_ready(unit: Unit) -> bool:
            if unit.flow.ready:
                failed[unit] = failed.get(unit, False) or unit.flow.failed
            return unit in failed

        self._control_loop.wait_for_units(was_ready, timeout, DeviceFaultError("preflight.not_ready", seconds=timeout))
        for unit in self._units:
            if failed[unit]:
                self._units.leave(unit, DeviceFaultError("preflight.self_test_failed"))

    def _home(self) -> None:
        if self._control_loop.status.homed:
            return
        self._context.emit(Message("homing"))
        self._context.table.home()
        timeout = self._limits.home_timeout
        self._control_loop.wait(
            lambda: self._control_loop.status.homed and not self._control_loop.status.moving,
            timeout,
            DeviceFaultError("motion.homing_timeout", seconds=timeout),
        )

    def _warm_up(self, begin: float) -> None:
        """Wait until the warm-up, which began at station time `begin`, s, is complete."""
        clock = self._context.clock
        warm_ups = {unit: _WarmUp(unit, begin, clock.now()) for unit in self._units}
        end = max(warm_up.end for warm_up in warm_ups.values())
        if end <= clock.now():
            return
        self._context.emit(Message("warming_up", {"seconds": round(end - clock.now(), 1)}))
        cold = tuple(warm_ups)
        while cold:
            self._control_loop.tick()
            cold = tuple(unit for unit in self._units.of(cold) if not warm_ups[unit].done(clock.now()))
            for unit in cold:
                if (timeout_error := warm_ups[unit].timeout_error(clock.now())) is not None:
                    self._units.leave(unit, timeout_error)

    def _check_flow(self) -> dict[Unit, FloatArray]:
        """Record data at rest, and return the counts of each unit, shape (n, 6); a unit with a gap leaves."""
        gaps = {unit: unit.acquisition.gaps for unit in self._units}
        with self._units.taps() as blocks:
            self._control_loop.rest(self._limits.flow)
        counts: dict[Unit, FloatArray] = {}

        def check(unit: Unit) -> None:
            if unit.acquisition.gaps != gaps[unit]:
                raise DeviceFaultError("preflight.gaps")
            counts[unit] = _counts(blocks[unit])

        self._units.each(check)
        return counts

    def _check_gravity(self) -> dict[Unit, FloatArray]:
        """Check gravity and data flow, and return the mean gyro output of each unit at rest, rad/s, shape (3,)."""
        by_hand = self._context.task.by_hand or self._context.task.gimbal
        self._context.emit(Message("checking_gravity" if by_hand else "checking_mounting"))
        counts = self._check_flow()
        means = {unit: counts[unit].mean(axis=0) * unit.acquisition.scale for unit in self._units}
        position = None if by_hand else self._runner.position()
        self._units.each(lambda unit: _check_output(unit.slot.unit, means[unit], position))
        return {unit: mean[:3] for unit, mean in means.items()}

    def _check_signs(self, biases: Mapping[Unit, FloatArray]) -> None:
        """Turn each joint by a small angle, then both back, and check size, axis and sign of the measured turns."""
        target = [0.0, 0.0]
        for joint, axis in enumerate(JOINTS):
            start = self._runner.position()
            inside = self._context.task.geometry.limits.within(joint, self._limits.turn)
            target[joint] = self._limits.turn if inside else -self._limits.turn
            with self._units.taps() as blocks:
                self._runner.drive(self._turn_to(*target))
            end = self._runner.position()
            check = partial(_check_turn, biases=biases, blocks=blocks, axis=axis, start=start, end=end)
            self._units.each(check)
        self._runner.drive(self._turn_to(0.0, 0.0))

    def _turn_to(self, outer: float, inner: float) -> Move:
        rate = self._limits.turn_rate
        return Move(outer, inner, *self._context.task.geometry.limits.limited(rate, rate), ("check",))


class _WarmUp:
    """The warm-up of a unit from station time `begin`, s, to `end`, s, or later."""

    def __init__(self, unit: Unit, begin: float, now: float) -> None:
        self._limits, self._begin = unit.slot.unit.preflight, begin
        slope_after = 0.0 if self._limits.warm_up_slope is None else _MIN_SLOPE_TIME
        self.end = max(begin + self._limits.warm_up, now + slope_after)
        self._track = TemperatureTrack(unit, _SLOPE_PERIOD)

    def done(self, now: float) -> bool:
        """Record the temperature, and return whether the unit is warm; called at every tick until then."""
        if self._limits.warm_up_slope is None:
            return now >= self.end
        self._track.add(now)
        is_long = self._track.remaining(now) <= _SLOPE_PERIOD - _MIN_SLOPE_TIME  # lost samples restart the track
        return now >= self.end and is_long and abs(self._track.slope) <= self._limits.warm_up_slope

    def timeout_error(self, now: float) -> DeviceFaultError | None:
        """Return the error of a unit whose temperature has not become stable in time, or None."""
        timeout = self._limits.warm_up_timeout
        if self._limits.warm_up_slope is None or now - self._begin <= timeout:
            return None
        return DeviceFaultError("preflight.temperature_drift", slope=self._track.slope, seconds=timeout)


def _check_output(task: UnitTask, mean: FloatArray, position: tuple[float, float] | None) -> None:
    """Check the mean output at rest, rad/s and m/s², and its direction if the joint angles `position`, rad, are known.

    Raises DeviceFaultError.
    """
    limits, rates, force = task.preflight, mean[:3], mean[3:]
    size = float(np.linalg.norm(force))
    if abs(size / limits.gravity - 1.0) > limits.gravity_tolerance:
        raise DeviceFaultError("preflight.gravity_size", measured=size, expected=limits.gravity)
    # No stage could detect rests in the data of a gyro whose bias is so far outside the limits of its profile.
    for axis, rate, low, high in zip(AXES, rates, limits.rate_low, limits.rate_high, strict=True):
        if not low <= rate <= high:
            rate_dps, low_dps, high_dps = (float(np.rad2deg(v)) for v in (rate, low, high))
            raise DeviceFaultError(
                "preflight.gyro_rate", axis=axis, rate_dps=rate_dps, low_dps=low_dps, high_dps=high_dps
            )
    if position is None:
        return
    up = task.geometry.body_to_home(*position).T @ UP
    deviation = float(np.arccos(np.clip(force @ up / size, -1.0, 1.0)))
    if deviation > limits.direction_tolerance:
        raise DeviceFaultError("preflight.gravity_direction", away_deg=float(np.rad2deg(deviation)))


def _check_turn(
    unit: Unit,
    biases: Mapping[Unit, FloatArray],
    blocks: Mapping[Unit, list[SampleBlock]],
    axis: str,
    start: tuple[float, float],
    end: tuple[float, float],
) -> None:
    """Check a small turn of a joint from joint angles `start` to `end`, rad. Raises DeviceFaultError."""
    limits, geometry, scale = unit.slot.unit.preflight, unit.slot.unit.geometry, unit.acquisition.scale
    counts = _counts(blocks[unit])
    if len(counts) < 2:
        raise DeviceFaultError("preflight.no_data_in_turn")
    period = (blocks[unit][-1].time[-1] - blocks[unit][0].time[0]) / (len(counts) - 1)
    turn = (counts[:, :3] * scale[:3] - biases[unit]).sum(axis=0) * period
    expected = rotation_vector(geometry.body_to_home(*start).T @ geometry.body_to_home(*end))
    size = float(np.linalg.norm(expected))
    along = float(turn @ expected) / size
    off = float(np.arctan2(np.linalg.norm(np.cross(turn, expected)) / size, abs(along)))
    if off > limits.direction_tolerance:
        raise DeviceFaultError("preflight.turn_axis", axis=axis, away_deg=float(np.rad2deg(off)))
    if abs(along / size - 1.0) > limits.turn_tolerance + np.deg2rad(0.5) / size:
        raise DeviceFaultError(
            "preflight.turn_size",
            axis=axis,
            expected_deg=float(np.rad2deg(size)),
            measured_deg=float(np.rad2deg(along)),
        )


def _counts(blocks: list[SampleBlock]) -> FloatArray:
    """Return all counts, shape (n, 6). Raises DeviceFaultError if a sample is not numeric or not valid."""
    counts = np.concatenate([np.empty((0, 6)), *(block.counts for block in blocks)])
    if not np.isfinite(counts).all():
        raise DeviceFaultError("preflight.non_numeric")
    if not all(block.valid.all() for block in blocks):
        raise DeviceFaultError("preflight.saturated")
    return counts
