"""Names of polynomial coefficients over temperature in the registers of a unit, and their values at a temperature.

    parameter(T) = sum over k of c_k (T − temperature_reference)^k,  T limited to temperature_low to temperature_high

The register of a parameter contains c_0, and `gyro_bias_x[k]` contains c_k, SI per K^k. A unit evaluates all parameters
at the temperature of its own sensor first, and then corrects its output once with these values; nothing is corrected
before or after.
"""

import re
from collections.abc import Iterable, Mapping

from calstation.physics.parameters import NAMES, PARAMETERS

#: Registers with the reference and the range of the polynomials, °C.
TEMPERATURES = ("temperature_reference", "temperature_low", "temperature_high")

#: Largest power of the temperature in a register.
MAX_POWER = 6

_TERM = re.compile(r"(\w+)\[(\d)\]")
_CHANGING = frozenset(p.name for p in PARAMETERS if p.sensor != "lever")


def coefficient(name: str) -> tuple[str, int] | None:
    """Return the parameter and the power of a coefficient like `gyro_bias_x[2]`; None for any other name."""
    match = _TERM.fullmatch(name)
    if match is None or match[1] not in _CHANGING or int(match[2]) > MAX_POWER:
        return None
    return match[1], int(match[2])


def is_over_temperature(name: str) -> bool:
    """Return whether a register belongs to the polynomials over temperature, beside the values at the reference."""
    return name in TEMPERATURES or coefficient(name) is not None


def highest_powers(names: Iterable[str]) -> dict[str, int]:
    """Return the highest power of each parameter among the names of registers, 0 without coefficients."""
    powers = dict.fromkeys((name for name in names if name in NAMES), 0)
    for parameter, power in filter(None, map(coefficient, names)):
        powers[parameter] = max(power, powers.get(parameter, 0))
    return powers


def values_at(registers: Mapping[str, float], temperature: float | None) -> dict[str, float]:
    """Return the parameters that a unit applies at a temperature of its sensor, by name, SI.

    Parameters
    ----------
    registers : registers by name, SI and °C; without coefficients, they are returned unchanged
    temperature : °C; None for the reference
    """
    values = {name: value for name, value in registers.items() if not is_over_temperature(name)}
    if TEMPERATURES[0] not in registers or temperature is None:
        return values
    reference, low, high = (registers[name] for name in TEMPERATURES)
    change = min(max(temperature, low), high) - reference
    for name, value in registers.items():
        if (term := coefficient(name)) is not None:
            values[term[0]] = values.get(term[0], 0.0) + value * change ** term[1]
    return values
