"""The running bench, which advances joints, controller, stream and unit together and injects faults."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calstation.bench.chamber import ChamberMachine
from calstation.bench.config import BenchConfig, FaultCommand
from calstation.bench.imu import UNITS, StreamFaults, count_flash_cycles
from calstation.bench.table import Clocks, Fault, GimbalDrive, TableMachine, TableRegisters
from calstation.bench.truth import (
    BodyMotion,
    BodyStream,
    Field,
    GimbalStream,
    ManualRigStream,
    Mounting,
    SensorStream,
    TableDrive,
    draw_mounting,
)

TABLE_MODEL = "bench-table"

_FAULTS = {
    "drive_fault": Fault.DRIVE,
    "limit_fault": Fault.LIMIT,
    "stall": Fault.STALL,
    "trip_watchdog": Fault.WATCHDOG,
}

#: Maximum joint angle at power-on if it is drawn at random, rad.
_MAX_START_ANGLE = np.deg2rad(15.0)


class LiveBench:
    """All devices with a common time, without their links.

    `host_time` is the clock of the watchdog, and `now` the time of the control service, s. Fault commands for the links
    are passed to `on_link`. A unit with a `first` unit is on the table or body of that unit and advances with it;
    `outbox` contains the frames that it has sent in the meantime.
    """

    def __init__(self, config: BenchConfig, host_time: Callable[[], float], first: "LiveBench | None" = None) -> None:
        flash_cycles = count_flash_cycles(config.flash_file)
        self.truth = config.truth(flash_cycles)
        self.number = config.unit
        self.outbox: list[bytes] = []
        self._followers: list[LiveBench] = []
        self._first = first
        if first is not None:
            first._followers.append(self)
            if config.body is None:
                unit_table = self.truth.table
                table = replace(first.truth.table, mount=unit_table.mount, orientation=unit_table.orientation)
                self.truth = replace(self.truth, table=table, encoder=first.truth.encoder)
        extra_seed = [config.interruptions] if config.interruptions else []  # a resumed run has different noise
        stream_seed, encoder_seed, other_seed = np.random.SeedSequence(
            [config.seed, 1, flash_cycles, *extra_seed]
        ).spawn(3)
        self._random = np.random.default_rng(other_seed)
        if config.start_deg is None:
            outer, inner = self._random.uniform(-_MAX_START_ANGLE, _MAX_START_ANGLE, 2)
        else:
            outer, inner = np.deg2rad(config.start_deg)
        start = (float(outer), float(inner))
        self._gain = 1.0 + 1e-6 * config.clock_drift_ppm
        self._power_on = config.power_on_s
        self.thermal = config.unit_thermal()
        self.chamber = None if config.chamber is None else ChamberMachine(config.chamber)
        if first is not None:
            self.chamber = first.chamber
        self._stream: SensorStream | ManualRigStream | BodyStream | GimbalStream
        if config.body is not None:
            body, table = config.body, self.truth.table
            self._stream = BodyStream(
                self.truth.imu,
                BodyMotion(body.rest_s, body.motion_s, body.seed),
                draw_mounting(self._random) if first is not None else Mounting(np.eye(3), np.zeros(3)),
                Field(table.up_force_n, table.earth_rate_n),
                stream_seed,
                config.power_on_s,
                self._gain,
                np.reshape(config.gyro_steps, (-1, 2)) * [1.0, np.deg2rad(1.0)],
            )
        elif config.table_protocol == "hand":
            self._stream = ManualRigStream(self.truth.imu, config.rig(), stream_seed)
        elif config.table_protocol == "gimbal":
            self._stream = config.gimbal(self.truth.imu, stream_seed)
        elif first is None:
            self._stream = SensorStream(
                self.truth.imu, self.truth.table, stream_seed, thermal=self.thermal, air=self._air
            )
        else:
            #: Device time of the first unit when the device time of this unit is 0, s, if both have no clock delay.
            self._begin = (config.power_on_s - first._power_on) * first._gain
            self._stream = SensorStream(
                self.truth.imu,
                self.truth.table,
                stream_seed,
                rate=first._gain / self._gain,
                begin=self._begin,
                thermal=self.thermal,
                air=self._air,
            )
        self._latency, self._jitter = config.latency_s, config.jitter_s
        self._commands = sorted(config.orders, key=lambda command: command.at)
        self.now = 0.0
        self.executed: list[str] = []
        self.on_link: Callable[[FaultCommand], None] = lambda command: None
        self.clocks: Clocks = Clocks(lambda: self.device_time, host_time, self._reading_time)
        self.machine: TableMachine = TableMachine(
            GimbalDrive(self._stream)
            if isinstance(self._stream, GimbalStream)
            else TableDrive(self.truth.encoder, start, encoder_seed),
            config.limits(),
            interlock_closed=config.interlock_closed,
            watchdog=config.watchdog_ms / 1000.0,
        )
        if first is not None:
            self.machine, self.clocks = first.machine, first.clocks
        self.registers = TableRegisters(self.machine, self.clocks, TABLE_MODEL, config.table_serial)
        imu = self.truth.imu
        per_count = imu.sample_rate if imu.output == "increment" else 1.0
        self.unit = UNITS[config.imu_protocol](config, np.repeat([imu.gyro_lsb, imu.accel_lsb], 3) * per_count)
        if self.thermal is not None:
            self.unit.sensor_output = self.thermal.sensor_output
        if config.calibrated:
            self.unit.calibrate(imu.error_model())
        if config.table_protocol == "imu_link":
            self.unit.axes = self.registers
        self.faults = StreamFaults(self._random, self.unit.frame_size)

    @property
    def gimbal(self) -> GimbalStream:
        """The gimbal of the bench. Raises TypeError if another table is configured."""
        if not isinstance(self._stream, GimbalStream):
            raise TypeError("the bench has no gimbal")
        return self._stream

    @property
    def device_time(self) -> float:
        """Current time of the devices, s."""
        return (self.now - self._power_on) * self._gain - self._clock_delay

    @property
    def _clock_delay(self) -> float:
        """Delay of the unit's clock due to the temperature, s."""
        return 0.0 if self.thermal is None else self.thermal.clock_delay

    @property
    def sample_count(self) -> int:
        """Number of samples produced so far."""
        return self._stream.produced

    def new_parser(self) -> Callable[[bytes], list[bytes]]:
        """Return a parser for one connection, which converts received bytes to the unit's replies."""
        parse = self.unit.new_parser()
        return lambda data: parse(data, self.device_time)

    def advance(self, now: float) -> bytes:
        """Advance to `now`, s; return the frames that the unit sends in this interval."""
        parts = []
        while self._commands and self._commands[0].at <= (now - self._power_on) * self._gain:
            due = self._commands.pop(0)
            parts += self._advance_in_steps(max(self._power_on + due.at / self._gain, self.now))
            self.execute(due)
        parts += self._advance_in_steps(now)
        return b"".join(parts)

    def _advance_in_steps(self, now: float) -> list[bytes]:
        """Advance to `now`, s, in steps that end when faults end, so that their effects do not depend on the caller."""
        ends = (self._power_on + end / self._gain for end in self.faults.until.values())
        return [self._produce(step_end) for step_end in (*sorted(end for end in ends if self.now < end < now), now)]

    def execute(self, command: FaultCommand) -> None:
        """Execute a fault command immediately, or schedule it if its `after` is positive."""
        time, value, faults, machine = self.device_time, command.value, self.faults, self.machine
        if command.after > 0.0:
            later = command.model_copy(update={"after": 0.0, "at": time + command.after})
            self._commands = sorted([*self._commands, later], key=lambda o: o.at)
            return
        self.executed.append(command.order)
        if command.order in _FAULTS:
            machine.trip(_FAULTS[command.order], time)
        elif command.order in faults.counts:
            faults.counts[command.order] = int(value)
        elif command.order in faults.until:
            faults.until[command.order] = time + value
        elif command.order.startswith("chamber_"):
            self._execute_for_chamber(command.order, value)
        elif command.order.startswith("temperature_"):
            self._execute_for_sensor(command.order, value)
        elif command.order == "interlock":
            machine.set_interlock(value != 0.0, time)
        elif command.order == "jam":
            machine.jam(time)
        elif command.order == "overshoot":
            machine.overshoot = np.deg2rad(value)
        elif command.order == "never_settle":
            machine.unsettled_until = time + value
        elif command.order == "freeze_channel":
            faults.frozen, faults.frozen_until = int(value), np.inf
        elif command.order == "reset_imu":
            self.unit.restart(time)
        elif command.order == "jump_counter":
            self.unit.counter = int(value)
        elif command.order == "brown_out_write":
            self.unit.write_power_cut = int(value)
        elif command.order == "brown_out_commit":
            self.unit.commit_power_cut = int(value)
        else:
            self.on_link(command)

    def _execute_for_chamber(self, order: str, value: float) -> None:
        """Execute a fault command for the chamber if there is one."""
        chamber = self.chamber
        if chamber is None:
            return
        if order == "chamber_alarm":
            chamber.trip(int(value))
        elif order == "chamber_door":
            chamber.open_door(value)
        elif order == "chamber_off":
            chamber.stop()
        elif order == "chamber_no_power":
            chamber.powerless = value != 0.0
        elif order == "chamber_set_point":
            chamber.set_point = value
        elif order == "chamber_sensor_stuck":
            chamber.stuck = value != 0.0
        elif order == "chamber_sensor_offset":
            chamber.offset = value

    def _execute_for_sensor(self, order: str, value: float) -> None:
        """Execute a fault command for the temperature sensor of the unit if it is in a chamber."""
        thermal = self.thermal
        if thermal is None:
            return
        if order == "temperature_stuck":
            thermal.stuck = thermal.sensor_output(self.device_time)
        elif order == "temperature_offset":
            thermal.offset = value
        elif order == "temperature_jump":
            thermal.jumps_until = self.device_time + value

    def _air(self) -> float:
        return 0.0 if self.chamber is None else self.chamber.truth.air

    def carry(self, outer: float, inner: float, rest: float) -> None:
        """Request rail angles and a rest from the simulated operator of a manual rig; do nothing on a driven table.

        Parameters
        ----------
        outer, inner : angles of the rails, rad
        rest : duration of the rest, s
        """
        if isinstance(self._stream, ManualRigStream):
            self._stream.carry((outer, inner), rest, self.device_time)

    def _produce(self, now: float) -> bytes:
        if self._first is None and self.chamber is not None:
            self.chamber.advance(now)
        for follower in self._followers:
            follower.outbox.append(follower.advance(now))
        begin, self.now = self.device_time, now
        middle = 0.5 * (begin + self.device_time)
        interval = self._stream.interval
        first = self._stream.produced
        count = int(self.device_time / interval + 1e-6) - first
        if count <= 0:
            return b""
        if self._first is not None and isinstance(self._stream, SensorStream):
            rate = self._first._gain / self._gain
            self._stream.begin = self._begin + rate * self._clock_delay - self._first._clock_delay
        if isinstance(self._stream, ManualRigStream | BodyStream):
            output = self._stream.produce(count)
        elif isinstance(self._stream, GimbalStream):
            output = self._stream.produce(count, self.unit.correction().gyro)
        else:
            output = self._stream.produce(count, *self.machine.drive.profiles)
        if self._first is None:
            self.machine.advance(self.device_time)
        ends = np.arange(first + 1, first + count + 1, dtype=np.float64) * interval
        frames = self.unit.frames(self.faults.samples(output, middle), ends)
        return self.faults.frames(frames, middle)

    def _reading_time(self) -> float:
        delay = self._latency + self._jitter * self._random.uniform(-1.0, 1.0)
        return max(0.0, self.device_time - max(0.0, delay))
