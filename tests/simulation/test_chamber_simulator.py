"""The simulator of a stage over temperature, and whole calibrations that are simulated without protocols."""

from dataclasses import replace

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.config import RunRequest, library, load_configuration
from calstation.estimation.common import SampleBlock
from calstation.judgement import judge
from calstation.physics import NAMES, Dwell, Move, Ramp, Soak
from calstation.results import StageChain, one_blas_thread
from calstation.schema import validate
from calstation.simulation import bench_config
from calstation.simulation.chamber_simulator import ChamberSimulator
from calstation.simulation.temperature_study import PRODUCTS, RAMP_SCHEDULE, RATE_TERM
from procedures import method

STAGE = "temperature"


def bench(grade: str, seed: int, rate: float):
    """Return the configuration of a run and of its bench."""
    station, product = library.find("stations", "virtual_chamber"), library.find("products", PRODUCTS[grade])
    setup = load_configuration(RunRequest(f"SN-{seed:06d}", station, product))
    settings = {**bench_config(setup), "flash_file": None, "sample_rate_hz": rate}
    return setup, BenchConfig.model_validate(settings)


def simulator(counts: bool, rate: float) -> ChamberSimulator:
    _, config = bench("mems", 1, rate)
    return ChamberSimulator(config.truth(), config, 5, counts=counts)


def test_temperatures_do_not_depend_on_whether_output_is_simulated() -> None:
    steps = [Move(0.0, 0.0, 2.0, 2.0), Soak(40.0, 2.0, 20.0, 2000.0, 1, 2), Move(1.0, 2.0, 2.0, 2.0), Dwell(5.0)]
    steps += [Ramp(30.0, 4.0), Move(0.0, 0.0, 2.0, 2.0), Dwell(60.0)]
    full, course = (simulator(counts, 20.0) for counts in (True, False))
    samples, without = full.run(steps, STAGE), course.run(steps, STAGE)
    assert np.array_equal(samples.temperature, without.temperature)
    assert np.array_equal(samples.step, without.step)
    assert full.thermal.temperatures == course.thermal.temperatures
    assert np.array_equal(full.parameters, course.parameters)
    assert samples.temperature[0] == 23.0
    assert 34.0 < samples.temperature[samples.step == 1][-1] < 44.0  # changes by 2 K/min
    ramp = np.count_nonzero(samples.step == 3) / 20.0
    assert full.set_point == pytest.approx(40.0 - ramp * 4.0 / 60.0, abs=0.1)
    assert len(course.parameters_of_cells) == np.ceil(len(without.seq) / 10)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("grade", "ramp"), [("mems", True), ("mems", False), ("nav", True), ("nav", False)])
def test_whole_calibrations_pass_with_errors_within_their_sigmas(grade: str, ramp: bool) -> None:
    setup, config = bench(grade, 3, 100.0)
    values = {**setup.schedules[STAGE].model_dump(), **(RAMP_SCHEDULE if ramp else {})}
    schedule = validate(method(STAGE).schedule, values, STAGE)
    meta = setup.log_meta()
    section = meta.temperature.model_copy(update={"rate_term": sorted(RATE_TERM)} if ramp else {})
    imu = meta.imu.model_copy(update={"sample_rate_hz": 100.0})
    meta = meta.model_copy(update={"imu": imu, "temperature": section, "schedule": {STAGE: schedule.model_dump()}})
    truth = config.truth()
    simulated = ChamberSimulator(truth, config, 3)
    s = simulated.run(method(STAGE).plan(setup.table.geometry(), schedule), STAGE)
    block = SampleBlock(STAGE, s.seq, s.time, s.counts, s.angles, s.step, np.ones(len(s.seq), np.bool_), s.temperature)
    chain = StageChain(meta)
    with one_blas_thread():
        chain.start(STAGE)
        chain.feed(replace(block, station=s.time[:, None]))
        fit = chain.finish().temperature
    assert [c.name for c in judge(meta, chain.prior, tuple(chain.solutions)).checks if not c.passed] == []
    for temperature in np.linspace(-40.0, 85.0, 12):
        found, steady = fit.at(temperature), simulated.thermal.steady(truth.parameters, temperature)
        known = found.sigma > 0.0
        ratios = np.abs(found.mean - steady)[known] / found.sigma[known]
        assert ratios.max() < 5.0, (temperature, np.array(NAMES)[known][ratios.argmax()], ratios.max())
    if ramp and grade == "mems":
        assert s.time[-1] < 7200.0
        assert np.abs(fit.lags - [25.0, 15.0]).max() < 5.0 * fit.lag_sigmas.max()
