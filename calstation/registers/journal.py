"""The journal of each unit's registers: the intended values of every transfer, its time, its author and its progress.

There is one file per serial number, with a checksummed line for every event (`checked_lines`), each on disk before the
announced action. If the journal is damaged, the unit is refused, because the written values are then unknown.

The journals of hardware units are in the site's own folder, regardless of the folder of a run: flash cycles and
interrupted transfers belong to the unit. The journals of virtual units are in the folder of their runs.
"""

import hashlib
import json
import secrets
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote, unquote

from calstation.config import RunConfiguration, StationConfig, site_folder
from calstation.devices.imu import Closing, Step
from calstation.devices.profiles import RegisterEntry
from calstation.errors import ConfigurationError
from calstation.messages import Text, Value, os_reason
from calstation.records import DamagedLineError, Line, Lines, append_line, read_lines

#: Folder of the journals, in the site's folder or in the folder of the runs.
FOLDER = "registers"

#: Kind of a unit's station; ``unknown`` for transfers recorded before hardware units had separate journals.
Kind = Literal["hardware", "virtual", "unknown"]

_SUFFIX = ".jsonl"

_BOTH = {"event", "id", "utc"}
#: Keys of every event's line. A line without a checksum has exactly these; one with a checksum may have more.
_KEYS = {
    "intended": _BOTH | {"serial", "by", "why", "source", "old", "new"},
    "step": _BOTH | {"step"},
    "closed": _BOTH | {"closing"},
}

#: Keys of a register entry that do not affect the meaning of its content.
_WITHOUT_MEANING = {"tolerance", "range"}


@dataclass(frozen=True)
class UnitType:
    """Model reported by a unit, and the profile and product with which it was written; "" if unknown.

    map : digest of the profile's register entries that define the meaning of the content
    """

    model: str = ""
    profile: str = ""
    product: str = ""
    map: str = ""

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "UnitType":
        return cls(**{field.name: str(content.get(field.name, "")) for field in fields(cls)})


@dataclass(frozen=True)
class Purpose:
    """Requester and reason of a transfer (run, hand or restore); `source` is the log or set of values that it uses."""

    by: str | None
    why: str
    source: str
    unit_type: UnitType = field(default_factory=UnitType)

    @classmethod
    def of(cls, setup: RunConfiguration, model: str, why: str, source: str) -> "Purpose":
        """Return the purpose for the operator of a configuration and a unit that reports `model`."""
        unit_type = UnitType(model, setup.imu.name, setup.product.name, map_digest(setup.imu.registers))
        return cls(setup.request.operator, why, source, unit_type)


def map_digest(registers: list[RegisterEntry]) -> str:
    """Return a digest that is equal for registers whose contents have the same meaning."""
    rows = sorted(
        json.dumps(entry.model_dump(mode="json", exclude=_WITHOUT_MEANING), sort_keys=True) for entry in registers
    )
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()[:16]


@dataclass
class Transfer:
    """One transfer as recorded in the journal; implements `transfer.Entry`. `id` increases with time.

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
    steps: list[str] = field(default_factory=list)
    closing: str | None = None

    def note(self, step: Step) -> None:
        """Record a step. Raises ConfigurationError if it cannot be written."""
        self._add({"event": "step", "step": step})
        self.steps.append(str(step))

    def close(self, closing: Closing) -> None:
        """Record how the transfer ended. Raises ConfigurationError if it cannot be written."""
        self._add({"event": "closed", "closing": closing})
        self.closing = str(closing)

    @property
    def cycles(self) -> int:
        """Flash cycles that the transfer used."""
        return self.steps.count(Step.COMMITTING)

    def _add(self, line: Mapping[str, Any]) -> None:
        _append(self.path, {"id": self.id, "utc": _now(), **line})


def begin(
    runs: Path,
    serial: str,
    old: Mapping[str, float],
    new: Mapping[str, float],
    purpose: Purpose,
    site: Path | None = None,
) -> Transfer:
    """Record an intended transfer, SI by parameter; `site` as in `history`. Raises ConfigurationError.

    The error means that the journal is damaged or cannot be written; otherwise the record is on disk.
    """
    history(runs, serial, site)
    path = _path(site or runs, serial)
    ident = f"{datetime.now(UTC):%Y%m%dT%H%M%S%f}-{secrets.token_hex(3)}"
    by, why, source, unit_type = purpose.by, purpose.why, purpose.source, purpose.unit_type
    made = Transfer(path, ident, serial, _now(), dict(old), dict(new), by, why, source, unit_type)
    intention = {"event": "intended", "id": ident, "serial": serial, "utc": made.utc, "by": by, "why": why}
    _append(path, {**intention, **asdict(unit_type), "source": source, "old": dict(old), "new": dict(new)})
    return made


def history(runs: Path, serial: str, site: Path | None = None) -> list[Transfer]:
    """Return every transfer to a unit, oldest first. Raises ConfigurationError if a journal is damaged.

    `site` is the site's folder for a hardware unit, None for a virtual one, whose journal is in the folder `runs`. That
    folder may also contain older transfers on hardware, from before the site had journals.
    """
    if site is None:
        return [transfer for transfer, _ in _transfers(_path(runs, serial), serial)]
    known = by_station(runs, serial, site)
    return known["unknown"] + known["hardware"]


def by_station(runs: Path, serial: str, site: Path) -> dict[Kind, list[Transfer]]:
    """Return every transfer by kind of station; `history` counts transfers at unknown stations for both kinds."""
    beside = _transfers(_path(runs, serial), serial)
    return {
        "hardware": [transfer for transfer, _ in _transfers(_path(site, serial), serial)],
        "virtual": [transfer for transfer, checked in beside if checked],
        "unknown": [transfer for transfer, checked in beside if not checked],
    }


def interrupted(runs: Path, serial: str, site: Path | None = None) -> Transfer | None:
    """Return the unit's latest transfer if it is still open, else None. Arguments and exceptions: see `history`."""
    transfers = history(runs, serial, site)
    return transfers[-1] if transfers and transfers[-1].closing is None else None


def truncated(runs: Path, serial: str, site: Path | None = None) -> Path | None:
    """Return the unit's journal if a power failure truncated it. Arguments and exceptions: see `history`."""
    path = _path(site or runs, serial)
    return path if _lines(path, serial).torn else None


def journal_folder(station: StationConfig) -> Path | None:
    """Return the site's folder for a hardware station; None for a virtual bench, whose journals are with the runs."""
    return None if station.bench is not None else site_folder()


def serials(folder: Path) -> list[str]:
    """Return the sorted serial numbers that have a journal in a folder of runs or in the site's folder."""
    return sorted(unquote(path.name.removesuffix(_SUFFIX)) for path in (folder / FOLDER).glob(f"*{_SUFFIX}"))


def cycles(runs: Path, serial: str, site: Path | None = None) -> int:
    """Return the number of the unit's flash cycles in the journal. Arguments and exceptions: see `history`."""
    return sum(transfer.cycles for transfer in history(runs, serial, site))


def _transfers(path: Path, serial: str) -> list[tuple[Transfer, bool]]:
    """Return a journal's transfers to a unit, and whether each has a checksum. Raises ConfigurationError."""
    found: dict[str, tuple[Transfer, bool]] = {}
    for line in _lines(path, serial).lines:
        try:
            _take(found, path, line)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as exc:
            raise _damaged(path, serial, line.number, Text("journal.unknown_content")) from exc
    # On a case-insensitive file system, two serial numbers may share a file.
    return [(transfer, checked) for transfer, checked in found.values() if transfer.serial == serial]


def _take(found: dict[str, tuple[Transfer, bool]], path: Path, line: Line) -> None:
    """Add a line to the transfers found so far. Raises various errors for a line with invalid content."""
    content = line.content
    keys = _KEYS[content["event"]]
    if not (keys <= content.keys() if line.checked else keys - {"source"} <= content.keys() <= keys):
        raise ValueError("other keys")
    ident = str(content["id"])
    if content["event"] == "intended":
        if ident in found:
            raise ValueError("begun twice")
        found[ident] = _intended(path, content), line.checked
    elif content["event"] == "step":
        found[ident][0].steps.append(str(Step(content["step"])))
    else:
        found[ident][0].closing = str(Closing(content["closing"]))


def _intended(path: Path, content: Mapping[str, Any]) -> Transfer:
    old, new = ({name: float(value) for name, value in content[which].items()} for which in ("old", "new"))
    ident, serial, utc, why = (str(content[name]) for name in ("id", "serial", "utc", "why"))
    source, unit_type = str(content.get("source", "")), UnitType.from_json(content)
    return Transfer(path, ident, serial, utc, old, new, content["by"], why, source, unit_type)


def _path(folder: Path, serial: str) -> Path:
    return folder / FOLDER / f"{quote(serial, safe='')}{_SUFFIX}"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _lines(path: Path, serial: str) -> Lines:
    try:
        return read_lines(path)
    except DamagedLineError as exc:
        raise _damaged(path, serial, exc.number, exc.why) from exc
    except OSError as exc:
        raise ConfigurationError("journal.unreadable", path=str(path), cause=os_reason(exc)) from exc


def _damaged(path: Path, serial: str, number: int, why: Value) -> ConfigurationError:
    return ConfigurationError("journal.damaged", path=str(path), line=number, why=why, serial=serial)


def _append(path: Path, line: Mapping[str, Any]) -> None:
    try:
        append_line(path, line)
    except OSError as exc:
        raise ConfigurationError("journal.unwritable", path=str(path), cause=os_reason(exc)) from exc
