"""Registers of a unit: values read from the unit in the fixture, and values required by a result."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calstation.config import RunConfiguration, RunRequest, load_configuration
from calstation.connection import open_imu_session
from calstation.devices import ImuIdentity
from calstation.devices.imu import RegisterMap
from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.physics import compose, is_over_temperature
from calstation.records import open_log
from calstation.registers import journal
from calstation.registers.journal import journal_folder
from calstation.results import Registers, Result


@dataclass(frozen=True)
class Register:
    """One register of the unit's map: address, parameter, value (SI) and stored content in hexadecimal."""

    address: int
    parameter: str
    value: float
    raw: str


@dataclass(frozen=True)
class UnitRegisters:
    """Registers read from a unit, by increasing address; `commits` is the number of flash cycles in its journal."""

    serial: str
    model: str
    firmware: str
    registers: tuple[Register, ...]
    commits: int
    virtual: bool

    @property
    def values(self) -> dict[str, float]:
        """Values by parameter name, SI."""
        return {register.parameter: register.value for register in self.registers}

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON data."""
        return asdict(self)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> "UnitRegisters":
        """Restore the object from the data that `to_json` returned."""
        return cls(**{**data, "registers": tuple(Register(**row) for row in data["registers"])})


@dataclass(frozen=True)
class TargetRegisters:
    """The registers that a result requires, those that its run replaced, and those that its run wrote."""

    serial: str
    registers: tuple[Register, ...]
    before: tuple[Register, ...] = ()
    written: tuple[Register, ...] = ()

    @property
    def values(self) -> dict[str, float]:
        """Values by parameter name, SI."""
        return {register.parameter: register.value for register in self.registers}


def read_unit(progress: ProgressCallback, request: RunRequest, runs: Path) -> UnitRegisters:
    """Read the registers of the unit in the fixture. Raises DeviceFaultError or ConfigurationError."""
    setup = load_configuration(request)
    with open_imu_session(progress, setup) as unit:
        values = unit.imu.read_registers()
    return unit_registers(setup, unit.identity, values, runs)


def target_registers(progress: ProgressCallback, request: RunRequest, result: Result) -> TargetRegisters:
    """Return the registers that a result requires, with the encoding of its product's profile.

    If the run wrote registers, the written values are returned. If the unit applied registers to its output, the result
    is combined with the registers in the log.

    Raises InputError if a required log is missing, if IMU profile or product differ from those of the result, if the
    result was not tested or contains states added for a trial, if it was simulated and the station has hardware, or if
    the registers cannot store it over temperature.

    Parameters
    ----------
    progress : callback for the progress
    request : request with the unit, station and product
    result : result whose parameters the registers must contain
    """
    if not result.tested:
        raise InputError("transfer.result_untested")
    if result.states_added:
        raise InputError("transfer.result_of_trial", states=", ".join(result.states_added))
    setup = load_configuration(request)
    if result.simulated and setup.station.bench is None:
        raise InputError("transfer.result_simulated")
    imu_file, profile = result.configuration.get("imu"), setup.sources["imu"].section.name
    if imu_file is not None and imu_file.name != profile:
        names = {
            "profile": imu_file.name,
            "product": setup.product.name,
            "own": profile,
            "result_product": result.product,
        }
        raise InputError("transfer.result_other_profile", **names)
    if result.product and result.product != setup.product.name:
        raise InputError("transfer.result_other_product", product=setup.product.name, result_product=result.product)
    estimates = {name: parameter.value for name, parameter in result.parameters.items()}
    entries, over = setup.register_map, result.temperature
    if over is not None and (setup.after_registers or not over.fits(entries.parameters)):
        raise InputError("transfer.result_over_temperature", profile=profile)
    registers = result.registers or Registers()
    written = registers.new
    if setup.after_registers and not written:
        log = Path(result.log.file)
        if not log.is_file():
            raise InputError("transfer.log_missing", path=str(log))
        estimates = compose(open_log(log).meta.registers, estimates)
    if not setup.after_registers:  # a result at one temperature replaces the coefficients, as a run does
        estimates |= dict.fromkeys(filter(is_over_temperature, entries.parameters), 0.0)
        estimates |= {} if over is None else over.registers
    progress(0.5)
    known = [name for name in entries.parameters if name in estimates]
    complete = dict.fromkeys(entries.parameters, 0.0) | {name: estimates[name] for name in known}
    values = written or entries.rounded(complete)
    return TargetRegisters(
        result.serial,
        _rows(entries, {name: values[name] for name in known if name in values}),
        _rows(entries, registers.old),
        _rows(entries, written or {}),
    )


def unit_registers(
    setup: RunConfiguration, identity: ImuIdentity, values: Mapping[str, float], runs: Path
) -> UnitRegisters:
    """Combine the registers read from a unit with the flash cycles in its journal.

    Parameters
    ----------
    setup : configuration of the unit
    identity : identity that the unit reported
    values : registers by parameter, SI
    runs : folder of the runs
    """
    return UnitRegisters(
        identity.serial,
        identity.model,
        identity.firmware,
        _rows(setup.register_map, values),
        journal.cycles(journal_folder(setup.station, runs), identity.serial),
        setup.station.bench is not None,
    )


def _rows(entries: RegisterMap, values: Mapping[str, float]) -> tuple[Register, ...]:
    return tuple(Register(address, name, values[name], raw) for address, name, raw in entries.hex_contents(values))


def ranges_of(addresses: Iterable[int]) -> str:
    """Return register addresses as a list of ranges, such as ``3–5, 9``."""
    ranges: list[list[int]] = []
    for address in sorted(addresses):
        if ranges and address == ranges[-1][1] + 1:
            ranges[-1][1] = address
        else:
            ranges.append([address, address])
    return ", ".join(f"{a}" if a == b else f"{a}–{b}" for a, b in ranges)
