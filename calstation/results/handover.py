"""Delivery of the result of every run to the factory's system exactly once, as a JSON file and a CSV line.

A run is pending from its start until its result is delivered, regardless of its outcome; a later run may deliver it.
"""

import os
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from calstation.config import StationConfig, load_station
from calstation.escaping import for_csv
from calstation.jobs import ProgressCallback
from calstation.messages import Text, os_reason
from calstation.parsing import parse_json
from calstation.records import FILE_MODE, SUFFIX, locked, sync_folder, write_atomic
from calstation.results.result import NO_RESULT, Result
from calstation.sequencer import Emit, Message

CSV_NAME = "handover.csv"

#: Folder inside the runs folder, with an empty file for each pending run.
PENDING = ".handover"

#: Maximum time that a run waits for an unresponsive folder, s.
_WAIT_TIME = 10.0

_LOCK_TIMEOUT = 5.0
#: Number of bytes at the end of the CSV that are searched for the line of an interrupted delivery.
_TAIL = 65_536

#: Columns of the CSV except the last, `result`, which names the JSON file in the same folder.
COLUMNS: dict[str, Callable[[Result], Any]] = {
    **{n: attrgetter(n) for n in ("started_utc", "serial")},
    "outcome": attrgetter("verdict"),
    **{n: attrgetter(n) for n in ("attempt", "product", "station", "operator")},
    "stages": lambda r: " ".join(r.solved_stages),
    "duration_s": lambda r: f"{r.duration_s:.1f}",
    "advice": lambda r: r.advice,
    "failed_checks": lambda r: "; ".join(check.name for check in r.failed_checks),
    "error": lambda r: r.end_reason,
    "registers_written": lambda r: int(r.verified),
    "configuration_sha256": lambda r: r.configuration_sha256,
    "log_sha256": lambda r: r.log.sha256,
    "log": lambda r: r.log.file,
    "simulated": lambda r: int(r.simulated),
}


@dataclass(frozen=True)
class Delivery:
    """Outcome of a delivery: numbers of delivered and of pending results, and the reason for a failure."""

    folder: Path
    done: int
    waiting: int
    reason: Text | None = None


class HandOver:
    """Delivers results in a separate thread, so that a slow folder does not delay the run."""

    def __init__(self, runs: Path, station_path: Path, station: StationConfig, emit: Emit) -> None:
        self._runs = runs
        self._folder, self._create = _target(runs, station_path, station)
        self._emit = emit
        self._thread: threading.Thread | None = None
        self._delivery: Delivery | None = None

    def start(self) -> threading.Thread:
        """Start delivering the results that are pending from earlier runs."""
        self._thread = threading.Thread(target=self._deliver, name="handover", daemon=True)
        self._thread.start()
        return self._thread

    def finish(self) -> None:
        """Deliver all pending results; emit a message if some are still pending or earlier ones were delivered.

        It waits at most `_WAIT_TIME` for a delivery in progress, and again for the new delivery.
        """
        if self._thread is not None:
            self._thread.join(_WAIT_TIME)
        before = 0 if self._delivery is None else self._delivery.done
        self._delivery = None
        if self._thread is None or not self._thread.is_alive():
            self.start().join(_WAIT_TIME)
        unresponsive = Text.of("handover.no_answer", seconds=_WAIT_TIME)
        ended = self._delivery or Delivery(self._folder, 0, len(_pending(self._runs)), unresponsive)
        values = {"folder": str(ended.folder)}
        if ended.waiting:
            self._emit(Message("handover_waiting", {**values, "count": ended.waiting, "reason": ended.reason}))
        elif before or ended.done > 1:
            self._emit(Message("handover_done", {**values, "count": before + ended.done}))

    def _deliver(self) -> None:
        self._delivery = _deliver(self._runs, self._folder, self._create)


def register_pending(runs: Path, name: str) -> None:
    """Register a run as pending; `name` is the stem of its log. Raises OSError."""
    folder = runs / PENDING
    folder.mkdir(exist_ok=True)
    (folder / name).touch()
    sync_folder(folder)


def deliver_pending(report: ProgressCallback, runs: Path, station: Path | None) -> Delivery:
    """Job: deliver the pending results of a runs folder to the hand-over folder of a station file."""
    path, config = load_station(station)
    return _deliver(runs, *_target(runs, path, config))


def _target(runs: Path, station_path: Path, station: StationConfig) -> tuple[Path, bool]:
    """Return the hand-over folder and whether to create it; a configured folder may be a missing network share."""
    if station.handover is None:
        return runs.absolute().parent / "handover", True
    return station_path.absolute().parent / Path(station.handover.folder).expanduser(), False


def _pending(runs: Path) -> list[str]:
    """Return the stems of the pending runs, the oldest first; remove pending runs without any file."""
    names = []
    for entry in (runs / PENDING).glob("*"):
        with suppress(FileNotFoundError):  # another process has already delivered it
            if (runs / f"{entry.name}.json").is_file():
                names.append((entry.stat().st_mtime, entry.name))
            elif not (runs / f"{entry.name}{SUFFIX}").exists() and not entry.name.startswith("."):
                entry.unlink()
    return [name for _, name in sorted(names)]


def _deliver(runs: Path, folder: Path, create: bool) -> Delivery:
    """Deliver the pending results; after a failure, continue with the others as long as the folder exists."""
    done = 0
    reason: Text | None = None
    try:
        if not _pending(runs):
            return Delivery(folder, 0, 0)
        if create:
            folder.mkdir(parents=True, exist_ok=True)
        with locked(runs / PENDING / ".lock", _LOCK_TIMEOUT):
            for name in _pending(runs):
                try:
                    _hand_over(runs, name, folder)
                    done += 1
                except OSError as exc:
                    reason = os_reason(exc)
                    if not folder.is_dir():
                        break
    except OSError as exc:
        reason = os_reason(exc)
    return Delivery(folder, done, len(_pending(runs)) if reason else 0, reason)


def _hand_over(runs: Path, name: str, folder: Path) -> None:
    content = (runs / f"{name}.json").read_bytes()
    write_atomic(folder / f"{name}.json", content)
    with suppress(*NO_RESULT):  # a JSON file of another program has no line
        _append(folder, name, Result.from_json(parse_json(content)))
    (runs / PENDING / name).unlink(missing_ok=True)


def _append(folder: Path, name: str, result: Result) -> None:
    """Append the run's line in one write, unless it exists; a new file starts with the header."""
    end = f",{name}.json\n"  # exact, because another program opens the file
    with ExitStack() as stack:
        try:
            stack.enter_context(locked(folder / ".handover.lock", _LOCK_TIMEOUT))
        except TimeoutError:
            raise
        except OSError:
            pass  # a share without locks: a single appending write is still atomic
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0)
        handle = os.open(folder / CSV_NAME, flags, FILE_MODE)
        stack.callback(os.close, handle)
        size = os.fstat(handle).st_size
        os.lseek(handle, max(0, size - _TAIL), os.SEEK_SET)
        tail = os.read(handle, _TAIL)
        if end.encode() in tail:
            return
        cells = [_cell(COLUMNS[name](result)) for name in _columns(handle)]
        begin = "" if not tail or tail.endswith(b"\n") else "\n"  # the last line may be truncated by a power failure
        header = "" if size else for_csv([[*COLUMNS, "result"]])
        os.write(handle, (begin + header + for_csv([cells]).removesuffix("\n") + end).encode())
        os.fsync(handle)


def _columns(handle: int) -> list[str]:
    """Return the columns of the open CSV; a file started by an earlier version may lack the last columns."""
    os.lseek(handle, 0, os.SEEK_SET)
    names = os.read(handle, _TAIL).partition(b"\n")[0].decode(errors="replace").strip().split(",")
    return names[:-1] if {*names[:-1]} <= COLUMNS.keys() and names[-1] == "result" else [*COLUMNS]


def _cell(value: Any) -> str:
    return "" if value is None else " ".join(str(value).split())
