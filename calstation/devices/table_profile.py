"""Table profiles (`data/tables`): axes, limits, accuracy and Modbus registers, checked as a whole."""

import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from calstation.configuration import StrictModel, load, suggestion
from calstation.devices.link import SerialSettings
from calstation.devices.text_profile import TextSection
from calstation.physics.table import JointLimits, TableGeometry

RegisterType = Literal["u16", "i16", "u32", "i32", "text"]
JOINTS = ("outer", "inner")
JOINT_REGISTERS = ("position", "rate", "target", "target_rate", "acceleration", "low", "high")
REGISTERS = (
    "model",
    "serial",
    "controlword",
    "statusword",
    "fault",
    "interlock",
    "watchdog",
    "heartbeat",
    "command",
    *(f"{joint}_{name}" for joint in JOINTS for name in JOINT_REGISTERS),
)
STATUS_BITS = ("enabled", "fault", "settled", "homed", "moving")
HINDRANCE_BITS = ("quick_stop", "remote", "limit")
"""Bits that a profile may name besides: 0 while a quick stop is in force, 0 under local control, 1 at a limit."""
COMMANDS = ("move", "stop", "home")
RATE_COMMAND = "rate"
"""The command that a profile may name besides: turn endlessly at the target rates."""
_WORDS = {"u16": 1, "i16": 1, "u32": 2, "i32": 2}


class ModbusRegister(StrictModel):
    """A holding register, 0-based; value = raw × scale in degrees, °/s, °/s² or s; text has `words`."""

    address: int = Field(ge=0, le=0xFFFF)
    type: RegisterType
    scale: float = Field(default=1.0, gt=0)
    words: int | None = Field(default=None, ge=1, le=64)

    @property
    def count(self) -> int:
        """Registers that it takes."""
        return self.words if self.words is not None else _WORDS[self.type]

    @property
    def bounds(self) -> tuple[int, int]:
        """Lowest and highest raw value."""
        bits = 16 * self.count
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.type[0] == "i" else (0, (1 << bits) - 1)

    @model_validator(mode="after")
    def _words_for_text(self) -> "ModbusRegister":
        if (self.type == "text") != (self.words is not None):
            raise ValueError('words belongs to type "text" and only there; add or remove it')
        return self


class ModbusSection(StrictModel):
    """`[modbus]`: unit number, timeouts and what may be read in one transfer.

    timeout_s : host time for an answer; gap : unused registers that may be read along
    """

    unit: int = Field(ge=0, le=255)
    timeout_s: float = Field(gt=0, le=60)
    gap: int = Field(default=0, ge=0, le=100)
    serial: SerialSettings = SerialSettings()


class ImuLinkSection(StrictModel):
    """`[imu_link]`: axes commanded through the link of an inertial system that has them.

    gap : unused registers that may be read along
    """

    gap: int = Field(default=0, ge=0, le=100)


class JointSection(StrictModel):
    """`[outer]`, `[inner]`: travel in degrees, largest rate and acceleration in °/s and °/s²."""

    low_deg: float
    high_deg: float
    max_rate_dps: float = Field(gt=0)
    max_acceleration_dps2: float = Field(gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> "JointSection":
        if self.low_deg >= self.high_deg:
            raise ValueError(f"low_deg = {self.low_deg:g} must be below high_deg = {self.high_deg:g}")
        return self


class AccuracySection(StrictModel):
    """`[accuracy]`: worth of angles and rest under the names of a log's `[table]`, and when angles come.

    poll_latency_s, poll_jitter_s : age of an angle beyond the middle of request and answer, and its sigma
    """

    encoder_sigma_deg: float = Field(gt=0, le=90)
    mount_sigma_deg: float = Field(gt=0, le=180)
    azimuth_sigma_deg: float = Field(gt=0, le=180)
    base_tilt_sigma_deg: float = Field(gt=0, le=90)
    velocity_sigma: float = Field(gt=0)
    velocity_interval_s: float = Field(gt=0)
    poll_latency_s: float = Field(default=0.0, ge=0)
    poll_jitter_s: float = Field(default=0.0, ge=0)


class TableProfile(StrictModel):
    """One type of table: all that driver, plans and solvers must know of it.

    model : text that the table's own model name must contain
    protocol : "modbus", by the sections `[modbus]`, `[status_bits]`, `[commands]`, `[registers]`; "imu_link", the same
        registers behind the link of the IMU that the axes belong to, with `[imu_link]`; or text by `[text]`: "atl"
        with a prompt, "acl" in plain lines, "mn" in checked lines; or "hand", rails that nobody drives, with neither
    status_bits : bit numbers in the statusword; commands : values of the command register
    faults : meaning of the fault codes; settle_s : from the end of a move's course until the table says settled
    link_loss_stop_s : a table without a watchdog stops its axes by itself so long after the last line that it
        hears, s; left out where it does not: then only moves to angles are allowed, never an endless rate
    """

    name: str
    model: str
    protocol: Literal["modbus", "imu_link", "atl", "acl", "mn", "hand"]
    outer_axis: list[float] = Field(min_length=3, max_length=3)
    inner_axis: list[float] = Field(min_length=3, max_length=3)
    outer_lever: Literal["estimated", "fixed"]
    settle_s: float = Field(default=1.5, ge=0, le=60)
    outer: JointSection
    inner: JointSection
    accuracy: AccuracySection
    link_loss_stop_s: float | None = Field(default=None, gt=0, le=60)
    faults: dict[str, str]
    modbus: ModbusSection | None = None
    imu_link: ImuLinkSection | None = None
    status_bits: dict[str, int] = Field(default_factory=dict)
    commands: dict[str, int] = Field(default_factory=dict)
    registers: dict[str, ModbusRegister] = Field(default_factory=dict)
    text: TextSection | None = None

    @field_validator("outer_axis", "inner_axis")
    @classmethod
    def _unit_vector(cls, axis: list[float]) -> list[float]:
        if abs(math.hypot(*axis) - 1.0) > 1e-3:
            raise ValueError(f"{axis} has length {math.hypot(*axis):.6g}; give a unit vector")
        return axis

    @model_validator(mode="after")
    def _whole(self) -> "TableProfile":
        if abs(float(np.dot(self.outer_axis, self.inner_axis))) > 0.5:
            raise ValueError("outer_axis and inner_axis are less than 60° apart; correct one of them")
        own = self.protocol if self.protocol in ("modbus", "imu_link", "hand") else "text"
        if not self.by_hand and getattr(self, own) is None:
            raise ValueError(f'protocol = "{self.protocol}" needs [{own}]; add it')
        for section in ("modbus", "imu_link", "text"):
            if section != own and getattr(self, section) is not None:
                raise ValueError(f'[{section}] does not belong to protocol = "{self.protocol}"; remove it')
        if self.by_hand:
            self._check_hand()
        elif self.text is None:
            self._check_registers()
        else:
            self._check_text(self.text)
        return self

    def _check_registers(self) -> None:
        _complete("status_bits", self.status_bits, STATUS_BITS, HINDRANCE_BITS)
        _complete("commands", self.commands, COMMANDS, (RATE_COMMAND,))
        _complete("registers", self.registers, REGISTERS)
        for name, bit in self.status_bits.items():
            if not 0 <= bit <= 15:
                raise ValueError(f"status_bits.{name} = {bit} is out of range; it must be 0 to 15")
        for code in self.faults:
            if not code.isdecimal():
                raise ValueError(f'faults.{code} must be a number in quotes, like "2"')
        ordered = sorted(self.registers.items(), key=lambda item: item[1].address)
        for (first, a), (second, b) in pairwise(ordered):
            if b.address < a.address + a.count:
                raise ValueError(
                    f"registers.{first} ({a.address}-{a.address + a.count - 1}) and registers.{second}"
                    f" ({b.address}) overlap; correct an address"
                )
        if RATE_COMMAND in self.commands:
            for joint in JOINTS:
                if self.registers[f"{joint}_target_rate"].type[0] == "u":
                    raise ValueError(
                        f"commands.rate: registers.{joint}_target_rate has no sign, so it cannot turn both ways;"
                        " correct its type or remove the command"
                    )

    def _no_registers(self) -> None:
        for name in ("status_bits", "commands", "registers"):
            if getattr(self, name):
                raise ValueError(f'[{name}] does not belong to protocol = "{self.protocol}"; remove it')

    def _check_hand(self) -> None:
        self._no_registers()
        if self.link_loss_stop_s is not None:
            raise ValueError('link_loss_stop_s does not belong to protocol = "hand"; remove it')

    def _check_text(self, text: TextSection) -> None:
        self._no_registers()
        if (self.protocol == "atl") != bool(text.prompt):
            raise ValueError(
                f'text.prompt belongs to protocol = "atl", not "{self.protocol}"; add or remove it'
            )
        if (self.protocol == "mn") != (text.checked is not None):
            raise ValueError(
                f'[text.checked] belongs to protocol = "mn", not "{self.protocol}"; add or remove it'
            )

    @property
    def by_hand(self) -> bool:
        """Whether nobody drives it: it has no link, and its angles are not known."""
        return self.protocol == "hand"

    @property
    def serial(self) -> SerialSettings:
        """Settings of a serial port, where a station has none of its own."""
        if self.text is not None:
            return self.text.serial
        return self.modbus.serial if self.modbus is not None else SerialSettings()

    @property
    def timeout_s(self) -> float:
        """Host time for an answer, s."""
        section = self.text or self.modbus
        return section.timeout_s if section is not None else 1.0

    @property
    def unit(self) -> int | None:
        """Modbus unit number, None where it has none."""
        return self.modbus.unit if self.modbus is not None else None

    def at_place(self, timeout_s: float | None, unit: int | None) -> "TableProfile":
        """The profile with a station's own time for an answer and unit number, where it has them."""
        if self.text is not None:
            changed = {"timeout_s": timeout_s} if timeout_s is not None else {}
            return self.model_copy(update={"text": self.text.model_copy(update=changed)})
        if self.modbus is None:
            return self
        told = {"timeout_s": timeout_s, "unit": unit}
        modbus = self.modbus.model_copy(update={k: v for k, v in told.items() if v is not None})
        return self.model_copy(update={"modbus": modbus})

    def geometry(self) -> TableGeometry:
        """Axes and limits in rad."""
        joints = (self.outer, self.inner)
        return TableGeometry(
            _normalised(self.outer_axis),
            _normalised(self.inner_axis),
            JointLimits(
                low=_radians(joints[0].low_deg, joints[1].low_deg),
                high=_radians(joints[0].high_deg, joints[1].high_deg),
                rate=_radians(joints[0].max_rate_dps, joints[1].max_rate_dps),
                acceleration=_radians(joints[0].max_acceleration_dps2, joints[1].max_acceleration_dps2),
            ),
        )


def _complete(
    section: str, found: Mapping[str, object], needed: tuple[str, ...], allowed: tuple[str, ...] = ()
) -> None:
    for name in needed:
        if name not in found:
            raise ValueError(f"{section}.{name} is missing; add it")
    known = needed + allowed
    for name in found:
        if name not in known:
            raise ValueError(f"{section}.{name} is unknown{suggestion(name, known) or '; remove it'}")


def _radians(outer: float, inner: float) -> tuple[float, float]:
    return float(np.deg2rad(outer)), float(np.deg2rad(inner))


def _normalised(axis: list[float]) -> tuple[float, float, float]:
    unit = np.asarray(axis) / np.linalg.norm(axis)
    return float(unit[0]), float(unit[1]), float(unit[2])


def load_table_profile(path: Path) -> TableProfile:
    """Read and check a table profile; raises ConfigurationError naming file, entry and mend."""
    return load(TableProfile, path)
