"""The events of a run with their times, read from its log."""

from dataclasses import dataclass
from pathlib import Path

from calstation.jobs import ProgressCallback
from calstation.records import open_log
from calstation.sequencer import Event, from_json


@dataclass(frozen=True)
class TimedEvent:
    """An event and the time since the first event of its run, s; None if the log does not contain the time.

    `utc` is the time of day, ISO 8601; "" if the log, written by an earlier version, does not contain it.
    """

    seconds: float | None
    event: Event
    utc: str = ""


def load_events(report: ProgressCallback, log: Path) -> list[TimedEvent]:
    """Job: read the events of a run from its log; events of other versions are skipped. Raises InputError."""
    events: list[TimedEvent] = []
    first: float | None = None
    for entry in open_log(log).events:
        values = dict(entry)
        at, utc = values.pop("station_time", None), str(values.pop("utc", ""))
        first = at if first is None else first
        try:
            seconds = None if at is None or first is None else at - first
            events.append(TimedEvent(seconds, from_json(values), utc))
        except (KeyError, TypeError):  # an entry that is not an event, or an event of another version
            continue
    return events
