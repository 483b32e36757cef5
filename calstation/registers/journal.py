"""The journal of each unit's registers, with the intended values, time, author and progress of every transfer.

There is one chained file per serial number, with a line for every event. The line of an action is on disk before the
action begins. A unit with a damaged journal is refused, because its register values are unknown.

The journals of hardware units are in the site's own folder, regardless of the folder of a run: flash cycles and
interrupted transfers belong to the unit. The journals of virtual units are in the folder of their runs.
"""

import hashlib
import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import quote, unquote

from pydantic import BaseModel, Field

from calstation.config import RunConfiguration, StationConfig, site_folder
from calstation.devices.imu import TransferOutcome, TransferStep
from calstation.devices.profiles import RegisterEntry
from calstation.errors import ConfigurationError
from calstation.messages import Text, os_reason
from calstation.records import Chain, ChainedFile

#: Folder of the journals, in the site's folder or in the folder of the runs.
FOLDER = "registers"

_SUFFIX = ".jsonl"

#: Keys of a register entry that do not affect the meaning of its content.
_IGNORED_KEYS = {"tolerance", "range"}


@dataclass(frozen=True)
class UnitType:
    """Model reported by a unit, and the profile and product with which its registers were written; "" if unknown.

    map : digest of the profile's register entries that define the meaning of the content
    """

    model: str = ""
    profile: str = ""
    product: str = ""
    map: str = ""


@dataclass(frozen=True)
class Purpose:
    """Requester, reason ("run", "hand" or "restore") and source of a transfer, such as the log of the run."""

    by: str | None
    why: str
    source: str
    unit_type: UnitType = field(default_factory=UnitType)
    station: str | None = None  #: Name of the station; None in journals of earlier versions.

    @classmethod
    def of(cls, setup: RunConfiguration, model: str, why: str, source: str) -> "Purpose":
        """Return the purpose of a transfer by the operator of a configuration to a unit that reports `model`."""
        unit_type = UnitType(model, setup.imu.name, setup.product.name, map_digest(setup.imu.registers))
        return cls(setup.request.operator, why, source, unit_type, setup.station.name)


def map_digest(registers: list[RegisterEntry]) -> str:
    """Return a digest that is equal for registers whose contents have the same meaning."""
    rows = sorted(
        json.dumps(entry.model_dump(mode="json", exclude=_IGNORED_KEYS), sort_keys=True) for entry in registers
    )
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()[:16]


class _Intended(BaseModel):
    """Line written at the start of a transfer."""

    event: Literal["intended"]
    id: str
    serial: str
    utc: str
    old: dict[str, float]
    new: dict[str, float]
    by: str | None
    why: str
    source: str
    unit_type: UnitType
    station: str | None = None


class _StepTaken(BaseModel):
    event: Literal["step"]
    id: str
    step: TransferStep


class _Closed(BaseModel):
    event: Literal["closed"]
    id: str
    closing: TransferOutcome


_Line = Annotated[_Intended | _StepTaken | _Closed, Field(discriminator="event")]


@dataclass
class Transfer:
    """One transfer as recorded in the journal; implements `devices.imu.JournalEntry`. `id` increases with time.

    old, new : the unit's registers before the transfer, and the intended ones, by parameter, SI
    closing : how the transfer ended; None while it is open
    """

    path: Path
    id: str
    serial: str
    utc: str  #: Start, ISO 8601 in UTC.
    old: Mapping[str, float]
    new: Mapping[str, float]
    by: str | None
    why: str
    source: str
    unit_type: UnitType = field(default_factory=UnitType)
    station: str | None = None
    steps: list[str] = field(default_factory=list)
    closing: str | None = None

    def note(self, step: TransferStep) -> None:
        """Record a step. Raises ConfigurationError if it cannot be written."""
        _append(self.path, {"event": "step", "id": self.id, "utc": _now(), "step": step})
        self.steps.append(str(step))

    def close(self, outcome: TransferOutcome) -> None:
        """Record how the transfer ended. Raises ConfigurationError if it cannot be written."""
        _append(self.path, {"event": "closed", "id": self.id, "utc": _now(), "closing": outcome})
        self.closing = str(outcome)

    @property
    def written(self) -> bool:
        """Whether the restarted unit has its new registers, so that only their verification is missing."""
        return self.steps[-1:] == [TransferStep.RESTARTED] and TransferStep.RESTORING not in self.steps

    @property
    def cycles(self) -> int:
        """Number of flash cycles that the transfer used."""
        return self.steps.count(TransferStep.COMMITTING)


def journal_folder(station: StationConfig, runs: Path) -> Path:
    """Return the folder of a station that contains `FOLDER`: `runs` for a virtual bench, otherwise the site folder."""
    return runs if station.bench is not None else site_folder()


def begin(folder: Path, serial: str, old: Mapping[str, float], new: Mapping[str, float], purpose: Purpose) -> Transfer:
    """Record an intended transfer in the journal of a unit, and return it once the record is on disk.

    Raises ConfigurationError if the journal is damaged or cannot be written.

    Parameters
    ----------
    folder : folder returned by `journal_folder`
    serial : serial number of the unit
    old, new : registers before the transfer and intended registers, by parameter, SI
    purpose : requester, reason and source of the transfer
    """
    history(folder, serial)
    ident = f"{datetime.now(UTC):%Y%m%dT%H%M%S%f}-{secrets.token_hex(3)}"
    transfer = Transfer(_path(folder, serial), ident, serial, _now(), dict(old), dict(new), **vars(purpose))
    content = {name: value for name, value in asdict(transfer).items() if name not in ("path", "steps", "closing")}
    _append(transfer.path, {"event": "intended", **content})
    return transfer


def history(folder: Path, serial: str) -> list[Transfer]:
    """Return every transfer to a unit, oldest first. Raises ConfigurationError if the journal is damaged."""
    path = _path(folder, serial)
    transfers: dict[str, Transfer] = {}
    chain = _read(path, serial)
    for number, line in zip(chain.numbers, chain.entries, strict=True):
        if (line.id in transfers) == isinstance(line, _Intended):
            raise _damaged(path, serial, number, Text("log.line_unknown"))
        if isinstance(line, _Intended):
            transfers[line.id] = Transfer(path, **{name: value for name, value in line if name != "event"})
        elif isinstance(line, _StepTaken):
            transfers[line.id].steps.append(str(line.step))
        else:
            transfers[line.id].closing = str(line.closing)
    # On a case-insensitive file system, two serial numbers may share a file.
    return [transfer for transfer in transfers.values() if transfer.serial == serial]


def in_unit(transfers: Sequence[Transfer]) -> Transfer | None:
    """Return the latest transfer whose new values are, or may be, in the unit; None if there is none."""
    return next(
        (each for each in reversed(transfers) if each.steps and each.closing in (None, TransferOutcome.DONE)), None
    )


def interrupted(folder: Path, serial: str) -> Transfer | None:
    """Return the unit's latest transfer if it is still open, otherwise None. Raises the errors of `history`."""
    transfers = history(folder, serial)
    return transfers[-1] if transfers and transfers[-1].closing is None else None


def truncated(folder: Path, serial: str) -> Path | None:
    """Return the path of the unit's journal if a power failure truncated it. Raises the errors of `history`."""
    path = _path(folder, serial)
    return path if _read(path, serial).truncated else None


def serials(folder: Path) -> list[str]:
    """Return the sorted serial numbers that have a journal in a folder of runs or in the site's folder."""
    return sorted(unquote(path.name.removesuffix(_SUFFIX)) for path in (folder / FOLDER).glob(f"*{_SUFFIX}"))


def cycles(folder: Path, serial: str) -> int:
    """Return the number of the unit's flash cycles in the journal. Raises the errors of `history`."""
    return sum(transfer.cycles for transfer in history(folder, serial))


def _path(folder: Path, serial: str) -> Path:
    return folder / FOLDER / f"{quote(serial, safe='')}{_SUFFIX}"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _read(path: Path, serial: str) -> Chain[_Line]:
    try:
        chain = ChainedFile[_Line](path, _Line).read()
    except OSError as exc:
        raise ConfigurationError("journal.unreadable", path=str(path), cause=os_reason(exc)) from exc
    if chain.damage is not None:
        raise _damaged(path, serial, chain.damage.number, chain.damage.reason)
    return chain


def _damaged(path: Path, serial: str, number: int, why: Text) -> ConfigurationError:
    return ConfigurationError("journal.damaged", path=str(path), line=number, why=why, serial=serial)


def _append(path: Path, line: Mapping[str, Any]) -> None:
    try:
        ChainedFile[_Line](path, _Line).append(line)
    except OSError as exc:
        raise ConfigurationError("journal.unwritable", path=str(path), cause=os_reason(exc)) from exc
