"""The register map of a profile, which converts between parameters in SI and numbers in registers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from calstation.devices.codecs import (
    ELEMENTS,
    SENSORS,
    Convention,
    from_registers,
    matrix_elements,
    number,
    offset_elements,
    parameter_of,
    to_registers,
)
from calstation.devices.profiles import RegisterEntry
from calstation.errors import DeviceFaultError

#: Maximum number of times that values are encoded and decoded until they no longer change.
_MAX_PASSES = 8

#: Rounding error of the scale and of the conversion to and from a matrix, for number types that resolve it, SI.
_CONVERSION_ERROR = {"f64": 1e-12}


@dataclass(frozen=True)
class RegisterMap:
    """Register entries of a profile in order of address, which do not overlap."""

    entries: tuple[RegisterEntry, ...]

    @cached_property
    def _names(self) -> tuple[str, ...]:
        return tuple(name for entry in self.entries for name in entry.names if name)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters that have a register."""
        return tuple(filter(None, map(parameter_of, self._names)))

    def encode(self, values: Mapping[str, float]) -> dict[int, list[float]]:
        """Return the numbers of each entry by its key. Raises DeviceFaultError if a value is out of range."""
        contents = self._contents(values)
        return {
            entry.key: [_register_number(entry, i, contents.get(name, 0.0)) for i, name in enumerate(entry.names)]
            for entry in self.entries
        }

    def decode(self, registers: Mapping[int, list[float]]) -> dict[str, float]:
        """Convert numbers by entry key to parameters, SI. Raises DeviceFaultError if the error model excludes them."""
        contents = {
            name: registers[entry.key][i] * entry.scale
            for entry in self.entries
            for i, name in enumerate(entry.names)
            if name
        }
        values = {name: value for name, value in contents.items() if name not in ELEMENTS}
        for sensor in SENSORS:
            elements = {element: contents[element] for element in self._elements(sensor)}
            if elements:
                values |= from_registers(sensor, elements, *self._conventions(sensor))
        return {name: values[name] for name in self.parameters}

    def rounded(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values as rounded by the registers, SI. Raises DeviceFaultError as `encode` does."""
        now = self.decode(self.encode(values))
        for _ in range(_MAX_PASSES):
            before, now = now, self.decode(self.encode(now))
            if before == now:
                break
        return now

    def differing_parameters(self, required: Mapping[str, float], values: Mapping[str, float]) -> list[str]:
        """Return the parameters whose values read back differ from the required values, both in SI.

        In entries without a tolerance, every bit must agree, except for rounding errors of scaled or converted f64
        values: −0 differs from 0, but all NaN (erased) are equal.
        """
        suspects = [
            name for name, value in required.items() if name not in values or not _bits_equal(values[name], value)
        ]
        if not suspects:
            return []
        unknown = dict.fromkeys(self.parameters, math.nan)
        written, read = self._contents({**unknown, **required}), self._contents({**unknown, **values})
        wrong = []
        for entry in self.entries:
            for name in filter(None, entry.names):
                parameter = parameter_of(name)
                if parameter in suspects and not _is_equal(entry, written[name], read[name], name in ELEMENTS):
                    wrong.append(parameter)
        return [name for name in suspects if name in wrong or name not in unknown]

    def address(self, name: str) -> int:
        """Return the register address of a parameter."""
        for entry in self.entries:
            for i, content in enumerate(entry.names):
                if name in (content, parameter_of(content)):
                    return entry.address_of(i)
        raise KeyError(name)

    def hex_contents(self, values: Mapping[str, float]) -> list[tuple[int, str, str]]:
        """Return the address, parameter and hexadecimal content (high byte first) of each register in `values`."""
        numbers = self.encode({**dict.fromkeys(self.parameters, 0.0), **values})
        return [
            (entry.address_of(i), parameter, number(entry.type).pack(content, "big").hex().upper())
            for entry in self.entries
            for i, (name, content) in enumerate(zip(entry.names, numbers[entry.key], strict=True))
            if (parameter := parameter_of(name)) and parameter in values
        ]

    def _contents(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the SI value of each parameter and each matrix or offset element in the registers."""
        contents = {name: values[name] for name in self._names if name not in ELEMENTS}
        for sensor in SENSORS:
            if elements := self._elements(sensor):
                contents |= to_registers(sensor, values, elements, *self._conventions(sensor))
        return contents

    def _elements(self, sensor: str) -> list[str]:
        return [element for element in matrix_elements(sensor) + offset_elements(sensor) if element in self._names]

    def _conventions(self, sensor: str) -> tuple[Convention, Convention]:
        matrix, offset = (
            next((e.effective_convention for e in self.entries if set(elements) & set(e.names)), Convention())
            for elements in (matrix_elements(sensor), offset_elements(sensor))
        )
        return matrix, offset


def _register_number(entry: RegisterEntry, index: int, value: float) -> float:
    """Return the number in a register for a value. Raises DeviceFaultError if the value is out of range."""
    kind, name = number(entry.type), entry.names[index]
    if not name:
        return 0.0
    low, high = entry.range
    try:
        stored = kind.nearest(value / entry.scale)
        # The comparison of stored numbers keeps a value at the edge of the range valid after it is read back.
        edges = sorted(kind.nearest(edge / entry.scale) for edge in (low, high))
        if not edges[0] <= stored <= edges[1]:
            raise ValueError
    except ValueError:
        address = entry.address_of(index)
        raise DeviceFaultError(
            "imu.value_beyond_register", name=name, value=value, address=address, low=low, high=high
        ) from None
    return stored


def _is_equal(entry: RegisterEntry, written: float, read: float, converted: bool) -> bool:
    if math.isnan(written) or math.isnan(read):
        return math.isnan(written) and math.isnan(read)
    rounding = _CONVERSION_ERROR.get(entry.type, 0.0) if converted or entry.scale != 1.0 else 0.0
    if tolerance := max(entry.tolerance, rounding):
        return abs(written - read) <= tolerance
    kind = number(entry.type)
    return _bits_equal(kind.nearest(written / entry.scale), kind.nearest(read / entry.scale))


def bitwise_equal(numbers: Sequence[float], others: Sequence[float]) -> bool:
    """Return whether all numbers agree in every bit."""
    return all(_bits_equal(a, b) for a, b in zip(numbers, others, strict=True))


def _bits_equal(a: float, b: float) -> bool:
    """Return whether two numbers agree in every bit; any NaN equals any other."""
    return (a == b and math.copysign(1.0, a) == math.copysign(1.0, b)) or (math.isnan(a) and math.isnan(b))
