"""Follows a log of IMUs on one body as it would be followed live: checks, calibrates what is off, keeps the answer.

What is kept of a pair stands in the site's own folder; the next log is compensated with it first.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calstation.config.library import pair_folder
from calstation.errors import InputError
from calstation.estimation.common.context import StoredPair
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.pairs.calibration import PairCalibration
from calstation.estimation.pairs.static import StaticCheck
from calstation.estimation.pairs.watch import PairWatch, WatchEvent, check_values
from calstation.messages.rendering import Text, values_from_json, values_to_json
from calstation.records.csv_log import estimated_rows
from calstation.records.log import open_log
from calstation.records.meta import context_from_meta, load_pair, prior_from_meta, store_pair
from calstation.records.raw_log import SUFFIX
from calstation.records.raw_read import row_count
from calstation.results.plots.pairs import PairEvent, StoredPairFile, stored_pairs
from calstation.results.solver_chain import one_blas_thread
from calstation.schema import validate
from procedures.cross_calibration import Schedule

STAGE = "cross_calibration"


@dataclass(frozen=True)
class PairWatchResult:
    """What happened, the last check of each secondary, and what is stored of it now, by number."""

    events: tuple[WatchEvent, ...]
    checks: dict[int, StaticCheck]
    stored: dict[int, StoredPair]


def watch_log(
    path: Path,
    folder: Path,
    command: bool = False,
    tell: Callable[[WatchEvent], None] | None = None,
    look: Callable[[float, PairWatch], None] | None = None,
) -> PairWatchResult:
    """Follow a log from its begin to its end.

    Parameters
    ----------
    folder : of the stored pairs; a pair that is not there yet starts with what the log says
    command : check at the first rest, whatever the log's schedule says of triggers
    tell : told what happens; look : shown the watch every second of the log, with that second, s

    Raises InputError or ConfigurationError with file, field and mend.
    """
    log = open_log(path)
    context = context_from_meta(log.meta)
    if not context.secondaries:
        raise InputError("solution.in_log", file=path, what=Text("solution.one_imu"))
    schedule = validate(Schedule, log.meta.schedule.get(STAGE, {}), f"schedule of {STAGE}", InputError)
    primary = log.meta.imu.serial
    secondaries = tuple(
        replace(s, stored=found if (found := load_pair(folder, primary, s.imu.serial)).values else s.stored)
        for s in context.secondaries
    )
    serials = {s.number: s.imu.serial for s in secondaries}
    watch = PairWatch(
        context.imu,
        secondaries,
        PairCalibration(replace(context, secondaries=secondaries), prior_from_meta(log.meta), schedule.rules),
        schedule.triggers,
        lambda number, pair: _keep(folder, primary, serials[number], pair),
    )
    if command or schedule.trigger == "command":
        watch.command()
    events: list[WatchEvent] = []

    def heard(new: list[WatchEvent]) -> None:
        events.extend(new)
        if tell is not None:
            for event in new:
                tell(event)

    with one_blas_thread():
        for block in log.blocks():
            for second in _seconds(block, log.meta.imu.sample_rate_hz):
                heard(watch.feed(second))
                if look is not None:
                    look(float(second.time[-1]), watch)
        heard(watch.finish())
    return PairWatchResult(tuple(events), watch.checks, watch.stored)


def _seconds(block: SampleBlock, rate: float) -> Iterator[SampleBlock]:
    """A block in parts of a second."""
    width = max(1, round(rate))
    for start in range(0, len(block), width):
        yield block.part(start, min(start + width, len(block)))


def _keep(folder: Path, primary: str, secondary: str, pair: StoredPair) -> None:
    store_pair(folder, primary, secondary, pair)


@dataclass(frozen=True)
class PairProgress:
    """How far a recording has been followed.

    Attributes
    ----------
    time, duration : s followed, and of the whole recording
    state : waiting, checking or calibrating; motion : collected of what a calibration wants, 0 to 1
    happened : so far, in order
    """

    time: float
    duration: float
    state: str
    motion: float
    happened: tuple[PairEvent, ...]

    def to_note(self) -> str:
        """As the text that travels with a job's progress."""
        happened = [(h.kind, h.time, h.number, values_to_json(h.values)) for h in self.happened]
        return json.dumps([self.time, self.duration, self.state, self.motion, happened])


def progress_from_note(note: str) -> PairProgress | None:
    """What `PairProgress.to_note` told; None for any other note."""
    if not note.startswith("["):
        return None
    time, duration, state, motion, happened = json.loads(note)
    events = tuple(
        PairEvent(kind, at, number, values_from_json(values)) for kind, at, number, values in happened
    )
    return PairProgress(time, duration, state, motion, events)


@dataclass(frozen=True)
class PairCheckResult:
    """A recording followed to its end: the last check of each secondary by number, and what is kept of it now."""

    followed: PairProgress
    checks: Mapping[int, Mapping[str, Any]]
    kept: tuple[StoredPairFile, ...]

    @property
    def calibrated(self) -> frozenset[int]:
        """Numbers of the secondaries that were off and have been calibrated."""
        return frozenset(h.number for h in self.followed.happened if h.kind == "calibrated")


def check_pair(tell: Callable[..., None], path: Path) -> PairCheckResult:
    """Check at the first rest, calibrate what is off, and keep what was found in the site's own folder.

    Raises InputError or ConfigurationError with file, field and mend.
    """
    log = open_log(path)
    rows = max(1, row_count(path) if path.suffix == SUFFIX else estimated_rows(path))
    duration = rows / log.meta.imu.sample_rate_hz
    begin: list[float] = []
    happened: list[PairEvent] = []

    def since_begin(time: float) -> float:
        if not begin:
            begin.append(time)
        return time - begin[0]

    def heard(event: WatchEvent) -> None:
        happened.append(PairEvent(event.kind, since_begin(event.time), event.number, event.values))

    last = 0.0

    def look(time: float, watch: PairWatch) -> None:
        nonlocal last
        now = last = since_begin(time)
        state = PairProgress(now, duration, watch.state, watch.progress, tuple(happened))
        tell(min(now / duration, 0.99), note=state.to_note())

    tell(0.0)
    watched = watch_log(path, pair_folder(), True, heard, look)
    end = PairProgress(last, last, "waiting", 0.0, tuple(happened))
    checks = {number: check_values(check) for number, check in watched.checks.items()}
    return PairCheckResult(end, checks, stored_pairs(context_from_meta(log.meta), pair_folder()))
