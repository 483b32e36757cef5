"""The prior that a run takes from the registers of its unit."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from calstation.config import (
    RunRequest,
)
from calstation.physics import INDEX
from calstation.records import prior_from_meta
from tests.prepared import prepare_run

NOW = datetime(2026, 1, 1, tzinfo=UTC)


def meta_of(setup, registers):
    return setup.log_meta(NOW, 1, registers)


def test_prior_of_an_uncorrected_stream_is_the_register_values():
    setup = prepare_run(RunRequest("SN-1"))
    posterior = prior_from_meta(meta_of(setup, {"accel_scale_x": 4e-4, "gyro_bias_z": 0.0}))
    assert posterior.mean[INDEX["accel_scale_x"]] == 4e-4
    assert posterior.mean[INDEX["accel_scale_y"]] == 0.0


def test_implausible_register_values_give_no_prior():
    setup = prepare_run(RunRequest("SN-1"))
    posterior = prior_from_meta(meta_of(setup, {"accel_scale_x": 0.5, "gyro_bias_z": float("nan")}))
    assert not posterior.mean.any()


def test_prior_of_a_corrected_stream_is_zero_and_registers_are_kept():
    setup = prepare_run(RunRequest("SN-1"))
    stream = setup.imu.stream.model_copy(update={"order": "after_registers"})
    setup = replace(setup, imu=setup.imu.model_copy(update={"stream": stream}))
    meta = meta_of(setup, {"accel_scale_x": 4e-4})
    assert not prior_from_meta(meta).mean.any()
    assert meta.registers == {"accel_scale_x": pytest.approx(4e-4)}
