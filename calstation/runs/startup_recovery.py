"""What is to be done when the program opens: runs that died get their result, what waits is handed over."""

from dataclasses import dataclass
from pathlib import Path

from calstation.jobs.queue import ProgressCallback
from calstation.results.handover import Delivery, deliver_pending
from calstation.results.history import History
from calstation.runs.incomplete import finish_incomplete


@dataclass(frozen=True)
class StartupRecovery:
    """Logs of runs that had died, and what came of the hand-over."""

    incomplete: tuple[Path, ...]
    delivery: Delivery


def recover_startup(tell: ProgressCallback, runs: Path, station: Path | None) -> StartupRecovery:
    """Work for the workshop: bring a folder of runs in order; `station` : the file that says where to hand over."""
    dead = finish_incomplete(runs) if runs.is_dir() else []
    tell(0.3)
    History(runs).refresh(lambda fraction: tell(0.3 + 0.4 * fraction))
    return StartupRecovery(tuple(dead), deliver_pending(tell, runs, station))
