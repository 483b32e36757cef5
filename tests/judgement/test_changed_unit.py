"""A gross change of a unit in the run is named with its channel and time, instead of a diverged solution."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from faulty_samples import exchange, offset, reverse, with_columns

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.estimation.common import SampleBlock, SolveContext, stage_data
from calstation.judgement.changed_unit import ChangedUnit
from calstation.judgement.table_motion import table_motion

sys.path.append(str(Path(__file__).parents[1] / "estimation"))
from simulated_stages import block_of, context_of, simulate

Unit = tuple[SolveContext, SampleBlock]


@pytest.fixture(scope="module")
def unit() -> Unit:
    """A unit and its samples of two equal stages."""
    truth = BenchConfig(grade="mems", seed=5, sample_rate_hz=100.0).truth()
    return context_of(truth), block_of(simulate(Simulator(truth, 5), truth, "six_position"))


def found(
    unit: Unit, change: Callable[..., object] | None, *, over_temperature: bool = False
) -> dict[str, object] | None:
    """Return what is named if the second of two equal stages is changed."""
    context, block = unit
    comparison = ChangedUnit(context.site.local_gravity, over_temperature=over_temperature)
    after = block if change is None else with_columns(block, change)
    for part in (block, replace(after, time=after.time + 1e4)):
        data = stage_data([part], context.imu)
        motion = table_motion(data)
        assert motion is not None
        diagnosis = comparison.find(motion, data)
    return None if diagnosis is None else {**diagnosis.values, "cause": diagnosis.cause}


def test_unit_that_does_not_change_is_not_named(unit: Unit) -> None:
    assert found(unit, None) is None


@pytest.mark.parametrize(("change", "channel"), [(reverse(5), "accel_z"), (exchange(3, 5), "accel_x")])
def test_change_between_two_stages_is_named(unit: Unit, change: Callable[..., object], channel: str) -> None:
    values = found(unit, change)
    assert values is not None
    assert (values["cause"], values["channel"]) == ("unit_changed", channel)
    assert found(unit, change, over_temperature=True) == values
    assert float(str(values["first"])) >= 1e4


def test_change_of_a_gyro_bias_is_named_with_its_size(unit: Unit) -> None:
    imu = unit[0].imu
    counts = np.deg2rad(10.0) / imu.gyro_lsb / (imu.sample_rate if imu.output == "increment" else 1.0)
    values = found(unit, offset(2, counts))
    assert values is not None
    assert values["channel"] == "gyro_z"
    assert float(str(values["after"])) - float(str(values["before"])) == pytest.approx(10.0, abs=0.1)
    assert found(unit, offset(2, counts), over_temperature=True) is None, "a sound gyro may change with its temperature"
