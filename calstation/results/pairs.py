"""Monitoring of IMUs on one body, from a log or live: check, calibration if out of tolerance, and storage.

The calibration of a pair is stored in the site's folder and applied to the next log before its check.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from calstation.config import pair_folder
from calstation.errors import InputError
from calstation.estimation.common import SampleBlock, StoredCrossCalibration
from calstation.estimation.pairs import (
    Alignment,
    PairCalibration,
    PairSchedule,
    PairWatch,
    StaticCheck,
    Submit,
    Verdict,
    WatchEvent,
    call_now,
    check_values,
)
from calstation.jobs import ProgressCallback
from calstation.messages import Text, values_from_json, values_to_json
from calstation.records import (
    Log,
    LogMeta,
    context_from_meta,
    estimated_rows,
    load_pair,
    open_log,
    prior_from_meta,
    store_pair,
)
from calstation.results.plots import StoredPairFile, stored_pairs
from calstation.results.solver_chain import one_blas_thread
from calstation.schema import validate

STAGE = "cross_calibration"


class PairConsumer(Protocol):
    """Receives the data of a `PairSession`, in order and in one thread."""

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        """Process the next samples, which `watch` has already processed, and the events that resulted.

        `block` contains the raw counts of the primary and, in `others`, of the secondaries at the same times; see
        `PairWatch` for the state of the primary and the stored calibrations. After the last samples, `block` is empty.
        """


@dataclass(frozen=True)
class PairWatchResult:
    """Events of a watch, and the last check, verdicts and stored calibration of each secondary by number.

    `silent` are the IMUs that were silent at the end, 0 for the primary.
    """

    events: tuple[WatchEvent, ...]
    checks: Mapping[int, StaticCheck]
    verdicts: Mapping[int, Mapping[str, Verdict]]
    stored: Mapping[int, StoredCrossCalibration]
    silent: frozenset[int]

    @property
    def within(self) -> bool:
        """Whether every sensor was checked and is within tolerance or was calibrated, and all results were stored."""
        if self.checks.keys() != self.stored.keys() or self.silent:
            return False
        verdicts = [verdict for sensors in self.verdicts.values() for verdict in sensors.values()]
        failed = "out_of_tolerance" in verdicts or any(event.kind == "not_stored" for event in self.events)
        return not failed and not any(c.primary_out_of_tolerance for c in self.checks.values())


class PairSession:
    """Monitors IMUs on one body, from a log or live, and stores the calibrations of its secondaries.

    A pair without a file in `folder` starts with the values in `meta`. `source` is the name of the log in messages, and
    `submit` executes the fits, see `PairWatch`. Raises InputError if `meta` has no secondary or an invalid schedule.
    """

    def __init__(self, meta: LogMeta, folder: Path, source: str | Path, submit: Submit = call_now) -> None:
        context = context_from_meta(meta)
        if not context.secondaries:
            raise InputError("solution.in_log", file=source, what=Text("solution.one_imu"))
        schedule = validate(PairSchedule, meta.schedule.get(STAGE, {}), f"schedule of {STAGE}", InputError)
        primary, self.meta, self.schedule = meta.imu.serial, meta, schedule
        serials = {s.number: s.imu.serial for s in context.secondaries}
        pairs = [(s, load_pair(folder, primary, s.imu.serial)) for s in context.secondaries]
        secondaries = tuple(replace(s, stored=pair) if pair.values else s for s, pair in pairs)

        def store(number: int, pair: StoredCrossCalibration) -> None:
            store_pair(folder, primary, serials[number], pair)

        self.context = replace(context, secondaries=secondaries)
        self.prior = prior_from_meta(meta)  #: The primary's own errors.
        calibration = PairCalibration(self.context, self.prior, schedule)
        self.watch = PairWatch(context.imu, secondaries, calibration, store, submit)

    def run(
        self,
        blocks: Iterable[SampleBlock],
        consumers: Sequence[PairConsumer] = (),
        stopped: Callable[[], bool] = lambda: False,
    ) -> PairWatchResult:
        """Process all blocks, and pass each to the consumers together with its events.

        After the last block, a check or calibration of the collected data is completed, unless `stopped` returns True.
        """
        watch, events = self.watch, list[WatchEvent]()
        last: SampleBlock | None = None

        def deliver(block: SampleBlock, new: list[WatchEvent]) -> None:
            events.extend(new)
            for consumer in consumers:
                consumer.feed(block, watch, new)

        with one_blas_thread():
            for last in blocks:
                deliver(last, watch.feed(last))
            if last is not None:
                deliver(last.part(0, 0), [] if stopped() else watch.finish())
        return PairWatchResult(tuple(events), watch.checks, watch.verdicts, watch.stored, watch.silent)


def pair_report(watched: PairWatchResult, alignments: Mapping[int, Alignment] | None = None) -> dict[str, Any]:
    """Return the report of a watch as JSON values; `alignments` are the clocks of secondaries monitored live."""
    return {
        "schema": "calstation.watch/1",
        "passed": watched.within,
        "silent": sorted(watched.silent),
        "secondaries": [
            {
                "number": number,
                "verdicts": dict(watched.verdicts.get(number, {})),
                "check": check_values(watched.checks[number]) if number in watched.checks else None,
                "stored": {**asdict(stored), "values": dict(stored.values)},
                "alignment": asdict(alignments[number]) if alignments else None,
            }
            for number, stored in watched.stored.items()
        ],
        "events": [
            {"kind": e.kind, "time": e.time, "number": e.number, **values_to_json(e.values)} for e in watched.events
        ],
    }


def watch_log(
    path: Path, folder: Path, command: bool = False, consumers: Sequence[PairConsumer] = ()
) -> PairWatchResult:
    """Replay a log in blocks of a second with the calibrations in `folder`.

    With `command`, the pair is checked at the first rest, regardless of the triggers in the log's schedule. Raises
    InputError or ConfigurationError if the log cannot be used.
    """
    log = open_log(path)
    session = PairSession(log.meta, folder, path)
    if command or session.schedule.trigger == "command":
        session.watch.command()
    return session.run(_seconds(log), consumers)


def _seconds(log: Log) -> Iterator[SampleBlock]:
    """Yield the samples of a log in blocks of at most a second."""
    width = max(1, round(log.meta.imu.sample_rate_hz))
    for block in log.blocks():
        for start in range(0, len(block), width):
            yield block.part(start, min(start + width, len(block)))


@dataclass(frozen=True)
class PairProgress:
    """Progress of a replayed recording."""

    time: float  #: Time replayed so far, s.
    duration: float  #: Duration of the whole recording, s.
    state: str  #: ``waiting``, ``checking`` or ``calibrating``.
    motion: float  #: Collected fraction of the motion required for a calibration, 0 to 1.
    events: tuple[WatchEvent, ...]  #: Events so far.

    def to_note(self) -> str:
        """Return the progress as the text of a job's progress note."""
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


class _ProgressReport:
    """Reports the progress of a replay, with times since its start."""

    def __init__(self, report: ProgressCallback, duration: float) -> None:
        self._report, self._duration = report, duration
        self._start: float | None = None
        self.time = 0.0
        self.events: tuple[WatchEvent, ...] = ()

    def feed(self, block: SampleBlock, watch: PairWatch, events: Sequence[WatchEvent]) -> None:
        if len(block):
            self._start = float(block.time[0]) if self._start is None else self._start
            self.time = float(block.time[-1]) - self._start
        begin = self._start or 0.0
        self.events += tuple(replace(event, time=event.time - begin) for event in events)
        state = PairProgress(self.time, self._duration, watch.state, watch.progress, self.events)
        self._report(min(self.time / self._duration, 0.99), note=state.to_note())


def check_pair(report: ProgressCallback, path: Path) -> PairCheckResult:
    """Job: replay a recording with a check at the first rest, and store the calibrations in the site's folder.

    Raises InputError or ConfigurationError.
    """
    meta = open_log(path).meta
    progress = _ProgressReport(report, estimated_rows(path) / meta.imu.sample_rate_hz)
    report(0.0)
    watched = watch_log(path, pair_folder(), True, [progress])
    end = PairProgress(progress.time, progress.time, "waiting", 0.0, progress.events)
    checks = {number: check_values(check) for number, check in watched.checks.items()}
    return PairCheckResult(end, checks, stored_pairs(context_from_meta(meta), pair_folder()))
