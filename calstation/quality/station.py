"""State of a station: its check standards with their runs, its instruments, and the charts of its table."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from calstation.config import InstrumentSection, ProductConfig, StationConfig, library, load_product, load_station
from calstation.devices.profiles import load_imu_profile
from calstation.errors import InputError
from calstation.jobs import ProgressCallback
from calstation.judgement import StandardComparison
from calstation.quality.gravity_shift import GravityShift, gravity_shift
from calstation.quality.runs import product_runs
from calstation.quality.standards import (
    InstrumentState,
    StandardState,
    instrument_state,
    judge_result,
    standard_states,
    whole_runs,
)
from calstation.quality.summary import limit_interval
from calstation.quality.table_chart import TableChart, table_charts
from calstation.results import History

#: Only this number of runs of a check standard, the latest, are compared with the reference.
_MAX_RUNS = 200


@dataclass(frozen=True)
class StandardHistory:
    """A check standard with its runs at the station, the oldest first, compared with the current reference."""

    state: StandardState
    names: tuple[str, ...]  #: File names of the logs of the runs, without suffix.
    started_utc: tuple[str, ...]
    verdicts: tuple[StandardComparison, ...]
    half_limits: Mapping[str, float]  #: Half the width of the product's limits by parameter, SI.


@dataclass(frozen=True)
class StationQuality:
    """State of a station for a product."""

    standards: tuple[StandardHistory, ...]
    instruments: tuple[InstrumentSection, ...]
    instrument_states: tuple[InstrumentState, ...]  #: State of each of the `instruments`.
    table: Mapping[str, TableChart]
    gravity: GravityShift | None = None  #: A step of the accelerometer scale factors that is common to all units.
    station: str = ""  #: Name of the station.


def station_quality(
    report: ProgressCallback, folder: Path, station: Path | None, product: Path | None
) -> StationQuality:
    """Job: read the state of a station for a product from the runs of a folder, whose index is up to date.

    Raises ConfigurationError if the station or product file cannot be used.
    """
    (_, station_config), (_, product_config) = load_station(station), load_product(product)
    now, history = datetime.now(UTC), History.at(folder, station_config)
    standards = tuple(_standard_histories(station_config, product_config, history, now))
    report(0.8)
    runs = product_runs(folder, product_config.name, measured=station_config.bench is None)
    return StationQuality(
        standards,
        tuple(station_config.instruments),
        tuple(instrument_state(each, now) for each in station_config.instruments),
        table_charts(station_config, runs),
        gravity_shift(station_config, runs),
        station_config.name,
    )


def _standard_histories(
    station: StationConfig, product: ProductConfig, history: History, now: datetime
) -> Iterator[StandardHistory]:
    for state in standard_states(station, product, history, now):
        imu = load_imu_profile(library.find("imus", product.imu))
        runs = whole_runs(state.standard, station, product, history, now)[:_MAX_RUNS]
        rows = []
        for run in reversed(runs):
            try:
                rows.append((run, judge_result(state.standard, imu, history.result(run))))
            except InputError:  # a result that cannot be read cannot be displayed
                continue
        names, started = tuple(run.log.stem for run, _ in rows), tuple(run.started_utc for run, _ in rows)
        intervals = {name: limit_interval(product, name) for name in state.standard.reference}
        halves = {name: 0.5 * (each[1] - each[0]) for name, each in intervals.items() if each is not None}
        yield StandardHistory(state, names, started, tuple(verdict for _, verdict in rows), halves)
