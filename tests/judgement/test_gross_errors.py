"""Gross errors of a configuration are named, with the entry to change, from the table's motion."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from faulty_samples import (
    exchange,
    exchange_angles,
    modulo,
    offset,
    other_kind,
    reverse,
    reverse_angle,
    turn_unit,
    with_columns,
)

from calstation.bench import BenchConfig
from calstation.bench.truth import Simulator
from calstation.judgement import data_faults, gross_errors
from calstation.messages import sentence

sys.path.append(str(Path(__file__).parents[1] / "estimation"))
from simulated_stages import block_of, context_of, prior_of, simulate

STAGES = ("rate", "six_position")


@pytest.fixture(scope="module", params=["nav", "mems"])
def unit(request):
    truth = BenchConfig(grade=request.param, seed=5, sample_rate_hz=100.0, azimuth_deg=30.0).truth()
    simulator = Simulator(truth, 5)
    return context_of(truth), prior_of(truth), {s: block_of(simulate(simulator, truth, s)) for s in STAGES}


def causes(unit, stage, change=None, **imu):
    context, prior, blocks = unit
    block = blocks[stage] if change is None else with_columns(blocks[stage], change)
    context = replace(context, imu=replace(context.imu, **imu))
    return [(cause.cause, sentence(cause.text(stage))) for cause in data_faults(block, context, prior)]


@pytest.mark.filterwarnings("error")
def test_rotation_by_nothing_says_nothing_about_axes():
    turns = np.vstack([np.eye(3), np.zeros(3)])
    assert gross_errors._fits(turns, turns)[0].factor == 1.0
    assert gross_errors._fits(turns[3:], turns[3:]) == [None]


@pytest.mark.parametrize("stage", STAGES)
def test_right_configuration_has_no_fault(unit, stage):
    assert causes(unit, stage) == []


def test_recording_without_gyros_has_no_fault(unit):
    def without_gyros(block):
        return replace(block, counts=np.hstack([np.full((len(block), 3), np.nan), block.counts[:, 3:]]))

    context, prior, blocks = unit
    assert not data_faults(without_gyros(blocks["six_position"]), context, prior)


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (exchange_angles, "outer_deg and inner_deg are exchanged"),
        (reverse_angle(0), "outer_deg has the opposite sign"),
        (reverse_angle(1), "inner_deg has the opposite sign"),
        (reverse(0), "gyro_x is −gyro_x"),
        (exchange(0, 1), "gyro_x is gyro_y, gyro_y is gyro_x"),
        (exchange(1, 2), "gyro_y is gyro_z, gyro_z is gyro_y"),
        (reverse(5), "accel_z is −accel_z"),
        (exchange(3, 5), "accel_x is accel_z, accel_z is accel_x"),
        (turn_unit, 'orientation = "+y+z"'),
    ],
)
def test_wrong_axes_and_angles_are_named(unit, stage, change, words):
    ((cause, text),) = causes(unit, stage, change)
    assert cause == "angles_or_axes"
    assert words in text
    assert "[columns]" in text


@pytest.mark.parametrize("stage", STAGES)
def test_wrong_units_are_named_with_the_size_of_a_count(unit, stage):
    imu = unit[0].imu
    cases = [
        ({"accel_lsb": imu.accel_lsb / 9.80665}, "accel_unit", "g instead of m/s²", "accel_lsb = "),
        ({"accel_lsb": imu.accel_lsb * 9.80665}, "accel_unit", "m/s² instead of g", "accel_lsb = "),
        ({"gyro_lsb": imu.gyro_lsb * np.rad2deg(1.0)}, "gyro_unit", "°/s instead of rad/s", "gyro_lsb = "),
        ({"gyro_lsb": imu.gyro_lsb * np.deg2rad(1.0)}, "gyro_unit", "rad/s instead of °/s", "gyro_lsb = "),
        ({"sample_rate": 50.0}, "sample_rate_wrong", "instead of 50 samples", "sample_rate_hz = "),
        ({"sample_rate": 200.0}, "sample_rate_wrong", "instead of 200 samples", "sample_rate_hz = "),
        ({"output": other_kind(imu).output}, "output_kind", "wrong kind", f'output = "{imu.output}"'),
    ]
    for changed, code, words, remedy in cases:
        ((cause, text),) = causes(unit, stage, **changed)
        assert cause == code
        assert words in text
        assert remedy in text
        if code.endswith("_unit"):
            suggested = float(re.search(r"_lsb = (\S+) in", text)[1])
            assert suggested == pytest.approx(getattr(imu, remedy.split()[0]), rel=0.02)


def test_rates_read_as_increments_are_named(unit):
    imu = unit[0].imu
    rates = {"output": "rate", "gyro_lsb": imu.gyro_lsb * 100.0, "accel_lsb": imu.accel_lsb * 100.0}
    assert causes(unit, "rate", **rates) == []
    ((cause, text),) = causes(unit, "rate", **{**rates, "output": "increment"})
    assert cause == "output_kind"
    assert 'output = "rate"' in text
    ((cause, text),) = causes(unit, "rate", **{**rates, "sample_rate": 50.0})
    assert cause == "sample_rate_wrong"
    assert "correct gyro_lsb" in text


@pytest.mark.parametrize(("channel", "counts"), [(1, 65536.0), (4, -65536.0)])
def test_wrapped_count_is_named(unit, channel, counts):
    ((cause, text),) = causes(unit, "rate", offset(channel, counts))
    assert cause == "count_offset"
    assert f"is off by {counts:+.0f} counts" in text


def test_angles_modulo_a_turn_that_cannot_be_continued_are_named(unit):
    ((cause, _),) = causes(unit, "rate", modulo)
    assert cause == "angles_modulo"


@pytest.mark.parametrize("wrong", [45.0, 180.0, -90.0])
def test_wrong_heading_is_measured(unit, wrong):
    context, prior, blocks = unit
    if context.imu.gyro_arw > 1e-5:
        return  # six short rests of a MEMS unit do not measure it
    azimuth = context.site.azimuth + np.deg2rad(wrong)
    faults = data_faults(blocks["six_position"], replace(context, site=replace(context.site, azimuth=azimuth)), prior)
    ((cause, text),) = [(fault.cause, sentence(fault.text("six_position"))) for fault in faults]
    assert cause == "heading_wrong"
    assert "a heading of 30.0 ±" in text or "a heading of 29.9 ±" in text or "a heading of 30.1 ±" in text


def test_heading_in_the_other_sense_is_named(unit):
    context, prior, blocks = unit
    if context.imu.gyro_arw > 1e-5:
        return
    other = replace(context, site=replace(context.site, azimuth=-context.site.azimuth))
    ((fault),) = data_faults(blocks["six_position"], other, prior)
    assert "It is counted in the opposite sense." in sentence(fault.text("six_position"))
