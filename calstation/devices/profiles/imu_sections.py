"""The sections of an IMU profile: stream, noise, status, commands by protocol, corrected output."""

from typing import Literal

from pydantic import Field, field_validator

from calstation.devices.codecs import CRC_WIDTHS, ByteOrder, WordOrder, check_code
from calstation.devices.profiles.entries import Address, Word, hex_bytes
from calstation.devices.profiles.frame import FrameSection
from calstation.schema import EntryError, StrictModel, entry, near_miss

#: Op codes of the framed link and their usual numbers; `..._words` are for systems with their own indexing unit.
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

#: The usual error code of the framed link for "flash busy".
FLASH_BUSY = 3


def check_lines(lines: list[str]) -> list[str]:
    """Check command lines for a VectorNav, without $ and checksum; raises EntryError naming the line."""
    for i, line in enumerate(lines):
        if not line or not line.isascii() or not line.isprintable() or set(line) & set("$*"):
            raise EntryError("profile.not_a_command_line", i, value=line)
    return lines


class StreamSection(StrictModel):
    """`[stream]`: meaning of a count; units as in the `[imu]` section of a log.

    order : whether the stream is taken before or after the unit applies its calibration registers
    gyro_quantisation, accel_quantisation : step of the rounding; default: one count, or 0 if the frame has floats
    """

    sample_rate_hz: float = Field(gt=0, le=100_000)
    output: Literal["increment", "rate"]
    gyro_lsb: float = Field(gt=0)
    accel_lsb: float = Field(gt=0)
    gyro_quantisation: float | None = Field(default=None, ge=0)
    accel_quantisation: float | None = Field(default=None, ge=0)
    order: Literal["before_registers", "after_registers"]


class NoiseSection(StrictModel):
    """`[noise]`: random walks in rad/√s and m/s/√s, bias instabilities in rad/s and m/s²."""

    gyro_arw: float = Field(gt=0)
    accel_vrw: float = Field(gt=0)
    gyro_bias_instability: float = Field(default=0.0, ge=0)
    accel_bias_instability: float = Field(default=0.0, ge=0)


class StatusSection(StrictModel):
    """`[status]`: masks of the status word; 0 for a state that the unit does not report."""

    ready: int = Field(default=0, ge=0)
    saturated: int = Field(default=0, ge=0)
    failed: int = Field(default=0, ge=0)


class CommandTimes(StrictModel):
    """Timeouts, host time in s: for a reply, for writing the flash, and until the unit replies again after a reset."""

    timeout_s: float = Field(gt=0, le=60)
    commit_timeout_s: float = Field(default=5.0, gt=0, le=120)
    reset_timeout_s: float = Field(default=30.0, gt=0)


class CommandSection(CommandTimes):
    """`[commands]`: request and reply frames, sync | op u8 | n u8 | n bytes | checksum over op to payload.

    ops : numbers of the ops that differ from `OPS`; errors : meanings of the codes in an error reply
    busy : error codes of a unit that is busy; by default 3, or none if `errors` is given
    """

    request_sync: str
    reply_sync: str
    crc: str
    ops: dict[str, int] = Field(default_factory=dict)
    errors: dict[str, str] = Field(default_factory=dict)
    busy: list[int] | None = None

    @field_validator("ops")
    @classmethod
    def _ops(cls, ops: dict[str, int]) -> dict[str, int]:
        for name, op in ops.items():
            if name not in OPS:
                raise EntryError("entry.unknown", name, remedy=near_miss(name, OPS))
            if not 0 <= op <= 255:
                raise EntryError("entry.out_of_range", name, value=op, low=0, high=255)
        every = {**OPS, **ops}
        if len(set(every.values())) < len(every):
            raise EntryError("profile.same_op_twice")
        return ops

    @property
    def busy_codes(self) -> tuple[int, ...]:
        return tuple(self.busy) if self.busy is not None else () if self.errors else (FLASH_BUSY,)

    @field_validator("errors")
    @classmethod
    def _errors(cls, errors: dict[str, str]) -> dict[str, str]:
        for code in errors:
            with entry(code):
                check_code(code)
                if int(code) > 0xFF:
                    raise EntryError("entry.out_of_range", value=code, low=0, high=255)
        return errors

    @field_validator("request_sync", "reply_sync")
    @classmethod
    def _sync(cls, sync: str) -> str:
        if not hex_bytes(sync):
            raise EntryError("profile.no_sync_bytes")
        return sync

    @field_validator("crc")
    @classmethod
    def _known(cls, kind: str) -> str:
        if kind not in CRC_WIDTHS:
            raise EntryError("profile.unknown_check", value=kind, names=list(CRC_WIDTHS))
        return kind


class TextRegisters(StrictModel):
    """ASCII text in holding registers, two characters in each, high byte first."""

    address: Address
    words: int = Field(ge=1, le=64)


class WordCommand(StrictModel):
    """A command given by writing a value to a holding register.

    done : value of the register once the command is done; if absent, the reply to the write confirms it
    """

    address: Address
    value: Word
    done: Word | None = None


class StreamSwitch(StrictModel):
    """The holding register that switches the stream; off : value during register access, if the unit requires it."""

    address: Address
    on: Word
    off: Word | None = None

    @property
    def values(self) -> tuple[int, ...]:
        return (self.on,) if self.off is None else (self.on, self.off)


class ModbusUnitSection(CommandTimes):
    """`[modbus]`: the unit's registers over Modbus RTU, on the line of its stream. Addresses are 0-based.

    model, serial, firmware : text registers; byte_order, word_order : orders in the calibration registers
    page : register that selects the page; commit, reset, stream : the registers of these commands
    """

    unit: int = Field(ge=1, le=247)
    model: TextRegisters
    serial: TextRegisters
    firmware: TextRegisters | None = None
    byte_order: ByteOrder = "big"
    word_order: WordOrder | None = None
    page: Address | None = None
    commit: WordCommand
    reset: WordCommand
    stream: StreamSwitch | None = None

    @property
    def ranges(self) -> dict[str, tuple[int, int]]:
        """Address ranges [first, last + 1) of everything except the calibration registers, by name."""
        found = {}
        for text in ("model", "serial", "firmware"):
            if (registers := getattr(self, text)) is not None:
                found[text] = (registers.address, registers.address + registers.words)
        for command in ("commit", "reset", "stream"):
            if (register := getattr(self, command)) is not None:
                found[command] = (register.address, register.address + 1)
        if self.page is not None:
            found["page"] = (self.page, self.page + 1)
        return found

    @property
    def written(self) -> dict[str, tuple[int, ...]]:
        """Values that each command writes to its register; the value distinguishes commands that share a register."""
        switch = {} if self.stream is None else {"stream": self.stream.values}
        return {"commit": (self.commit.value,), "reset": (self.reset.value,), **switch}


class VectorNavSection(CommandTimes):
    """`[vectornav]`: commands as lines $VN...*checksum.

    start : lines that configure and start the stream, without $ and checksum, e.g. "VNWRG,75,1,4,05,0001,001C"
    digits : number of significant digits of a written value
    commit_timeout_s : timeout of a commit, which takes about half a second
    """

    check: Literal["xor8", "crc16_xmodem"] = "xor8"
    start: list[str] = Field(default_factory=list)
    digits: int = Field(default=9, ge=9, le=17)
    commit_timeout_s: float = Field(default=3.0, gt=0, le=120)

    _lines = field_validator("start")(check_lines)


class CorrectedSection(StrictModel):
    """`[corrected]`: how the unit is commanded to stream its output with the registers applied; omitted if it cannot.

    stream : value that starts this stream: the byte after the op of the framed link, or the Modbus register value
    start : lines that start it on a VectorNav, without $ and checksum
    frame : frame of this stream if it differs from the raw one; it has the same units and rate
    """

    stream: Word | None = None
    start: list[str] = Field(default_factory=list)
    frame: FrameSection | None = None

    _lines = field_validator("start")(check_lines)
