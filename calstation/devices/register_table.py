"""A two-axis table behind 16-bit registers, laid out as its profile says (CiA 402 words), whatever carries them."""

from typing import Protocol

import numpy as np

from calstation.devices.endless import check_endless
from calstation.devices.interfaces import LOCAL_CONTROL, OtherModelError, TableIdentity, TableStatus
from calstation.devices.table_profile import JOINTS, RATE_COMMAND, ModbusRegister, TableProfile
from calstation.errors import ConfigurationError
from calstation.estimation.samples import snap_angles
from calstation.physics.table import JointLimits

SHUTDOWN, SWITCH_ON, ENABLE, FAULT_RESET = 0x06, 0x07, 0x0F, 0x86
_POLLED = (
    "statusword",
    "fault",
    "interlock",
    "watchdog",
    *(f"{joint}_{name}" for joint in JOINTS for name in ("position", "rate", "low", "high")),
)
_LARGEST_READ = 120  # registers in one transfer


class RegisterLink(Protocol):
    """What carries the registers. Both calls are bounded in time and raise DeviceFaultError where they fail."""

    @property
    def heard(self) -> bytes:
        """The bytes that came last, whether they make sense or not."""

    def read(self, address: int, count: int) -> list[int]:
        """Read registers; a lost transfer is repeated."""

    def write(self, address: int, values: list[int], repeat: bool = True) -> None:
        """Write registers; a lost transfer is repeated only where `repeat`."""

    def close(self) -> None:
        """Hang up."""


def encode(register: ModbusRegister, value: float, name: str) -> list[int]:
    """A value in the profile's unit as registers, high word first.

    Raises ConfigurationError where it does not fit.
    """
    raw = round(value / register.scale)
    low, high = register.bounds
    if not low <= raw <= high:
        raise ConfigurationError(
            f"table: {name} = {value:g} does not fit its register ({low * register.scale:g} to"
            f" {high * register.scale:g}); correct the schedule or the table profile"
        )
    return [raw >> shift & 0xFFFF for shift in range(16 * (register.count - 1), -1, -16)]


def decode(register: ModbusRegister, words: list[int]) -> float:
    """Registers, high word first, as a value in the profile's unit."""
    raw = 0
    for word in words:
        raw = raw << 16 | word
    if register.type[0] == "i" and raw >> (16 * register.count - 1):
        raw -= 1 << 16 * register.count
    return raw * register.scale


class RegisterTable:
    """The table of a profile behind a link.

    Moves are absolute, so a repeated transfer never adds to a motion; homing is never repeated.

    Parameters
    ----------
    link : carries the registers
    profile : what they mean
    gap : unused registers that may be read along
    """

    def __init__(self, link: RegisterLink, profile: TableProfile, gap: int) -> None:
        self._link = link
        self._profile = profile
        self._powered = False
        self._spans = _spans([profile.registers[name] for name in _POLLED], gap)
        geometry = profile.geometry().limits
        self._rate, self._acceleration = geometry.rate, geometry.acceleration

    def identify(self) -> TableIdentity:
        """Model and serial number; raises OtherModelError where another model answers."""
        identity = TableIdentity(self._text("model"), self._text("serial"))
        if self._profile.model not in identity.model:
            raise OtherModelError(
                f"table: model '{identity.model}' answers, the profile is for '{self._profile.model}';"
                " choose the right table profile in the station file",
                identity.model,
                self._profile.model,
            )
        return identity

    def status(self) -> TableStatus:
        """Poll the table, in one transfer where the profile's layout allows."""
        words = {start: self._link.read(start, end - start) for start, end in self._spans}
        value = {name: self._pick(words, name) for name in _POLLED}
        bits = self._profile.status_bits
        word = int(value["statusword"])
        degrees = {
            n: np.array([value[f"{j}_{n}"] for j in JOINTS]) for n in ("position", "rate", "low", "high")
        }
        low, high = np.deg2rad(degrees["low"]), np.deg2rad(degrees["high"])
        return TableStatus(
            angles=snap_angles(np.deg2rad(degrees["position"])),
            rates=np.deg2rad(degrees["rate"]),
            enabled=bool(word >> bits["enabled"] & 1),
            homed=bool(word >> bits["homed"] & 1),
            moving=bool(word >> bits["moving"] & 1),
            settled=bool(word >> bits["settled"] & 1),
            fault=self._fault(word, int(value["fault"])),
            interlock_closed=int(value["interlock"]) == 1,
            watchdog=value["watchdog"],
            limits=JointLimits(
                (float(low[0]), float(low[1])),
                (float(high[0]), float(high[1])),
                self._rate,
                self._acceleration,
            ),
        )

    def enable(self) -> None:
        """Switch both axes on, by the CiA 402 sequence."""
        for word in (SHUTDOWN, SWITCH_ON, ENABLE):
            self._write("controlword", word)
        self._powered = True

    def disable(self) -> None:
        """Switch both axes off."""
        self._powered = False
        self._write("controlword", SHUTDOWN)

    def home(self) -> None:
        """Start homing; a lost answer is a fault, never a second homing."""
        self._write("command", self._profile.commands["home"], repeat=False)

    def move(self, outer: float, inner: float, rate: float, acceleration: float) -> None:
        """Start both joints towards absolute angles; rad, rad/s, rad/s²."""
        for joint, angle in zip(JOINTS, (outer, inner), strict=True):
            self._write_together(
                {
                    f"{joint}_target": float(np.rad2deg(angle)),
                    f"{joint}_target_rate": float(np.rad2deg(rate)),
                    f"{joint}_acceleration": float(np.rad2deg(acceleration)),
                }
            )
        self._write("command", self._profile.commands["move"])

    def rate(self, outer: float, inner: float, acceleration: float) -> None:
        """Turn both joints endlessly at these rates until stopped; rad/s, rad/s². See `interfaces.Table`."""
        command = self._profile.commands.get(RATE_COMMAND)
        if command is None:
            raise ConfigurationError("table: the profile has no commands.rate; add it")
        check_endless(self._profile, self.status().watchdog, (outer, inner), acceleration)
        for joint, rate in zip(JOINTS, (outer, inner), strict=True):
            self._write_together(
                {
                    f"{joint}_target_rate": float(np.rad2deg(rate)),
                    f"{joint}_acceleration": float(np.rad2deg(acceleration)),
                }
            )
        self._write("command", command)

    def stop(self) -> None:
        """Decelerate to rest."""
        self._write("command", self._profile.commands["stop"])

    def reset_fault(self) -> None:
        """Clear a latched fault by a rising edge of the reset bit; the axes stay off."""
        self._powered = False
        for word in (SHUTDOWN, FAULT_RESET, SHUTDOWN):
            self._write("controlword", word)

    def heartbeat(self) -> None:
        """Feed the table's watchdog."""
        self._write("heartbeat", 1)

    def close(self) -> None:
        """Hang up."""
        self._link.close()

    @property
    def heard(self) -> bytes:
        """The bytes that came last, whether they make sense or not."""
        return self._link.heard

    def _fault(self, word: int, code: int) -> str | None:
        """What is latched, or keeps the table from obeying: a fault first, then what bits 5, 9 and 11 say."""
        bits = self._profile.status_bits
        if word >> bits["fault"] & 1 or code != 0:
            return self._profile.faults.get(str(code), f"code {code}")
        if "remote" in bits and not word >> bits["remote"] & 1:
            return LOCAL_CONTROL
        # A drive that is off may show anything in this bit (CiA 402-2, table 30).
        if "quick_stop" in bits and self._powered and not word >> bits["quick_stop"] & 1:
            return "quick stop"
        if "limit" in bits and word >> bits["limit"] & 1:
            return "limit"
        return None

    def _write(self, name: str, value: float, repeat: bool = True) -> None:
        register = self._profile.registers[name]
        self._link.write(register.address, encode(register, value, name), repeat)

    def _write_together(self, values: dict[str, float]) -> None:
        """Write neighbouring registers in one transfer, others in one each."""
        registers = self._profile.registers
        pending: list[int] = []
        start = end = -1
        for name in sorted(values, key=lambda n: registers[n].address):
            register = registers[name]
            if register.address != end:
                if pending:
                    self._link.write(start, pending)
                pending, start = [], register.address
            pending = pending + encode(register, values[name], name)
            end = register.address + register.count
        self._link.write(start, pending)

    def _pick(self, words: dict[int, list[int]], name: str) -> float:
        register = self._profile.registers[name]
        for start, values in words.items():
            if start <= register.address < start + len(values):
                place = register.address - start
                return decode(register, values[place : place + register.count])
        raise KeyError(name)

    def _text(self, name: str) -> str:
        register = self._profile.registers[name]
        words = self._link.read(register.address, register.count)
        raw = b"".join(word.to_bytes(2, "big") for word in words)
        return raw.split(b"\0")[0].decode("ascii", errors="replace").strip()


def _spans(registers: list[ModbusRegister], gap: int) -> list[tuple[int, int]]:
    """Address ranges [start, end) that cover the registers, joined over at most `gap` unused ones."""
    spans: list[tuple[int, int]] = []
    for register in sorted(registers, key=lambda r: r.address):
        end = register.address + register.count
        if spans and register.address - spans[-1][1] <= gap and end - spans[-1][0] <= _LARGEST_READ:
            spans[-1] = (spans[-1][0], end)
        else:
            spans.append((register.address, end))
    return spans
