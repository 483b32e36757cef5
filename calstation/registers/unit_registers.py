"""Puts what was found behind the unit's own registers together with them into one set of registers."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calstation.config.request import RunRequest
from calstation.config.resolved import ResolvedConfiguration, resolve_configuration
from calstation.connection.imu_session import open_imu_session
from calstation.devices.imu.registers import RegisterMap
from calstation.devices.interfaces import ImuIdentity
from calstation.errors import InputError
from calstation.jobs.queue import ProgressCallback
from calstation.physics.arrays import FloatArray
from calstation.physics.parameters import NAMES, PARAMETERS, group_matrix, group_vector
from calstation.records.log import open_log
from calstation.registers import journal as register_journal
from calstation.registers.journal import journal_folder


def compose(old: Mapping[str, float], found: Mapping[str, float]) -> dict[str, float]:
    """Registers that correct the raw output as `old` and, behind it, `found` do one after the other.

    With raw = (I + M_old) y + b_old and y = (I + M) ω + b the raw output is
    (I + M_old)(I + M) ω + (I + M_old) b + b_old. Second-order terms and levers, which act on the
    specific force itself, add to first order. The accelerometer matrix stays lower triangular because
    the product of two is.

    Parameters
    ----------
    old, found : parameters by contract name, SI; a name that is missing is 0
    """
    was, now = _vector(old), _vector(found)
    result = was + now
    for sensor in ("gyro", "accel"):
        groups = (f"{sensor}_scale", f"{sensor}_misalign")
        before = np.eye(3) + group_matrix(was, *groups)
        matrix = before @ (np.eye(3) + group_matrix(now, *groups)) - np.eye(3)
        bias = before @ group_vector(now, f"{sensor}_bias") + group_vector(was, f"{sensor}_bias")
        for i, parameter in enumerate(PARAMETERS):
            if parameter.group in groups:
                result[i] = matrix[parameter.row, parameter.column]
            elif parameter.group == f"{sensor}_bias":
                result[i] = bias[parameter.row]
    return dict(zip(NAMES, result.tolist(), strict=True))


def _vector(values: Mapping[str, float]) -> FloatArray:
    return np.array([values.get(name, 0.0) for name in NAMES])


@dataclass(frozen=True)
class Register:
    """One register of the unit's map: its address, its parameter, and as it is stored, in hexadecimal.

    value : SI
    """

    address: int
    parameter: str
    value: float
    raw: str


@dataclass(frozen=True)
class UnitRegisters:
    """What a unit holds; `to_json` and `of` carry it in an event.

    Attributes
    ----------
    serial, model, firmware : as it answered
    registers : by rising address
    commits : flash cycles that the unit's journal knows of
    virtual : the unit is a virtual bench's
    """

    serial: str
    model: str
    firmware: str
    registers: tuple[Register, ...]
    commits: int
    virtual: bool

    @property
    def values(self) -> dict[str, float]:
        """SI by parameter."""
        return {register.parameter: register.value for register in self.registers}

    def to_json(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> "UnitRegisters":
        """What `to_json` has made."""
        return cls(**{**data, "registers": tuple(Register(**row) for row in data["registers"])})


@dataclass(frozen=True)
class TargetRegisters:
    """The registers that a result asks for, of the unit it was found on.

    before : those that its run found and replaced; empty where it wrote none
    written : what its run wrote and proved in their place; empty where it did not
    written_utc : when that was, ISO 8601, "" where that is not known
    """

    serial: str
    registers: tuple[Register, ...]
    before: tuple[Register, ...] = ()
    written: tuple[Register, ...] = ()
    written_utc: str = ""

    @property
    def values(self) -> dict[str, float]:
        """SI by parameter."""
        return {register.parameter: register.value for register in self.registers}


def read_unit(tell: ProgressCallback, request: RunRequest, runs: Path) -> UnitRegisters:
    """Work for the workshop: ask the unit in the fixture for its registers. Nothing moves, nothing is written.

    `runs` : folder of the runs, for what was written before. Raises DeviceFaultError, ConfigurationError.
    """
    setup = resolve_configuration(request)
    with open_imu_session(tell, setup) as unit:
        values = unit.imu.read_registers()
    return held(setup, unit.identity, values, runs)


def wanted_registers(
    tell: ProgressCallback, request: RunRequest, result: Mapping[str, Any]
) -> TargetRegisters:
    """Work for the workshop: what a result wants in the unit's registers, as its product's profile holds them.

    Where its run has written them that is what it wrote; registers that it kept are left aside. A result found
    behind the registers is put together with those that its log says were in force.
    Raises InputError where the log is needed and missing, or the result is of another IMU profile than the product's.
    """
    setup = resolve_configuration(request)
    _refuse_other_profile(setup, result)
    found = {name: float(row["value"]) for name, row in result["parameters"].items()}
    registers = result.get("registers") or {}
    written = registers.get("new") if registers.get("verified") else None
    if setup.after_registers and not written:
        log = Path(result["log"]["file"])
        if not log.is_file():
            raise InputError(
                f"{log}: no such file; the result was found behind the unit's registers and needs its log"
            )
        found = compose(open_log(log).meta.registers, found)
    tell(0.5)
    entries = _map(setup)
    kept = registers.get("kept") or {}
    named = [name for name in entries.parameters if name in found and name not in kept]
    complete = dict.fromkeys(entries.parameters, 0.0) | {name: found[name] for name in named}
    rounded = written or entries.rounded(complete)
    return TargetRegisters(
        str(result["unit"]["serial"]),
        _rows(entries, {name: rounded[name] for name in named}),
        _rows(entries, registers.get("old") or {}),
        _rows(entries, written or {}),
        str(registers.get("written_utc") or "") if written else "",
    )


def held(
    setup: ResolvedConfiguration, identity: ImuIdentity, values: Mapping[str, float], runs: Path
) -> UnitRegisters:
    """What a unit holds, of its registers' `values`, SI by parameter."""
    return UnitRegisters(
        identity.serial,
        identity.model,
        identity.firmware,
        _rows(_map(setup), values),
        register_journal.cycles(runs, identity.serial, journal_folder(setup.station)),
        setup.station.bench is not None,
    )


def _refuse_other_profile(setup: ResolvedConfiguration, result: Mapping[str, Any]) -> None:
    """Values of one sort of unit mean nothing to the registers of another. Raises InputError."""
    used = (result.get("configuration") or {}).get("imu")
    mine = setup.sources["imu"].section.name
    if used is not None and used["name"] != mine:
        raise InputError(
            f"the result is of a unit with IMU profile '{used['name']}', product '{setup.product.name}' has '{mine}';"
            f" choose the result's own product, '{result.get('product')}'"
        )


def _map(setup: ResolvedConfiguration) -> RegisterMap:
    return RegisterMap(tuple(setup.imu.registers))


def _rows(entries: RegisterMap, values: Mapping[str, float]) -> tuple[Register, ...]:
    """Every register of a parameter in `values`, with its encoding."""
    return tuple(Register(address, name, values[name], raw) for address, name, raw in entries.stored(values))
