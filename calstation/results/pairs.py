"""Replays a log of IMUs on one body as if live: checks them, calibrates those out of tolerance, stores the result.

The calibration of a pair is stored in the site's folder and applied to the next log before its check.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calstation.config import pair_folder
from calstation.errors import InputError
from calstation.estimation.common import StoredPair
from calstation.estimation.pairs import PairCalibration, PairSchedule, PairWatch, StaticCheck, WatchEvent, check_values
from calstation.jobs import ProgressCallback
from calstation.messages import Text, values_from_json, values_to_json
from calstation.records import context_from_meta, estimated_rows, load_pair, open_log, prior_from_meta, store_pair
from calstation.results.plots import StoredPairFile, stored_pairs
from calstation.results.solver_chain import one_blas_thread
from calstation.schema import validate

STAGE = "cross_calibration"


@dataclass(frozen=True)
class PairWatchResult:
    """All events, and the last check and stored calibration of each secondary by number."""

    events: tuple[WatchEvent, ...]
    checks: dict[int, StaticCheck]
    stored: dict[int, StoredPair]


def watch_log(
    path: Path,
    folder: Path,
    command: bool = False,
    on_event: Callable[[WatchEvent], None] = lambda event: None,
    on_second: Callable[[float, PairWatch], None] = lambda time, watch: None,
) -> PairWatchResult:
    """Replay a log from start to end. Raises InputError or ConfigurationError if it cannot be used.

    A pair without a file in `folder` starts with the values in the log. With `command`, it is checked at the first
    rest, regardless of the triggers in the log's schedule. `on_event` is called with every event, `on_second` for every
    second of the log with its time, s, and the watch.
    """
    log = open_log(path)
    context = context_from_meta(log.meta)
    if not context.secondaries:
        raise InputError("solution.in_log", file=path, what=Text("solution.one_imu"))
    schedule = validate(PairSchedule, log.meta.schedule.get(STAGE, {}), f"schedule of {STAGE}", InputError)
    primary, width = log.meta.imu.serial, max(1, round(log.meta.imu.sample_rate_hz))
    secondaries = tuple(
        replace(s, stored=found if (found := load_pair(folder, primary, s.imu.serial)).values else s.stored)
        for s in context.secondaries
    )
    serials = {s.number: s.imu.serial for s in secondaries}

    def store(number: int, pair: StoredPair) -> None:
        store_pair(folder, primary, serials[number], pair)

    calibration = PairCalibration(replace(context, secondaries=secondaries), prior_from_meta(log.meta), schedule)
    watch = PairWatch(context.imu, secondaries, calibration, store)
    if command or schedule.trigger == "command":
        watch.command()
    events: list[WatchEvent] = []

    def handle(new: list[WatchEvent]) -> None:
        events.extend(new)
        for event in new:
            on_event(event)

    with one_blas_thread():
        for block in log.blocks():
            for start in range(0, len(block), width):
                second = block.part(start, min(start + width, len(block)))
                handle(watch.feed(second))
                on_second(float(second.time[-1]), watch)
        handle(watch.finish())
    return PairWatchResult(tuple(events), watch.checks, watch.stored)


@dataclass(frozen=True)
class PairProgress:
    """Progress of a replayed recording."""

    time: float  #: Time replayed so far, s.
    duration: float  #: Duration of the whole recording, s.
    state: str  #: ``waiting``, ``checking`` or ``calibrating``.
    motion: float  #: Fraction of the motion that a calibration needs, 0 to 1.
    events: tuple[WatchEvent, ...]  #: Events so far.

    def to_note(self) -> str:
        """Return the progress as the note of a job."""
        events = [(h.kind, h.time, h.number, values_to_json(h.values)) for h in self.events]
        return json.dumps([self.time, self.duration, self.state, self.motion, events])


def progress_from_note(note: str) -> PairProgress | None:
    """Return the progress from a note of `PairProgress.to_note`; None for any other note."""
    if not note.startswith("["):
        return None
    time, duration, state, motion, rows = json.loads(note)
    events = tuple(WatchEvent(kind, at, number, values_from_json(values)) for kind, at, number, values in rows)
    return PairProgress(time, duration, state, motion, events)


@dataclass(frozen=True)
class PairCheckResult:
    """Result of a replayed recording: the last check of each secondary by number, and its stored calibration."""

    progress: PairProgress
    checks: Mapping[int, Mapping[str, Any]]
    stored: tuple[StoredPairFile, ...]

    @property
    def calibrated(self) -> frozenset[int]:
        """Numbers of the secondaries that were out of tolerance and have been calibrated."""
        return frozenset(h.number for h in self.progress.events if h.kind == "calibrated")


def check_pair(report: ProgressCallback, path: Path) -> PairCheckResult:
    """Job: replay a recording with a check at the first rest, and store the calibrations in the site's folder.

    Raises InputError or ConfigurationError.
    """
    log = open_log(path)
    duration = estimated_rows(path) / log.meta.imu.sample_rate_hz
    events: list[WatchEvent] = []
    start: float | None = None
    last = 0.0

    def since_start(time: float) -> float:
        nonlocal start
        start = time if start is None else start
        return time - start

    def handle(event: WatchEvent) -> None:
        events.append(replace(event, time=since_start(event.time)))

    def on_second(time: float, watch: PairWatch) -> None:
        nonlocal last
        last = since_start(time)
        state = PairProgress(last, duration, watch.state, watch.progress, tuple(events))
        report(min(last / duration, 0.99), note=state.to_note())

    report(0.0)
    watched = watch_log(path, pair_folder(), True, handle, on_second)
    end = PairProgress(last, last, "waiting", 0.0, tuple(events))
    checks = {number: check_values(check) for number, check in watched.checks.items()}
    return PairCheckResult(end, checks, stored_pairs(context_from_meta(log.meta), pair_folder()))
