"""Follows a log of IMUs on one body as it would be followed live: checks, calibrates what is off, keeps the answer.

What is kept of a pair stands in the site's own folder; the next log is compensated with it first.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from calstation.config.library import site_folder
from calstation.errors import InputError
from calstation.estimation.common.context import StoredPair
from calstation.estimation.common.samples import SampleBlock
from calstation.estimation.pairs.calibration import PairCalibration
from calstation.estimation.pairs.static import StaticCheck
from calstation.estimation.pairs.watch import PairWatch, WatchEvent
from calstation.records.log import open_log
from calstation.records.meta import context_from_meta, load_pair, prior_from_meta, store_pair
from calstation.results.solver_chain import one_blas_thread
from calstation.schema import validate
from procedures.cross_calibration import Schedule

STAGE = "cross_calibration"


@dataclass(frozen=True)
class Watched:
    """What happened, the last check of each secondary, and what is stored of it now, by number."""

    events: tuple[WatchEvent, ...]
    checks: dict[int, StaticCheck]
    stored: dict[int, StoredPair]


def pair_folder() -> Path:
    """Where the site keeps its pairs."""
    return site_folder() / "pairs"


def watch_log(
    path: Path,
    folder: Path,
    command: bool = False,
    tell: Callable[[WatchEvent], None] | None = None,
    look: Callable[[float, PairWatch], None] | None = None,
) -> Watched:
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
        raise InputError(f"{path}: holds one IMU; add [imu2] to the configuration and its columns to the log")
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
    return Watched(tuple(events), watch.checks, watch.stored)


def _seconds(block: SampleBlock, rate: float) -> Iterator[SampleBlock]:
    """A block in parts of a second."""
    width = max(1, round(rate))
    for start in range(0, len(block), width):
        yield block.part(start, min(start + width, len(block)))


def _keep(folder: Path, primary: str, secondary: str, pair: StoredPair) -> None:
    store_pair(folder, primary, secondary, pair)
