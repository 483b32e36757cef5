"""The virtual bench of a station: its settings, its devices, and the hooks of a run on it.

`BENCH` is loaded by `calstation.config.load_bench` for a station with a section `[bench]`, and for no other.
"""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from calstation.bench import BenchClock, BenchConfig, BenchHost
from calstation.config import (
    VIRTUAL_UNIT,
    PairConfiguration,
    RunConfiguration,
    RunRequest,
    library,
    load_configuration,
)
from calstation.connection import Endpoints, StationBench
from calstation.errors import ConfigurationError
from calstation.physics import NAMES
from calstation.records import ImuSection, open_log, read_truth
from calstation.schema import validate
from calstation.simulation.bench_settings import DEFAULT_SEED, bench_config, bench_settings, pair_bench_config
from calstation.simulation.hooks import BenchHooks


class VirtualBench(StationBench):
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
    def open(
        self, units: tuple[RunConfiguration, ...] | PairConfiguration, check_cancelled: Callable[[], None]
    ) -> Iterator[Endpoints]:
        """Start the bench with these units; yield their ports. Raises DeviceFaultError."""
        if isinstance(units, PairConfiguration):
            config, setups = pair_bench_config(units), units.units
        else:
            config, setups = bench_config(*units), units
        with closing(BenchHost.start(config, check_cancelled)) as bench:
            ports = bench.endpoints
            host, _, port = ports["clock"].rpartition(":")
            over_tcp = ports["table_transport"] == "tcp" and setups[0].table.protocol != "imu_link"
            table = f"tcp://{ports['table']}" if over_tcp else ports["table"]
            imus = (ports["imu"], *(ports[f"imu{number}"] for number in range(2, len(setups) + 1)))
            with closing(BenchClock((host, int(port)), float(config.get("speed", 0.0)))) as clock:
                chamber = f"tcp://{ports['chamber']}" if "chamber" in ports else ""
                yield Endpoints(table, imus, clock, chamber)

    def with_recorded_unit(self, recording: Path, setup: RunConfiguration) -> RunConfiguration:
        """Return the configuration with the unit of a recording in the fixture. Raises InputError.

        Its true errors are determined by the seed of its run, or by the truth file next to the recording.
        """
        meta = open_log(recording).meta
        seed = None if meta.run is None else meta.run.seed
        truth = {name: value for name, value in read_truth(recording).items() if name in NAMES}
        is_known = seed is not None or bool(truth)
        request = replace(
            setup.request,
            serial=meta.imu.serial if is_known else VIRTUAL_UNIT,
            product=_product_like(meta.imu, setup.request) if is_known else setup.request.product,
            seed=seed,
        )
        setup = load_configuration(request)
        if truth:
            bench = {**(setup.station.bench or {}), "parameters": truth}
            setup = replace(setup, station=setup.station.model_copy(update={"bench": bench}))
        return setup


BENCH = VirtualBench()


def _product_like(imu: ImuSection, request: RunRequest) -> Path | None:
    """Return the product with the IMU noise of the recorded unit; the requested product is tried first."""
    for path in (request.product, *(library.find("products", name) for name in library.names("products"))):
        with suppress(ConfigurationError):
            noise = load_configuration(replace(request, product=path)).imu.noise
            if np.allclose([noise.gyro_arw, noise.accel_vrw], [imu.gyro_arw, imu.accel_vrw], rtol=1e-3, atol=0.0):
                return path
    return request.product
