"""The journal of every unit's registers: what was to be written when, by whom, and how far it came.

One file for a serial number in the folder `registers` beside the runs, a JSON object a line, only ever added to, each
line on disk before what it announces is done. A line that a power cut tore announces nothing that happened.
"""

import json
import os
import secrets
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

from calstation.devices.transfer import Closing, Step
from calstation.errors import ConfigurationError
from calstation.records.atomic import sync_folder

FOLDER = "registers"
"""Beside the runs; a copy of the folder of the runs takes its units' history along."""

_SUFFIX = ".jsonl"


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
) -> Transfer:
    """Put an intention down, on disk when this returns. Raises ConfigurationError; nothing was written then."""
    path = _path(runs, serial)
    ident = f"{datetime.now(UTC):%Y%m%dT%H%M%S%f}-{secrets.token_hex(3)}"
    made = Transfer(path, ident, serial, _now(), dict(old), dict(new), by, why, source)
    intention = {"event": "intended", "id": ident, "serial": serial, "utc": made.utc, "by": by, "why": why}
    _append(path, {**intention, "source": source, "old": dict(old), "new": dict(new)})
    return made


def history(runs: Path, serial: str) -> list[Transfer]:
    """Every transfer to a unit that this folder knows, oldest first. Raises ConfigurationError."""
    path = _path(runs, serial)
    transfers: dict[str, Transfer] = {}
    for line in _lines(path):
        known = transfers.get(str(line.get("id")))
        if line.get("event") == "intended" and line.get("serial") == serial:
            with suppress(KeyError, TypeError, ValueError, AttributeError):  # no line of this program
                transfers[str(line["id"])] = _intended(path, line)
        elif known is not None and line.get("event") == "step":
            known.steps.append(str(line.get("step")))
        elif known is not None and line.get("event") == "closed":
            known.closing = str(line.get("closing"))
    return list(transfers.values())


def interrupted(runs: Path, serial: str) -> Transfer | None:
    """The unit's transfer that was begun and not closed, None where there is none; a later one replaces it."""
    transfers = history(runs, serial)
    return transfers[-1] if transfers and transfers[-1].closing is None else None


def serials(runs: Path) -> list[str]:
    """Units that have a journal, sorted."""
    return sorted(unquote(path.name.removesuffix(_SUFFIX)) for path in (runs / FOLDER).glob(f"*{_SUFFIX}"))


def cycles(runs: Path, serial: str) -> int:
    """Flash cycles that the transfers of this folder cost a unit."""
    return sum(transfer.cycles for transfer in history(runs, serial))


def _intended(path: Path, line: Mapping[str, Any]) -> Transfer:
    old, new = ({str(k): float(v) for k, v in line[which].items()} for which in ("old", "new"))
    return Transfer(
        path,
        str(line["id"]),
        str(line["serial"]),
        str(line["utc"]),
        old,
        new,
        line.get("by"),
        str(line["why"]),
        str(line.get("source", "")),
    )


def _path(runs: Path, serial: str) -> Path:
    return runs / FOLDER / f"{quote(serial, safe='')}{_SUFFIX}"


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _lines(path: Path) -> list[dict[str, Any]]:
    try:
        content = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: the register journal cannot be read ({exc.strerror or exc}); mend its folder"
        ) from exc
    lines = []
    for text in content.split(b"\n"):
        try:
            line = json.loads(text)
        except (ValueError, RecursionError):
            continue  # torn by a power cut: what it was to announce did not happen
        if isinstance(line, dict):
            lines.append(line)
    return lines


def _append(path: Path, line: Mapping[str, Any]) -> None:
    """Add a line, on disk when this returns; a torn line before it is ended first."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new = not path.exists()
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0)
        handle = os.open(path, flags, 0o644)
        try:
            size = os.fstat(handle).st_size
            os.lseek(handle, max(0, size - 1), os.SEEK_SET)
            torn = os.read(handle, 1) not in (b"", b"\n")
            text = json.dumps(line, ensure_ascii=False)
            _write(handle, (b"\n" if torn else b"") + text.encode() + b"\n")
            os.fsync(handle)
        finally:
            os.close(handle)
        if new:
            sync_folder(path.parent)
            sync_folder(path.parent.parent)
    except OSError as exc:
        raise ConfigurationError(
            f"{path}: the register journal cannot be written ({exc.strerror or exc}), so nothing further was"
            " written to the unit; make room or choose another folder for the runs"
        ) from exc


def _write(handle: int, data: bytes) -> None:
    while data:
        data = data[os.write(handle, data) :]
