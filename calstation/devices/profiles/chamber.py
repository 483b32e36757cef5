"""Chamber profiles (`data/chambers`), which define ranges, and registers or lines of text."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from calstation.devices.profiles.entries import ProfileSection, Rules, SerialSettings, TemperatureRange, needs
from calstation.devices.profiles.table_registers import ModbusRegister, Writes
from calstation.devices.profiles.text import Flag, LineSection, check_line
from calstation.schema import EntryError, StrictModel, entry, load_once

#: Registers that the driver reads; only the first two must exist.
_REGISTERS = ("air", "set_point", "running", "alarm", "door")

Lines = Annotated[list[str], Field(min_length=1)]


class ChamberLines(ProfileSection):
    """`[text.commands]`: the lines of each command in order; without `start`, the chamber always runs."""

    set_point: Lines
    start: list[str] = Field(default_factory=list)
    stop: list[str] = Field(default_factory=list)

    rules: ClassVar[Rules["ChamberLines"]] = (lambda s: s._errors(),)

    def _errors(self) -> Iterator[EntryError]:
        named: set[str] = set()
        for name, lines in self:
            for number, line in enumerate(lines):
                with entry(name, number):
                    named |= check_line(line, ("temperature",) if name == "set_point" else (), axes=False)
        if not named:
            yield EntryError("profile.value_not_sent", "set_point", name="temperature")


class ChamberFlags(StrictModel):
    """`[text.flags]`: sources of the flags; `door` is set while the door is open."""

    running: Flag = Flag(always=True)
    alarm: Flag | None = None
    door: Flag | None = None


class ChamberTextSection(LineSection):
    """`[text]` of a chamber; queries that are not polled are sent once, when the chamber is identified."""

    decimals: int = Field(default=1, ge=0, le=9)
    commands: ChamberLines
    flags: ChamberFlags = ChamberFlags()

    rules: ClassVar[Rules[Any]] = (
        lambda s: s.needed_groups(
            {"identity": ("model",), "air": ("value",), "set_point": ("value",)}, ("identity", "air", "set_point")
        ),
        *LineSection.rules,
        lambda s: s.flag_errors(dict(s.flags)),
    )

    @property
    def polled(self) -> tuple[str, ...]:
        """Names of the queries that are sent in each poll."""
        flags = (flag.query for _, flag in self.flags if flag is not None and flag.query is not None)
        return tuple(dict.fromkeys(("air", "set_point", *flags)))


class ChamberWrites(StrictModel):
    """`[modbus.commands]`: register values that each command writes; without `start`, the chamber always runs."""

    start: Writes | None = None
    stop: Writes | None = None


class ChamberModbusSection(ProfileSection):
    """`[modbus]` of a chamber; the flags `running`, `alarm` and `door` are set if their registers are not 0.

    `expected` contains register values that are compared once, when the chamber is identified.
    """

    unit: int = Field(default=1, ge=0, le=255)
    timeout_s: float = Field(default=1.0, gt=0, le=60)
    serial: SerialSettings = SerialSettings(baud=9600)
    registers: dict[str, ModbusRegister]
    commands: ChamberWrites = ChamberWrites()
    expected: dict[str, int] = Field(default_factory=dict)

    rules: ClassVar[Rules["ChamberModbusSection"]] = (lambda s: s._errors(),)

    def _errors(self) -> Iterator[EntryError]:
        for name in _REGISTERS[:2]:
            if name not in self.registers:
                yield EntryError("entry.missing", "registers", name)
        for name, register in self.registers.items():
            if register.type == "text":
                yield EntryError("profile.register_is_number", "registers", name, "type", type=register.type)
        written = [(name, register) for name, writes in self.commands for w in writes or () for register in w]
        for name, register in (*written, *(("expected", register) for register in self.expected)):
            if register not in self.registers:
                key_path = ("expected",) if name == "expected" else ("commands", name)
                yield EntryError("profile.needs_register", *key_path, register=register)


class ChamberProfile(ProfileSection):
    """A type of chamber, with all data for its driver and the control.

    range_c : range of the set point, °C
    max_rate_c_per_min : largest rate of the air temperature, K/min
    follow_s : time within which the air temperature must approach the set point, s
    alarms : names of the alarms by number, as in the register or group `alarm`
    """

    name: str
    model: str = ""
    protocol: Literal["text", "modbus"]
    range_c: TemperatureRange
    max_rate_c_per_min: float = Field(gt=0, le=100)
    follow_s: float = Field(default=600.0, ge=60, le=7200)
    alarms: dict[str, str] = Field(default_factory=dict)
    text: ChamberTextSection | None = None
    modbus: ChamberModbusSection | None = None

    rules: ClassVar[Rules["ChamberProfile"]] = (
        lambda p: needs('protocol = "{0.protocol}"', p.protocol)(p),
        lambda p: (
            p.text is not None
            and p.modbus is not None
            and EntryError("profile.not_with", "modbus" if p.protocol == "text" else "text", other=p.protocol)
        ),
    )

    @property
    def section(self) -> ChamberTextSection | ChamberModbusSection:
        """The section of the protocol."""
        section = self.text or self.modbus
        if section is None:
            raise EntryError("entry.missing", self.protocol)
        return section

    @property
    def max_rate(self) -> float:
        """Largest rate of the air temperature, K/s."""
        return self.max_rate_c_per_min / 60.0

    def at_station(self, timeout_s: float | None) -> "ChamberProfile":
        """Return the profile with the reply timeout of a station, unless it is None."""
        if timeout_s is None:
            return self
        return self.model_copy(update={self.protocol: self.section.model_copy(update={"timeout_s": timeout_s})})

    def alarm(self, number: str) -> str:
        """Return the name of an alarm, by default the text itself or `code NUMBER`."""
        return self.alarms.get(number, number if re.search("[A-Za-z]", number) else f"code {number}")


def load_chamber_profile(path: Path) -> ChamberProfile:
    """Read and check a chamber profile. Raises ConfigurationError with the file, entry and remedy."""
    return load_once(ChamberProfile, path)
