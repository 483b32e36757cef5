"""IMU profiles (`data/imus`): stream frame, commands, register map, noise and priors, checked as a whole."""

from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from calstation.devices.codecs.frame_checks import CRC_WIDTHS
from calstation.devices.codecs.numbers import ByteOrder, WordOrder, check_code, number
from calstation.devices.links.serial_link import SerialSettings
from calstation.devices.profiles.channels import CHANNELS
from calstation.devices.profiles.corrected import CorrectedSection, check_corrected
from calstation.devices.profiles.frame import FrameSection, hex_bytes, unknown_field
from calstation.devices.profiles.imu_checks import (
    check_baud,
    check_modbus_map,
    check_nanoseconds,
    check_samples,
    check_status,
    check_sync,
    check_wrap,
)
from calstation.devices.profiles.registers import RegisterEntry, check_registers
from calstation.physics.parameters import GROUPS, NAMES, PARAMETERS
from calstation.schema import EntryError, StrictModel, entry, load, suggestion

#: Status words, taken together as one of 48 bits, `status` the lowest 16.
STATUS_WORDS = ("status", "status2", "status3")
FIELDS = ("counter", *CHANNELS, "temperature", *STATUS_WORDS)


#: Ops of the framed link, and their usual numbers; those of words belong to systems with axes of their own.
OPS = {
    "identify": 1,
    "read": 2,
    "write": 3,
    "commit": 4,
    "reset": 5,
    "stream": 6,
    "read_words": 7,
    "write_words": 8,
    "error": 255,
}


#: The usual code of the framed link's error that its flash is being burnt.
FLASH_BUSY = 3


class StreamSection(StrictModel):
    """`[stream]`: what a count means; units as in a log's `[imu]`.

    order : whether the stream is taken before or after the unit's own calibration registers
    """

    sample_rate_hz: float = Field(gt=0, le=100_000)
    output: Literal["increment", "rate"]
    gyro_lsb: float = Field(gt=0)
    accel_lsb: float = Field(gt=0)
    order: Literal["before_registers", "after_registers"]


class NoiseSection(StrictModel):
    """`[noise]`: rad/√s, m/s/√s, rad/s, m/s²."""

    gyro_arw: float = Field(gt=0)
    accel_vrw: float = Field(gt=0)
    gyro_bias_instability: float = Field(default=0.0, ge=0)
    accel_bias_instability: float = Field(default=0.0, ge=0)


class StatusSection(StrictModel):
    """`[status]`: masks of the status word; 0 where the unit does not tell."""

    ready: int = Field(default=0, ge=0)
    saturated: int = Field(default=0, ge=0)
    failed: int = Field(default=0, ge=0)


class CommandSection(StrictModel):
    """`[commands]`: request and reply frames, sync | op u8 | n u8 | n bytes | check over op to payload.

    ops : numbers of the ops where they are not `OPS`; errors : meaning of the codes of an error's reply
    busy : codes of the errors that say "not yet"; absent 3, where errors are the usual ones
    timeout_s : host time for an answer; commit_timeout_s : until the flash is burnt; reset_timeout_s : for the unit to
        answer again after a reset
    """

    request_sync: str
    reply_sync: str
    crc: str
    ops: dict[str, int] = Field(default_factory=dict)
    errors: dict[str, str] = Field(default_factory=dict)
    busy: list[int] | None = None
    timeout_s: float = Field(gt=0, le=60)
    commit_timeout_s: float = Field(default=5.0, gt=0, le=120)
    reset_timeout_s: float = Field(default=30.0, gt=0)

    @field_validator("ops")
    @classmethod
    def _ops(cls, ops: dict[str, int]) -> dict[str, int]:
        for name, op in ops.items():
            if name not in OPS:
                raise ValueError(f"'{name}' is no op{suggestion(name, tuple(OPS)) or '; remove it'}")
            if not 0 <= op <= 255:
                raise ValueError(f"{name} = {op} is out of range; it must be 0 to 255")
        numbers = list({**OPS, **ops}.values())
        if len(set(numbers)) < len(numbers):
            raise ValueError("two ops have the same number; correct one")
        return {**OPS, **ops}

    @property
    def busy_codes(self) -> tuple[int, ...]:
        """Codes of the errors that say "not yet"."""
        return tuple(self.busy) if self.busy is not None else () if self.errors else (FLASH_BUSY,)

    @field_validator("errors")
    @classmethod
    def _errors(cls, errors: dict[str, str]) -> dict[str, str]:
        for code in errors:
            with entry(code):
                check_code(code)
                if int(code) > 0xFF:
                    raise ValueError("is more than a byte, so no unit tells it; correct it")
        return errors

    @field_validator("request_sync", "reply_sync")
    @classmethod
    def _sync(cls, sync: str) -> str:
        if not hex_bytes(sync):
            raise ValueError('is empty; write bytes like "55 A5"')
        return sync

    @field_validator("crc")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in CRC_WIDTHS:
            raise ValueError(f"check '{kind}' is unknown; it must be one of {', '.join(CRC_WIDTHS)}")
        return kind


class TextRegisters(StrictModel):
    """ASCII in holding registers, two characters each, high byte first."""

    address: int = Field(ge=0, le=0xFFFF)
    words: int = Field(ge=1, le=64)


class WordCommand(StrictModel):
    """A value that does something when it is written to a holding register.

    done : what the register reads once it is done; the answer to the write is enough where absent
    """

    address: int = Field(ge=0, le=0xFFFF)
    value: int = Field(ge=0, le=0xFFFF)
    done: int | None = Field(default=None, ge=0, le=0xFFFF)


class StreamSwitch(StrictModel):
    """The holding register that switches the stream; off : while registers are asked, where the unit needs that."""

    address: int = Field(ge=0, le=0xFFFF)
    on: int = Field(ge=0, le=0xFFFF)
    off: int | None = Field(default=None, ge=0, le=0xFFFF)


class ModbusUnitSection(StrictModel):
    """`[modbus]`: the unit's registers over Modbus RTU, on the line of its stream. Addresses are 0-based.

    model, serial, firmware : texts; byte_order, word_order : of the calibration registers
    page : register that chooses the page; commit, reset, stream : what they take
    timeout_s, commit_timeout_s, reset_timeout_s : host time for an answer, for a commit, until it answers again
    """

    unit: int = Field(ge=1, le=247)
    model: TextRegisters
    serial: TextRegisters
    firmware: TextRegisters | None = None
    byte_order: ByteOrder = "big"
    word_order: WordOrder | None = None
    page: int | None = Field(default=None, ge=0, le=0xFFFF)
    commit: WordCommand
    reset: WordCommand
    stream: StreamSwitch | None = None
    timeout_s: float = Field(gt=0, le=60)
    commit_timeout_s: float = Field(default=5.0, gt=0, le=120)
    reset_timeout_s: float = Field(default=30.0, gt=0)


class VectorNavSection(StrictModel):
    """`[vectornav]`: commands in lines, $VN...*check.

    start : what configures and starts the stream, without $ and check, e.g. "VNWRG,75,1,4,05,0001,001C"
    digits : significant ones of a value that is written
    commit_timeout_s : a commit takes about half a second
    """

    check: Literal["xor8", "crc16_xmodem"] = "xor8"
    start: list[str] = Field(default_factory=list)
    digits: int = Field(default=9, ge=9, le=17)
    timeout_s: float = Field(gt=0, le=60)
    commit_timeout_s: float = Field(default=3.0, gt=0, le=120)
    reset_timeout_s: float = Field(default=30.0, gt=0)

    @field_validator("start")
    @classmethod
    def _lines(cls, start: list[str]) -> list[str]:
        for line in start:
            if not line or not line.isascii() or not line.isprintable() or set(line) & set("$*"):
                raise ValueError(f"{line!r} must be one line of ASCII without $ and check; correct it")
        return start


#: The section that each protocol needs.
_SECTIONS = {"framed": "commands", "modbus": "modbus", "vectornav": "vectornav"}


class PriorSigma(StrictModel):
    """`[prior.NAME]`: of a parameter or a group, SI."""

    sigma: float = Field(gt=0)


class ImuProfile(StrictModel):
    """One type of IMU: all that driver, register transfer and solvers must know of it.

    model : text that the unit's own model name must contain
    protocol : how it takes commands: framed, by `[commands]`; modbus, by `[modbus]`; vectornav, by `[vectornav]`;
        stream, none at all
    without_register : parameters and groups that the unit has no register for
    flash_cycles_max : how often its registers may be committed, by its data sheet
    corrected : how a stream before the registers is exchanged for one behind them
    """

    name: str
    model: str = Field(min_length=1)
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

    @field_validator("model")
    @classmethod
    def _says_something(cls, model: str) -> str:
        if not model.strip():
            raise ValueError(
                "is blank, so it tells no unit from another; write what its own model name contains"
            )
        return model

    @field_validator("frame")
    @classmethod
    def _sample(cls, frame: FrameSection) -> FrameSection:
        for i, f in enumerate(frame.fields):
            if f.name not in FIELDS and not f.name.startswith("spare"):
                raise EntryError(unknown_field(f.name, FIELDS), "fields", i)
        check_samples(frame, STATUS_WORDS)
        return frame

    @field_validator("prior")
    @classmethod
    def _known(cls, prior: dict[str, PriorSigma]) -> dict[str, PriorSigma]:
        for name in prior:
            if name not in NAMES and name not in GROUPS:
                raise ValueError(f"'{name}' is no parameter or group{suggestion(name, NAMES + GROUPS)}")
        return prior

    @model_validator(mode="before")
    @classmethod
    def _addresses(cls, data: Any) -> Any:
        """Tells each entry how many addresses a number takes on this link, where it does not say so itself."""
        if not isinstance(data, dict) or not isinstance(data.get("registers"), list):
            return data
        protocol = data.get("protocol")
        if protocol not in ("vectornav", "modbus"):
            return data
        entries = []
        for told in data["registers"]:
            entry = told
            if isinstance(told, dict) and "span" not in told:
                with suppress(ValueError, TypeError):  # an unknown type is told by its own entry
                    width = number(told.get("type", "f32")).width
                    entry = {**told, "span": max(1, width // 2) if protocol == "modbus" else 0}
            entries.append(entry)
        return {**data, "registers": entries}

    @field_validator("registers")
    @classmethod
    def _by_address(cls, registers: list[RegisterEntry]) -> list[RegisterEntry]:
        return sorted((r.at_row(i) for i, r in enumerate(registers)), key=lambda r: r.key)

    @model_validator(mode="after")
    def _section_of_protocol(self) -> "ImuProfile":
        for protocol, section in _SECTIONS.items():
            if (self.protocol == protocol) != (getattr(self, section) is not None):
                raise ValueError(
                    f'protocol = "{self.protocol}" needs [{section}]; add it'
                    if self.protocol == protocol
                    else f'[{section}] does not belong to protocol = "{self.protocol}"; remove it'
                )
        if self.protocol == "stream" and self.registers:
            raise ValueError('registers do not belong to protocol = "stream", which writes none; remove them')
        return self

    @model_validator(mode="after")
    def _register_map(self) -> "ImuProfile":
        pages = self.modbus is not None and self.modbus.page is not None
        for told in self.registers:
            if self.protocol == "modbus" and number(told.type).width % 2:
                raise EntryError(
                    f"{told}: type {told.type} does not fill 16-bit registers; correct it",
                    *("registers", told.row, "type"),
                )
        check_registers(self.registers, self.prior_sigmas(), self.without_register, pages=pages)
        if self.modbus is not None:
            check_modbus_map(self.modbus, self.registers)
        return self

    @model_validator(mode="after")
    def _stream_whole(self) -> "ImuProfile":
        self._check_stream(self.frame)
        if self.commands is not None:
            with entry("frame"):
                check_sync(self.frame, hex_bytes(self.commands.reply_sync))
        return self

    @model_validator(mode="after")
    def _corrected_stream(self) -> "ImuProfile":
        if self.corrected is None:
            return self
        switch = None if self.modbus is None else self.modbus.stream
        raw: tuple[int, ...] | None = (0, 1) if self.protocol == "framed" else None
        if switch is not None:
            raw = (switch.on,) if switch.off is None else (switch.on, switch.off)
        check_corrected(self.corrected, self.protocol, self.stream.order, raw)
        if self.corrected.frame is not None:
            with entry("corrected", "frame"):
                type(self)._sample(self.corrected.frame)
                self._check_stream(self.corrected.frame)
                if self.commands is not None:
                    check_sync(self.corrected.frame, hex_bytes(self.commands.reply_sync))
        return self

    def _check_stream(self, frame: FrameSection) -> None:
        """Does a stream of these frames carry what is looked for, and does the link carry it? Raises ValueError."""
        rate = self.stream.sample_rate_hz
        check_status(self.status, frame, STATUS_WORDS)
        check_wrap(frame, rate)
        if "baud" in self.link.model_fields_set:
            check_baud(self.link, frame, rate)
        if self.protocol == "vectornav":
            check_nanoseconds(frame, rate)

    @property
    def frames(self) -> tuple[FrameSection, ...]:
        """Those of all streams that the unit is told to send."""
        own = self.corrected.frame if self.corrected is not None else None
        return (self.frame,) if own is None else (self.frame, own)

    @property
    def timeout_s(self) -> float:
        """Host time for an answer, s."""
        section = self.commands or self.modbus or self.vectornav
        return section.timeout_s if section is not None else 1.0

    def with_timeout(self, seconds: float) -> "ImuProfile":
        """The profile with another time for an answer, s."""
        name = _SECTIONS.get(self.protocol)
        if name is None:
            return self
        section = getattr(self, name).model_copy(update={"timeout_s": seconds})
        return self.model_copy(update={name: section})

    def prior_sigmas(self) -> dict[str, float]:
        """Prior standard deviations by parameter, SI, for those that the profile states."""
        return {
            p.name: self.prior.get(p.name, self.prior.get(p.group, PriorSigma(sigma=1.0))).sigma
            for p in PARAMETERS
            if p.name in self.prior or p.group in self.prior
        }


def load_imu_profile(path: Path) -> ImuProfile:
    """Read and check an IMU profile; raises ConfigurationError naming file, entry and mend."""
    return load(ImuProfile, path)
