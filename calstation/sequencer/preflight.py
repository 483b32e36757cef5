"""What is made sure before a stage may begin: identity, power, home, warm-up, gravity, signs, data flow."""

import re
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from calstation.devices.interfaces import Imu, ImuIdentity, Table, TableIdentity
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation.common.samples import SampleBlock
from calstation.physics.arrays import FloatArray
from calstation.physics.motion import Move
from calstation.physics.rotation import rotation_vector
from calstation.physics.table import TableGeometry
from calstation.sequencer import guard
from calstation.sequencer.acquisition import Acquisition
from calstation.sequencer.control_loop import ControlLoop
from calstation.sequencer.events import Message
from calstation.sequencer.ports import Clock, Emit
from calstation.sequencer.steps import StepRunner


@dataclass(frozen=True)
class PreflightLimits:
    """What a unit and its mounting must show before the run.

    Attributes
    ----------
    serial : the serial number that the unit must answer to; serial_pattern : regular expression for it
    ready_timeout, home_timeout : s
    warm_up : s at least; warm_up_slope : °C/min at most, None where temperature does not matter;
        warm_up_timeout : s, after which a still drifting unit is a fault
    gravity : m/s², expected at rest; gravity_tolerance : fraction of it
    direction_tolerance : rad, between declared and measured directions
    rate_low, rate_high : rad/s, between which each gyro measures at rest, shape (3,)
    turn : rad, the small turn of each joint; turn_rate : rad/s; turn_tolerance : fraction of the turn
    flow : s of data without a gap
    by_hand : nothing drives the axes and nothing knows their angles: power, home, direction and turns are left out
    output : the unit's output is judged; not where registers that may be wrong have already gone into it
    """

    serial: str
    serial_pattern: str
    gravity: float
    ready_timeout: float = 30.0
    home_timeout: float = 180.0
    warm_up: float = 0.0
    warm_up_slope: float | None = None
    warm_up_timeout: float = 1800.0
    gravity_tolerance: float = 0.03
    direction_tolerance: float = np.deg2rad(5.0)
    rate_low: FloatArray = field(default_factory=lambda: np.full(3, -np.inf))
    rate_high: FloatArray = field(default_factory=lambda: np.full(3, np.inf))
    turn: float = np.deg2rad(5.0)
    turn_rate: float = np.deg2rad(5.0)
    turn_tolerance: float = 0.1
    flow: float = 2.0
    by_hand: bool = False
    output: bool = True


class Preflight:
    """Runs the checks in the order in which each may rely on the ones before."""

    def __init__(
        self,
        table: Table,
        imu: Imu,
        control_loop: ControlLoop,
        acquisition: Acquisition,
        runner: StepRunner,
        clock: Clock,
        geometry: TableGeometry,
        scale: FloatArray,
        limits: PreflightLimits,
        emit: Emit,
    ) -> None:
        self._table = table
        self._imu = imu
        self._control_loop = control_loop
        self._acquisition = acquisition
        self._runner = runner
        self._clock = clock
        self._geometry = geometry
        self._scale = scale
        self._limits = limits
        self._emit = emit

    def run(self) -> None:
        """Make sure of everything. Raises DeviceFaultError or ConfigurationError with what is wrong."""
        self.identify()
        self._wait_until_ready()
        if self._limits.output:
            self._check_flow()
        if self._limits.by_hand:
            self._warm_up()
            self._check_gravity()
            return
        guard.check_power(self._control_loop.status)
        self._table.enable()
        self._control_loop.wait(
            lambda: self._control_loop.status.enabled, 5.0, "table: the drive does not enable its axes"
        )
        self._control_loop.powered = True
        self._home()
        self._go_home_angle()
        self._warm_up()
        if self._limits.output:
            self._check_signs(self._check_gravity())

    def identify(self) -> tuple[TableIdentity, ImuIdentity]:
        """Read who is there; refuses a wrong serial number or one outside the pattern."""
        limits = self._limits
        table = self._table.identify()
        imu = self._imu.identify()
        self._emit(
            Message(
                "identified",
                {"table": table.model, "table_serial": table.serial, "imu": imu.model, "serial": imu.serial},
            )
        )
        check_unit(imu, limits.serial)
        if not re.fullmatch(limits.serial_pattern, imu.serial):
            raise ConfigurationError(
                f"serial number '{imu.serial}' does not fit the product's pattern '{limits.serial_pattern}'; "
                "choose the product that belongs to the unit"
            )
        return table, imu

    def _wait_until_ready(self) -> None:
        self._emit(Message("waiting_ready"))
        self._control_loop.wait(
            lambda: self._control_loop.flow.ready,
            self._limits.ready_timeout,
            f"IMU: not ready after {self._limits.ready_timeout:g} s; check power, port, baud and parity",
        )
        if self._control_loop.flow.failed:
            raise DeviceFaultError("IMU: the unit reports a failed self-test; replace the unit")

    def _home(self) -> None:
        if self._control_loop.status.homed:
            return
        self._emit(Message("homing"))
        self._table.home()
        self._control_loop.wait(
            lambda: self._control_loop.status.homed and not self._control_loop.status.moving,
            self._limits.home_timeout,
            f"table: homing did not end within {self._limits.home_timeout:g} s; check the home switches",
        )

    def _go_home_angle(self) -> None:
        if not self._runner.arrived((0.0, 0.0)):
            self._runner.drive(self._turn_to(0.0, 0.0))

    def _warm_up(self) -> None:
        limits = self._limits
        if limits.warm_up <= 0.0 and limits.warm_up_slope is None:
            return
        self._emit(Message("warming_up", {"seconds": limits.warm_up}))
        begin = self._clock.now()
        track: deque[tuple[float, float]] = deque()
        while True:
            self._control_loop.tick()
            now = self._clock.now()
            if limits.warm_up_slope is None:
                if now - begin >= limits.warm_up:
                    return
                continue
            if self._acquisition.recent is not None and self._acquisition.recent[1] is not None:
                track.append((now, self._acquisition.recent[1]))
            while track and now - track[0][0] > 60.0:
                track.popleft()
            if now - begin >= max(limits.warm_up, 20.0) and abs(_slope(track)) <= limits.warm_up_slope:
                return
            if now - begin > limits.warm_up_timeout:
                raise DeviceFaultError(
                    f"IMU: temperature still drifts by {_slope(track):.2g} °C/min after "
                    f"{limits.warm_up_timeout:g} s; wait, or allow more in the product's warm_up"
                )

    def _check_flow(self) -> FloatArray:
        """Counts of some seconds at rest, without a gap, shape (n, 6)."""
        gaps = self._acquisition.gaps
        with self._acquisition.tap() as blocks:
            self._control_loop.rest(self._limits.flow)
        if self._acquisition.gaps != gaps:
            raise DeviceFaultError("IMU: data have gaps already at rest; check cable, baud and sample rate")
        return _counts(blocks)

    def _check_gravity(self) -> FloatArray:
        """Gravity as declared, data without a gap; returns the gyro's mean at rest, rad/s, shape (3,)."""
        self._emit(Message("checking_gravity" if self._limits.by_hand else "checking_mounting"))
        limits = self._limits
        mean = self._check_flow().mean(axis=0) * self._scale
        force = mean[3:]
        size = float(np.linalg.norm(force))
        if abs(size / limits.gravity - 1.0) > limits.gravity_tolerance:
            raise DeviceFaultError(
                f"IMU: gravity measures {size:.3f} m/s², expected {limits.gravity:.3f} m/s²; "
                "check the IMU profile's accel_lsb and output, and the unit"
            )
        rates: FloatArray = mean[:3]
        self._check_rates(rates)
        if limits.by_hand:
            return rates
        up = self._geometry.body_to_home(*self._runner.position()).T @ np.array([0.0, 0.0, 1.0])
        away = float(np.arccos(np.clip(force @ up / size, -1.0, 1.0)))
        if away > limits.direction_tolerance:
            raise DeviceFaultError(
                f"IMU: gravity points {np.rad2deg(away):.1f}° away from the declared mounting; "
                "check how the unit is mounted and the table profile's axes"
            )
        return rates

    def _check_rates(self, rates: FloatArray) -> None:
        """A gyro so far from what its profile expects finds no rest in the data of any stage."""
        for axis, rate, low, high in zip(
            "xyz", rates, self._limits.rate_low, self._limits.rate_high, strict=True
        ):
            if not low <= rate <= high:
                raise DeviceFaultError(
                    f"IMU: gyro {axis} measures {np.rad2deg(rate):.3g} °/s at rest, expected {np.rad2deg(low):.3g} to"
                    f" {np.rad2deg(high):.3g} °/s; replace the unit, or correct prior.gyro_bias in the IMU profile"
                )

    def _check_signs(self, bias: FloatArray) -> None:
        """A small turn of each joint, there and back: the gyro must see it with its size, axis and sign."""
        for joint, name in enumerate(guard.JOINTS):
            start = self._runner.position()
            target = [0.0, 0.0]
            target[joint] = self._small_turn(joint)
            with self._acquisition.tap() as blocks:
                self._runner.drive(self._turn_to(*target))
            end = self._runner.position()
            counts = _counts(blocks)
            if len(counts) < 2:
                raise DeviceFaultError("IMU: no data during a turn; check cable, power and port")
            period = (blocks[-1].time[-1] - blocks[0].time[0]) / (len(counts) - 1)
            turned = (counts[:, :3] * self._scale[:3] - bias).sum(axis=0) * period
            expected = rotation_vector(
                self._geometry.body_to_home(*start).T @ self._geometry.body_to_home(*end)
            )
            size = float(np.linalg.norm(expected))
            along = float(turned @ expected) / size
            off = float(np.arctan2(np.linalg.norm(np.cross(turned, expected)) / size, abs(along)))
            if off > self._limits.direction_tolerance:
                raise DeviceFaultError(
                    f"IMU: a turn of the {name} axis measures {np.rad2deg(off):.1f}° away from the declared "
                    "axis; check how the unit is mounted and the table profile's axes"
                )
            if abs(along / size - 1.0) > self._limits.turn_tolerance + np.deg2rad(0.5) / size:
                raise DeviceFaultError(
                    f"IMU: a turn of {np.rad2deg(size):.1f}° of the {name} axis measures "
                    f"{np.rad2deg(along):.1f}° about it; check axes, mounting and gyro_lsb"
                )
            self._runner.drive(self._turn_to(0.0, 0.0))

    def _small_turn(self, joint: int) -> float:
        inside = self._geometry.limits.within(joint, self._limits.turn)
        return self._limits.turn if inside else -self._limits.turn

    def _turn_to(self, outer: float, inner: float) -> Move:
        limits = self._geometry.limits
        rate = min(self._limits.turn_rate, *limits.rate)
        return Move(outer, inner, rate, min(self._limits.turn_rate, *limits.acceleration), ("check",))


def check_unit(identity: ImuIdentity, serial: str) -> None:
    """Raises DeviceFaultError where another unit answers than the one meant."""
    if identity.serial != serial:
        raise DeviceFaultError(
            f"IMU: the unit answers to serial number '{identity.serial}', not '{serial}'; "
            "check the unit in the fixture and the number given"
        )


def _counts(blocks: list[SampleBlock]) -> FloatArray:
    """All counts, shape (n, 6). Raises DeviceFaultError where they are none that anything can be judged by."""
    counts = np.concatenate([np.empty((0, 6)), *(block.counts for block in blocks)])
    if not np.isfinite(counts).all():
        raise DeviceFaultError(
            "IMU: the output is no number; switch the unit off and on, check the IMU profile"
        )
    if not all(block.valid.all() for block in blocks):
        raise DeviceFaultError(
            "IMU: the output saturates though the table rests or turns slowly; look for what shakes the unit, check"
            " the IMU profile"
        )
    return counts


def _slope(track: deque[tuple[float, float]]) -> float:
    """Least-squares slope of temperature over time, °C/min; infinite for fewer than 10 values."""
    if len(track) < 10:
        return float("inf")
    times, values = np.array(track).T
    return float(np.polyfit((times - times[0]) / 60.0, values, 1)[0])
