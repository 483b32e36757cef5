"""A table's registers in its profile: numbers and texts, bits of the status, what a command writes; checked as a whole.

A table has one controller, or a drive for each axis. What belongs to a drive (`controlword`, `statusword`, ...) is
named once, or once for each axis: `outer_controlword`, `inner_controlword`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from calstation.devices.codecs.numbers import Number, check_code, number
from calstation.schema import StrictModel, entry, suggestion

JOINTS = ("outer", "inner")
#: Of the table, or of each axis's own drive.
DRIVE_REGISTERS = ("model", "controlword", "statusword", "fault")
OPTIONAL_DRIVE_REGISTERS = (
    "serial",
    "interlock",
    "watchdog",
    "heartbeat",
    "command",
    "mode",
    "status2",
)
JOINT_REGISTERS = ("position", "rate", "target", "target_rate", "acceleration")
#: Travel as the table has it set; the rate of endless turns, where it is not `target_rate`.
OPTIONAL_JOINT_REGISTERS = ("low", "high", "turn_rate")
TEXTS = ("model", "serial")
#: Registers that are taken as they stand: whole numbers without a scale.
WORDS = ("controlword", "statusword", "fault", "interlock", "heartbeat", "command", "mode", "status2")
STATUS_BITS = ("enabled", "fault", "settled", "homed")
#: Bits that a profile may name besides: 0 while a quick stop is in force, 0 under local control, 1 at a limit.
HINDRANCE_BITS = ("quick_stop", "remote", "limit")
OPTIONAL_BITS = ("moving", "interlock", *HINDRANCE_BITS)
COMMANDS = ("move", "stop", "home")
#: The command that a profile may name besides: turn endlessly at the target rates.
RATE_COMMAND = "rate"
#: Registers that a command may write.
WRITTEN = ("command", "controlword", "mode", "turn_rate", "target_rate")

_LAST_ADDRESS = 0xFFFF
#: An angle's step may be this many sigmas of the encoder: coarser, and no encoder could be so good.
_COARSEST = 3.0


def _table_type(name: str) -> str:
    if name != "text" and number(name).width % 2:
        raise ValueError(f"type '{name}' does not fill registers of 16 bits; correct it")
    return name


class ModbusRegister(StrictModel):
    """A holding register, 0-based; value = raw × scale in degrees, °/s, °/s² or s; text has `words`.

    scale : negative where the table counts the other way round
    word_order : of its 16-bit words, the link's own where absent
    """

    address: int = Field(ge=0, le=_LAST_ADDRESS)
    type: Annotated[str, AfterValidator(_table_type)]
    scale: float = 1.0
    word_order: Literal["big", "little"] | None = None
    words: int | None = Field(default=None, ge=1, le=64)

    @property
    def count(self) -> int:
        """Registers that it takes."""
        return self.words if self.words is not None else self.number.width // 2

    @property
    def end(self) -> int:
        """First address behind it."""
        return self.address + self.count

    @property
    def number(self) -> Number:
        """What its type means; of a number only."""
        return number(self.type)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest value in the profile's unit."""
        low, high = sorted(bound * self.scale for bound in self.number.bounds)
        return low, high

    @property
    def step(self) -> float:
        """Smallest difference of two values; 0 of floats, whose digits follow the value."""
        kind = self.number
        return 0.0 if kind.kind == "f" else abs(self.scale) * 2.0**-kind.fraction

    def __str__(self) -> str:
        return f"{self.address}" if self.count == 1 else f"{self.address}-{self.end - 1}"

    @model_validator(mode="after")
    def _consistent(self) -> "ModbusRegister":
        if (self.type == "text") != (self.words is not None):
            raise ValueError('words belongs to type "text" and only there; add or remove it')
        if self.type == "text" and (self.scale != 1.0 or self.word_order is not None):
            raise ValueError('a text has no scale and no word_order; remove them or correct type = "text"')
        if self.scale == 0.0:
            raise ValueError("scale is 0, so every value would be; give the value of 1 in the register")
        if self.end - 1 > _LAST_ADDRESS:
            raise ValueError(f"{self} runs past address {_LAST_ADDRESS}; correct address, type or words")
        return self


class StatusBit(StrictModel):
    """A flag of the status: a bit of a register, or it is always the same (`homed` of absolute encoders)."""

    word: Literal["statusword", "status2"] = "statusword"
    bit: int | None = Field(default=None, ge=0, le=63)
    always: bool | None = None

    @model_validator(mode="after")
    def _one_way(self) -> "StatusBit":
        if (self.bit is None) == (self.always is None):
            raise ValueError("needs bit, or always; add or remove one")
        return self


def _as_bit(told: Any) -> Any:
    return {"bit": told} if isinstance(told, int) and not isinstance(told, bool) else told


def _as_writes(told: Any) -> Any:
    if isinstance(told, int) and not isinstance(told, bool):
        return [{"command": told}]
    if not isinstance(told, list) or not all(isinstance(write, dict) and len(write) == 1 for write in told):
        raise ValueError(
            "must be a whole number, or a list like [{ mode = 1 }, { controlword = 0x1F }]; correct it"
        )
    return told


#: The number of a bit in the statusword, or where else the flag stands.
Bit = Annotated[StatusBit, BeforeValidator(_as_bit)]

#: What a command writes, in order: the number for `command`, or values of several registers.
Writes = Annotated[list[dict[str, int]], BeforeValidator(_as_writes), Field(min_length=1)]


@dataclass(frozen=True)
class Axis:
    """What a profile states of an axis: degrees, °/s, °/s²."""

    low: float
    high: float
    rate: float
    acceleration: float


@dataclass(frozen=True)
class TableMap:
    """Registers, bits and commands of a table as its profile has them.

    inner_apart : the registers of the inner axis (`inner_...`) are those of a drive of its own
    """

    registers: Mapping[str, ModbusRegister]
    bits: Mapping[str, StatusBit]
    commands: Mapping[str, Sequence[Mapping[str, int]]]
    inner_apart: bool

    def names(self, name: str) -> tuple[str, ...]:
        """Registers behind a name: one, one of each axis, or none."""
        if name in self.registers:
            return (name,)
        return tuple(own for own in (f"{joint}_{name}" for joint in JOINTS) if own in self.registers)

    def check(self, axes: Sequence[Axis], encoder_sigma: float, faults: Mapping[str, str]) -> None:
        """Is this a table that can be told to do what its profile says? Raises ValueError naming the entry.

        Parameters
        ----------
        axes : outer, inner; encoder_sigma : degrees
        """
        self._check_names()
        self._check_apart()
        self._check_kinds()
        self._check_bits()
        self._check_commands()
        self._check_signs()
        self._check_watchdog()
        self._check_ranges(axes, encoder_sigma)
        self._check_faults(faults)

    def _check_names(self) -> None:
        told = set(self.registers)
        known = [
            *(f"{joint}_{name}" for joint in JOINTS for name in JOINT_REGISTERS + OPTIONAL_JOINT_REGISTERS)
        ]
        for name in DRIVE_REGISTERS + OPTIONAL_DRIVE_REGISTERS:
            known += [name, *(f"{joint}_{name}" for joint in JOINTS)]
        for name in self.registers:
            if name not in known:
                raise ValueError(f"registers.{name} is unknown{suggestion(name, known) or '; remove it'}")
        for name in (f"{joint}_{name}" for joint in JOINTS for name in JOINT_REGISTERS):
            if name not in told:
                raise ValueError(f"registers.{name} is missing; add it")
        for name in DRIVE_REGISTERS + OPTIONAL_DRIVE_REGISTERS:
            own = [f"{joint}_{name}" for joint in JOINTS if f"{joint}_{name}" in told]
            if name in told and own:
                raise ValueError(f"registers.{name} and registers.{own[0]} are the same twice; remove one")
            if len(own) == 1:
                other = next(f"{joint}_{name}" for joint in JOINTS if f"{joint}_{name}" not in told)
                raise ValueError(f"registers.{other} is missing beside registers.{own[0]}; add it")
            if name in DRIVE_REGISTERS and name not in told and not own:
                raise ValueError(
                    f"registers.{name} is missing; add it, or one for each axis: outer_{name}, inner_{name}"
                )
            if name in DRIVE_REGISTERS and self.inner_apart and name in told:
                raise ValueError(
                    f"registers.{name} is one, but modbus.inner_unit gives each axis a drive of its own; write"
                    f" outer_{name} and inner_{name}"
                )
        for joint in JOINTS:
            if (f"{joint}_low" in told) != (f"{joint}_high" in told):
                raise ValueError(
                    f"registers.{joint}_low and registers.{joint}_high belong together; add the other"
                )

    def _check_apart(self) -> None:
        drives: dict[bool, list[tuple[str, ModbusRegister]]] = {}
        for name, register in sorted(self.registers.items(), key=lambda item: item[1].address):
            drives.setdefault(self.inner_apart and name.startswith("inner_"), []).append((name, register))
        for drive in drives.values():
            for (first, a), (second, b) in pairwise(drive):
                if b.address < a.end:
                    raise ValueError(
                        f"registers.{first} ({a.address}-{a.end - 1}) and registers.{second} ({b.address}) overlap;"
                        " correct an address"
                    )

    def _check_kinds(self) -> None:
        for name, register in self.registers.items():
            plain = name.removeprefix("outer_").removeprefix("inner_")
            if (plain in TEXTS) != (register.type == "text"):
                wanted = (
                    'a text; write type = "text" and words'
                    if plain in TEXTS
                    else "a number; correct its type"
                )
                raise ValueError(f"registers.{name} has type '{register.type}', but it is {wanted}")
            if plain in WORDS and (not register.number.whole or register.scale != 1.0):
                raise ValueError(
                    f"registers.{name} is taken as it stands; give it a whole number and no scale"
                )

    def _check_bits(self) -> None:
        for name in STATUS_BITS:
            if name not in self.bits:
                raise ValueError(f"status_bits.{name} is missing; add it")
        known = STATUS_BITS + OPTIONAL_BITS
        seen: dict[tuple[str, int], str] = {}
        for name, bit in self.bits.items():
            if name not in known:
                raise ValueError(f"status_bits.{name} is unknown{suggestion(name, known) or '; remove it'}")
            if bit.bit is None:
                if name != "homed" or not bit.always:
                    raise ValueError(
                        f"status_bits.{name}: always = true is for homed, of absolute encoders; give its bit"
                    )
                continue
            places = self.names(bit.word)
            if not places:
                raise ValueError(f"status_bits.{name} is a bit of {bit.word}; add registers.{bit.word}")
            width = min(8 * self.registers[place].number.width for place in places)
            if bit.bit >= width:
                raise ValueError(
                    f"status_bits.{name} = {bit.bit} is out of range; it must be 0 to {width - 1}"
                )
            if other := seen.get((bit.word, bit.bit)):
                raise ValueError(
                    f"status_bits.{name} and status_bits.{other} are the same bit {bit.bit}; correct one"
                )
            seen[bit.word, bit.bit] = name
        if "interlock" in self.bits and self.names("interlock"):
            raise ValueError("status_bits.interlock and registers.interlock say the same; remove one")

    def _check_commands(self) -> None:
        for name in COMMANDS:
            if name not in self.commands:
                raise ValueError(f"commands.{name} is missing; add it")
        known = (*COMMANDS, RATE_COMMAND)
        for name, writes in self.commands.items():
            if name not in known:
                raise ValueError(f"commands.{name} is unknown{suggestion(name, known) or '; remove it'}")
            for write in writes:
                for register, value in write.items():
                    self._check_write(name, register, value)
        for (a, first), (b, second) in combinations(self.commands.items(), 2):
            if list(first) == list(second):
                raise ValueError(f"commands.{a} and commands.{b} write the same; correct one")
        if RATE_COMMAND in self.commands:
            for name in self.turning():
                if self.registers[name].bounds[0] >= 0.0:
                    raise ValueError(
                        f"commands.rate: registers.{name} has no sign, so it cannot turn both ways; correct its type"
                        " or remove the command"
                    )

    def _check_write(self, command: str, register: str, value: int) -> None:
        if register not in WRITTEN:
            raise ValueError(
                f"commands.{command}: '{register}' is no register that a command writes"
                f"{suggestion(register, WRITTEN) or '; it must be one of ' + ', '.join(WRITTEN)}"
            )
        places = self.names(register)
        if not places:
            raise ValueError(f"commands.{command} writes {register}; add registers.{register}")
        for place in places:
            low, high = self.registers[place].number.bounds
            if not low <= value <= high:
                raise ValueError(
                    f"commands.{command} = {value} does not fit registers.{place}, {low:g} to {high:g}; correct it"
                )

    def turning(self) -> tuple[str, ...]:
        """Registers that take the rates of an endless turn, outer and inner."""
        return self.names("turn_rate") or self.names("target_rate")

    def _check_ranges(self, axes: Sequence[Axis], encoder_sigma: float) -> None:
        for joint, axis in zip(JOINTS, axes, strict=True):
            travel, both_ways = (axis.low, axis.high), (-axis.rate, axis.rate)
            needed = {
                "position": (*travel, "the axis travels", "°"),
                "target": (*travel, "the axis travels", "°"),
                "low": (*travel, "the axis travels", "°"),
                "high": (*travel, "the axis travels", "°"),
                "rate": (*both_ways, "the axis turns at", "°/s"),
                "turn_rate": (*both_ways, "the axis turns at", "°/s"),
                "target_rate": (0.0, axis.rate, "the axis turns at", "°/s"),
                "acceleration": (0.0, axis.acceleration, "the axis takes", "°/s²"),
            }
            for name, (low, high, does, unit) in needed.items():
                register = self.registers.get(f"{joint}_{name}")
                if register is None:
                    continue
                least, most = register.bounds
                if low < least or high > most:
                    raise ValueError(
                        f"registers.{joint}_{name}: type {register.type} × {register.scale:g} holds {least:g} to"
                        f" {most:g} {unit}, but {does} {low:g} to {high:g}; correct type, scale or [{joint}]"
                    )
                if name in ("position", "target") and register.step > _COARSEST * encoder_sigma:
                    raise ValueError(
                        f"registers.{joint}_{name}: a step of {register.step:g}° is too coarse for"
                        f" accuracy.encoder_sigma_deg = {encoder_sigma:g}; correct one"
                    )

    def _check_signs(self) -> None:
        """Angles are told and read in the same sense, and what has none is not negative."""
        for joint in JOINTS:
            position = self.registers[f"{joint}_position"]
            signed = [f"{joint}_{name}" for name in ("target", "rate", "turn_rate", "low", "high")]
            if RATE_COMMAND in self.commands:
                signed += [name for name in self.turning() if name.startswith(joint)]
            unsigned = [f"{joint}_{name}" for name in ("target_rate", "acceleration")]
            for name in unsigned:
                if self.registers[name].scale < 0.0:
                    raise ValueError(
                        f"registers.{name}: scale = {self.registers[name].scale:g} is negative, but it tells a move how"
                        " fast, whichever way it goes; make it positive"
                    )
            for name in signed:
                register = self.registers.get(name)
                if register is None or register.scale * position.scale > 0.0:
                    continue
                mend = f"add registers.{joint}_turn_rate" if name in unsigned else "correct one"
                raise ValueError(
                    f"registers.{name}: scale = {register.scale:g} counts the other way than that of"
                    f" registers.{joint}_position, {position.scale:g}; {mend}"
                )

    def _check_watchdog(self) -> None:
        """Its time is known where it is to be fed, and can be one."""
        for name in self.names("watchdog"):
            if self.registers[name].scale < 0.0:
                raise ValueError(
                    f"registers.{name}: scale = {self.registers[name].scale:g} is negative, and so its time would be;"
                    " make it positive"
                )
        fed, known = self.names("heartbeat"), self.names("watchdog")
        if fed and not known:
            raise ValueError(
                f"registers.{fed[0]} is never written where no register tells the watchdog's time, by which it is fed;"
                " add registers.watchdog, or remove it"
            )

    def _check_faults(self, faults: Mapping[str, str]) -> None:
        for code in faults:
            with entry("faults", code):
                check_code(code)
            for place in self.names("fault"):
                if int(code) > self.registers[place].number.bounds[1]:
                    raise ValueError(f"faults.{code} is no value of registers.{place}; correct it")
