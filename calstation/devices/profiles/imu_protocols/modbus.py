"""The protocol "modbus", which accesses registers by Modbus RTU on the line of the stream."""

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Any, ClassVar

from pydantic import Field

from calstation.devices.codecs import ByteOrder, WordOrder, number
from calstation.devices.profiles.entries import LAST_ADDRESS, Address, ProfileSection, Rules, Word, with_prefix
from calstation.devices.profiles.imu_protocols.base import ImuProtocol
from calstation.devices.profiles.registers import RegisterEntry
from calstation.schema import EntryError, StrictModel


class TextRegisters(StrictModel):
    """ASCII text in holding registers, two characters in each, high byte first."""

    address: Address
    words: int = Field(ge=1, le=64)


class WordCommand(ProfileSection):
    """A command that consists of writing a value to a holding register.

    done : value of the register after the execution; if it is None, the reply to the write confirms the execution
    """

    address: Address
    value: Word
    done: Word | None = None

    rules: ClassVar[Rules["WordCommand"]] = (
        lambda s: s.done == s.value and EntryError("profile.done_at_once", "done", value=s.done),
    )


class StreamSwitch(StrictModel):
    """The holding register that switches the stream; `off` is written before register access if it is specified."""

    address: Address
    on: Word
    off: Word | None = None

    @property
    def values(self) -> tuple[int, ...]:
        """Values that are written to the register."""
        return (self.on,) if self.off is None else (self.on, self.off)


class ModbusProtocol(ImuProtocol):
    """`[modbus]`: registers of the unit on the line of its stream, accessed by Modbus RTU with 0-based addresses."""

    section: ClassVar[str] = "modbus"

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

    @staticmethod
    def address_span(width: int) -> int:
        """Return the number of 16-bit registers that a number of `width` bytes occupies."""
        return max(1, width // 2)

    @property
    def has_pages(self) -> bool:
        """Whether a register selects the page."""
        return self.page is not None

    @property
    def raw_stream(self) -> tuple[int, ...] | None:
        """Values of the register that switches the stream on and off; None without such a register."""
        return None if self.stream is None else self.stream.values

    @property
    def ranges(self) -> dict[str, tuple[int, int]]:
        """Address ranges [first, last + 1) of everything except the calibration registers, by name."""
        ranges = {}
        for text in ("model", "serial", "firmware"):
            if (registers := getattr(self, text)) is not None:
                ranges[text] = (registers.address, registers.address + registers.words)
        for command in ("commit", "reset", "stream"):
            if (register := getattr(self, command)) is not None:
                ranges[command] = (register.address, register.address + 1)
        if self.page is not None:
            ranges["page"] = (self.page, self.page + 1)
        return ranges

    @property
    def written(self) -> dict[str, tuple[int, ...]]:
        """Values that each command writes to its register; the value distinguishes commands that share a register."""
        switch = {} if self.stream is None else {"stream": self.stream.values}
        return {"commit": (self.commit.value,), "reset": (self.reset.value,), **switch}

    rules: ClassVar[Rules["ModbusProtocol"]] = (
        lambda s: (
            EntryError("profile.past_last_address", name, address=begin, last=end - 1)
            for name, (begin, end) in s.ranges.items()
            if end - 1 > LAST_ADDRESS
        ),
        lambda s: (
            EntryError("profile.registers_overlap", b, mine=_span(*other), other=f"modbus.{a}", at=_span(*at))
            for (a, at), (b, other) in combinations(s.ranges.items(), 2)
            # the value distinguishes commands that share a register
            if not {a, b} <= s.written.keys() and at[0] < other[1] and other[0] < at[1]
        ),
        lambda s: (
            EntryError("profile.same_write", b, other=f"modbus.{a}")
            for (a, values), (b, others) in combinations(s.written.items(), 2)
            if s.ranges[a] == s.ranges[b] and set(values) & set(others)
        ),
    )
    # Calibration registers of any page must not overlap the commands or the page register, which are on every page.
    profile_rules: ClassVar[Rules[Any]] = (
        lambda p: (
            with_prefix(error, "registers", register.row)
            for register in p.registers
            for error in _register_errors(register, p.modbus.ranges)
        ),
    )


def _register_errors(register: RegisterEntry, ranges: Mapping[str, tuple[int, int]]) -> Iterator[EntryError]:
    width = number(register.type).width
    if width % 2:
        yield EntryError("profile.not_whole_registers", "type", type=register.type)
    if register.span != width // 2:
        yield EntryError("profile.span", "span", value=register.span, type=register.type, needed=width // 2)
    for name, (begin, end) in ranges.items():
        if register.address < end and begin < register.end:
            values = {"mine": register.label, "other": f"modbus.{name}", "at": _span(begin, end)}
            yield EntryError("profile.registers_overlap", "address", **values)


def _span(begin: int, end: int) -> str:
    return f"{begin}" if end - begin == 1 else f"{begin}-{end - 1}"


PROTOCOL = ModbusProtocol
