"""Transfers that were interrupted: found at the next start, finished or taken back on a person's word."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from calstation.devices.interfaces import Imu
from calstation.devices.registers import RegisterMap
from calstation.devices.transfer import Closing, Entry, Holds, finish, recognise, restore, transfer
from calstation.errors import DeviceFaultError, InputError
from calstation.sequencer.events import Message
from calstation.sequencer.ports import Clock, Emit
from calstation.station import register_journal
from calstation.station.register_journal import Transfer
from calstation.station.request import RunRequest
from calstation.station.setup import Setup, configured
from calstation.station.unit_alone import prove_at_rest, unit_alone
from calstation.station.worker import Tell

Decision = Literal["finish", "restore"]

DECISIONS: tuple[Decision, ...] = ("finish", "restore")
"""What may be done about an interrupted transfer: go on to the new registers and prove them, or take them back."""


@dataclass(frozen=True)
class Settled:
    """What became of a unit's registers: serial number, how its transfer ended, what the unit holds, SI."""

    serial: str
    closing: str
    registers: Mapping[str, float]


def settle(imu: Imu, clock: Clock, setup: Setup, runs: Path, emit: Emit) -> None:
    """Before a run: see whether an earlier transfer to its unit was interrupted.

    A unit that still holds its old registers is as it was, and is told so. Of any other the request's
    `unfinished` decides; without a decision the run is refused and the offers are told. Raises DeviceFaultError.
    """
    request = setup.request
    entry = register_journal.interrupted(runs, request.serial)
    if entry is None:
        return
    holds = recognise(imu, entry, _map(setup))
    about = {"serial": entry.serial, "holds": holds, "utc": entry.utc, "by": entry.by, "why": entry.why}
    if holds is Holds.OLD:
        entry.close(Closing.KEPT)
        imu.start()
        emit(Message("transfer_kept", about))
        return
    if request.unfinished is None:
        emit(Message("transfer_open", {**about, "offers": list(DECISIONS)}))
        raise _undecided(entry, holds)
    closing = _decide(imu, clock, setup, entry, request.unfinished).closing
    imu.start()
    emit(Message("transfer_settled", {**about, "closing": closing}))


def refuse_interrupted(imu: Imu, setup: Setup, runs: Path, serial: str) -> None:
    """Raises DeviceFaultError where a transfer to the unit waits for a decision; one that left no trace is closed."""
    entry = register_journal.interrupted(runs, serial)
    if entry is not None:
        holds = recognise(imu, entry, _map(setup))
        if holds is not Holds.OLD:
            raise _undecided(entry, holds)
        entry.close(Closing.KEPT)


def finish_transfer(tell: Tell, request: RunRequest, runs: Path) -> Settled:
    """Work for the workshop, never to be killed: bring a unit's interrupted transfer to its end.

    Raises InputError where there is none, DeviceFaultError where it cannot be done.
    """
    return _settle_by_hand(tell, request, runs, "finish")


def restore_registers(
    tell: Tell, request: RunRequest, runs: Path, by: str | None, ident: str | None = None
) -> Settled:
    """Work for the workshop, never to be killed: put earlier registers back into a unit.

    Parameters
    ----------
    by : who says so
    ident : of the transfer before which the unit held them; None for the latest, interrupted or not

    Raises
    ------
    InputError
        where the journal knows no such set.
    DeviceFaultError
        where it cannot be done; a unit whose interrupted transfer waits takes no other set before that is settled.
    """
    serial = request.serial
    if register_journal.interrupted(runs, serial) is not None and ident is None:
        return _settle_by_hand(tell, request, runs, "restore")
    wanted = _chosen(runs, serial, ident)
    setup, _ = configured(request)

    def begin(old: Mapping[str, float], new: Mapping[str, float]) -> Entry:
        source = f"before {wanted.id}"
        return register_journal.begin(runs, serial, old, new, by=by, why="restore", source=source)

    with unit_alone(tell, setup) as unit:
        refuse_interrupted(unit.imu, setup, runs, serial)
        done = transfer(unit.imu, _map(setup), serial, wanted.old, begin)
        prove_at_rest(unit.imu, unit.clock, setup, done)
    return Settled(serial, str(Closing.DONE), dict(done.found))


def _chosen(runs: Path, serial: str, ident: str | None) -> Transfer:
    known = register_journal.history(runs, serial)
    if not known:
        raise InputError(
            f"{runs}: no transfer to unit '{serial}' is known; give the folder of its runs with --out"
        )
    if ident is None:
        return known[-1]
    for transfer_ in known:
        if transfer_.id == ident:
            return transfer_
    raise InputError(
        f"{runs}: unit '{serial}' has no transfer '{ident}'; see calstation registers list {serial}"
    )


def _settle_by_hand(tell: Tell, request: RunRequest, runs: Path, decision: Decision) -> Settled:
    entry = register_journal.interrupted(runs, request.serial)
    if entry is None:
        raise InputError(
            f"{runs}: no transfer to unit '{request.serial}' is open; there is nothing to {decision}"
        )
    setup, _ = configured(request)
    with unit_alone(tell, setup) as unit:
        return _decide(unit.imu, unit.clock, setup, entry, decision)


def _decide(imu: Imu, clock: Clock, setup: Setup, entry: Transfer, decision: Decision) -> Settled:
    if decision == "restore":
        found: Mapping[str, Any] = restore(imu, _map(setup), entry)
    else:
        done = finish(imu, _map(setup), entry)
        prove_at_rest(imu, clock, setup, done)
        found = done.found
    return Settled(entry.serial, str(entry.closing), dict(found))


def _map(setup: Setup) -> RegisterMap:
    return RegisterMap(tuple(setup.imu.registers))


def _undecided(entry: Transfer, holds: Holds) -> DeviceFaultError:
    which = (
        "its new registers, which were never proved"
        if holds is Holds.NEW
        else "neither its old nor its new registers"
    )
    return DeviceFaultError(
        f"IMU: a transfer to unit '{entry.serial}' was interrupted ({entry.utc}) and it holds {which}; finish or"
        f" restore it: calstation registers finish {entry.serial}, or restore {entry.serial}"
    )
