"""The result of a comparison of two versions, which the interface can show without the packages for databases."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

VERDICTS = ("passed", "failed", "partial", "unjudged", "error")
#: Properties of a log by which the comparison is grouped.
GROUPS = ("product", "station", "month")


@dataclass(frozen=True)
class ParameterShift:
    """Change of a parameter over many logs, in units of the larger of the two sigmas of each log."""

    median: float
    percentile_95: float
    largest: float
    log: str  #: Location of the log with the largest change.
    serial: str  #: Serial number of the unit of this log.


@dataclass(frozen=True)
class VerdictChange:
    """A log whose verdict changed."""

    serial: str
    log: str  #: Location of the log.
    product: str | None
    station: str | None
    started_utc: str | None
    before: str  #: One of `VERDICTS`.
    after: str
    failed_before: str  #: Names of the checks that failed, separated by commas.
    failed_after: str


@dataclass(frozen=True)
class Group:
    """The logs of one product, station or month."""

    name: str
    logs: int
    pass_to_fail: int
    fail_to_pass: int
    moves: Mapping[str, ParameterShift]


@dataclass(frozen=True)
class Comparison:
    """Two versions of the solutions of the same logs."""

    before: str
    after: str
    logs: int  #: Number of logs that both versions contain.
    only_before: int
    only_after: int
    verdicts: Mapping[str, Mapping[str, int]]  #: Number of logs by verdict before and verdict after.
    changes: tuple[VerdictChange, ...]  #: In the order of product, station and start.
    moves: Mapping[str, ParameterShift]  #: By parameter.
    groups: Mapping[str, tuple[Group, ...]]  #: By kind of group.

    @property
    def pass_to_fail(self) -> tuple[VerdictChange, ...]:
        """Logs that passed before and fail after."""
        return tuple(each for each in self.changes if (each.before, each.after) == ("passed", "failed"))

    @property
    def fail_to_pass(self) -> tuple[VerdictChange, ...]:
        """Logs that failed before and pass after."""
        return tuple(each for each in self.changes if (each.before, each.after) == ("failed", "passed"))

    def to_json(self) -> dict[str, Any]:
        """Return JSON data."""
        return {"schema": "calstation.comparison/1", **asdict(self)}
