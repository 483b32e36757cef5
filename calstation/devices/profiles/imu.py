"""IMU profiles (`data/imus`): stream frame, commands, register map, noise and priors, checked as a whole."""

from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from calstation.devices.codecs import number
from calstation.devices.profiles.entries import ModelName, hex_bytes
from calstation.devices.profiles.frame import FrameSection, check_samples
from calstation.devices.profiles.imu_checks import (
    check_baud,
    check_corrected,
    check_modbus_map,
    check_nanoseconds,
    check_status,
    check_sync,
    check_wrap,
)
from calstation.devices.profiles.imu_sections import (
    CommandSection,
    CommandTimes,
    CorrectedSection,
    ModbusUnitSection,
    NoiseSection,
    StatusSection,
    StreamSection,
    VectorNavSection,
)
from calstation.devices.profiles.registers import RegisterEntry, check_registers
from calstation.devices.profiles.serial_settings import SerialSettings
from calstation.physics import GROUPS, NAMES, PARAMETERS
from calstation.schema import EntryError, StrictModel, entry, load, near_miss

#: The section that each protocol needs.
_SECTIONS = {"framed": "commands", "modbus": "modbus", "vectornav": "vectornav"}


class PriorSigma(StrictModel):
    """`[prior.NAME]`: of a parameter or a group, SI."""

    sigma: float = Field(gt=0)


class ImuProfile(StrictModel):
    """One type of IMU: all that driver, register transfer and solvers must know of it.

    model : text that the unit's own model name must contain
    protocol : of its commands: framed, with `[commands]`; modbus, with `[modbus]`; vectornav, with `[vectornav]`;
        stream, without commands
    without_register : parameters and groups that the unit has no register for
    flash_cycles_max : number of commits that its data sheet allows
    corrected : how a stream before the registers is replaced by one after them
    """

    name: str
    model: ModelName
    protocol: Literal["framed", "modbus", "vectornav", "stream"] = "framed"
    link: SerialSettings
    stream: StreamSection
    frame: FrameSection
    status: StatusSection = StatusSection()
    commands: CommandSection | None = None
    modbus: ModbusUnitSection | None = None
    vectornav: VectorNavSection | None = None
    corrected: CorrectedSection | None = None
    flash_cycles_max: int | None = Field(default=None, ge=1)
    noise: NoiseSection
    registers: list[RegisterEntry] = Field(default_factory=list)
    without_register: list[str] = Field(default_factory=list)
    prior: dict[str, PriorSigma] = Field(default_factory=dict)

    @field_validator("frame")
    @classmethod
    def _sample(cls, frame: FrameSection) -> FrameSection:
        check_samples(frame)
        return frame

    @field_validator("prior")
    @classmethod
    def _priors(cls, prior: dict[str, PriorSigma]) -> dict[str, PriorSigma]:
        for name in prior:
            if name not in NAMES and name not in GROUPS:
                remedy = near_miss(name, NAMES + GROUPS)
                raise EntryError("entry.unknown_parameter", name, name=name, remedy=remedy)
        return prior

    @model_validator(mode="before")
    @classmethod
    def _addresses(cls, data: Any) -> Any:
        """Set the span of each register entry that has none: the addresses of a number on this link."""
        if not isinstance(data, dict) or not isinstance(data.get("registers"), list):
            return data
        protocol = data.get("protocol")
        if protocol not in ("vectornav", "modbus"):
            return data
        entries = []
        for given in data["registers"]:
            entry = given
            if isinstance(given, dict) and "span" not in given:
                with suppress(ValueError, TypeError):  # an unknown type is reported by the entry itself
                    width = number(given.get("type", "f32")).width
                    entry = {**given, "span": max(1, width // 2) if protocol == "modbus" else 0}
            entries.append(entry)
        return {**data, "registers": entries}

    @field_validator("registers")
    @classmethod
    def _by_address(cls, registers: list[RegisterEntry]) -> list[RegisterEntry]:
        return sorted((r.at_row(i) for i, r in enumerate(registers)), key=lambda r: r.key)

    @model_validator(mode="after")
    def _section_of_protocol(self) -> "ImuProfile":
        own = f'protocol = "{self.protocol}"'
        for protocol, section in _SECTIONS.items():
            present = getattr(self, section) is not None
            if self.protocol == protocol and not present:
                raise EntryError("profile.needed_by", section, owner=own)
            if self.protocol != protocol and present:
                raise EntryError("profile.not_with", section, other=own)
        if self.protocol == "stream" and self.registers:
            raise EntryError("profile.not_with", "registers", other=own)
        return self

    @model_validator(mode="after")
    def _register_map(self) -> "ImuProfile":
        pages = self.modbus is not None and self.modbus.page is not None
        for register in self.registers:
            if self.protocol == "modbus" and number(register.type).width % 2:
                place = ("registers", register.row, "type")
                raise EntryError("profile.not_whole_registers", *place, type=register.type)
        check_registers(self.registers, self.prior_sigmas(), self.without_register, pages=pages)
        if self.modbus is not None:
            check_modbus_map(self.modbus, self.registers)
        return self

    @model_validator(mode="after")
    def _streams(self) -> "ImuProfile":
        self._check_stream(self.frame, "frame")
        if self.corrected is None:
            return self
        switch = None if self.modbus is None else self.modbus.stream
        raw: tuple[int, ...] | None = (0, 1) if self.protocol == "framed" else None
        if switch is not None:
            raw = switch.values
        check_corrected(self.corrected, self.protocol, self.stream.order, raw)
        if self.corrected.frame is not None:
            with entry("corrected", "frame"):
                check_samples(self.corrected.frame)
            self._check_stream(self.corrected.frame, "corrected", "frame")
        return self

    def _check_stream(self, frame: FrameSection, *place: str) -> None:
        rate, name = self.stream.sample_rate_hz, ".".join(place)
        check_status(self.status, frame, name)
        if "baud" in self.link.model_fields_set:
            check_baud(self.link, frame, rate, name)
        with entry(*place):
            check_wrap(frame, rate)
            if self.protocol == "vectornav":
                check_nanoseconds(frame, rate)
            if self.commands is not None:
                check_sync(frame, hex_bytes(self.commands.reply_sync))

    @property
    def frames(self) -> tuple[FrameSection, ...]:
        """The frames of all streams that the unit can send."""
        own = self.corrected.frame if self.corrected is not None else None
        return (self.frame,) if own is None else (self.frame, own)

    @property
    def timeout_s(self) -> float:
        """Host time for an answer, s."""
        return 1.0 if self.command_times is None else self.command_times.timeout_s

    @property
    def command_times(self) -> CommandTimes | None:
        """The section of the protocol; None for a unit without commands."""
        return self.commands or self.modbus or self.vectornav

    def with_timeout(self, seconds: float) -> "ImuProfile":
        """The profile with another host time for an answer, s."""
        name = _SECTIONS.get(self.protocol)
        if name is None:
            return self
        section = getattr(self, name).model_copy(update={"timeout_s": seconds})
        return self.model_copy(update={name: section})

    def prior_sigmas(self) -> dict[str, float]:
        """Prior standard deviations by parameter, SI, of the parameters with a prior."""
        found = {p.name: self.prior.get(p.name, self.prior.get(p.group)) for p in PARAMETERS}
        return {name: prior.sigma for name, prior in found.items() if prior is not None}


def load_imu_profile(path: Path) -> ImuProfile:
    """Read and check an IMU profile; raises ConfigurationError naming file, entry and remedy."""
    return load(ImuProfile, path)
