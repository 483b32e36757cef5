"""The register map of a profile (`[[registers]]`), validated as a whole: names, overlaps, ranges, completeness."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Literal

from pydantic import Field, PrivateAttr

from calstation.devices.codecs import (
    SENSORS,
    SLOTS,
    ByteOrder,
    Convention,
    NumberName,
    WordOrder,
    check_orders,
    legal_range,
    matrix_slots,
    number,
    offset_slots,
    parameter_of,
)
from calstation.devices.profiles.entries import LAST_ADDRESS, Address, Scale
from calstation.messages import Text
from calstation.physics import AXES, EFFECT_PARAMETERS, EFFECT_STATES, GROUPS, NAMES, PARAMETERS
from calstation.schema import EntryError, StrictModel, entry, field_name, near_miss

#: Number of standard deviations of its prior for which a parameter must fit its register.
_MAX_SIGMAS = 3.0

#: Largest tolerance of a value that is read back, as a fraction of its range.
_MAX_TOLERANCE = 0.01

_EFFECTS = tuple(p.name for p in EFFECT_PARAMETERS)
_KNOWN = (
    *NAMES,
    *SLOTS,
    *GROUPS,
    *(f"{sensor}_{kind}" for sensor in SENSORS for kind in ("matrix", "offset")),
    *_EFFECTS,
    *EFFECT_STATES,
)
_NEVER_IN_REGISTERS = "outer_lever"

#: Sets of matrix elements that may have registers: all nine, lower triangular, or diagonal.
_ALL = {a + b for a in AXES for b in AXES}
_MATRICES = (_ALL, {pair for pair in _ALL if pair[0] >= pair[1]}, {axis + axis for axis in AXES})


class RegisterEntry(StrictModel):
    """Consecutive calibration registers; SI value = number in the register × scale.

    address : address of the first register; page : page to select before access, if the unit has pages
    parameters : contents in order: parameters by contract name, also of effects; slots of the matrix and offset in the
        unit's own formula, e.g. `gyro_matrix_xy`, `gyro_offset_x`; "" for a number that remains 0. The name of a group,
        e.g. `gyro_bias` or `gyro_matrix`, includes all names of the group
    major : whether the group of a matrix is in row or column order
    type, byte_order, word_order : type and orders of each number; the orders of the link if absent
    span : number of addresses of each number, 0 if all have the same address; set by the protocol if absent
    scale : SI value of 1 in the register; negative if the unit has the opposite sign
    range : lowest and highest SI value that the register accepts
    tolerance : largest difference of a value read back, SI, for a unit that does not return its registers exactly
    convention : convention of matrix and offset
    """

    address: Address
    page: Address = 0
    parameters: list[str] = Field(min_length=1)
    major: Literal["row", "column"] = "row"
    type: NumberName = "f32"
    byte_order: ByteOrder | None = None
    word_order: WordOrder | None = None
    span: int = Field(default=1, ge=0, le=8)
    scale: Scale = 1.0
    range: list[float] = Field(min_length=2, max_length=2)
    tolerance: float = Field(default=0.0, ge=0)
    convention: Convention | None = None
    _row: int = PrivateAttr(default=0)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of the content of each number; groups are replaced by the names of their members."""
        return tuple(name for listed in self.parameters for name in self._members(listed))

    def _members(self, listed: str) -> Sequence[str]:
        for sensor in SENSORS:
            if listed == f"{sensor}_matrix":
                rows = matrix_slots(sensor)
                return rows if self.major == "row" else [rows[3 * (i % 3) + i // 3] for i in range(9)]
            if listed == f"{sensor}_offset":
                return offset_slots(sensor)
        members = [p.name for p in PARAMETERS if p.group == listed]
        return members or [p.name for p in EFFECT_PARAMETERS if p.group == listed] or [listed]

    @property
    def key(self) -> int:
        """Page << 16 | address."""
        return self.page << 16 | self.address

    @property
    def end(self) -> int:
        return self.address + max(1, self.span * len(self.names))

    def address_of(self, index: int) -> int:
        return self.address + self.span * index

    @property
    def step(self) -> float:
        """Smallest difference between two SI values; 0 for floats."""
        return number(self.type).step(self.scale)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest SI value that type and scale can represent."""
        return number(self.type).scaled_bounds(self.scale)

    @property
    def effective_convention(self) -> Convention:
        return self.convention or Convention()

    @property
    def row(self) -> int:
        """Index of the entry in the file."""
        return self._row

    def at_row(self, row: int) -> "RegisterEntry":
        """Set the index of the entry in the file and return the entry."""
        self._row = row
        return self

    @property
    def label(self) -> str | Text:
        """Addresses, with the page if there is one, for messages."""
        last = self.end - 1
        addresses = f"{self.address}" if last == self.address else f"{self.address}-{last}"
        return Text.of("profile.at_page", addresses=addresses, page=self.page) if self.page else addresses


def check_registers(
    entries: Sequence[RegisterEntry], sigmas: Mapping[str, float], without: Sequence[str], *, pages: bool
) -> None:
    """Check a register map as a whole; raises EntryError for the first invalid entry.

    sigmas : standard deviations of the parameters' priors, SI
    without : parameters and groups that the profile declares to have no register
    pages : whether the link can select pages
    """
    for register in entries:
        with entry("registers", register.row):
            _check_entry(register, sigmas, pages)
    ordered = sorted(entries, key=lambda e: e.key)
    for a, b in pairwise(ordered):
        if a.page == b.page and b.address < a.end:
            key_path = ("registers", b.row, "address")
            other = field_name(("registers", a.row))
            raise EntryError("profile.registers_overlap", *key_path, mine=b.label, other=other, at=a.label)
    seen: dict[str, RegisterEntry] = {}
    for register in ordered:
        for name in filter(None, register.names):
            if name in seen:
                key_path = ("registers", register.row, "parameters")
                raise EntryError("profile.parameter_twice", *key_path, name=name, other=seen[name].label)
            seen[name] = register
    for sensor in SENSORS:
        _check_sensor(sensor, seen)
    _check_missing(set(seen), without)


def _check_entry(register: RegisterEntry, sigmas: Mapping[str, float], pages: bool) -> None:
    for i, name in enumerate(register.parameters):
        if name and name not in _KNOWN:
            remedy = near_miss(name, _KNOWN)
            raise EntryError("entry.unknown_parameter", "parameters", i, name=name, remedy=remedy)
    check_orders(register.type, register.word_order)
    if register.page and not pages:
        raise EntryError("profile.no_pages", "page")
    low, high = register.range
    if low >= high:
        raise EntryError("profile.range_order", "range", low=low, high=high)
    least, most = register.bounds
    if low < least * (1 + 1e-6) - 1e-300 or high > most * (1 + 1e-6):
        values = {"type": register.type, "scale": register.scale, "least": least, "most": most}
        raise EntryError("profile.range_beyond_type", "range", low=low, high=high, **values)
    if register.convention is not None and not set(register.names) & set(SLOTS):
        raise EntryError("profile.convention_without_matrix", "convention")
    if register.end - 1 > LAST_ADDRESS:
        raise EntryError("profile.past_last_address", "address", address=register.address, last=register.end - 1)
    if register.tolerance > _MAX_TOLERANCE * (high - low):
        raise EntryError("profile.tolerance_too_large", "tolerance", value=register.tolerance)
    legal = {name: _MAX_SIGMAS * sigma for name, sigma in sigmas.items()}
    for i, name in enumerate(register.names):
        parameter = parameter_of(name)
        if parameter and parameter not in _EFFECTS:
            _check_prior(register, parameter, sigmas)
        if name in SLOTS:
            needed = legal_range(name, legal, register.effective_convention)
        else:
            needed = (-legal[name], legal[name]) if name in legal else None
        if needed is not None and (needed[0] < low or needed[1] > high):
            least, most = needed
            values = {"name": name, "address": register.address_of(i), "parameter": parameter}
            raise EntryError("profile.range_too_narrow", "range", least=least, most=most, low=low, high=high, **values)


def _check_prior(register: RegisterEntry, parameter: str, sigmas: Mapping[str, float]) -> None:
    if parameter not in sigmas:
        group = PARAMETERS[NAMES.index(parameter)].group
        raise EntryError("profile.no_prior", "parameters", name=parameter, group=group)
    if register.step > sigmas[parameter]:
        raise EntryError(
            "profile.register_too_coarse", "scale", step=register.step, parameter=parameter, sigma=sigmas[parameter]
        )


def _check_sensor(sensor: str, seen: Mapping[str, RegisterEntry]) -> None:
    """Check that a sensor's matrix can be inverted and that all its registers have the same convention."""
    matrix = [slot for slot in matrix_slots(sensor) if slot in seen]
    offset = [slot for slot in offset_slots(sensor) if slot in seen]
    slots = matrix or offset
    if not slots:
        return
    key_path = ("registers", seen[slots[0]].row)
    parameters = {parameter_of(slot) for slot in matrix_slots(sensor) + offset_slots(sensor)}
    direct = [name for name in NAMES if name in seen and name in parameters]
    if direct:
        raise EntryError("profile.parameter_and_matrix", *key_path, name=direct[0], slot=slots[0])
    for alike in (matrix, offset):
        for slot in alike[1:]:
            if seen[slot].effective_convention != seen[alike[0]].effective_convention:
                raise EntryError("profile.two_conventions", *key_path, "convention", other=seen[slot].label)
    if matrix and offset:
        _check_agreement(seen[matrix[0]], seen[offset[0]])
    pairs = {slot.rsplit("_", 1)[1] for slot in matrix}
    if pairs and pairs not in _MATRICES:
        raise EntryError("profile.matrix_incomplete", *key_path, sensor=sensor, present=sorted(pairs))
    if offset and len(offset) < 3:
        raise EntryError("profile.offset_incomplete", *key_path, sensor=sensor)


def _check_agreement(matrix: RegisterEntry, offset: RegisterEntry) -> None:
    """Check that neither entry contradicts the part of the convention defined by the other entry."""
    for register, other, fields in (
        (offset, matrix, ("matrix", "identity", "negated")),
        (matrix, offset, ("offset", "added")),
    ):
        stated = register.convention.model_fields_set if register.convention else set()
        for name in fields:
            value, its = (getattr(entry_.effective_convention, name) for entry_ in (register, other))
            if name in stated and value != its:
                key_path = ("registers", register.row, "convention", name)
                raise EntryError("profile.convention_contradicts", *key_path, value=value, other=other.label, its=its)


def _check_missing(seen: set[str], without: Sequence[str]) -> None:
    parameters = {parameter_of(name) for name in seen}
    for i, name in enumerate(without):
        if name not in NAMES and name not in GROUPS:
            remedy = near_miss(name, NAMES + GROUPS)
            raise EntryError("entry.unknown_parameter", "without_register", i, name=name, remedy=remedy)
        inside = [p.name for p in PARAMETERS if name in (p.name, p.group) and p.name in parameters]
        if inside:
            raise EntryError("profile.has_register", "without_register", i, name=inside[0])
    if not parameters:
        return
    for p in PARAMETERS:
        if p.name not in parameters and p.group != _NEVER_IN_REGISTERS and not {p.name, p.group} & set(without):
            raise EntryError("profile.parameter_without_register", "registers", name=p.name, group=p.group)
