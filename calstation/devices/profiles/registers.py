"""The register map of a profile (`[[registers]]`), and checks of its names, overlaps, ranges and completeness."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, ClassVar, Literal

from pydantic import Field, PrivateAttr

from calstation.devices.codecs import (
    ELEMENTS,
    SENSORS,
    ByteOrder,
    Convention,
    NumberName,
    WordOrder,
    matrix_elements,
    number,
    offset_elements,
    order_error,
    parameter_of,
    permitted_range,
)
from calstation.devices.profiles.entries import LAST_ADDRESS, Address, ProfileSection, Rules, Scale, with_prefix
from calstation.messages import Text
from calstation.physics import (
    AXES,
    EFFECT_PARAMETERS,
    EFFECT_STATES,
    GROUPS,
    NAMES,
    PARAMETERS,
    TEMPERATURES,
    coefficient,
    is_over_temperature,
)
from calstation.schema import EntryError, field_name, near_miss

if TYPE_CHECKING:
    from calstation.devices.profiles.imu import ImuProfile

#: Number of prior standard deviations of a parameter that its register must be able to represent.
_MAX_SIGMAS = 3.0

#: Largest tolerance of a value that is read back, as a fraction of the register's range.
_MAX_TOLERANCE = 0.01

_EFFECTS = tuple(p.name for p in EFFECT_PARAMETERS)
_KNOWN = (
    *NAMES,
    *ELEMENTS,
    *GROUPS,
    *(f"{sensor}_{kind}" for sensor in SENSORS for kind in ("matrix", "offset")),
    *_EFFECTS,
    *EFFECT_STATES,
    *TEMPERATURES,
)
_UNREGISTERED_GROUP = "outer_lever"

#: Sets of matrix elements that may have registers: all nine, lower triangular, or diagonal.
_ALL = {a + b for a in AXES for b in AXES}
_MATRICES = (_ALL, {pair for pair in _ALL if pair[0] >= pair[1]}, {axis + axis for axis in AXES})


class RegisterEntry(ProfileSection):
    """Consecutive calibration registers, where SI value = number in the register × scale.

    address : address of the first register
    page : page selected before access, if the unit has pages
    parameters : names of the contents in order: parameters, including those of effects; elements of the matrix and
        offset in the formula of the unit, e.g. `gyro_matrix_xy`, `gyro_offset_x`; or "" for a number that remains 0.
        The name of a group, e.g. `gyro_bias` or `gyro_matrix`, stands for all names of the group. Coefficients over
        temperature are `gyro_bias_x[k]`, of which `gyro_bias_x[0]` is `gyro_bias_x`; see `calstation.physics`
    major : whether the group of a matrix is in row or column order
    type, byte_order, word_order : type and orders of each number; the default orders are those of the link
    span : number of addresses of each number; 0 if all have the same address. The default depends on the protocol
    scale : SI value of 1 in the register, negative if the unit has the opposite sign
    range : lowest and highest SI value that the register accepts
    tolerance : largest difference of a value read back, SI, if the unit does not return its registers exactly
    convention : convention of the matrix and offset
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
        """Name of each number; a group is replaced by the names of its members."""
        return tuple(name for listed in self.parameters for name in self._members(listed))

    def _members(self, listed: str) -> Sequence[str]:
        for sensor in SENSORS:
            if listed == f"{sensor}_matrix":
                rows = matrix_elements(sensor)
                return rows if self.major == "row" else [rows[3 * (i % 3) + i // 3] for i in range(9)]
            if listed == f"{sensor}_offset":
                return offset_elements(sensor)
        term = coefficient(listed)
        if term is not None and term[1] == 0:
            return [term[0]]
        members = [p.name for p in PARAMETERS if p.group == listed]
        return members or [p.name for p in EFFECT_PARAMETERS if p.group == listed] or [listed]

    @property
    def key(self) -> int:
        """Key of the entry, which is page << 16 | address."""
        return self.page << 16 | self.address

    @property
    def end(self) -> int:
        """Address after the last register."""
        return self.address + max(1, self.span * len(self.names))

    def address_of(self, index: int) -> int:
        """Return the address of a number by its index in the entry."""
        return self.address + self.span * index

    @property
    def step(self) -> float:
        """Smallest difference between two SI values; 0 for floats."""
        return number(self.type).step(self.scale)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lowest and highest SI value that the type and the scale can represent."""
        return number(self.type).scaled_bounds(self.scale)

    @property
    def effective_convention(self) -> Convention:
        """The convention of the matrix and offset, by default `Convention()`."""
        return self.convention or Convention()

    @property
    def row(self) -> int:
        """Index of the entry in the file."""
        return self._row

    def with_row(self, row: int) -> "RegisterEntry":
        """Set the index of the entry in the file and return the entry."""
        self._row = row
        return self

    @property
    def label(self) -> str | Text:
        """Addresses for messages, with the page if there is one."""
        last = self.end - 1
        addresses = f"{self.address}" if last == self.address else f"{self.address}-{last}"
        return Text.of("profile.at_page", addresses=addresses, page=self.page) if self.page else addresses

    rules: ClassVar[Rules["RegisterEntry"]] = (
        lambda register: (
            EntryError("entry.unknown_parameter", "parameters", i, name=name, remedy=near_miss(name, _KNOWN))
            for i, name in enumerate(register.parameters)
            if name and name not in _KNOWN and coefficient(name) is None
        ),
        lambda register: order_error(register.type, register.word_order),
        lambda register: (
            EntryError("profile.range_order", "range", low=low, high=high)
            for low, high in [register.range]
            if low >= high
        ),
        lambda register: (
            EntryError(
                "profile.range_beyond_type", "range", low=low, high=high, least=min_value, most=max_value, **values
            )
            for (low, high), (min_value, max_value) in [(register.range, register.bounds)]
            for values in [{"type": register.type, "scale": register.scale}]
            if low < min_value * (1 + 1e-6) - 1e-300 or high > max_value * (1 + 1e-6)
        ),
        lambda register: (
            register.convention is not None
            and not set(register.names) & set(ELEMENTS)
            and EntryError("profile.convention_without_matrix", "convention")
        ),
        lambda register: (
            register.end - 1 > LAST_ADDRESS
            and EntryError("profile.past_last_address", "address", address=register.address, last=register.end - 1)
        ),
        lambda register: (
            register.tolerance > _MAX_TOLERANCE * (register.range[1] - register.range[0])
            and EntryError("profile.tolerance_too_large", "tolerance", value=register.tolerance)
        ),
    )

    def contents(self) -> Iterator[tuple[str, int, str]]:
        """Yield the name, address and parameter of each number that contains a parameter."""
        for i, name in enumerate(self.names):
            if (parameter := parameter_of(name)) and not is_over_temperature(name):
                yield name, self.address_of(i), parameter


def _prior_errors(register: RegisterEntry, sigmas: Mapping[str, float]) -> Iterator[EntryError]:
    """Yield the errors of a register that cannot represent its parameters within their prior sigmas, SI."""
    legal = {name: _MAX_SIGMAS * sigma for name, sigma in sigmas.items()}
    low, high = register.range
    for name, address, parameter in register.contents():
        if parameter not in _EFFECTS and parameter not in sigmas:
            group = PARAMETERS[NAMES.index(parameter)].group
            yield EntryError("profile.no_prior", "parameters", name=parameter, group=group)
        if parameter not in _EFFECTS and register.step > sigmas[parameter]:
            values = {"step": register.step, "parameter": parameter, "sigma": sigmas[parameter]}
            yield EntryError("profile.register_too_coarse", "scale", **values)
        if name in ELEMENTS:
            needed = permitted_range(name, legal, register.effective_convention)
        else:
            needed = (-legal[name], legal[name]) if name in legal else None
        if needed is not None and (needed[0] < low or needed[1] > high):
            values = {"name": name, "address": address, "parameter": parameter, "least": needed[0], "most": needed[1]}
            yield EntryError("profile.range_too_narrow", "range", low=low, high=high, **values)


def _sensor_errors(seen: Mapping[str, RegisterEntry], sensor: str) -> Iterator[EntryError]:
    """Yield the errors of a matrix that cannot be inverted, and of registers with different conventions."""
    matrix, offset = (
        [element for element in elements if element in seen]
        for elements in (matrix_elements(sensor), offset_elements(sensor))
    )
    elements = matrix or offset
    if not elements:
        return
    key_path = ("registers", seen[elements[0]].row)
    parameters = {parameter_of(element) for element in matrix_elements(sensor) + offset_elements(sensor)}
    for name in NAMES:
        if name in seen and name in parameters:
            yield EntryError("profile.parameter_and_matrix", *key_path, name=name, slot=elements[0])
    for part in (matrix, offset):
        for element in part[1:]:
            if seen[element].effective_convention != seen[part[0]].effective_convention:
                yield EntryError("profile.two_conventions", *key_path, "convention", other=seen[element].label)
    if matrix and offset:
        yield from _contradictions(seen[offset[0]], seen[matrix[0]], ("matrix", "identity", "negated"))
        yield from _contradictions(seen[matrix[0]], seen[offset[0]], ("offset", "added"))
    pairs = {element.rsplit("_", 1)[1] for element in matrix}
    if pairs and pairs not in _MATRICES:
        yield EntryError("profile.matrix_incomplete", *key_path, sensor=sensor, present=sorted(pairs))
    if offset and len(offset) < 3:
        yield EntryError("profile.offset_incomplete", *key_path, sensor=sensor)


def _contradictions(register: RegisterEntry, other: RegisterEntry, fields: Sequence[str]) -> Iterator[EntryError]:
    """Yield the errors of an entry that contradicts fields of the convention of another entry."""
    stated = register.convention.model_fields_set if register.convention else set()
    for name in fields:
        value, its = (getattr(entry.effective_convention, name) for entry in (register, other))
        if name in stated and value != its:
            key_path = ("registers", register.row, "convention", name)
            yield EntryError("profile.convention_contradicts", *key_path, value=value, other=other.label, its=its)


def _by_name(profile: "ImuProfile") -> dict[str, RegisterEntry]:
    return {name: register for register in profile.registers for name in register.names if name}


def _temperature_errors(seen: Mapping[str, RegisterEntry]) -> Iterator[EntryError]:
    """Yield the errors of coefficients without registers for the reference and range, or for their parameter."""
    over = [name for name in seen if is_over_temperature(name)]
    for name in TEMPERATURES if over else ():
        if name not in seen:
            yield EntryError("profile.temperature_incomplete", "registers", seen[over[0]].row, name=name)
    for name in over:
        term = coefficient(name)
        if term is not None and term[0] not in seen:
            values = {"name": name, "parameter": term[0]}
            yield EntryError("profile.coefficient_alone", "registers", seen[name].row, "parameters", **values)


#: Rules for the register map of a profile.
REGISTER_RULES: Rules["ImuProfile"] = (
    lambda profile: (
        EntryError("profile.no_pages", "registers", register.row, "page")
        for register in profile.registers
        if register.page and not (profile.protocol_section and profile.protocol_section.has_pages)
    ),
    lambda profile: (
        with_prefix(error, "registers", register.row)
        for register in profile.registers
        for error in _prior_errors(register, profile.prior_sigmas())
    ),
    lambda profile: (
        EntryError("profile.registers_overlap", "registers", b.row, "address", mine=b.label, other=other, at=a.label)
        for a, b in pairwise(profile.registers)
        for other in [field_name(("registers", a.row))]
        if a.page == b.page and b.address < a.end
    ),
    lambda profile: (
        EntryError("profile.parameter_twice", "registers", b.row, "parameters", name=name, other=a.label)
        for (a, name), (b, other) in combinations(((r, name) for r in profile.registers for name in r.names), 2)
        if name and name == other
    ),
    lambda profile: (error for sensor in SENSORS for error in _sensor_errors(_by_name(profile), sensor)),
    lambda profile: _temperature_errors(_by_name(profile)),
    lambda profile: (
        EntryError("entry.unknown_parameter", "without_register", i, name=name, remedy=near_miss(name, NAMES + GROUPS))
        for i, name in enumerate(profile.without_register)
        if name not in NAMES + GROUPS
    ),
    lambda profile: (
        EntryError("profile.has_register", "without_register", i, name=p.name)
        for i, name in enumerate(profile.without_register)
        for p in PARAMETERS
        if name in (p.name, p.group) and p.name in map(parameter_of, _by_name(profile))
    ),
    lambda profile: (
        EntryError("profile.parameter_without_register", "registers", name=p.name, group=p.group)
        for present in [set(map(parameter_of, _by_name(profile)))]
        for p in PARAMETERS
        if present and not {p.name, p.group} & {*present, *profile.without_register, _UNREGISTERED_GROUP}
    ),
)
