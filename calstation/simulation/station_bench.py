"""The virtual bench of a station: its settings, its devices, and the hooks of a run on it.

`BENCH` is loaded by `calstation.config.load_bench` for a station with a section `[bench]`, and for no other.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from calstation.bench import BenchClock, BenchConfig, BenchHost
from calstation.config import (
    VIRTUAL_UNIT,
    BenchSettings,
    PairConfiguration,
    RunConfiguration,
    RunRequest,
    library,
    load_configuration,
)
from calstation.connection import BenchDevices, Endpoints, RecordedUnits
from calstation.errors import ConfigurationError
from calstation.physics import NAMES
from calstation.records import ImuSection, open_log, read_truth
from calstation.runs import BenchRuns
from calstation.schema import validate
from calstation.simulation.bench_settings import DEFAULT_SEED, Settings, bench_config, bench_settings, pair_bench_config
from calstation.simulation.hooks import BenchHooks


class StationBench(BenchSettings, BenchDevices, RecordedUnits, BenchRuns):
    """The virtual bench of any station with a section `[bench]`."""

    model = BenchConfig
    hooks = BenchHooks

    def check(self, setup: RunConfiguration, where: str) -> None:
        """Check the settings of a station's bench; `where` names them. Raises ConfigurationError."""
        validate(BenchConfig, {**bench_settings(setup), **setup.bench_overrides}, where)

    def seed(self, setup: RunConfiguration) -> int:
        """Return the seed of the bench from the files or the request."""
        return int(bench_settings(setup).get("seed", DEFAULT_SEED))

    @contextmanager
    def open(self, setups: tuple[RunConfiguration, ...], check_cancelled: Callable[[], None]) -> Iterator[Endpoints]:
        """Start the bench with the table and these units; yield their ports. Raises DeviceFaultError."""
        with _running(bench_config(*setups), check_cancelled) as (ports, clock):
            over_tcp = ports["table_transport"] == "tcp" and setups[0].table.protocol != "imu_link"
            table = f"tcp://{ports['table']}" if over_tcp else ports["table"]
            yield Endpoints(table, _imu_ports(ports, len(setups)), clock)

    @contextmanager
    def open_pair(self, setup: PairConfiguration, check_cancelled: Callable[[], None]) -> Iterator[Endpoints]:
        """Start the bench with these IMUs on one body; yield their ports. Raises DeviceFaultError."""
        with _running(pair_bench_config(setup), check_cancelled) as (ports, clock):
            yield Endpoints("", _imu_ports(ports, len(setup.units)), clock)

    def with_recorded_unit(self, recording: Path, setup: RunConfiguration) -> RunConfiguration:
        """Return the configuration with the unit of a recording in the fixture. Raises InputError.

        Its true errors follow from the seed of its run, or are those of the truth file next to the recording.
        """
        meta = open_log(recording).meta
        seed = None if meta.run is None else meta.run.seed
        truth = {name: value for name, value in read_truth(recording).items() if name in NAMES}
        known = seed is not None or bool(truth)
        request = replace(
            setup.request,
            serial=meta.imu.serial if known else VIRTUAL_UNIT,
            product=_product_like(meta.imu, setup.request) if known else setup.request.product,
            seed=seed,
        )
        setup = load_configuration(request)
        if truth:
            bench = {**(setup.station.bench or {}), "parameters": truth}
            setup = replace(setup, station=setup.station.model_copy(update={"bench": bench}))
        return setup


BENCH = StationBench()


@contextmanager
def _running(config: Settings, check_cancelled: Callable[[], None]) -> Iterator[tuple[Mapping[str, Any], BenchClock]]:
    """Start a bench; yield its ports and its clock."""
    with closing(BenchHost.start(config, check_cancelled)) as bench:
        host, _, port = bench.endpoints["clock"].rpartition(":")
        with closing(BenchClock((host, int(port)), float(config.get("speed", 0.0)))) as clock:
            yield bench.endpoints, clock


def _imu_ports(ports: Mapping[str, Any], count: int) -> tuple[str, ...]:
    return (ports["imu"], *(ports[f"imu{number}"] for number in range(2, count + 1)))


def _product_like(imu: ImuSection, request: RunRequest) -> Path | None:
    """Return the product whose IMU noise equals the recorded unit's; the requested product is tried first."""
    for path in (request.product, *(library.find("products", name) for name in library.names("products"))):
        with suppress(ConfigurationError):
            noise = load_configuration(replace(request, product=path)).imu.noise
            if np.allclose([noise.gyro_arw, noise.accel_vrw], [imu.gyro_arw, imu.accel_vrw], rtol=1e-3, atol=0.0):
                return path
    return request.product
