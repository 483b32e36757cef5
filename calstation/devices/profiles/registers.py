"""The register map of a profile (`[[registers]]`), checked as a whole: names, overlaps, ranges, what is missing."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Literal

from pydantic import Field, PrivateAttr, field_validator

from calstation.devices.codecs.conventions import (
    SENSORS,
    SLOTS,
    Convention,
    legal_range,
    matrix_slots,
    offset_slots,
    parameter_of,
)
from calstation.devices.codecs.numbers import ByteOrder, NumberName, WordOrder, check_orders, number
from calstation.physics.parameters import GROUPS, NAMES, PARAMETERS
from calstation.schema import EntryError, StrictModel, entry, suggestion

#: A unit's parameter may lie this many sigmas of its prior from zero.
_LEGAL = 3.0

#: A value may read back otherwise by no more than this share of its range.
_COARSEST = 0.01

_LARGEST_ADDRESS = 0xFFFF

_KNOWN = (
    *NAMES,
    *SLOTS,
    *GROUPS,
    *(f"{sensor}_{kind}" for sensor in SENSORS for kind in ("matrix", "offset")),
)
_NEVER_IN_REGISTERS = "outer_lever"


class RegisterEntry(StrictModel):
    """Consecutive calibration registers; SI value = number in the register × scale.

    Attributes
    ----------
    address : of the first; page : that must be chosen before, where the unit has pages
    parameters : what they hold in order: parameters by contract name; or slots of a matrix and an offset after the
        unit's own formula, `gyro_matrix_xy`, `gyro_offset_x`; "" for a number that stays 0. The name of a group,
        `gyro_bias` or `gyro_matrix`, stands for all of its names
    major : whether a group that is a matrix is listed row by row or column by column
    type, byte_order, word_order : of each number; orders as the link's where absent
    span : addresses that each number takes, 0 where all stand at the same one; the link's own way where absent
    scale : SI value of 1 in the register, negative where the unit has the opposite sign
    range : lowest and highest SI value that fits
    tolerance : by how much a value may read back otherwise, SI, of a unit that does not give its registers exactly
    convention : of matrix and offset
    """

    address: int = Field(ge=0, le=0xFFFF)
    page: int = Field(default=0, ge=0, le=0xFFFF)
    parameters: list[str] = Field(min_length=1)
    major: Literal["row", "column"] = "row"
    type: NumberName = "f32"
    byte_order: ByteOrder | None = None
    word_order: WordOrder | None = None
    span: int = Field(default=1, ge=0, le=8)
    scale: float = 1.0
    range: list[float] = Field(min_length=2, max_length=2)
    tolerance: float = Field(default=0.0, ge=0)
    convention: Convention | None = None
    _row: int = PrivateAttr(default=0)

    @field_validator("scale")
    @classmethod
    def _scale(cls, scale: float) -> float:
        if scale == 0.0:
            raise ValueError("is 0, so every value would be; give the SI value of 1 in the register")
        return scale

    @property
    def names(self) -> tuple[str, ...]:
        """What each register holds, groups told one by one."""
        return tuple(name for told in self.parameters for name in self._members(told))

    def _members(self, told: str) -> Sequence[str]:
        for sensor in SENSORS:
            if told == f"{sensor}_matrix":
                rows = matrix_slots(sensor)
                return rows if self.major == "row" else [rows[3 * (i % 3) + i // 3] for i in range(9)]
            if told == f"{sensor}_offset":
                return offset_slots(sensor)
        return [p.name for p in PARAMETERS if p.group == told] or [told]

    @property
    def key(self) -> int:
        """Address and page in one."""
        return self.page << 16 | self.address

    @property
    def end(self) -> int:
        """First address behind the entry."""
        return self.address + max(1, self.span * len(self.names))

    def place(self, index: int) -> int:
        """Address of a number of the entry."""
        return self.address + self.span * index

    @property
    def step(self) -> float:
        """Smallest difference of two SI values; 0 of floats, whose digits follow the value."""
        kind = number(self.type)
        return 0.0 if kind.kind == "f" else abs(self.scale) * 2.0**-kind.fraction

    @property
    def bounds(self) -> tuple[float, float]:
        """SI values that type and scale can hold."""
        low, high = (bound * self.scale for bound in number(self.type).bounds)
        return (low, high) if low < high else (high, low)

    @property
    def row(self) -> int:
        """Which of the profile's entries it is, as they stand in the file."""
        return self._row

    def at_row(self, row: int) -> "RegisterEntry":
        """The same, known as the profile's entry of that number."""
        self._row = row
        return self

    def __str__(self) -> str:
        page = f"page {self.page} " if self.page else ""
        return f"{page}register {self.address}" + (f"-{self.end - 1}" if self.span else "")


def check_registers(
    entries: Sequence[RegisterEntry], sigmas: Mapping[str, float], without: Sequence[str], *, pages: bool
) -> None:
    """Is this a register map? Raises ValueError naming the entry.

    Parameters
    ----------
    sigmas : of the parameters' priors, SI
    without : parameters and groups that have no register, by the profile's own word
    pages : whether the link can choose pages
    """
    for told in entries:
        with entry("registers", told.row):
            _check_entry(told, sigmas, pages)
    ordered = sorted(entries, key=lambda e: e.key)
    for a, b in pairwise(ordered):
        if a.page == b.page and b.address < a.end:
            raise EntryError(f"{a} and {b} overlap; correct an address", "registers", b.row, "address")
    seen: dict[str, RegisterEntry] = {}
    for told in ordered:
        for name in filter(None, told.names):
            if name in seen:
                raise EntryError(
                    f"'{name}' is in {seen[name]} and in {told}; remove one", "registers", told.row
                )
            seen[name] = told
    for sensor in SENSORS:
        _check_sensor(sensor, seen)
    _check_missing(set(seen), without)


def _check_entry(told: RegisterEntry, sigmas: Mapping[str, float], pages: bool) -> None:
    for name in told.names:
        if name and name not in NAMES and name not in SLOTS:
            raise ValueError(f"{told}: '{name}' is no parameter{suggestion(name, _KNOWN) or '; remove it'}")
    check_orders(told.type, told.word_order)
    if told.page and not pages:
        raise ValueError(f"{told}: this link has no pages; remove page, or say where it is chosen")
    low, high = told.range
    if low >= high:
        raise ValueError(f"{told}: range = {told.range} must be [low, high] with low below high")
    least, most = told.bounds
    if low < least * (1 + 1e-6) - 1e-300 or high > most * (1 + 1e-6):
        raise ValueError(
            f"{told}: range = {told.range} is more than type {told.type} × {told.scale:g} holds,"
            f" {least:.6g} to {most:.6g}; correct range, scale or type"
        )
    slots = [name for name in told.names if name in SLOTS]
    if told.convention is not None and not slots:
        raise ValueError(f"{told}: convention belongs to registers of a matrix or an offset; remove it")
    if told.end - 1 > _LARGEST_ADDRESS:
        raise ValueError(f"{told} runs past address {_LARGEST_ADDRESS}; correct it")
    if told.tolerance > _COARSEST * (high - low):
        raise ValueError(
            f"{told}: tolerance = {told.tolerance:g} is more than a hundredth of the range, so hardly any value read"
            " back would be wrong; state what the unit rounds by"
        )
    legal = {name: _LEGAL * sigma for name, sigma in sigmas.items()}
    for i, name in enumerate(told.names):
        _check_known(told, name, sigmas)
        if name in SLOTS:
            needed = legal_range(name, legal, told.convention or Convention())
        else:
            needed = (-legal[name], legal[name]) if name in legal else None
        if needed is not None and (needed[0] < low or needed[1] > high):
            parameter = parameter_of(name) if name in SLOTS else name
            raise ValueError(
                f"{told}: {name} in register {told.place(i)} may need {needed[0]:.6g} to {needed[1]:.6g} (from the"
                f" prior of {parameter}), its range is {low:g} to {high:g}; widen the range or correct the prior"
            )


def _check_known(told: RegisterEntry, name: str, sigmas: Mapping[str, float]) -> None:
    """What a parameter may be is known, and the register tells such values apart."""
    parameter = parameter_of(name) if name in SLOTS else name
    if not parameter:
        return
    if parameter not in sigmas:
        raise ValueError(
            f"{told}: {parameter} has a register but no prior, so nobody knows whether its values fit; add"
            f" [prior.{PARAMETERS[NAMES.index(parameter)].group}]"
        )
    if told.step > sigmas[parameter]:
        raise ValueError(
            f"{told}: a step of type {told.type} × {told.scale:g} is more than the prior of {parameter},"
            f" {sigmas[parameter]:g}, so the register could not tell units apart; correct scale or type"
        )


def _check_sensor(sensor: str, seen: Mapping[str, RegisterEntry]) -> None:
    """The matrix of a sensor is there in a form that can be inverted, in one convention."""
    rows = [told.row for name, told in seen.items() if name in (*matrix_slots(sensor), *offset_slots(sensor))]
    with entry("registers", *rows[:1]):
        _check_matrix(sensor, seen)


def _check_matrix(sensor: str, seen: Mapping[str, RegisterEntry]) -> None:
    matrix = [slot for slot in matrix_slots(sensor) if slot in seen]
    offset = [slot for slot in offset_slots(sensor) if slot in seen]
    direct = [
        n for n in NAMES if n in seen and n.startswith(sensor) and any(parameter_of(s) == n for s in SLOTS)
    ]
    if (matrix or offset) and direct:
        raise ValueError(
            f"'{direct[0]}' in {seen[direct[0]]} and '{(matrix or offset)[0]}' in {seen[(matrix or offset)[0]]}: the"
            f" {sensor}'s registers are parameters or a matrix and an offset, not both"
        )
    for slots in (matrix, offset):
        for slot in slots[1:]:
            if _convention(seen[slot]) != _convention(seen[slots[0]]):
                raise ValueError(
                    f"{seen[slots[0]]} and {seen[slot]}: one matrix or offset has one convention"
                )
    if matrix and offset:
        _check_one_word(seen[matrix[0]], seen[offset[0]])
    places = {slot.rsplit("_", 1)[1] for slot in matrix}
    whole = {a + b for a in "xyz" for b in "xyz"}
    if places and places not in (whole, {p for p in whole if p[0] >= p[1]}, {"xx", "yy", "zz"}):
        raise ValueError(
            f"{seen[matrix[0]]}: the {sensor}'s matrix has registers for {', '.join(sorted(places))}; it must be all"
            " nine, the six on and below the diagonal, or the three on it"
        )
    if offset and len(offset) < 3:
        raise ValueError(f"{seen[offset[0]]}: the {sensor}'s offset needs registers for x, y and z")


def _check_one_word(matrix: RegisterEntry, offset: RegisterEntry) -> None:
    """What one entry says of the other's part is what that one says: nothing is said in vain."""
    for told, other, fields in (
        (offset, matrix, ("matrix", "identity", "negated")),
        (matrix, offset, ("offset", "added")),
    ):
        said = told.convention.model_fields_set if told.convention else set()
        for name in fields:
            mine, its = getattr(_convention(told), name), getattr(_convention(other), name)
            if name in said and mine != its:
                raise ValueError(
                    f"{told}: convention.{name} = {mine!r} contradicts {other}, which has {its!r}; correct one"
                )


def _convention(entry: RegisterEntry) -> Convention:
    return entry.convention or Convention()


def _check_missing(seen: set[str], without: Sequence[str]) -> None:
    """Every parameter has a register, or the profile says that it has none."""
    held = {parameter_of(name) if name in SLOTS else name for name in seen}
    for i, name in enumerate(without):
        with entry("without_register", i):
            if name not in NAMES and name not in GROUPS:
                raise ValueError(f"'{name}' is no parameter or group{suggestion(name, NAMES + GROUPS)}")
            inside = [p.name for p in PARAMETERS if name in (p.name, p.group) and p.name in held]
            if inside:
                raise ValueError(f"'{name}': {inside[0]} has a register; remove one of both")
    if not held:
        return
    for p in PARAMETERS:
        if p.name not in held and p.group != _NEVER_IN_REGISTERS and not {p.name, p.group} & set(without):
            raise EntryError(
                f"{p.name} has no register; add one, or name it (or {p.group}) in without_register",
                "registers",
            )
