"""Selection of logs by place and time of their recording."""

from dataclasses import dataclass
from datetime import date
from typing import NamedTuple

from calstation.records import LogMeta


class Origin(NamedTuple):
    """Place and time of recording of a log, and its product; None if unknown."""

    station: str | None
    product: str | None
    started_utc: str | None  #: ISO 8601.

    @classmethod
    def of(cls, meta: LogMeta) -> "Origin":
        """Return the origin of a log from its configuration."""
        run, product = meta.run, meta.product
        station, started = (None, None) if run is None else (run.station, run.started_utc)
        return cls(station, None if product is None else product.name, started)


@dataclass(frozen=True)
class Selection:
    """Conditions that must all hold; None means no condition. A log that lacks a selected property is not selected."""

    station: str | None = None
    product: str | None = None
    since: date | None = None  #: First day of the start, UTC.
    until: date | None = None  #: Last day of the start, UTC.

    def takes(self, origin: Origin) -> bool:
        """Return whether a log is selected."""
        day = (origin.started_utc or "")[:10]
        return (
            self.station in (None, origin.station)
            and self.product in (None, origin.product)
            and (self.since is None or day >= self.since.isoformat())
            and (self.until is None or "" < day <= self.until.isoformat())
        )
