"""Registers by hand: read from the unit, set beside what a result wants, written on an engineer's explicit word.

The only place outside a run that writes to a unit. Who wrote what stands in a journal beside the runs, and so does the
intention with the old values, on disk before the first register is written.
"""

import json
import os
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from calstation.devices.interfaces import ImuIdentity
from calstation.devices.registers import RegisterMap
from calstation.devices.transfer import transfer
from calstation.errors import ConfigurationError, DeviceFaultError, InputError
from calstation.records.atomic import sync_folder
from calstation.records.log import open_log
from calstation.station.clock import BenchClock
from calstation.station.compose import compose
from calstation.station.request import RunRequest
from calstation.station.setup import Setup, configured
from calstation.station.wiring import endpoints, open_imu
from calstation.station.worker import Tell

JOURNAL = "register_writes.jsonl"
"""Name of the journal in the folder of the runs: one JSON object a line, never rewritten."""

_SHARES = (0.1, 0.4, 0.6)
"""Told when the link is open, the unit named, the old registers read."""


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
    """What a unit holds.

    Attributes
    ----------
    serial, model, firmware : as it answered
    registers : by rising address
    commits : times that this station is known to have committed this unit's registers to flash
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


@dataclass(frozen=True)
class Wanted:
    """The registers that a result asks for: SI by parameter, and the unit it was found on."""

    serial: str
    registers: tuple[Register, ...]

    @property
    def values(self) -> dict[str, float]:
        """SI by parameter."""
        return {register.parameter: register.value for register in self.registers}


def read_unit(tell: Tell, request: RunRequest, runs: Path) -> UnitRegisters:
    """Work for the workshop: ask the unit in the fixture for its registers. Nothing moves, nothing is written.

    `runs` : folder of the runs, for what was written before. Raises DeviceFaultError, ConfigurationError.
    """
    setup, _ = configured(request)
    with _unit(tell, setup) as (imu, identity):
        values = imu.read_registers()
    return _held(setup, identity, values, runs)


def wanted_registers(tell: Tell, request: RunRequest, result: Mapping[str, Any]) -> Wanted:
    """Work for the workshop: what a result wants in the unit's registers, as its product's profile holds them.

    A result found behind the registers is put together with those that its log says were in force.
    Raises InputError where the log is needed and missing.
    """
    setup, _ = configured(request)
    found = {name: float(row["value"]) for name, row in result["parameters"].items()}
    if setup.after_registers:
        log = Path(result["log"]["file"])
        if not log.is_file():
            raise InputError(
                f"{log}: no such file; the result was found behind the unit's registers and needs its log"
            )
        found = compose(open_log(log).meta.registers, found)
    tell(0.5)
    entries = _map(setup)
    named = [name for name in entries.parameters if name in found]
    complete = dict.fromkeys(entries.parameters, 0.0) | {name: found[name] for name in named}
    rounded = entries.rounded(complete)
    return Wanted(str(result["unit"]["serial"]), _rows(entries, {name: rounded[name] for name in named}))


def write_unit(
    tell: Tell, request: RunRequest, serial: str, values: Mapping[str, float], engineer: str, runs: Path
) -> UnitRegisters:
    """Work for the workshop, never to be killed: write registers, read back, commit, restart, read again.

    Parameters
    ----------
    serial : of the unit that is meant; another one in the fixture is refused
    values : SI by parameter; registers of other parameters keep theirs
    engineer : who says so
    runs : folder of the runs, where the journal is

    Raises
    ------
    DeviceFaultError
        where another unit answers, a value does not fit, or a register does not read back.
    ConfigurationError
        where the journal cannot be written; nothing was written then.
    """
    setup, _ = configured(request)
    runs.mkdir(parents=True, exist_ok=True)
    about = {"serial": serial, "engineer": engineer, "station": setup.station.name}
    with _unit(tell, setup) as (imu, identity):
        if identity.serial != serial:
            raise DeviceFaultError(
                f"IMU: unit '{identity.serial}' is in the fixture, the values are for '{serial}';"
                " nothing was written; change the unit or open its own result"
            )

        def on_old(old: Mapping[str, float]) -> None:
            tell(_SHARES[2])
            _note(runs, {"event": "intended", **about, "old": dict(old), "new": dict(values)})

        try:
            done = transfer(imu, _map(setup), values, on_old)
        except DeviceFaultError as error:
            _note(runs, {"event": "failed", **about, "error": str(error)})
            raise
        _note(runs, {"event": "written", **about, "new": done.new, "verified": done.verified})
    return _held(setup, identity, done.new, runs)


def known_commits(runs: Path, serial: str) -> int:
    """How often this station committed a unit's registers: by its runs in `runs` and by hand."""
    count = 0
    for entry in journal(runs):
        count += entry.get("event") == "written" and entry.get("serial") == serial
    for path in runs.glob("*.json"):
        try:
            result = json.loads(path.read_text(encoding="utf-8"))
            written = (result.get("registers") or {}).get("new") is not None
            count += written and result["unit"]["serial"] == serial
        except (OSError, ValueError, KeyError, AttributeError, TypeError):
            continue
    return count


def journal(runs: Path) -> list[dict[str, Any]]:
    """What was written by hand so far, oldest first; a line torn by a power cut is left out."""
    try:
        lines = (runs / JOURNAL).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
    entries = []
    for line in lines:
        try:
            entries.append(json.loads(line))
        except ValueError:
            continue
    return entries


@contextmanager
def _unit(tell: Tell, setup: Setup) -> "Iterator[tuple[Any, ImuIdentity]]":
    """The IMU alone, open and named; closed on the way out."""
    with endpoints(setup) as at:
        tell(_SHARES[0])
        imu = open_imu(setup, at.imu)
        try:
            if isinstance(at.clock, BenchClock):
                at.clock.attach(lambda: imu.received)
            identity = imu.identify()
            tell(_SHARES[1])
            yield imu, identity
        finally:
            imu.close()


def _held(setup: Setup, identity: ImuIdentity, values: Mapping[str, float], runs: Path) -> UnitRegisters:
    return UnitRegisters(
        identity.serial,
        identity.model,
        identity.firmware,
        _rows(_map(setup), values),
        known_commits(runs, identity.serial),
        setup.station.bench is not None,
    )


def _map(setup: Setup) -> RegisterMap:
    return RegisterMap(tuple(setup.imu.registers))


def _rows(entries: RegisterMap, values: Mapping[str, float]) -> tuple[Register, ...]:
    """Every register of a parameter in `values`, with its encoding."""
    rows = []
    for entry in entries.entries:
        for i, name in enumerate(entry.parameters):
            if name in values:
                stored = np.float32(values[name] / entry.scale)
                raw = struct.pack(">f", stored).hex().upper()
                rows.append(Register(entry.address + i, name, values[name], raw))
    return tuple(rows)


def _note(runs: Path, entry: Mapping[str, Any]) -> None:
    """Add a line to the journal, on disk when this returns."""
    line = json.dumps({"utc": datetime.now(UTC).isoformat(timespec="seconds"), **entry}, ensure_ascii=False)
    path = runs / JOURNAL
    new = not path.exists()
    try:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: cannot be written ({exc.strerror or exc}), so no register was; make room or choose"
            " another folder for the runs"
        ) from exc
    if new:
        sync_folder(runs)
