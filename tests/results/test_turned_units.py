"""Logs of units in other orientations and off the table centre are solved like logs of a run."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.config import (
    RunRequest,
    library,
)
from calstation.physics import INDEX, ORIENTATIONS
from calstation.records import SUFFIX, RawLogWriter
from calstation.results import resolve
from calstation.simulation import bench_config
from procedures import method
from tests.estimation.simulated_stages import block_of
from tests.helpers import sampled
from tests.prepared import prepare_batch

LEVER = [0.3, -0.25, 0.1]


@pytest.mark.parametrize("orientation", sampled(12, ORIENTATIONS))
def test_log_of_a_reoriented_unit_agrees_with_the_truth_and_passes(orientation: str, tmp_path: Path) -> None:
    station = tomllib.loads((library.shipped_folder() / "stations" / "virtual_batch.toml").read_text(encoding="utf-8"))
    station["bench"]["units"] = 2
    station["slots"] = [{"name": "A1"}, {"name": "A2", "orientation": orientation, "lever_m": LEVER}]
    path = tmp_path / "two.toml"
    path.write_text(tomli_w.dumps(station), encoding="utf-8")
    product = library.find("products", "tactical_b_fast")
    _, setup = prepare_batch(RunRequest("SN-1", path, product, serials=("SN-1", "SN-2"), out=tmp_path))

    bench = bench_config(setup)
    assert bench is not None
    truth = BenchConfig(**bench).truth()
    log = tmp_path / f"SN-2{SUFFIX}"
    writer, simulator = RawLogWriter(log, setup.log_meta()), Simulator(truth, 5)
    for stage, schedule in setup.schedules.items():
        steps = method(stage).plan(setup.table.geometry(), schedule)
        writer.append(block_of(simulator.run(steps, stage, getattr(schedule, "rounds", None))))
    writer.close("recorded")

    result = resolve(log).result
    errors = {n: (p.value - truth.parameters[INDEX[n]]) / p.sigma for n, p in result.parameters.items()}
    assert len(errors) == 30
    assert max(map(abs, errors.values())) < 4.0, errors
    assert np.sqrt(np.mean(np.square(list(errors.values())))) < 1.5
    assert result.passed, [check.name for check in result.failed_checks]
    assert (result.slot, result.batch) == ("A2", setup.request.batch)
    for name in ("tilt_x", "tilt_y", "orthogonality"):
        assert abs(result.table[name].value) < np.deg2rad(0.5), name
