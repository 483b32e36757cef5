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
JOINT_REGISTERS = ("position", "rate", "target", "target_rate", "acceleration")
#: Travel as set in the table; the rate of continuous rotation, if it is not `target_rate`.
OPTIONAL_JOINT_REGISTERS = ("low", "high", "turn_rate")
TEXTS = ("model", "serial")
#: Registers without a unit: integers without a scale.
WORDS = ("controlword", "statusword", "fault", "interlock", "heartbeat", "command", "mode", "status2")
STATUS_BITS = ("enabled", "fault", "settled", "homed")
#: `quick_stop` is 0 during a quick stop, `remote` is 0 under local control, `limit` is 1 at a limit.
OPTIONAL_BITS = ("moving", "interlock", "quick_stop", "remote", "limit")
COMMANDS = ("move", "stop", "home")
#: Optional command: rotate continuously at the target rates.
RATE_COMMAND = "rate"
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
    bits: Mapping[str, StatusBit]
    commands: Mapping[str, Sequence[Mapping[str, int]]]
    inner_apart: bool

    def names(self, name: str) -> tuple[str, ...]:
        """Return the names of a register: one, one for each axis, or none."""
        if name in self.registers:
            return (name,)
        return tuple(own for own in _of_joints(name) if own in self.registers)

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
        known = [own for name in JOINT_REGISTERS + OPTIONAL_JOINT_REGISTERS for own in _of_joints(name)]
        for name in DRIVE_REGISTERS + OPTIONAL_DRIVE_REGISTERS:
            known += [name, *_of_joints(name)]
        for name in self.registers:
            if name not in known:
                raise EntryError("entry.unknown", "registers", name, remedy=near_miss(name, known))
        for name in (f"{joint}_{name}" for joint in JOINTS for name in JOINT_REGISTERS):
            if name not in self.registers:
                raise EntryError("entry.missing", "registers", name)
        for name in DRIVE_REGISTERS + OPTIONAL_DRIVE_REGISTERS:
            own = [joint_name for joint_name in _of_joints(name) if joint_name in self.registers]
            if name in self.registers and own:
                raise EntryError("profile.same_register_twice", "registers", own[0], other=name)
            if len(own) == 1:
                other = next(joint_name for joint_name in _of_joints(name) if joint_name not in own)
                raise EntryError("profile.needed_by", "registers", other, owner=f"registers.{own[0]}")
            if name in DRIVE_REGISTERS and name not in self.registers and not own:
                raise EntryError("profile.drive_register_missing", "registers", name, name=name)
            if name in DRIVE_REGISTERS and self.inner_apart and name in self.registers:
                raise EntryError("profile.one_register_of_two_drives", "registers", name, name=name)
        for joint in JOINTS:
            for name, other in ((f"{joint}_low", f"{joint}_high"), (f"{joint}_high", f"{joint}_low")):
                if name in self.registers and other not in self.registers:
                    raise EntryError("profile.needed_by", "registers", other, owner=f"registers.{name}")

    def _check_overlaps(self) -> None:
        drives: dict[bool, list[tuple[str, ModbusRegister]]] = {}
        for name, register in sorted(self.registers.items(), key=lambda item: item[1].address):
            drives.setdefault(self.inner_apart and name.startswith("inner_"), []).append((name, register))
        for drive in drives.values():
            for (first, a), (second, b) in pairwise(drive):
                if b.address < a.end:
                    place = ("registers", second, "address")
                    values = {"mine": str(b), "other": f"registers.{first}", "at": str(a)}
                    raise EntryError("profile.registers_overlap", *place, **values)

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
        for name in STATUS_BITS:
            if name not in self.bits:
                raise EntryError("entry.missing", "status_bits", name)
        known = STATUS_BITS + OPTIONAL_BITS
        seen: dict[tuple[str, int], str] = {}
        for name, bit in self.bits.items():
            place = ("status_bits", name)
            if name not in known:
                raise EntryError("entry.unknown", *place, remedy=near_miss(name, known))
            if bit.bit is None:
                if name != "homed" or not bit.always:
                    raise EntryError("profile.only_homed_is_constant", *place)
                continue
            registers = self.names(bit.word)
            if not registers:
                raise EntryError("profile.needs_register", *place, register=bit.word)
            width = min(8 * self.registers[register].number.width for register in registers)
            if bit.bit >= width:
                raise EntryError("entry.out_of_range", *place, value=bit.bit, low=0, high=width - 1)
            if other := seen.get((bit.word, bit.bit)):
                raise EntryError("profile.same_bit", *place, other=other, bit=bit.bit)
            seen[bit.word, bit.bit] = name
        if "interlock" in self.bits and self.names("interlock"):
            raise EntryError("profile.interlock_twice", "status_bits", "interlock")

    def _check_commands(self) -> None:
        for name in COMMANDS:
            if name not in self.commands:
                raise EntryError("entry.missing", "commands", name)
        known = (*COMMANDS, RATE_COMMAND)
        for name, writes in self.commands.items():
            if name not in known:
                raise EntryError("entry.unknown", "commands", name, remedy=near_miss(name, known))
            for write in writes:
                for register, value in write.items():
                    with entry("commands", name):
                        self._check_write(register, value)
        for (a, first), (b, second) in combinations(self.commands.items(), 2):
            if list(first) == list(second):
                raise EntryError("profile.same_write", "commands", b, other=f"commands.{a}")
        if RATE_COMMAND in self.commands:
            for name in self.turning():
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
            for name in ("position", "target", "low", "high"):
                if held := self._narrower(f"{joint}_{name}", axis.low_deg, axis.high_deg):
                    place = ("registers", f"{joint}_{name}")
                    raise EntryError("profile.narrower_than_travel", *place, joint=joint, **held)
            for name in ("rate", "turn_rate", "target_rate"):
                low = 0.0 if name == "target_rate" else -axis.max_rate_dps
                if held := self._narrower(f"{joint}_{name}", low, axis.max_rate_dps):
                    place = ("registers", f"{joint}_{name}")
                    raise EntryError("profile.narrower_than_rate", *place, joint=joint, **held)
            name = f"{joint}_acceleration"
            if held := self._narrower(name, 0.0, axis.max_acceleration_dps2):
                raise EntryError("profile.narrower_than_acceleration", "registers", name, joint=joint, **held)
            for name in (f"{joint}_position", f"{joint}_target"):
                step = self.registers[name].step
                if step > _MAX_STEP * encoder_sigma:
                    raise EntryError("profile.angle_too_coarse", "registers", name, step=step, sigma=encoder_sigma)

    def _narrower(self, name: str, low: float, high: float) -> dict[str, str | float]:
        """Return the values of the message if a register cannot represent `low` to `high`, else an empty dict."""
        register = self.registers.get(name)
        if register is None:
            return {}
        least, most = register.bounds
        if least <= low and high <= most:
            return {}
        return {"type": register.type, "scale": register.scale, "least": least, "most": most, "low": low, "high": high}

    def _check_signs(self) -> None:
        """Check that angles are sent and read in the same sense, and that magnitudes are not negative."""
        for joint in JOINTS:
            position = self.registers[f"{joint}_position"]
            signed = [f"{joint}_{name}" for name in ("target", "rate", "turn_rate", "low", "high")]
            unsigned = [f"{joint}_{name}" for name in ("target_rate", "acceleration")]
            if RATE_COMMAND in self.commands:
                signed += [name for name in self.turning() if name.startswith(joint)]
            for name in unsigned:
                scale = self.registers[name].scale
                if scale < 0.0:
                    raise EntryError("profile.negative_magnitude", "registers", name, "scale", scale=scale)
            for name in signed:
                register = self.registers.get(name)
                if register is not None and register.scale * position.scale <= 0.0:
                    code = "profile.turn_rate_needed" if name in unsigned else "profile.opposite_sense"
                    values = {"scale": register.scale, "other": f"registers.{joint}_position", "its": position.scale}
                    raise EntryError(code, "registers", name, "scale", joint=joint, **values)

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
