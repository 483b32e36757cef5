"""The journal of each unit's registers: what was to be written when, by whom, and how far it came.

One file for a serial number, a checked line for every event (`checked_lines`), each on disk before what it announces
is done. A journal that does not read as it was written refuses its unit, because it is then unknown what was written.

Units on hardware have theirs in the site's own folder, whatever folder a run writes into: flash cycles and interrupted
transfers belong to the unit. Those of a virtual bench are beside the runs that the units belong to.
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

from calstation.config import ResolvedConfiguration, StationConfig, site_folder
from calstation.devices.imu import Closing, Step
from calstation.devices.profiles import RegisterEntry
from calstation.errors import ConfigurationError
from calstation.messages import Text, Value, os_reason
from calstation.records import DamagedLineError, Line, Lines, append_line, read_lines

#: In the site's folder, or beside the runs.
FOLDER = "registers"

#: Kind of a unit's station; ``unknown`` for what was written before hardware had journals of its own.
Kind = Literal["hardware", "virtual", "unknown"]

_SUFFIX = ".jsonl"

_BOTH = {"event", "id", "utc"}
#: Keys of every event's line; a line without a checksum has these and no others. One with a checksum may have more.
_KEYS = {
    "intended": _BOTH | {"serial", "by", "why", "source", "old", "new"},
    "step": _BOTH | {"step"},
    "closed": _BOTH | {"closing"},
}

#: Keys of a register's entry that do not change the meaning of its content.
_WITHOUT_MEANING = {"tolerance", "range"}


@dataclass(frozen=True)
class UnitType:
    """Model of a unit as it reports it, and the profile and product with which it was written; "" if unknown.

    map : digest of the profile's registers, as far as they define what a content means
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
    """Who wants a transfer, and what for (run, hand or restore); `source` is the log or set of values behind it."""

    by: str | None
    why: str
    source: str
    unit_type: UnitType = field(default_factory=UnitType)

    @classmethod
    def of(cls, setup: ResolvedConfiguration, model: str, why: str, source: str) -> "Purpose":
        """The purpose of a configuration's operator, for a unit that reports `model`."""
        unit_type = UnitType(model, setup.imu.name, setup.product.name, map_digest(setup.imu.registers))
        return cls(setup.request.operator, why, source, unit_type)


def map_digest(registers: list[RegisterEntry]) -> str:
    """A digest that is equal for registers whose contents mean the same."""
    rows = sorted(
        json.dumps(entry.model_dump(mode="json", exclude=_WITHOUT_MEANING), sort_keys=True) for entry in registers
    )
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()[:16]


@dataclass
class Transfer:
    """One transfer as the journal has it; implements `transfer.Entry`. `id` increases with time.

    old, new : the unit's registers before, and as intended, by parameter, SI
    closing : how it ended; None while it is open
    """

    path: Path
    id: str
    serial: str
    utc: str
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
        """Record how it ended. Raises ConfigurationError if it cannot be written."""
        self._add({"event": "closed", "closing": closing})
        self.closing = str(closing)

    @property
    def cycles(self) -> int:
        """Flash cycles that it cost the unit."""
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
    """Record an intention; it is on disk when this returns. Raises ConfigurationError if the journal is damaged or
    cannot be written; nothing was written to the unit.
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
    """Every transfer to a unit, oldest first. Raises ConfigurationError: a journal does not read as it was written.

    `site` is the site's folder for a unit on hardware, None for one of a virtual bench, whose journal is beside the
    `runs`. There are also transfers on hardware from before the site had journals.
    """
    if site is None:
        return [transfer for transfer, _ in _transfers(_path(runs, serial), serial)]
    known = by_station(runs, serial, site)
    return known["unknown"] + known["hardware"]


def by_station(runs: Path, serial: str, site: Path) -> dict[Kind, list[Transfer]]:
    """Every transfer by the kind of its station; those of an unknown station count for both in `history`."""
    beside = _transfers(_path(runs, serial), serial)
    return {
        "hardware": [transfer for transfer, _ in _transfers(_path(site, serial), serial)],
        "virtual": [transfer for transfer, checked in beside if checked],
        "unknown": [transfer for transfer, checked in beside if not checked],
    }


def interrupted(runs: Path, serial: str, site: Path | None = None) -> Transfer | None:
    """The unit's latest transfer if it is still open. Arguments and exceptions as `history`."""
    transfers = history(runs, serial, site)
    return transfers[-1] if transfers and transfers[-1].closing is None else None


def truncated(runs: Path, serial: str, site: Path | None = None) -> Path | None:
    """The unit's journal if a power cut truncated its last line. Arguments and exceptions as `history`."""
    path = _path(site or runs, serial)
    return path if _lines(path, serial).torn else None


def journal_folder(station: StationConfig) -> Path | None:
    """The site's folder for a station on hardware; None for a virtual bench, whose journals are beside the runs."""
    return None if station.bench is not None else site_folder()


def serials(folder: Path) -> list[str]:
    """Serial numbers that have a journal in a folder of runs or the site's, sorted."""
    return sorted(unquote(path.name.removesuffix(_SUFFIX)) for path in (folder / FOLDER).glob(f"*{_SUFFIX}"))


def cycles(runs: Path, serial: str, site: Path | None = None) -> int:
    """Flash cycles of the unit that the journal knows. Arguments and exceptions as `history`."""
    return sum(transfer.cycles for transfer in history(runs, serial, site))


def _transfers(path: Path, serial: str) -> list[tuple[Transfer, bool]]:
    """A journal's transfers to a unit, each with whether its intention has a checksum. Raises ConfigurationError."""
    found: dict[str, tuple[Transfer, bool]] = {}
    for line in _lines(path, serial).lines:
        try:
            _take(found, path, line)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as exc:
            raise _damaged(path, serial, line.number, Text("journal.unknown_content")) from exc
    # A file system that ignores case gives two serial numbers one file.
    return [(transfer, checked) for transfer, checked in found.values() if transfer.serial == serial]


def _take(found: dict[str, tuple[Transfer, bool]], path: Path, line: Line) -> None:
    """Add a line to the transfers found so far. Raises any of many errors for a line with other content."""
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
