"""State of the exchange with the shared database, in a file that the window reads without the network."""

import json
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from calstation.messages import Text, values_from_json
from calstation.records import locked, write_atomic
from calstation.sequencer import Message

#: File name of the state in the folder of the runs; the history ignores hidden files.
FILE = ".exchange.json"

#: Lock of the file, and the longest time to wait for it, s.
_LOCK, _LOCKED_S = ".exchange_state.lock", 10.0


@dataclass(frozen=True)
class Claim:
    """The claim of another station on a unit that this station has also claimed."""

    serial: str
    station: str
    operator: str | None
    since: datetime  #: UTC, by the clock of the database.

    @property
    def message(self) -> Message:
        """The message for the operator."""
        values = {"serial": self.serial, "station": self.station, "since": f"{self.since.astimezone():%H:%M}"}
        if self.operator is None:
            return Message("claimed_elsewhere", values)
        return Message("claimed_by", {**values, "operator": self.operator})


@dataclass(frozen=True)
class ExchangeState:
    """State after the last attempt of an exchange."""

    pending: int = 0  #: Runs that have not arrived.
    attempt_utc: datetime | None = None  #: Time of the attempt.
    contact_utc: datetime | None = None  #: Time of the last successful exchange.
    error: dict[str, Any] | None = None  #: Code and values of the error of the attempt; None if it succeeded.
    claims: tuple[Claim, ...] = ()  #: Claims at the time of the last successful exchange.
    refusal: dict[str, Any] | None = None  #: Code and values of the message about runs that the database refuses.
    logs_pending: int = 0  #: Logs that have not been copied to the archive.
    archive_error: dict[str, Any] | None = None  #: Code and values of the error of the last copy of a log.

    @property
    def error_text(self) -> Text | None:
        """The error as a message."""
        return _text(self.error)

    @property
    def refusal_text(self) -> Text | None:
        """Message about runs that the database refuses."""
        return _text(self.refusal)

    @property
    def archive_error_text(self) -> Text | None:
        """The error of the last copy of a log as a message."""
        return _text(self.archive_error)

    def to_json(self) -> dict[str, Any]:
        """Return the state as JSON data."""
        state: dict[str, Any] = _STATE.dump_python(self, mode="json")
        return state


_STATE = TypeAdapter(ExchangeState)


def _text(error: dict[str, Any] | None) -> Text | None:
    return None if error is None else Text(error["code"], values_from_json(error["values"]))


def read_state(folder: Path) -> ExchangeState:
    """Return the state of the exchange of a folder, in milliseconds; an empty state if there was no exchange."""
    try:
        return _STATE.validate_json((folder / FILE).read_bytes())
    except (OSError, ValueError):
        return ExchangeState()


def change_state(folder: Path, **changes: Any) -> None:
    """Change fields of the state of the exchange of a folder; several processes may do so. Raises OSError."""
    with locked(folder / _LOCK, _LOCKED_S):
        state = read_state(folder)
        changed = replace(state, **changes)
        if changed != state:
            write_atomic(folder / FILE, json.dumps(changed.to_json()), sync=False)
