"""The events of a run, which its log contains with their times."""

from dataclasses import dataclass
from pathlib import Path

from calstation.jobs import ProgressCallback
from calstation.records import open_log
from calstation.sequencer import Event, from_json


@dataclass(frozen=True)
class TimedEvent:
    """An event and the time since the first event of its run, s; None if the log does not contain it."""

    seconds: float | None
    event: Event


def load_events(report: ProgressCallback, log: Path) -> list[TimedEvent]:
    """Job: read the events of a run from its log; events of other versions are skipped. Raises InputError."""
    events: list[TimedEvent] = []
    first: float | None = None
    for entry in open_log(log).events:
        values = dict(entry)
        at = values.pop("station_time", None)
        first = at if first is None else first
        try:
            events.append(TimedEvent(None if at is None or first is None else at - first, from_json(values)))
        except (KeyError, TypeError):  # an entry that is not an event, or an event of another version
            continue
    return events
