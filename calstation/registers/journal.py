"""The journal of every unit's registers: what was to be written when, by whom, and how far it came.

One file for a serial number, a checked line for every event (`checked_lines`), each on disk before what it announces is
done. A journal that does not read as it was written refuses its unit: what it had announced is not known then.

Units on hardware have theirs in the site's own folder, whatever folder a run writes into: flash cycles and interrupted
transfers belong to the unit. Those of a virtual bench stand beside the runs, whose units they are.
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

from calstation.config.library import site_folder
from calstation.config.resolved import ResolvedConfiguration
from calstation.config.station import StationConfig
from calstation.devices.imu.transfer import Closing, Step
from calstation.devices.profiles.registers import RegisterEntry
from calstation.errors import ConfigurationError
from calstation.messages.rendering import sentence
from calstation.records.checked_lines import DamagedLineError, Line, Lines, append_line, read_lines

#: Of a register's entry, what leaves the meaning of its content as it is.
_MEANS_NOTHING = {"tolerance", "range"}


@dataclass(frozen=True)
class UnitType:
    """Model of a unit, and the profile and product that it was written by; "" where nobody noted it.

    Attributes
    ----------
    model : as the unit answered
    profile, product : names
    map : digest of the profile's registers, as far as they say what a content means
    """

    model: str = ""
    profile: str = ""
    product: str = ""
    map: str = ""

    @classmethod
    def of(cls, setup: ResolvedConfiguration, model: str) -> "UnitType":
        """Of a unit that answers with `model` and is written as `setup` has it."""
        return cls(model, setup.imu.name, setup.product.name, map_digest(setup.imu.registers))

    @classmethod
    def noted(cls, content: Mapping[str, Any]) -> "UnitType":
        """What a line of the journal says."""
        return cls(**{field.name: str(content.get(field.name, "")) for field in fields(cls)})

    def to_json(self) -> dict[str, str]:
        """As plain values."""
        return asdict(self)


def map_digest(registers: list[RegisterEntry]) -> str:
    """The same for registers whose contents mean the same."""
    rows = sorted(
        json.dumps(entry.model_dump(mode="json", exclude=_MEANS_NOTHING), sort_keys=True)
        for entry in registers
    )
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()[:16]


#: In the site's folder, or beside the runs.
FOLDER = "registers"

#: Of the station that a unit was at: ``unknown`` for what was written before hardware had journals of its own.
Kind = Literal["hardware", "virtual", "unknown"]

_SUFFIX = ".jsonl"

_BOTH = {"event", "id", "utc"}
#: Of every event's line; one without a check has these and no others. An intention with one may say its unit's sort.
_KEYS = {
    "intended": _BOTH | {"serial", "by", "why", "source", "old", "new"},
    "step": _BOTH | {"step"},
    "closed": _BOTH | {"closing"},
}


@dataclass
class Transfer:
    """One transfer as the journal has it; meets `transfer.Entry`.

    Attributes
    ----------
    id : of the transfer, rising with time
    old, new : the unit's registers before, and as they were to be, by parameter, SI
    by, why : who wanted it, and what for: run, hand or restore
    source : the log or the set that the values come from
    steps : what was noted, in order
    sort : of the unit, empty where it was not noted
    closing : how it ended, None where it is open
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
    sort: UnitType = field(default_factory=UnitType)
    steps: list[str] = field(default_factory=list)
    closing: str | None = None

    def note(self, step: Step) -> None:
        """Put down how far it has come. Raises ConfigurationError where the disk does not take it."""
        self._add({"event": "step", "step": step})
        self.steps.append(str(step))

    def close(self, closing: Closing) -> None:
        """Put down how it ended. Raises ConfigurationError."""
        self._add({"event": "closed", "closing": closing})
        self.closing = str(closing)

    @property
    def cycles(self) -> int:
        """Commits that it asked of the unit's flash."""
        return self.steps.count(Step.COMMITTING)

    def _add(self, line: Mapping[str, Any]) -> None:
        _append(self.path, {"id": self.id, "utc": _now(), **line})


def begin(
    runs: Path,
    serial: str,
    old: Mapping[str, float],
    new: Mapping[str, float],
    *,
    by: str | None,
    why: str,
    source: str,
    site: Path | None = None,
    sort: UnitType | None = None,
) -> Transfer:
    """Put an intention down, on disk when this returns.

    site : the site's folder where the unit is on hardware, None for one of a virtual bench
    sort : of the unit, None where nobody can tell

    Raises ConfigurationError, also where the unit's journal is damaged; nothing was written to the unit then.
    """
    history(runs, serial, site)
    path = _path(site or runs, serial)
    ident = f"{datetime.now(UTC):%Y%m%dT%H%M%S%f}-{secrets.token_hex(3)}"
    sort = sort or UnitType()
    made = Transfer(path, ident, serial, _now(), dict(old), dict(new), by, why, source, sort)
    intention = {"event": "intended", "id": ident, "serial": serial, "utc": made.utc, "by": by, "why": why}
    _append(path, {**intention, **sort.to_json(), "source": source, "old": dict(old), "new": dict(new)})
    return made


def history(runs: Path, serial: str, site: Path | None = None) -> list[Transfer]:
    """Every transfer to a unit, oldest first.

    `site` : see `begin`; what was written on hardware before the site had journals is found beside the runs

    Raises ConfigurationError where a journal cannot be read, or does not read as it was written.
    """
    if site is None:
        return [transfer for transfer, _ in _transfers(_path(runs, serial), serial)]
    before = [transfer for transfer, checked in _transfers(_path(runs, serial), serial) if not checked]
    return before + [transfer for transfer, _ in _transfers(_path(site, serial), serial)]


def apart(runs: Path, serial: str, site: Path) -> dict[Kind, list[Transfer]]:
    """Every transfer by the kind of its station; what may be of either counts for both in `history`.

    Raises ConfigurationError as `history`.
    """
    beside = _transfers(_path(runs, serial), serial)
    return {
        "hardware": [transfer for transfer, _ in _transfers(_path(site, serial), serial)],
        "virtual": [transfer for transfer, checked in beside if checked],
        "unknown": [transfer for transfer, checked in beside if not checked],
    }


def interrupted(runs: Path, serial: str, site: Path | None = None) -> Transfer | None:
    """The unit's transfer that was begun and not closed, None where there is none; a later one replaces it.

    Raises ConfigurationError as `history`.
    """
    transfers = history(runs, serial, site)
    return transfers[-1] if transfers and transfers[-1].closing is None else None


def torn(runs: Path, serial: str, site: Path | None = None) -> Path | None:
    """The unit's journal where a power cut tore its last line, None where it is whole. Raises ConfigurationError."""
    path = _path(site or runs, serial)
    return path if _lines(path, serial).torn else None


def journal_folder(station: StationConfig) -> Path | None:
    """Where the journals of a station's units are: the site's folder, None beside the runs of a virtual bench."""
    return None if station.bench is not None else site_folder()


def serials(folder: Path) -> list[str]:
    """Units that have a journal in a folder of runs or the site's, sorted."""
    return sorted(unquote(path.name.removesuffix(_SUFFIX)) for path in (folder / FOLDER).glob(f"*{_SUFFIX}"))


def cycles(runs: Path, serial: str, site: Path | None = None) -> int:
    """Flash cycles that the transfers known here cost a unit. Raises ConfigurationError."""
    return sum(transfer.cycles for transfer in history(runs, serial, site))


def _transfers(path: Path, serial: str) -> list[tuple[Transfer, bool]]:
    """A journal's transfers to a unit, each with whether a check proves its intention. Raises ConfigurationError."""
    found: dict[str, tuple[Transfer, bool]] = {}
    for line in _lines(path, serial).lines:
        try:
            _take(found, path, line)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as exc:
            raise _damaged(path, serial, line.number, "says nothing that this program knows") from exc
    # A file system that takes capitals for small letters gives two numbers one file.
    return [(transfer, checked) for transfer, checked in found.values() if transfer.serial == serial]


def _take(found: dict[str, tuple[Transfer, bool]], path: Path, line: Line) -> None:
    """Put a line into the transfers found so far. Raises any of many errors where it is none of this program's."""
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
    return Transfer(
        path,
        str(content["id"]),
        str(content["serial"]),
        str(content["utc"]),
        old,
        new,
        content["by"],
        str(content["why"]),
        str(content.get("source", "")),
        UnitType.noted(content),
    )


def _path(folder: Path, serial: str) -> Path:
    return folder / FOLDER / f"{quote(serial, safe='')}{_SUFFIX}"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _lines(path: Path, serial: str) -> Lines:
    try:
        return read_lines(path)
    except DamagedLineError as exc:
        raise _damaged(path, serial, exc.number, sentence(exc.why)) from exc
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: the register journal cannot be read ({exc.strerror or exc}); mend its folder"
        ) from exc


def _damaged(path: Path, serial: str, number: int, why: str) -> ConfigurationError:
    return ConfigurationError(
        f"{path}, line {number}: {why}, so it is not known what was written to unit '{serial}'; compare the unit's"
        " registers with those of its last result (Engineer page), then move this file away"
    )


def _append(path: Path, line: Mapping[str, Any]) -> None:
    try:
        append_line(path, line)
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: the register journal cannot be written ({exc.strerror or exc}), so nothing further was"
            " written to the unit; make room or mend its folder"
        ) from exc
