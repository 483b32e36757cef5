"""State of the exchange with the shared database in a file, which the interface reads without using the network."""

import json
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

from pydantic import PlainSerializer, PlainValidator, TypeAdapter

from calstation.messages import Text, values_from_json
from calstation.records import locked, write_atomic
from calstation.sequencer import Message

#: File name of the state in the folder of the runs; the history ignores hidden files.
FILE = ".exchange.json"

#: Lock of the file, and the longest time to wait for it, s.
_LOCK, _LOCK_TIMEOUT_S = ".exchange_state.lock", 10.0


#: A message that is stored as its code and values.
_StoredText = Annotated[
    Text | None,
    PlainValidator(lambda data: data and Text(data["code"], values_from_json(data["values"]))),
    PlainSerializer(lambda text: text and text.to_json()),
]


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

    pending: int = 0  #: Number of runs that the database has not received.
    attempt_utc: datetime | None = None  #: Time of the attempt.
    contact_utc: datetime | None = None  #: Time of the last successful exchange.
    error: _StoredText = None  #: Error of the attempt; None if it succeeded.
    claims: tuple[Claim, ...] = ()  #: Claims at the time of the last successful exchange.
    refusal: _StoredText = None  #: Message about runs that the database refuses.
    logs_pending: int = 0  #: Number of logs that have not been copied to the archive.
    archive_error: _StoredText = None  #: Error of the last attempt to copy a log.

    def to_json(self) -> dict[str, Any]:
        """Return the state as JSON data."""
        state: dict[str, Any] = _STATE.dump_python(self, mode="json")
        return state


_STATE = TypeAdapter(ExchangeState)


def read_state(folder: Path) -> ExchangeState:
    """Return the state of the exchange of a folder within milliseconds; an empty state if there was no exchange."""
    try:
        return _STATE.validate_json((folder / FILE).read_bytes())
    except (OSError, ValueError):
        return ExchangeState()


def change_state(folder: Path, **changes: Any) -> None:
    """Change fields of the state of the exchange of a folder; several processes may do so. Raises OSError."""
    with locked(folder / _LOCK, _LOCK_TIMEOUT_S):
        state = read_state(folder)
        changed = replace(state, **changes).to_json()
        if changed != state.to_json():
            write_atomic(folder / FILE, json.dumps(changed), sync=False)
