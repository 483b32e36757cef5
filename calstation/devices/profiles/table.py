"""Table profiles (`data/tables`): axes, limits, accuracy and Modbus registers, checked as a whole."""

import math
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from calstation.devices.links.serial_link import SerialSettings
from calstation.devices.profiles.table_registers import Axis, Bit, ModbusRegister, TableMap, Writes
from calstation.devices.profiles.text import TextSection
from calstation.errors import ConfigurationError
from calstation.physics.table import JointLimits, TableGeometry
from calstation.schema import EntryError, StrictModel, load

#: An angle in a line may be rounded by this many sigmas of the encoder.
_COARSEST = 3.0


class ImuLinkSection(StrictModel):
    """`[imu_link]`: axes commanded through the link of an inertial system that has them.

    gap : unused registers that may be read along
    word_order : of numbers of several registers, where one does not say otherwise
    rest_rate_dps : below which an axis is at rest, where no bit of the status tells that it moves
    """

    gap: int = Field(default=0, ge=0, le=100)
    word_order: Literal["big", "little"] = "big"
    rest_rate_dps: float = Field(default=0.002, gt=0)


class ModbusSection(ImuLinkSection):
    """`[modbus]`: unit number, timeouts and what may be read in one transfer.

    timeout_s : host time for an answer
    inner_unit : number of the inner axis's own drive, where each axis has one: its registers are those named `inner_`
    """

    unit: int = Field(ge=0, le=255)
    inner_unit: int | None = Field(default=None, ge=1, le=247)
    timeout_s: float = Field(gt=0, le=60)
    serial: SerialSettings = SerialSettings()

    @model_validator(mode="after")
    def _two_drives(self) -> "ModbusSection":
        if self.unit == self.inner_unit:
            raise ValueError(f"unit and inner_unit are both {self.unit}; correct one, or remove inner_unit")
        return self


class JointSection(StrictModel):
    """`[outer]`, `[inner]`: travel in degrees, largest rate and acceleration in °/s and °/s²."""

    low_deg: float
    high_deg: float
    max_rate_dps: float = Field(gt=0)
    max_acceleration_dps2: float = Field(gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> "JointSection":
        if self.low_deg >= self.high_deg:
            raise ValueError(
                f"low_deg = {self.low_deg:g} must be below high_deg = {self.high_deg:g}; correct one"
            )
        if not self.low_deg <= 0.0 <= self.high_deg:
            raise ValueError(
                f"low_deg = {self.low_deg:g} to high_deg = {self.high_deg:g} leaves out home, which is 0; count angles"
                " from home and correct them"
            )
        return self


class AccuracySection(StrictModel):
    """`[accuracy]`: worth of angles and rest under the names of a log's `[table]`, and when angles come.

    repeatability_deg : how far apart the table stands after two moves to the same angle (one sigma): what bounds a
        comparison of turns and rests that are made twice; as `encoder_sigma_deg` where absent
    poll_latency_s, poll_jitter_s : age of an angle beyond the middle of request and answer, and its sigma
    """

    encoder_sigma_deg: float = Field(gt=0, le=90)
    mount_sigma_deg: float = Field(gt=0, le=180)
    azimuth_sigma_deg: float = Field(gt=0, le=180)
    base_tilt_sigma_deg: float = Field(gt=0, le=90)
    velocity_sigma: float = Field(gt=0)
    velocity_interval_s: float = Field(gt=0)
    repeatability_deg: float | None = Field(default=None, gt=0, le=1)
    poll_latency_s: float = Field(default=0.0, ge=0)
    poll_jitter_s: float = Field(default=0.0, ge=0)


class TableProfile(StrictModel):
    """One type of table: all that driver, plans and solvers must know of it.

    model : text that the table's own model name must contain
    protocol : "modbus", by the sections `[modbus]`, `[status_bits]`, `[commands]`, `[registers]`; "imu_link", the same
        registers behind the link of the IMU that the axes belong to, with `[imu_link]`; or text by `[text]`: "atl"
        with a prompt, "acl" in plain lines, "mn" in checked lines; or "hand", rails that nobody drives, with neither
    status_bits : bit numbers in the statusword, or where else a flag stands
    commands : values of the command register, or what else each command writes
    faults : meaning of the fault codes; settle_s : from the end of a move's course until the table says settled
    link_loss_stop_s : a table without a watchdog stops its axes by itself so long after the last line that it
        hears, s; left out where it does not: then only moves to angles are allowed, never an endless rate
    """

    name: str
    model: str = Field(min_length=1)
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
    status_bits: dict[str, Bit] = Field(default_factory=dict)
    commands: dict[str, Writes] = Field(default_factory=dict)
    registers: dict[str, ModbusRegister] = Field(default_factory=dict)
    text: TextSection | None = None

    @field_validator("outer_axis", "inner_axis")
    @classmethod
    def _unit_vector(cls, axis: list[float]) -> list[float]:
        if abs(math.hypot(*axis) - 1.0) > 1e-3:
            raise ValueError(f"{axis} has length {math.hypot(*axis):.6g}; give a unit vector")
        return axis

    @field_validator("faults")
    @classmethod
    def _faults(cls, faults: dict[str, str]) -> dict[str, str]:
        if "0" in faults:
            raise EntryError("says that there is no fault, so its meaning is never told; remove it", "0")
        return faults

    @field_validator("model")
    @classmethod
    def _says_something(cls, model: str) -> str:
        if not model.strip():
            raise ValueError(
                "is blank, so it tells no table from another; write what its own model name contains"
            )
        return model

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
        axes = [
            Axis(joint.low_deg, joint.high_deg, joint.max_rate_dps, joint.max_acceleration_dps2)
            for joint in (self.outer, self.inner)
        ]
        self.map.check(axes, self.accuracy.encoder_sigma_deg, self.faults)

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
        for protocol, entry, there in (
            ("atl", "text.prompt", bool(text.prompt)),
            ("mn", "[text.checked]", text.checked is not None),
        ):
            if self.protocol == protocol and not there:
                raise ValueError(f'protocol = "{protocol}" needs {entry}; add it')
            if self.protocol != protocol and there:
                raise ValueError(
                    f'{entry} belongs to protocol = "{protocol}", not "{self.protocol}"; remove it'
                )
        step = 10.0**-text.decimals
        if step > _COARSEST * self.accuracy.encoder_sigma_deg:
            raise ValueError(
                f"text.decimals = {text.decimals} tells angles to {step:g}°, too coarse for"
                f" accuracy.encoder_sigma_deg = {self.accuracy.encoder_sigma_deg:g}; correct one"
            )

    @property
    def map(self) -> TableMap:
        """Registers, bits and commands, each register with the word order that it has on the link."""
        section = self.modbus or self.imu_link
        order = section.word_order if section is not None else "big"
        registers = {
            name: register
            if register.type == "text" or register.word_order is not None
            else register.model_copy(update={"word_order": order})
            for name, register in self.registers.items()
        }
        apart = self.modbus is not None and self.modbus.inner_unit is not None
        return TableMap(registers, self.status_bits, self.commands, apart)

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
        """The profile with a station's own time for an answer and unit number, where it has them.

        Raises ConfigurationError where that is the number of the inner axis's drive.
        """
        if self.text is not None:
            changed = {"timeout_s": timeout_s} if timeout_s is not None else {}
            return self.model_copy(update={"text": self.text.model_copy(update=changed)})
        if self.modbus is None:
            return self
        if unit is not None and unit == self.modbus.inner_unit:
            raise ConfigurationError(
                f"table.unit = {unit} is the inner axis's own drive (modbus.inner_unit of the table profile); give the"
                " outer one's"
            )
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


def _radians(outer: float, inner: float) -> tuple[float, float]:
    return float(np.deg2rad(outer)), float(np.deg2rad(inner))


def _normalised(axis: list[float]) -> tuple[float, float, float]:
    unit = np.asarray(axis) / np.linalg.norm(axis)
    return float(unit[0]), float(unit[1]), float(unit[2])


def load_table_profile(path: Path) -> TableProfile:
    """Read and check a table profile; raises ConfigurationError naming file, entry and mend."""
    return load(TableProfile, path)
