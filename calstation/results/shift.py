"""Counts of the runs of a station since the start of the shift."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, time, timedelta
from pathlib import Path

from calstation.jobs import ProgressCallback
from calstation.records import RunFilter
from calstation.results.history import History


@dataclass(frozen=True)
class ShiftCount:
    """Runs that ended with PASS or FAIL."""

    passed: int = 0
    failed: int = 0
    mean_duration: float | None = None  #: Mean duration of a run, s; None without runs.

    @property
    def done(self) -> int:
        """Number of runs."""
        return self.passed + self.failed

    @property
    def passed_share(self) -> float | None:
        """Fraction of the runs that passed (yield); None without runs."""
        return self.passed / self.done if self.done else None


def shift_start(starts: Iterable[str], now: datetime | None = None) -> datetime:
    """Return when the current shift began; `starts` are local times ``HH:MM``, `now` is the present by default."""
    now = (now or datetime.now()).astimezone()
    days = (now.date(), now.date() - timedelta(days=1))
    times = [datetime.combine(day, time.fromisoformat(start)).astimezone() for day in days for start in starts]
    return max(start for start in times if start <= now)


def count_shift(report: ProgressCallback, folder: Path, station: str, since: datetime) -> ShiftCount:
    """Job: count the runs of a station in a folder that began at `since` or later.

    Partial runs do not count, nor do runs that were stopped or ended in a fault; a resumed run counts once.
    """
    history = History(folder)
    history.refresh()
    begun = RunFilter(station=station, since=f"{since.astimezone(UTC):%Y-%m-%dT%H:%M:%S}")
    runs = [run for run in history.runs(begun, limit=None) if run.verdict in ("passed", "failed") and not run.partial]
    passed = sum(run.outcome == "passed" for run in runs)
    mean = sum(run.duration for run in runs) / len(runs) if runs else None
    return ShiftCount(passed, len(runs) - passed, mean)
