"""Axes and registers in the profile of a table.

A table has one controller or a drive for each axis. The registers of a drive (`controlword`, `statusword`, ...) are
defined once or for each axis (`outer_controlword`, `inner_controlword`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from calstation.devices.codecs import Number, is_code, number
from calstation.devices.profiles.entries import (
    LAST_ADDRESS,
    Address,
    ProfileSection,
    Rules,
    Scale,
    each_item,
    excludes,
    needs,
    only_if,
    only_with,
)
from calstation.errors import ConfigurationError
from calstation.messages import Text
from calstation.schema import EntryError, StrictModel, near_miss

if TYPE_CHECKING:
    from calstation.devices.profiles.table import TableProfile

JOINTS = ("outer", "inner")
#: Registers of the table, or of the drive of each axis.
DRIVE_REGISTERS = ("model", "controlword", "statusword", "fault")
OPTIONAL_DRIVE_REGISTERS = ("serial", "interlock", "watchdog", "heartbeat", "command", "mode", "status2")
#: Registers of a joint, and the limit of the joint that each register must be able to represent. `low` and `high` are
#: the travel as configured in the table; `turn_rate` sets the rate of continuous rotation if `target_rate` does not.
JOINT_REGISTERS = {
    "position": "travel",
    "rate": "rate",
    "target": "travel",
    "target_rate": "rate",
    "acceleration": "acceleration",
    "low": "travel",
    "high": "travel",
    "turn_rate": "rate",
}
OPTIONAL_JOINT_REGISTERS = ("low", "high", "turn_rate")
#: Registers of joints whose values are not negative; all others have the sign of the position.
UNSIGNED_REGISTERS = ("target_rate", "acceleration")
TEXT_REGISTERS = ("model", "serial")
#: Registers that contain integers without a unit and without a scale.
WORD_REGISTERS = ("controlword", "statusword", "fault", "interlock", "heartbeat", "command", "mode", "status2")
#: Registers that a command may write.
COMMAND_REGISTERS = ("command", "controlword", "mode", "turn_rate", "target_rate")

#: Coarsest allowed resolution of an angle register, in standard deviations of the encoder.
_MAX_STEP = 3.0


def _table_type(name: str) -> str:
    if name != "text" and number(name).width % 2:
        raise EntryError("profile.not_whole_registers", type=name)
    return name


class ModbusRegister(ProfileSection):
    """A holding register with a 0-based address, which contains raw × scale in degrees, °/s, °/s² or s, or a text."""

    address: Address
    type: Annotated[str, AfterValidator(_table_type)]
    scale: Scale = 1.0
    word_order: Literal["big", "little"] | None = None
    words: int | None = Field(default=None, ge=1, le=64)

    @property
    def count(self) -> int:
        """Number of 16-bit registers."""
        return self.words if self.words is not None else self.number.width // 2

    @property
    def end(self) -> int:
        """Address after the last register."""
        return self.address + self.count

    @property
    def number(self) -> Number:
        """Type of the number in the registers."""
        return number(self.type)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest value in the profile's unit."""
        return self.number.scaled_bounds(self.scale)

    @property
    def step(self) -> float:
        """Smallest difference between two values; 0 for floats."""
        return self.number.step(self.scale)

    def words_of(self, raw: float) -> list[int]:
        """Return the words of a raw number. Raises ValueError if it is out of range."""
        wire = self.number.pack(raw, "big", self.word_order)
        return [int.from_bytes(wire[i : i + 2], "big") for i in range(0, len(wire), 2)]

    def encode(self, value: float, name: str) -> list[int]:
        """Return the words of a value in the profile's unit. Raises ConfigurationError if it is out of range.

        `name` is the name of the register, for the error.
        """
        try:
            return self.words_of(value / self.scale)
        except ValueError:
            low, high = self.bounds
            values = {"name": name, "value": value, "low": low, "high": high}
            raise ConfigurationError("table.value_beyond_register", **values) from None

    def decode(self, words: list[int]) -> float:
        """Return the value of words in the profile's unit, which may be NaN or infinite for floats."""
        wire = b"".join(word.to_bytes(2, "big") for word in words)
        return self.number.unpack(wire, "big", self.word_order) * self.scale

    def __str__(self) -> str:
        return f"{self.address}" if self.count == 1 else f"{self.address}-{self.end - 1}"

    rules: ClassVar[Rules["ModbusRegister"]] = (
        *only_if(lambda s: s.type != "text", only_with('type = "text"', "words")),
        *only_if(
            lambda s: s.type == "text",
            needs('type = "text"', "words"),
            excludes('type = "text"', "scale", "word_order"),
        ),
        lambda s: (
            s.end - 1 > LAST_ADDRESS and EntryError("profile.past_last_address", address=s.address, last=s.end - 1)
        ),
    )


class StatusBit(ProfileSection):
    """A status flag, which is a bit of a register or a constant (such as `homed` with absolute encoders)."""

    word: Literal["statusword", "status2"] = "statusword"
    bit: int | None = Field(default=None, ge=0, le=63)
    always: bool | None = None

    rules: ClassVar[Rules["StatusBit"]] = (
        lambda bit: (bit.bit is None) == (bit.always is None) and EntryError("profile.bit_or_always"),
    )


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _as_writes(value: Any) -> Any:
    if _is_whole(value):
        return [{"command": value}]
    if not isinstance(value, list) or not all(isinstance(w, dict) and len(w) == 1 for w in value):
        raise EntryError("profile.not_writes")
    return value


#: A bit number in the statusword, or another source of the flag.
Bit = Annotated[StatusBit, BeforeValidator(lambda value: {"bit": value} if _is_whole(value) else value)]

#: Values that a command writes in order, either to the `command` register or to several registers.
Writes = Annotated[list[dict[str, int]], BeforeValidator(_as_writes), Field(min_length=1)]


class StatusBits(StrictModel):
    """`[status_bits]`: sources of the status flags."""

    enabled: Bit
    fault: Bit
    settled: Bit
    homed: Bit
    moving: Bit | None = None
    interlock: Bit | None = None
    quick_stop: Bit | None = None
    remote: Bit | None = None
    limit: Bit | None = None


class TableCommands(StrictModel):
    """`[commands]`: register values that each command writes; `rate` starts continuous rotation at the target rates."""

    move: Writes
    stop: Writes
    home: Writes
    rate: Writes | None = None


class JointSection(ProfileSection):
    """`[outer]` and `[inner]`: travel in degrees, and largest rate and acceleration in °/s and °/s²."""

    low_deg: float
    high_deg: float
    max_rate_dps: float = Field(gt=0, le=10_000)
    max_acceleration_dps2: float = Field(gt=0, le=100_000)

    rules: ClassVar[Rules["JointSection"]] = (
        lambda joint: (
            joint.low_deg >= joint.high_deg
            and EntryError("profile.travel_order", low=joint.low_deg, high=joint.high_deg)
        ),
        lambda joint: (
            not joint.low_deg <= 0.0 <= joint.high_deg
            and EntryError("profile.travel_without_home", low=joint.low_deg, high=joint.high_deg)
        ),
    )


@dataclass(frozen=True)
class TableMap:
    """Registers, bits and commands of a table as defined in its profile.

    has_inner_drive : whether a separate drive contains the registers of the inner axis (`inner_...`)
    """

    registers: Mapping[str, ModbusRegister]
    bits: StatusBits
    commands: TableCommands
    has_inner_drive: bool

    def names(self, name: str) -> tuple[str, ...]:
        """Return the names of a register, which may exist once, for each axis, or not at all."""
        if name in self.registers:
            return (name,)
        return tuple(joint_name for joint_name in _joint_names(name) if joint_name in self.registers)

    def rate_registers(self) -> tuple[str, ...]:
        """Return the registers that set the rates of continuous rotation, first outer, then inner."""
        return self.names("turn_rate") or self.names("target_rate")


def _joint_names(name: str) -> tuple[str, str]:
    return f"outer_{name}", f"inner_{name}"


_DRIVE_NAMES = DRIVE_REGISTERS + OPTIONAL_DRIVE_REGISTERS
_KNOWN = (*_DRIVE_NAMES, *(name for base_name in (*_DRIVE_NAMES, *JOINT_REGISTERS) for name in _joint_names(base_name)))


def _missing_register_errors(profile: "TableProfile") -> Iterator[EntryError]:
    table = profile.map
    for base_name in (*JOINT_REGISTERS, *_DRIVE_NAMES):
        present = [name for name in _joint_names(base_name) if name in table.registers]
        missing = [name for name in _joint_names(base_name) if name not in present]
        if missing and base_name in JOINT_REGISTERS and base_name not in OPTIONAL_JOINT_REGISTERS:
            yield EntryError("entry.missing", "registers", missing[0])
        if present and base_name in table.registers:
            yield EntryError("profile.same_register_twice", "registers", present[0], other=base_name)
        if present and missing:
            yield EntryError("profile.needed_by", "registers", missing[0], owner=f"registers.{present[0]}")
        if base_name in DRIVE_REGISTERS and not table.names(base_name):
            yield EntryError("profile.drive_register_missing", "registers", base_name, name=base_name)
        if base_name in DRIVE_REGISTERS and base_name in table.registers and table.has_inner_drive:
            yield EntryError("profile.one_register_of_two_drives", "registers", base_name, name=base_name)
    for name, other in (("outer_low", "outer_high"), ("outer_high", "outer_low")):
        if name in table.registers and other not in table.registers:
            yield EntryError("profile.needed_by", "registers", other, owner=f"registers.{name}")


def _overlap_errors(profile: "TableProfile") -> Iterator[EntryError]:
    drives: dict[bool, list[tuple[str, ModbusRegister]]] = {}
    for name, register in sorted(profile.registers.items(), key=lambda item: item[1].address):
        drives.setdefault(profile.two_drives and name.startswith("inner_"), []).append((name, register))
    for drive in drives.values():
        for (first, a), (second, b) in pairwise(drive):
            if b.address < a.end:
                values = {"mine": str(b), "other": f"registers.{first}", "at": str(a)}
                yield EntryError("profile.registers_overlap", "registers", second, "address", **values)


def _type_errors(profile: "TableProfile", name: str, register: ModbusRegister) -> Iterator[EntryError]:
    base_name = name.removeprefix("outer_").removeprefix("inner_")
    if base_name in TEXT_REGISTERS and register.type != "text":
        yield EntryError("profile.register_is_text", "type", type=register.type)
    if base_name not in TEXT_REGISTERS and register.type == "text":
        yield EntryError("profile.register_is_number", "type", type=register.type)
    if base_name in WORD_REGISTERS and (not register.number.is_integer or register.scale != 1.0):
        yield EntryError("profile.register_is_word")


def _bit_errors(profile: "TableProfile") -> Iterator[EntryError]:
    table = profile.map
    seen: dict[tuple[str, int], str] = {}
    for name, bit in table.bits:
        key_path = ("status_bits", name)
        if bit is None:
            continue
        if bit.bit is None:
            if name != "homed" or not bit.always:
                yield EntryError("profile.only_homed_is_constant", *key_path)
            continue
        registers = table.names(bit.word)
        if not registers:
            yield EntryError("profile.needs_register", *key_path, register=bit.word)
        last = min(8 * profile.registers[register].number.width for register in registers) - 1
        if bit.bit > last:
            yield EntryError("entry.out_of_range", *key_path, value=bit.bit, low=0, high=last)
        if other := seen.get((bit.word, bit.bit)):
            yield EntryError("profile.same_bit", *key_path, other=other, bit=bit.bit)
        seen[bit.word, bit.bit] = name
    if table.bits.interlock is not None and table.names("interlock"):
        yield EntryError("profile.interlock_twice", "status_bits", "interlock")


def _command_errors(profile: "TableProfile") -> Iterator[EntryError]:
    table = profile.map
    commands = [(name, writes) for name, writes in table.commands if writes is not None]
    for command, register, value in ((name, *item) for name, writes in commands for w in writes for item in w.items()):
        if register not in COMMAND_REGISTERS:
            remedy = near_miss(register, COMMAND_REGISTERS, Text.of("entry.choose_from", names=COMMAND_REGISTERS))
            yield EntryError("profile.register_not_written", "commands", command, name=register, remedy=remedy)
        if not table.names(register):
            yield EntryError("profile.needs_register", "commands", command, register=register)
        for name in table.names(register):
            low, high = profile.registers[name].number.bounds
            if not low <= value <= high:
                values = {"value": value, "name": name, "low": low, "high": high}
                yield EntryError("profile.value_beyond_register", "commands", command, **values)
    for (a, first), (b, second) in combinations(commands, 2):
        if first == second:
            yield EntryError("profile.same_write", "commands", b, other=f"commands.{a}")
    for name in table.rate_registers() if table.commands.rate is not None else ():
        if profile.registers[name].bounds[0] >= 0.0:
            yield EntryError("profile.turn_rate_unsigned", "registers", name, "type")


def _sign_errors(profile: "TableProfile", name: str, register: ModbusRegister) -> Iterator[EntryError]:
    """Yield errors for angles that are sent and read with different signs, and for negative magnitudes."""
    joint, _, base_name = name.partition("_")
    if base_name not in JOINT_REGISTERS:
        return
    if base_name in UNSIGNED_REGISTERS and register.scale < 0.0:
        yield EntryError("profile.negative_magnitude", "scale", scale=register.scale)
    other = f"{joint}_position"
    if register.scale * profile.registers[other].scale > 0.0:
        return
    table = profile.map
    turns = table.commands.rate is not None and name in table.rate_registers()
    if base_name not in UNSIGNED_REGISTERS or turns:
        code = "profile.turn_rate_needed" if base_name in UNSIGNED_REGISTERS else "profile.opposite_sense"
        values = {"other": f"registers.{other}", "its": profile.registers[other].scale}
        yield EntryError(code, "scale", joint=joint, scale=register.scale, **values)


def _watchdog_errors(profile: "TableProfile") -> Iterator[EntryError]:
    table = profile.map
    for name in table.names("watchdog"):
        if profile.registers[name].scale < 0.0:
            yield EntryError("profile.negative_timeout", "registers", name, "scale")
    for name in table.names("heartbeat"):
        if not table.names("watchdog"):
            yield EntryError("profile.heartbeat_without_watchdog", "registers", name)


def _range_errors(profile: "TableProfile", name: str, register: ModbusRegister) -> Iterator[EntryError]:
    joint, _, base_name = name.partition("_")
    if base_name not in JOINT_REGISTERS:
        return
    section, limit = {"outer": profile.outer, "inner": profile.inner}[joint], JOINT_REGISTERS[base_name]
    rate, acceleration = section.max_rate_dps, section.max_acceleration_dps2
    limits = {"travel": (section.low_deg, section.high_deg), "rate": (-rate, rate)}
    low, high = limits.get(limit, (-acceleration, acceleration))
    low = 0.0 if base_name in UNSIGNED_REGISTERS else low
    min_value, max_value = register.bounds
    if low < min_value or high > max_value:
        values = {"type": register.type, "scale": register.scale, "least": min_value, "most": max_value}
        yield EntryError(f"profile.narrower_than_{limit}", joint=joint, low=low, high=high, **values)
    sigma = profile.accuracy.encoder_sigma_deg
    if base_name in ("position", "target") and register.step > _MAX_STEP * sigma:
        yield EntryError("profile.angle_too_coarse", step=register.step, sigma=sigma)


def _code_errors(profile: "TableProfile", code: str, meaning: str) -> Iterator[EntryError]:
    if not is_code(code):
        yield EntryError("profile.not_a_code")
    for name in profile.map.names("fault"):
        low, high = profile.registers[name].number.bounds
        if int(code) > high:
            yield EntryError("profile.value_beyond_register", value=int(code), name=name, low=low, high=high)


#: Rules for the registers, bits and commands of a profile.
MAP_RULES: Rules["TableProfile"] = (
    each_item(
        "registers",
        lambda p, name, register: name not in _KNOWN and EntryError("entry.unknown", remedy=near_miss(name, _KNOWN)),
    ),
    _missing_register_errors,
    _overlap_errors,
    each_item("registers", _type_errors),
    _bit_errors,
    _command_errors,
    each_item("registers", _sign_errors),
    _watchdog_errors,
    each_item("registers", _range_errors),
    each_item("faults", _code_errors),
)
