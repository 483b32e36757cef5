"""Samples of a product's schedule, simulated on the virtual bench without its protocols and without a run."""

from pathlib import Path

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.config import RunRequest, load_configuration
from calstation.errors import ConfigurationError
from calstation.jobs import ProgressCallback
from calstation.physics import NAMES
from calstation.records import Log
from calstation.simulation.bench_settings import bench_config
from calstation.simulation.study import block_of

#: Serial number of the simulated unit.
_SERIAL = "SIMULATED-1"
#: Protocols of tables that the bench does not simulate from a plan.
_WITHOUT_PLAN = ("hand", "gimbal")


def simulate_log(
    report: ProgressCallback, station: Path | None, product: Path | None, seed: int
) -> tuple[Log, dict[str, float]]:
    """Job: simulate all stages of a product; return the log, in memory, and the true parameters by name, SI.

    All planned moves take place, because no solver ends a stage early. Raises ConfigurationError if the files are
    invalid, or if the product is calibrated without a motorised table.

    Parameters
    ----------
    report : callback for the progress
    station : station file with a virtual bench; None for the default
    product : product file; None for the default
    seed : seed of unit, table and noise
    """
    setup = load_configuration(RunRequest(_SERIAL, station, product, seed=seed))
    if setup.station.bench is None or setup.table.protocol in _WITHOUT_PLAN:
        raise ConfigurationError("simulation.not_simulated", station=setup.station.name, product=setup.product.name)
    settings = bench_config(setup)
    truth = BenchConfig.model_validate(settings).truth()
    simulator = Simulator(truth, settings["seed"])
    blocks = []
    for number, (stage, schedule) in enumerate(setup.schedules.items()):
        report(number / len(setup.schedules), note=stage)
        blocks.append(block_of(simulator.run(setup.plan(stage), stage, getattr(schedule, "rounds", None))))
    report(1.0)
    log = Log(Path(f"{setup.product.name}, seed {seed}"), setup.log_meta(), lambda: iter(blocks))
    return log, dict(zip(NAMES, truth.parameters.tolist(), strict=True))
