"""Settings of the tasks of a request, and the outcome of each log."""

from dataclasses import dataclass, field
from typing import Any, Literal

from calstation import __version__
from calstation.fleet.selection import Selection
from calstation.fleet.store import Wanted

#: ``failed``: stored as failed, now or before; ``unreachable``: failed without being stored.
Outcome = Literal["solved", "there", "failed", "unreachable", "not_selected", "refused"]


@dataclass(frozen=True)
class Assignment:
    """Settings common to all tasks."""

    database: str
    wanted: Wanted
    selection: Selection = field(default_factory=Selection)
    retry_failed: bool = False  #: Whether to solve again logs that are stored as failed.
    software: str = __version__


@dataclass(frozen=True)
class Status:
    """Outcome for a log."""

    location: str
    outcome: Outcome
    solution: int | None = None  #: Number of its solution in the database; None without a solution.
    error: dict[str, Any] = field(default_factory=dict)  #: The error as in a result JSON; {} if there is none.
    changed: bool | None = None  #: Whether configuration, range or stages differ from the log's own; None if unknown.
    seconds: dict[str, float] = field(default_factory=dict)  #: Duration of ``copy``, ``solve`` and ``write``.
