"""Work for the workshop: closes a run that is not to be resumed."""

from pathlib import Path

from calstation.jobs.queue import ProgressCallback
from calstation.runs.incomplete import close_incomplete


def close_run(tell: ProgressCallback, log: Path, operator: str | None) -> Path:
    """See `close_incomplete`; returns the run's result file."""
    result = close_incomplete(log, operator)
    tell(1.0)
    return result
