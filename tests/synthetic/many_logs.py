"""Many short raw logs like those recorded by several stations in a year, for re-solving and comparison.

They contain an error that a comparison should find: from March on, the configuration of `WRONG_STATION` has a surveyed
gravity that is too high by `GRAVITY_ERROR`, and the limits of the accelerometer scale factors are so narrow that units
fail. The stations are at locations with different gravity, so that no value is correct for all of them.
"""

import zlib
from datetime import UTC, datetime, timedelta
from multiprocessing import get_context
from pathlib import Path

from calstation.bench import BenchConfig
from calstation.bench.truth import GRADES, GradeName, Simulator
from calstation.config import RunConfiguration, RunRequest, library, load_configuration
from calstation.jobs import ProgressCallback
from calstation.records import SUFFIX, LogMeta, RawLogWriter
from calstation.simulation import bench_config
from calstation.simulation.study import FAST_PRODUCTS, block_of
from procedures import method

#: Site of each station, with its true gravity.
STATIONS = {
    "bench 1": {"latitude_deg": 34.25, "height_m": 400.0, "gravity_mps2": 9.79547},
    "bench 2": {"latitude_deg": 31.2, "height_m": 20.0, "gravity_mps2": 9.7941},
    "bench 3": {"latitude_deg": 45.75, "height_m": 150.0, "gravity_mps2": 9.8064},
}
#: Station with a wrong configured gravity, and the start of this error.
WRONG_STATION, WRONG_SINCE = "bench 2", datetime(2026, 3, 1, tzinfo=UTC)
#: Relative error of its configured gravity.
GRAVITY_ERROR = 20e-6
#: Limit of the accelerometer scale factors, in standard deviations of the grade's units.
SCALE_LIMIT = 1.5
_BEGIN, _PERIOD = datetime(2025, 12, 1, 6, tzinfo=UTC), timedelta(days=240)
_PROCESSES = 2


def record_logs(
    progress: ProgressCallback, folder: Path, count: int, grade: GradeName = "mems", seed: int = 1
) -> list[Path]:
    """Job: write `count` logs of different units to a folder, with all 30 parameters each; return their paths.

    The product is the grade's product with a designed schedule. Equal seeds yield equal logs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(folder, grade, seed, number, count) for number in range(count)]
    paths = []
    with get_context("spawn").Pool(min(_PROCESSES, count)) as pool:
        for done, path in enumerate(pool.imap(_record, jobs, chunksize=4), 1):
            paths.append(path)
            progress(done / count)
    return paths


def _record(job: tuple[Path, GradeName, int, int, int]) -> Path:
    folder, grade, seed, number, count = job
    serial, station = f"SN-{number + 1:05d}", [*STATIONS][number % len(STATIONS)]
    started = _BEGIN + number / count * _PERIOD
    request = RunRequest(serial, None, library.find("products", FAST_PRODUCTS[grade]), seed=seed)
    setup = load_configuration(request)
    bench = bench_config(setup)
    assert bench is not None
    bench["seed"] = zlib.crc32(f"{seed} {serial}".encode())
    bench |= STATIONS[station]
    truth = BenchConfig(**bench).truth()
    meta = _meta(setup, station, started, grade)
    path = folder / f"{serial}_{started:%Y%m%dT%H%M%S}{SUFFIX}"
    path.unlink(missing_ok=True)
    simulator = Simulator(truth, bench["seed"])
    writer = RawLogWriter(path, meta)
    for stage, schedule in setup.schedules.items():
        steps = method(stage).plan(setup.table.geometry(), schedule)
        writer.append(block_of(simulator.run(steps, stage, getattr(schedule, "rounds", None))))
    writer.close("recorded")
    return path


def _meta(setup: RunConfiguration, station: str, started: datetime, grade: GradeName) -> LogMeta:
    """Return the configuration of a log; the surveyed gravity of `WRONG_STATION` is wrong from `WRONG_SINCE` on."""
    plain = setup.log_meta(started).model_dump()
    wrong = station == WRONG_STATION and started >= WRONG_SINCE
    site = STATIONS[station]
    plain["site"] |= {**site, "gravity_mps2": round(site["gravity_mps2"] * (1.0 + GRAVITY_ERROR * wrong), 7)}
    plain["run"]["station"] = station
    plain["product"]["limits"]["accel_scale"]["within"] = SCALE_LIMIT * GRADES[grade].sigma["accel_scale"]
    return LogMeta.model_validate(plain)
