"""Axes and registers in the profile of a table, validated as a whole.

A table has one controller, or a drive for each axis. Registers of a drive (`controlword`, `statusword`, ...) are
defined once, or once for each axis: `outer_controlword`, `inner_controlword`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from calstation.devices.codecs import Number, check_code, number
from calstation.devices.profiles.entries import LAST_ADDRESS, Address, Scale
from calstation.messages import Text
from calstation.schema import EntryError, StrictModel, entry, near_miss

JOINTS = ("outer", "inner")
#: Registers of the table, or of each axis's own drive.
DRIVE_REGISTERS = ("model", "controlword", "statusword", "fault")
OPTIONAL_DRIVE_REGISTERS = ("serial", "interlock", "watchdog", "heartbeat", "command", "mode", "status2")
#: Registers of a joint, and the limit of the joint that each must be able to represent. `low` and `high` are the travel
#: as set in the table, `turn_rate` is the rate of continuous rotation if it is not `target_rate`.
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
#: Registers of joints that are not negative; all others have the sign of the position.
MAGNITUDES = ("target_rate", "acceleration")
TEXTS = ("model", "serial")
#: Registers without a unit: integers without a scale.
WORDS = ("controlword", "statusword", "fault", "interlock", "heartbeat", "command", "mode", "status2")
#: Registers that a command may write.
WRITTEN = ("command", "controlword", "mode", "turn_rate", "target_rate")

#: Coarsest allowed resolution of an angle register, in standard deviations of the encoder.
_MAX_STEP = 3.0


def _table_type(name: str) -> str:
    if name != "text" and number(name).width % 2:
        raise EntryError("profile.not_whole_registers", type=name)
    return name


class ModbusRegister(StrictModel):
    """A holding register with a 0-based address; value = raw × scale in degrees, °/s, °/s² or s; a text has `words`.

    scale : negative if the table counts in the opposite sense
    word_order : order of its 16-bit words; if absent, the order of the link
    """

    address: Address
    type: Annotated[str, AfterValidator(_table_type)]
    scale: Scale = 1.0
    word_order: Literal["big", "little"] | None = None
    words: int | None = Field(default=None, ge=1, le=64)

    @property
    def count(self) -> int:
        return self.words if self.words is not None else self.number.width // 2

    @property
    def end(self) -> int:
        return self.address + self.count

    @property
    def number(self) -> Number:
        return number(self.type)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest value in the profile's unit."""
        return self.number.scaled_bounds(self.scale)

    @property
    def step(self) -> float:
        """Smallest difference between two values; 0 for floats."""
        return self.number.step(self.scale)

    def __str__(self) -> str:
        return f"{self.address}" if self.count == 1 else f"{self.address}-{self.end - 1}"

    @model_validator(mode="after")
    def _consistent(self) -> "ModbusRegister":
        if self.type != "text" and self.words is not None:
            raise EntryError("profile.belongs_to", "words", owner='type = "text"')
        if self.type == "text":
            if self.words is None:
                raise EntryError("profile.needed_by", "words", owner='type = "text"')
            for name in ("scale", "word_order"):
                if getattr(self, name) != type(self).model_fields[name].default:
                    raise EntryError("profile.not_with", name, other='type = "text"')
        if self.end - 1 > LAST_ADDRESS:
            raise EntryError("profile.past_last_address", address=self.address, last=self.end - 1)
        return self


class StatusBit(StrictModel):
    """A status flag: a bit of a register, or a constant (`homed` with absolute encoders)."""

    word: Literal["statusword", "status2"] = "statusword"
    bit: int | None = Field(default=None, ge=0, le=63)
    always: bool | None = None

    @model_validator(mode="after")
    def _one_way(self) -> "StatusBit":
        if (self.bit is None) == (self.always is None):
            raise EntryError("profile.bit_or_always")
        return self


def _is_whole(given: Any) -> bool:
    return isinstance(given, int) and not isinstance(given, bool)


def _as_bit(given: Any) -> Any:
    return {"bit": given} if _is_whole(given) else given


def _as_writes(given: Any) -> Any:
    if _is_whole(given):
        return [{"command": given}]
    if not isinstance(given, list) or not all(isinstance(w, dict) and len(w) == 1 for w in given):
        raise EntryError("profile.not_writes")
    return given


#: The number of a bit in the statusword, or another source of the flag.
Bit = Annotated[StatusBit, BeforeValidator(_as_bit)]

#: Values that a command writes, in order: the value of the `command` register, or the values of several registers.
Writes = Annotated[list[dict[str, int]], BeforeValidator(_as_writes), Field(min_length=1)]


class StatusBits(StrictModel):
    """`[status_bits]`: sources of the flags.

    quick_stop : 0 during a quick stop; remote : 0 under local control; limit : 1 at a limit
    """

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
    """`[commands]`: register values that each command writes; rate : rotate continuously at the target rates."""

    move: Writes
    stop: Writes
    home: Writes
    rate: Writes | None = None


class JointSection(StrictModel):
    """`[outer]`, `[inner]`: travel in degrees, largest rate and acceleration in °/s and °/s²."""

    low_deg: float
    high_deg: float
    max_rate_dps: float = Field(gt=0)
    max_acceleration_dps2: float = Field(gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> "JointSection":
        if self.low_deg >= self.high_deg:
            raise EntryError("profile.travel_order", low=self.low_deg, high=self.high_deg)
        if not self.low_deg <= 0.0 <= self.high_deg:
            raise EntryError("profile.travel_without_home", low=self.low_deg, high=self.high_deg)
        return self


@dataclass(frozen=True)
class TableMap:
    """Registers, bits and commands of a table as defined in its profile.

    inner_apart : whether the registers of the inner axis (`inner_...`) belong to a separate drive
    """

    registers: Mapping[str, ModbusRegister]
    bits: StatusBits
    commands: TableCommands
    inner_apart: bool

    def names(self, name: str) -> tuple[str, ...]:
        """Return the names of a register: one, one for each axis, or none."""
        if name in self.registers:
            return (name,)
        return tuple(joint_name for joint_name in _of_joints(name) if joint_name in self.registers)

    def turning(self) -> tuple[str, ...]:
        """Return the registers that set the rates of continuous rotation, outer and inner."""
        return self.names("turn_rate") or self.names("target_rate")

    def check(self, axes: Sequence[JointSection], encoder_sigma: float, faults: Mapping[str, str]) -> None:
        """Raise EntryError for the first entry with which a table cannot be driven; `encoder_sigma` is in degrees."""
        self._check_names()
        self._check_overlaps()
        self._check_types()
        self._check_bits()
        self._check_commands()
        self._check_signs()
        self._check_watchdog()
        self._check_ranges(axes, encoder_sigma)
        self._check_faults(faults)

    def _check_names(self) -> None:
        of_drives = DRIVE_REGISTERS + OPTIONAL_DRIVE_REGISTERS
        known = [*of_drives, *(name for plain in (*of_drives, *JOINT_REGISTERS) for name in _of_joints(plain))]
        for name in self.registers:
            if name not in known:
                raise EntryError("entry.unknown", "registers", name, remedy=near_miss(name, known))
        for plain in (*JOINT_REGISTERS, *of_drives):
            present = [name for name in _of_joints(plain) if name in self.registers]
            missing = [name for name in _of_joints(plain) if name not in present]
            if missing and plain in JOINT_REGISTERS and plain not in OPTIONAL_JOINT_REGISTERS:
                raise EntryError("entry.missing", "registers", missing[0])
            if present and plain in self.registers:
                raise EntryError("profile.same_register_twice", "registers", present[0], other=plain)
            if present and missing:
                raise EntryError("profile.needed_by", "registers", missing[0], owner=f"registers.{present[0]}")
            if plain in DRIVE_REGISTERS and not present and plain not in self.registers:
                raise EntryError("profile.drive_register_missing", "registers", plain, name=plain)
            if plain in DRIVE_REGISTERS and plain in self.registers and self.inner_apart:
                raise EntryError("profile.one_register_of_two_drives", "registers", plain, name=plain)
        for name, other in (("outer_low", "outer_high"), ("outer_high", "outer_low")):
            if name in self.registers and other not in self.registers:
                raise EntryError("profile.needed_by", "registers", other, owner=f"registers.{name}")

    def _check_overlaps(self) -> None:
        drives: dict[bool, list[tuple[str, ModbusRegister]]] = {}
        for name, register in sorted(self.registers.items(), key=lambda item: item[1].address):
            drives.setdefault(self.inner_apart and name.startswith("inner_"), []).append((name, register))
        for drive in drives.values():
            for (first, a), (second, b) in pairwise(drive):
                if b.address < a.end:
                    key_path = ("registers", second, "address")
                    values = {"mine": str(b), "other": f"registers.{first}", "at": str(a)}
                    raise EntryError("profile.registers_overlap", *key_path, **values)

    def _check_types(self) -> None:
        for name, register in self.registers.items():
            plain = name.removeprefix("outer_").removeprefix("inner_")
            if plain in TEXTS and register.type != "text":
                raise EntryError("profile.register_is_text", "registers", name, "type", type=register.type)
            if plain not in TEXTS and register.type == "text":
                raise EntryError("profile.register_is_number", "registers", name, "type", type=register.type)
            if plain in WORDS and (not register.number.whole or register.scale != 1.0):
                raise EntryError("profile.register_is_word", "registers", name)

    def _check_bits(self) -> None:
        seen: dict[tuple[str, int], str] = {}
        for name in StatusBits.model_fields:
            bit: StatusBit | None = getattr(self.bits, name)
            key_path = ("status_bits", name)
            if bit is None:
                continue
            if bit.bit is None:
                if name != "homed" or not bit.always:
                    raise EntryError("profile.only_homed_is_constant", *key_path)
                continue
            registers = self.names(bit.word)
            if not registers:
                raise EntryError("profile.needs_register", *key_path, register=bit.word)
            width = min(8 * self.registers[register].number.width for register in registers)
            if bit.bit >= width:
                raise EntryError("entry.out_of_range", *key_path, value=bit.bit, low=0, high=width - 1)
            if other := seen.get((bit.word, bit.bit)):
                raise EntryError("profile.same_bit", *key_path, other=other, bit=bit.bit)
            seen[bit.word, bit.bit] = name
        if self.bits.interlock is not None and self.names("interlock"):
            raise EntryError("profile.interlock_twice", "status_bits", "interlock")

    def _check_commands(self) -> None:
        commands = {name: writes for name, writes in self.commands if writes is not None}
        for name, writes in commands.items():
            for register, value in (item for write in writes for item in write.items()):
                with entry("commands", name):
                    self._check_write(register, value)
        for (a, first), (b, second) in combinations(commands.items(), 2):
            if first == second:
                raise EntryError("profile.same_write", "commands", b, other=f"commands.{a}")
        for name in self.turning() if self.commands.rate is not None else ():
            if self.registers[name].bounds[0] >= 0.0:
                raise EntryError("profile.turn_rate_unsigned", "registers", name, "type")

    def _check_write(self, register: str, value: int) -> None:
        if register not in WRITTEN:
            remedy = near_miss(register, WRITTEN, Text.of("entry.choose_from", names=WRITTEN))
            raise EntryError("profile.register_not_written", name=register, remedy=remedy)
        if not self.names(register):
            raise EntryError("profile.needs_register", register=register)
        for name in self.names(register):
            low, high = self.registers[name].number.bounds
            if not low <= value <= high:
                raise EntryError("profile.value_beyond_register", value=value, name=name, low=low, high=high)

    def _check_ranges(self, axes: Sequence[JointSection], encoder_sigma: float) -> None:
        for joint, axis in zip(JOINTS, axes, strict=True):
            rate, acceleration = axis.max_rate_dps, axis.max_acceleration_dps2
            limits = {
                "travel": (axis.low_deg, axis.high_deg),
                "rate": (-rate, rate),
                "acceleration": (-acceleration, acceleration),
            }
            for plain, limit in JOINT_REGISTERS.items():
                name, (low, high) = f"{joint}_{plain}", limits[limit]
                low = 0.0 if plain in MAGNITUDES else low
                register = self.registers.get(name)
                least, most = (low, high) if register is None else register.bounds
                if register is not None and (low < least or high > most):
                    values = {"type": register.type, "scale": register.scale, "least": least, "most": most}
                    code = f"profile.narrower_than_{limit}"
                    raise EntryError(code, "registers", name, joint=joint, low=low, high=high, **values)
            for name in (f"{joint}_position", f"{joint}_target"):
                step = self.registers[name].step
                if step > _MAX_STEP * encoder_sigma:
                    raise EntryError("profile.angle_too_coarse", "registers", name, step=step, sigma=encoder_sigma)

    def _check_signs(self) -> None:
        """Check that angles are sent and read in the same sense, and that magnitudes are not negative."""
        turning = self.turning() if self.commands.rate is not None else ()
        for name in (f"{joint}_{plain}" for joint in JOINTS for plain in JOINT_REGISTERS):
            register = self.registers.get(name)
            if register is None:
                continue
            joint, _, plain = name.partition("_")
            key_path, scale = ("registers", name, "scale"), register.scale
            if plain in MAGNITUDES and scale < 0.0:
                raise EntryError("profile.negative_magnitude", *key_path, scale=scale)
            position = self.registers[f"{joint}_position"].scale
            if scale * position <= 0.0 and (plain not in MAGNITUDES or name in turning):
                code = "profile.turn_rate_needed" if plain in MAGNITUDES else "profile.opposite_sense"
                other = f"registers.{joint}_position"
                raise EntryError(code, *key_path, joint=joint, scale=scale, other=other, its=position)

    def _check_watchdog(self) -> None:
        for name in self.names("watchdog"):
            if self.registers[name].scale < 0.0:
                raise EntryError("profile.negative_timeout", "registers", name, "scale")
        fed = self.names("heartbeat")
        if fed and not self.names("watchdog"):
            raise EntryError("profile.heartbeat_without_watchdog", "registers", fed[0])

    def _check_faults(self, faults: Mapping[str, str]) -> None:
        for code in faults:
            with entry("faults", code):
                check_code(code)
                for name in self.names("fault"):
                    low, high = self.registers[name].number.bounds
                    if int(code) > high:
                        raise EntryError(
                            "profile.value_beyond_register", value=int(code), name=name, low=low, high=high
                        )


def _of_joints(name: str) -> tuple[str, str]:
    return f"outer_{name}", f"inner_{name}"
