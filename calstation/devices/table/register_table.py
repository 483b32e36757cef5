"""Drivers of two-axis tables with 16-bit registers, which their profiles define (CiA 402 words).

The registers are accessed over a Modbus link or, for an inertial system with an indexing unit, by two commands of the
IMU's driver, which owns the port.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress

import numpy as np

from calstation.devices.codecs import register_text
from calstation.devices.imu import FramedImu, ImuBusyError, ImuRefusalError, StreamedImu
from calstation.devices.interfaces import (
    LOCAL_CONTROL,
    UNKNOWN_FAULT,
    OtherModelError,
    Table,
    TableIdentity,
    TableStatus,
    latched_fault_error,
)
from calstation.devices.links import ModbusLink, ModbusRefusalError
from calstation.devices.profiles import (
    JOINTS,
    ImuLinkSection,
    ModbusRegister,
    ModbusSection,
    SerialSettings,
    StatusBit,
    TableProfile,
)
from calstation.errors import ConfigurationError, DeviceFaultError
from calstation.estimation.common import snap_angles
from calstation.physics import JointLimits

SHUTDOWN, SWITCH_ON, ENABLE, FAULT_RESET = 0x06, 0x07, 0x0F, 0x86
_POLLED = ("statusword", "status2", "fault", "interlock", "watchdog", "position", "rate", "low", "high")
_MAX_READ = 120  # largest number of registers in one transfer


class ImuWords:
    """Registers of axes that are accessed by commands of their IMU. Raises DeviceFaultError if a command fails."""

    received = b""
    deviation = None

    def __init__(self, imu: FramedImu, *, owned: bool) -> None:
        self._imu, self._owned = imu, owned

    def read(self, address: int, count: int, unit: int | None = None) -> list[int]:
        """Read registers and repeat a lost transfer; `unit` is ignored, because there is only one unit."""
        try:
            return self._imu.read_words(address, count)
        except ImuRefusalError as exc:
            code = "table.system_read_busy" if isinstance(exc, ImuBusyError) else "table.system_read_refused"
            raise DeviceFaultError(code, address=address, last=address + count - 1, reason=exc.reason) from exc

    def write(self, address: int, values: list[int], repeat: bool = True, unit: int | None = None) -> None:
        """Write registers; repeat a lost transfer only if `repeat`."""
        try:
            self._imu.write_words(address, values, repeat)
        except ImuRefusalError as exc:
            code = "table.system_write_busy" if isinstance(exc, ImuBusyError) else "table.system_write_refused"
            raise DeviceFaultError(code, address=address, reason=exc.reason) from exc

    def close(self) -> None:
        """Close the IMU if it was opened only for the table."""
        if self._owned:
            self._imu.close()


class RegisterTable(Table):
    """Driver of a table with registers. Moves are absolute, so that a repeated transfer does not add motion."""

    def __init__(self, link: ModbusLink | ImuWords, profile: TableProfile) -> None:
        section = profile.section_of(ImuLinkSection)
        self._link, self._profile, self._map = link, profile, profile.map
        self._rest_rate = section.rest_rate_dps
        self._powered = False
        self._polled = [register_name for name in _POLLED for register_name in self._map.names(name)]
        drives: dict[int | None, list[ModbusRegister]] = {None: []}
        for name in self._polled:
            drives.setdefault(self._unit(name), []).append(self._map.registers[name])
        self._spans = [(unit, *span) for unit, part in drives.items() for span in _spans(part, section.gap)]
        self._limits = profile.geometry().limits

    def identify(self) -> TableIdentity:
        """Return the model and serial number of the table, or of both drives. Raises OtherModelError."""
        models = [self._text(name) for name in self._map.names("model")]
        serials = [self._text(name) for name in self._map.names("serial")]
        for model in models:
            if self._profile.model not in model:
                raise OtherModelError("table.other_model", found=model, expected=self._profile.model)
        return TableIdentity(" + ".join(dict.fromkeys(models)), " + ".join(serials))

    def status(self) -> TableStatus:
        """Poll the table, using a single transfer for each drive if the layout of the registers allows it."""
        words = [(unit, start, self._link.read(start, end - start, unit)) for unit, start, end in self._spans]
        value = {name: self._value(words, name) for name in self._polled}
        position, rate = (np.array([value[f"{joint}_{name}"] for joint in JOINTS]) for name in ("position", "rate"))
        at_rest = bool(np.all(np.abs(rate) < self._rest_rate))
        return TableStatus(
            angles=snap_angles(np.deg2rad(position)),
            rates=np.deg2rad(rate),
            enabled=all(self._flags("enabled", value)),
            homed=all(self._flags("homed", value)),
            moving=any(self._flags("moving", value) or [not at_rest]),
            settled=all(self._flags("settled", value)),
            fault=self._fault(value),
            interlock_closed=all(self._flags("interlock", value))
            and all(value[name] == 1 for name in self._map.names("interlock")),
            watchdog=min((value[name] for name in self._map.names("watchdog")), default=math.inf),
            limits=JointLimits(
                self._travel("low", value, self._limits.low),
                self._travel("high", value, self._limits.high),
                self._limits.rate,
                self._limits.acceleration,
            ),
        )

    def enable(self) -> None:
        """Switch both axes on with the CiA 402 sequence."""
        with self._fault_as_cause():
            for word in (SHUTDOWN, SWITCH_ON, ENABLE):
                self._write_registers("controlword", word)
        self._powered = True

    def disable(self) -> None:
        """Switch both axes off, or the only axis whose drive responds."""
        self._powered = False
        self._write_each_drive([("controlword", SHUTDOWN)])

    def home(self) -> None:
        """Start homing; a lost reply is a fault and never causes a second homing."""
        self._command("home", repeat=False)

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start moving both joints to absolute angles; see `interfaces.Table`."""
        values = [
            {f"{joint}_target": angle, f"{joint}_target_rate": rate, f"{joint}_acceleration": acceleration}
            for joint, angle in zip(JOINTS, (outer, inner), strict=True)
        ]
        self._command("move", values)

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Rotate both joints at these rates until they are stopped; see `interfaces.Table`."""
        if self._map.commands.rate is None:
            raise ConfigurationError("table.no_rate_command")
        self._profile.check_continuous_rotation(self.status().watchdog, (outer, inner), acceleration)
        values = [
            {register_name: rate, f"{joint}_acceleration": acceleration}
            for joint, register_name, rate in zip(JOINTS, self._map.rate_registers(), (outer, inner), strict=True)
        ]
        self._command("rate", values)

    def stop(self) -> None:
        """Decelerate both axes to rest, or the only axis whose drive responds."""
        self._write_each_drive(self._writes("stop"))

    def reset_fault(self) -> None:
        """Clear a latched fault by a rising edge of the reset bit; the axes remain off."""
        self._powered = False
        for word in (SHUTDOWN, FAULT_RESET, SHUTDOWN):
            self._write_registers("controlword", word)

    def heartbeat(self) -> None:
        """Feed the table's watchdog if it has one."""
        with self._fault_as_cause():
            self._write_registers("heartbeat", 1)

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    @property
    def received(self) -> bytes:
        """Bytes received last."""
        return self._link.received

    @property
    def deviation(self) -> str | None:
        """How a Modbus TCP reply differs from its request; see `links.TcpConnection`."""
        return self._link.deviation

    def reply_time(self, unit: int, limit: float) -> float | None:
        """Return the reply time of a unit, s; None if no reply arrives within `limit` s of host time."""
        return self._link.reply_time(unit, limit) if isinstance(self._link, ModbusLink) else None

    def _unit(self, name: str) -> int | None:
        """Return the unit number of the inner axis's separate drive for its registers; None for the link's unit."""
        modbus = self._profile.modbus
        return modbus.inner_unit if modbus is not None and name.startswith("inner_") else None

    def _flags(self, name: str, value: Mapping[str, float]) -> list[bool]:
        """Return the value of a flag for each drive; an empty list if the profile does not define the flag."""
        bit: StatusBit | None = getattr(self._map.bits, name)
        if bit is None:
            return []
        if bit.bit is None:
            return [bool(bit.always)]
        return [bool(int(value[word]) >> bit.bit & 1) for word in self._map.names(bit.word)]

    def _fault(self, value: Mapping[str, float]) -> str | None:
        """Return the latched fault, or another reason why the table does not accept commands, or None."""
        codes = [int(value[name]) for name in self._map.names("fault")]
        if any(self._flags("fault", value)) or any(codes):
            code = next((code for code in codes if code), 0)
            return self._profile.faults.get(str(code), f"code {code}") if code else UNKNOWN_FAULT
        if not all(self._flags("remote", value)):
            return LOCAL_CONTROL
        # The quick stop bit may have any value while the drive is off (CiA 402-2, table 30).
        if self._powered and not all(self._flags("quick_stop", value)):
            return "quick stop"
        return "limit" if any(self._flags("limit", value)) else None

    def _writes(self, command: str) -> list[tuple[str, int]]:
        return [write for writes in getattr(self._map.commands, command) for write in writes.items()]

    def _write_each_drive(self, writes: list[tuple[str, int]]) -> None:
        """Write to every drive that replies, then raise the first DeviceFaultError."""
        failed: dict[int | None, DeviceFaultError] = {}
        for name, raw in writes:
            for register_name in self._map.names(name):
                unit = self._unit(register_name)
                if unit in failed:
                    continue
                try:
                    self._write_register(register_name, raw)
                except DeviceFaultError as exc:
                    failed[unit] = exc
        if failed:
            raise next(iter(failed.values()))

    def _write_registers(self, name: str, raw: int, repeat: bool = True) -> None:
        for register_name in self._map.names(name):
            self._write_register(register_name, raw, repeat)

    def _write_register(self, register_name: str, raw: int, repeat: bool = True) -> None:
        register = self._map.registers[register_name]
        self._link.write(register.address, register.words_of(raw), repeat, self._unit(register_name))

    def _command(self, command: str, values: Sequence[Mapping[str, float]] = (), repeat: bool = True) -> None:
        with self._fault_as_cause():
            for words in [self._encoded(register_name) for register_name in values]:
                self._write_adjacent(words)
            for name, raw in self._writes(command):
                self._write_registers(name, raw, repeat)

    @contextmanager
    def _fault_as_cause(self) -> Iterator[None]:
        """Raise the error of a latched fault, such as a tripped watchdog, if the table refuses a command."""
        try:
            yield
        except ModbusRefusalError as exc:
            fault = None
            with suppress(DeviceFaultError):
                fault = self.status().fault
            if fault in (None, LOCAL_CONTROL):
                raise
            raise latched_fault_error(str(fault)) from exc

    def _travel(self, end: str, value: Mapping[str, float], otherwise: tuple[float, float]) -> tuple[float, float]:
        """Return the lower or upper travel limit of both joints, rad, from the table or else from the profile."""
        reported = [value.get(f"{joint}_{end}") for joint in JOINTS]
        outer, inner = (
            known if degrees is None else float(np.deg2rad(degrees))
            for degrees, known in zip(reported, otherwise, strict=True)
        )
        return outer, inner

    def _encoded(self, values: Mapping[str, float]) -> dict[str, list[int]]:
        """Encode values in rad, rad/s and rad/s² for the registers of one axis, in order of address."""
        registers = self._map.registers
        ordered = sorted(values, key=lambda name: registers[name].address)
        return {name: registers[name].encode(float(np.rad2deg(values[name])), name) for name in ordered}

    def _write_adjacent(self, encoded: Mapping[str, list[int]]) -> None:
        """Write adjacent registers of one axis in one transfer, and all others separately."""
        blocks: list[tuple[int, list[int]]] = []
        for name, words in encoded.items():
            address = self._map.registers[name].address
            if blocks and blocks[-1][0] + len(blocks[-1][1]) == address:
                blocks[-1][1].extend(words)
            else:
                blocks.append((address, list(words)))
        for address, words in blocks:
            self._link.write(address, words, unit=self._unit(next(iter(encoded))))

    def _value(self, words: list[tuple[int | None, int, list[int]]], name: str) -> float:
        register = self._map.registers[name]
        for unit, start, values in words:
            if unit == self._unit(name) and start <= register.address < start + len(values):
                first = register.address - start
                value = register.decode(values[first : first + register.count])
                if not math.isfinite(value):
                    raise DeviceFaultError("table.register_not_a_number", name=name, addresses=str(register))
                return value
        raise KeyError(name)

    def _text(self, name: str) -> str:
        register = self._map.registers[name]
        return register_text(self._link.read(register.address, register.count, self._unit(name)))


class ModbusTable(RegisterTable):
    """Driver of a table on its own port, which is `tcp://host:port` or a serial port for RTU."""

    def __init__(self, port: str, profile: TableProfile, serial: SerialSettings | None = None) -> None:
        modbus = profile.section_of(ModbusSection)
        link = ModbusLink(port, modbus.unit, modbus.timeout_s, serial or modbus.serial)
        super().__init__(link, profile)
        self._port = port
        self._texts: dict[str, str] = {}
        link.on_reopen = self._check_same_table

    def _text(self, name: str) -> str:
        self._texts[name] = super()._text(name)
        return self._texts[name]

    def _check_same_table(self) -> None:
        for name, expected in self._texts.items():
            text = super()._text(name)
            if text != expected:
                raise DeviceFaultError("table.other_table", port=self._port, found=text, expected=expected)


class SharedTable(RegisterTable):
    """Driver of axes on the link of their IMU. Raises ConfigurationError if the IMU has no commands for axes."""

    def __init__(self, imu: StreamedImu, profile: TableProfile, *, owned: bool = False) -> None:
        if not isinstance(imu, FramedImu):
            if owned:
                imu.close()
            raise ConfigurationError("table.imu_without_words", profile=profile.name)
        super().__init__(ImuWords(imu, owned=owned), profile)


def _spans(registers: list[ModbusRegister], gap: int) -> list[tuple[int, int]]:
    """Return address ranges [start, end) of registers that are at most `gap` addresses apart."""
    spans: list[tuple[int, int]] = []
    for register in sorted(registers, key=lambda r: r.address):
        end = register.address + register.count
        if spans and register.address - spans[-1][1] <= gap and end - spans[-1][0] <= _MAX_READ:
            spans[-1] = (spans[-1][0], end)
        else:
            spans.append((register.address, end))
    return spans
