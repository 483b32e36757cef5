"""The register map of a profile, which converts parameters in SI to register values and back."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from calstation.devices.codecs import (
    SENSORS,
    SLOTS,
    Convention,
    from_registers,
    matrix_slots,
    number,
    offset_slots,
    parameter_of,
    to_registers,
)
from calstation.devices.profiles import RegisterEntry
from calstation.errors import DeviceFaultError

#: Largest number of times that a value is encoded and decoded until it no longer changes.
_MAX_PASSES = 8

#: Rounding error of the conversion to and from a matrix, for number types that resolve it.
_LEAST = {"f64": 1e-12}


@dataclass(frozen=True)
class RegisterMap:
    """Register entries of a profile, in order of address and without overlap."""

    entries: tuple[RegisterEntry, ...]

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Contract names of all parameters that have a register."""
        held = (parameter_of(name) for entry in self.entries for name in entry.names)
        return tuple(name for name in held if name)

    def encode(self, values: Mapping[str, float]) -> dict[int, list[float]]:
        """Return the numbers to store in each entry, by entry key; raises DeviceFaultError if a value does not fit."""
        held = self._held(values)
        return {
            entry.key: [_fitted(entry, i, held.get(name, 0.0)) for i, name in enumerate(entry.names)]
            for entry in self.entries
        }

    def decode(self, registers: Mapping[int, list[float]]) -> dict[str, float]:
        """Convert numbers by entry key to SI parameters; raises DeviceFaultError if they do not fit the error model."""
        held = {
            name: registers[entry.key][i] * entry.scale
            for entry in self.entries
            for i, name in enumerate(entry.names)
            if name
        }
        found = {name: value for name, value in held.items() if name not in SLOTS}
        for sensor in SENSORS:
            own = {slot: held[slot] for slot in self._slots(sensor)}
            if own:
                found |= from_registers(sensor, own, *self._conventions(sensor))
        return {name: found[name] for name in self.parameters}

    def rounded(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values as rounded by the registers, SI; raises DeviceFaultError like `encode`."""
        now = self.decode(self.encode(values))
        for _ in range(_MAX_PASSES):
            before, now = now, self.decode(self.encode(now))
            if before == now:
                break
        return now

    def differing(self, wanted: Mapping[str, float], found: Mapping[str, float]) -> list[str]:
        """Return the parameters whose registers read back differently from the values written.

        In entries without a tolerance, every bit must agree: −0 differs from 0, but any NaN (erased) equals any other.
        """
        suspects = [n for n, value in wanted.items() if n not in found or not _same(found[n], value)]
        if not suspects:
            return []
        want, have = self._held(_or_nan(wanted, self)), self._held(_or_nan(found, self))
        wrong = []
        for entry in self.entries:
            for name in filter(None, entry.names):
                parameter = parameter_of(name)
                if parameter in suspects and not _near(entry, want[name], have[name], name in SLOTS):
                    wrong.append(parameter)
        mapped = set(self.parameters)
        return [name for name in suspects if name in wrong or name not in mapped]

    def address(self, name: str) -> int:
        """Return the register address of a parameter."""
        for entry in self.entries:
            for i, held in enumerate(entry.names):
                if name in (held, parameter_of(held)):
                    return entry.address_of(i)
        raise KeyError(name)

    def stored(self, values: Mapping[str, float]) -> list[tuple[int, str, str]]:
        """Return address, parameter and hexadecimal content (high byte first) of each register of `values`."""
        complete = {**dict.fromkeys(self.parameters, 0.0), **values}
        numbers, rows = self.encode(complete), []
        for entry in self.entries:
            for i, (name, held) in enumerate(zip(entry.names, numbers[entry.key], strict=True)):
                parameter = parameter_of(name)
                if parameter and parameter in values:
                    rows.append((entry.address_of(i), parameter, number(entry.type).pack(held, "big").hex().upper()))
        return rows

    def _held(self, values: Mapping[str, float]) -> dict[str, float]:
        held = {n: values[n] for entry in self.entries for n in entry.names if n and n not in SLOTS}
        for sensor in SENSORS:
            if own := self._slots(sensor):
                held |= to_registers(sensor, values, own, *self._conventions(sensor))
        return held

    def _slots(self, sensor: str) -> list[str]:
        known = {name for entry in self.entries for name in entry.names}
        return [slot for slot in (*matrix_slots(sensor), *offset_slots(sensor)) if slot in known]

    def _conventions(self, sensor: str) -> tuple[Convention, Convention]:
        found = []
        for slots in (matrix_slots(sensor), offset_slots(sensor)):
            entry = next((e for e in self.entries if set(slots) & set(e.names)), None)
            found.append(entry.effective_convention if entry else Convention())
        return found[0], found[1]


def _fitted(entry: RegisterEntry, index: int, value: float) -> float:
    """Return the register number nearest to a value. Raises DeviceFaultError if the value does not fit."""
    kind, name = number(entry.type), entry.names[index]
    if not name:
        return 0.0
    low, high = entry.range
    try:
        held = kind.nearest(value / entry.scale)
        # Compare stored numbers, so that a value at the edge of the range still fits after it is read back.
        edges = sorted(kind.nearest(edge / entry.scale) for edge in (low, high))
        if not edges[0] <= held <= edges[1]:
            raise ValueError
    except ValueError:
        address = entry.address_of(index)
        raise DeviceFaultError(
            "imu.value_beyond_register", name=name, value=value, address=address, low=low, high=high
        ) from None
    return held


def _near(entry: RegisterEntry, wanted: float, found: float, converted: bool) -> bool:
    least = _LEAST.get(entry.type, 0.0) if converted or entry.scale != 1.0 else 0.0
    if math.isnan(wanted) or math.isnan(found):
        return math.isnan(wanted) and math.isnan(found)
    if tolerance := max(entry.tolerance, least):
        return abs(wanted - found) <= tolerance
    kind = number(entry.type)
    return _same(kind.nearest(wanted / entry.scale), kind.nearest(found / entry.scale))


def alike(numbers: Sequence[float], others: Sequence[float]) -> bool:
    return all(_same(a, b) for a, b in zip(numbers, others, strict=True))


def _same(a: float, b: float) -> bool:
    """Return whether two numbers agree in every bit; any NaN equals any other."""
    return (a == b and math.copysign(1.0, a) == math.copysign(1.0, b)) or (math.isnan(a) and math.isnan(b))


def _or_nan(values: Mapping[str, float], map_: RegisterMap) -> dict[str, float]:
    return {name: values.get(name, float("nan")) for name in map_.parameters}
