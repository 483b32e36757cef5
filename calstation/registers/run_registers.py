"""Registers that a run wrote, and the latest registers of a unit, according to its journal."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from calstation.config import StationConfig, site_folder
from calstation.devices.imu import TransferOutcome
from calstation.messages import Text
from calstation.registers import journal
from calstation.registers.journal import Transfer, journal_folder
from calstation.results import Registers, Result


@dataclass(frozen=True)
class RunRegisters:
    """Registers that a run wrote to its unit.

    transfer : transfer of the run; None if the journal does not contain it
    later : first transfer since then after which the unit has always had other values; None if it has those of the run
    """

    registers: Registers
    transfer: Transfer | None = None
    later: Transfer | None = None

    @property
    def verified(self) -> bool:
        """Whether the run, or a later start, has verified the output of the unit with these registers."""
        return self.registers.verified or self._closing == TransferOutcome.DONE

    @property
    def replaced(self) -> bool:
        """Whether the unit no longer contains these registers."""
        return self.later is not None or self._restored

    @property
    def texts(self) -> list[Text]:
        """Parts of a sentence about the time of writing, the verification and a later replacement of the registers."""
        return list(self._texts())

    def _texts(self) -> Iterator[Text]:
        registers = self.registers
        if registers.verified and registers.written_utc:
            yield Text.of("registers.written_at", time=registers.written_utc)
        elif self.verified:
            yield Text("registers.written")
        elif not self._restored:
            yield Text("registers.interrupted" if registers.new is None else "registers.unverified")
        if registers.proved_on == "read_back":
            yield Text("registers.read_back")
        if self.verified and not registers.verified:
            yield Text("registers.verified_later")
        if self._restored:
            yield Text("registers.restored")
        if self.later is not None:
            verified = self.later.closing is not None
            yield Text.of("registers.replaced" if verified else "registers.replaced_unverified", time=self.later.utc)

    @property
    def _restored(self) -> bool:
        return self._closing in (TransferOutcome.KEPT, TransferOutcome.RESTORED)

    @property
    def _closing(self) -> str | None:
        return None if self.transfer is None else self.transfer.closing


def unit_transfer(station: StationConfig, runs: Path, serial: str) -> Transfer | None:
    """Return the transfer that wrote the registers of a unit, which is open if it was interrupted, or None.

    Raises ConfigurationError if the journal of the unit is damaged.
    """
    return journal.in_unit(journal.history(journal_folder(station, runs), serial))


def run_registers(result: Result, runs: Path) -> RunRegisters | None:
    """Return the registers that a run wrote or began to write, or None if it wrote none.

    Raises ConfigurationError if the journal of the unit is damaged.

    Parameters
    ----------
    result : result of the run
    runs : folder of its log, in which a virtual bench keeps the journals of its units
    """
    registers = result.registers
    if registers is None:
        return None
    log = Path(result.log.file).name
    for folder in (runs, site_folder()):
        transfers = journal.history(folder, result.serial)
        own = next((n for n, each in enumerate(transfers) if (each.why, each.source) == ("run", log)), None)
        if own is not None:
            later = _replacement(transfers[own], transfers[own + 1 :])
            written = registers.new is not None or journal.in_unit(transfers[own : own + 1]) is not None
            return RunRegisters(registers, transfers[own], later) if written else None
    return None if registers.new is None else RunRegisters(registers)


def _replacement(own: Transfer, later: Sequence[Transfer]) -> Transfer | None:
    """Return the transfer that replaced the values of `own`, or None if they are in the unit."""
    effective = [each for each in later if journal.in_unit([each]) is not None]
    others = list(takewhile(lambda each: each.new != own.new, reversed(effective)))
    return others[-1] if others else None
