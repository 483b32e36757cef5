"""Checks before the first stage: identity, power, home, gravity, signs and data flow, while the unit warms up."""

import re
from collections import deque

import numpy as np

from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation.common import SampleBlock
from calstation.physics import AXES, JOINTS, UP, FloatArray, Move, rotation_vector
from calstation.sequencer.events import Message
from calstation.sequencer.guard import check_power
from calstation.sequencer.steps import StepRunner
from calstation.sequencer.unit_stream import check_unit

#: Time over which the temperature slope is computed, s, and minimum time at rest for a slope, s.
_SLOPE_OVER, _SLOPE_AFTER = 60.0, 20.0


class Preflight:
    """Runs the checks in an order in which each can rely on the previous ones.

    The warm-up begins with the first check: a unit that is mounted wrongly is refused before it is warm.
    """

    def __init__(self, runner: StepRunner) -> None:
        self._runner = runner
        self._control_loop = runner.control_loop
        self._acquisition = runner.acquisition
        self._context = runner.control_loop.context
        self._unit = self._context.slot.unit
        self._limits = self._unit.preflight
        self._geometry = self._context.task.geometry
        self._scale = self._acquisition.scale

    def run(self) -> None:
        """Run all checks. Raises DeviceFaultError or ConfigurationError."""
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
        table, imu = self._context.table.identify(), self._context.slot.imu.identify()
        found = {"table": table.model, "table_serial": table.serial, "imu": imu.model, "serial": imu.serial}
        self._context.emit(Message("identified", found))
        check_unit(imu, self._unit.serial)
        pattern = self._limits.serial_pattern
        if not re.fullmatch(pattern, imu.serial):
            raise ConfigurationError("preflight.serial_pattern", serial=imu.serial, pattern=pattern)

    def _wait_until_ready(self) -> None:
        self._context.emit(Message("waiting_ready"))
        timeout = self._limits.ready_timeout
        self._control_loop.wait(
            lambda: self._control_loop.flow.ready, timeout, DeviceFaultError("preflight.not_ready", seconds=timeout)
        )
        if self._control_loop.flow.failed:
            raise DeviceFaultError("preflight.self_test_failed")

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
        """Wait for the rest of the warm-up, which began at station time `begin`, s."""
        limits, clock = self._limits, self._context.clock
        slope_after = 0.0 if limits.warm_up_slope is None else _SLOPE_AFTER
        end = max(begin + limits.warm_up, clock.now() + slope_after)
        if end <= clock.now():
            return
        self._context.emit(Message("warming_up", {"seconds": round(end - clock.now(), 1)}))
        track: deque[tuple[float, float]] = deque()
        while True:
            self._control_loop.tick()
            now = clock.now()
            if limits.warm_up_slope is None:
                if now >= end:
                    return
                continue
            if self._acquisition.recent is not None and self._acquisition.recent[1] is not None:
                track.append((now, self._acquisition.recent[1]))
            while track and now - track[0][0] > _SLOPE_OVER:
                track.popleft()
            if now >= end and abs(_slope(track)) <= limits.warm_up_slope:
                return
            if now - begin > limits.warm_up_timeout:
                raise DeviceFaultError(
                    "preflight.temperature_drift", slope=_slope(track), seconds=limits.warm_up_timeout
                )

    def _check_flow(self) -> FloatArray:
        """Record some seconds at rest and return the counts, shape (n, 6). Raises DeviceFaultError for a gap."""
        gaps = self._acquisition.gaps
        with self._acquisition.tap() as blocks:
            self._control_loop.rest(self._limits.flow)
        if self._acquisition.gaps != gaps:
            raise DeviceFaultError("preflight.gaps")
        return _counts(blocks)

    def _check_gravity(self) -> FloatArray:
        """Check gravity and data flow; return the mean gyro output at rest, rad/s, shape (3,)."""
        by_hand = self._context.task.by_hand or self._context.task.gimbal
        self._context.emit(Message("checking_gravity" if by_hand else "checking_mounting"))
        limits = self._limits
        mean = self._check_flow().mean(axis=0) * self._scale
        force = mean[3:]
        size = float(np.linalg.norm(force))
        if abs(size / limits.gravity - 1.0) > limits.gravity_tolerance:
            raise DeviceFaultError("preflight.gravity_size", measured=size, expected=limits.gravity)
        rates: FloatArray = mean[:3]
        # With a gyro so far from its profile, no stage could detect rests in its data.
        for axis, rate, low, high in zip(AXES, rates, limits.rate_low, limits.rate_high, strict=True):
            if not low <= rate <= high:
                rate_dps, low_dps, high_dps = (float(np.rad2deg(v)) for v in (rate, low, high))
                raise DeviceFaultError(
                    "preflight.gyro_rate", axis=axis, rate_dps=rate_dps, low_dps=low_dps, high_dps=high_dps
                )
        if by_hand:
            return rates
        up = self._geometry.body_to_home(*self._runner.position()).T @ UP
        away = float(np.arccos(np.clip(force @ up / size, -1.0, 1.0)))
        if away > limits.direction_tolerance:
            raise DeviceFaultError("preflight.gravity_direction", away_deg=float(np.rad2deg(away)))
        return rates

    def _check_signs(self, bias: FloatArray) -> None:
        """Turn each joint by a small angle, then both back; check the size, axis and sign that the gyro measures."""
        target = [0.0, 0.0]
        for joint, axis in enumerate(JOINTS):
            start = self._runner.position()
            inside = self._geometry.limits.within(joint, self._limits.turn)
            target[joint] = self._limits.turn if inside else -self._limits.turn
            with self._acquisition.tap() as blocks:
                self._runner.drive(self._turn_to(*target))
            end = self._runner.position()
            counts = _counts(blocks)
            if len(counts) < 2:
                raise DeviceFaultError("preflight.no_data_in_turn")
            period = (blocks[-1].time[-1] - blocks[0].time[0]) / (len(counts) - 1)
            turned = (counts[:, :3] * self._scale[:3] - bias).sum(axis=0) * period
            expected = rotation_vector(self._geometry.body_to_home(*start).T @ self._geometry.body_to_home(*end))
            size = float(np.linalg.norm(expected))
            along = float(turned @ expected) / size
            off = float(np.arctan2(np.linalg.norm(np.cross(turned, expected)) / size, abs(along)))
            if off > self._limits.direction_tolerance:
                raise DeviceFaultError("preflight.turn_axis", axis=axis, away_deg=float(np.rad2deg(off)))
            if abs(along / size - 1.0) > self._limits.turn_tolerance + np.deg2rad(0.5) / size:
                raise DeviceFaultError(
                    "preflight.turn_size",
                    axis=axis,
                    expected_deg=float(np.rad2deg(size)),
                    measured_deg=float(np.rad2deg(along)),
                )
        self._runner.drive(self._turn_to(0.0, 0.0))

    def _turn_to(self, outer: float, inner: float) -> Move:
        rate = self._limits.turn_rate
        return Move(outer, inner, *self._geometry.limits.limited(rate, rate), ("check",))


def _counts(blocks: list[SampleBlock]) -> FloatArray:
    """Return all counts, shape (n, 6). Raises DeviceFaultError if any is non-numeric or invalid."""
    counts = np.concatenate([np.empty((0, 6)), *(block.counts for block in blocks)])
    if not np.isfinite(counts).all():
        raise DeviceFaultError("preflight.non_numeric")
    if not all(block.valid.all() for block in blocks):
        raise DeviceFaultError("preflight.saturated")
    return counts


def _slope(track: deque[tuple[float, float]]) -> float:
    """Return the least-squares slope of temperature over time, °C/min; infinite for fewer than 10 values."""
    if len(track) < 10:
        return float("inf")
    times, values = np.array(track).T
    return float(np.polyfit((times - times[0]) / 60.0, values, 1)[0])
