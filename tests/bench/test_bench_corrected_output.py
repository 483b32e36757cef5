"""The corrected stream of a simulated unit equals the true motion if its registers contain its true errors."""

import struct
from pathlib import Path

import numpy as np
import pytest

from calstation.bench import BenchConfig
from calstation.bench.imu import UNITS
from calstation.bench.imu.unit import CORRECTED, Requantiser
from calstation.bench.imu.units.framed import STREAM, WRITE
from calstation.bench.truth import StreamOutput
from calstation.devices.imu import ImuRefusalError, RegisterMap, open_imu
from calstation.devices.links import SerialLink
from calstation.devices.profiles import load_imu_profile
from calstation.physics import PARAMETERS
from tests.devices.powered_unit import shipped, write_directly

IMUS = Path(__file__).parents[2] / "data" / "imus"
_RNG = np.random.default_rng(3)
SIZES = {"bias": 1e-2, "scale": 3e-3, "misalign": 3e-3, "quadratic": 1e-5, "inner_lever": 0.02}
ERRORS = {p.name: float(_RNG.normal() * next((v for k, v in SIZES.items() if k in p.group), 0.0)) for p in PARAMETERS}


def measured(errors, rate, force):
    """Return the sensor output by the error model of the contract, implemented independently."""

    def of(name):
        return np.array([errors.get(f"{name}_{axis}", 0.0) for axis in "xyz"])

    def matrix(sensor):
        full = np.eye(3) + np.diag(of(f"{sensor}_scale"))
        for i, a in enumerate("xyz"):
            for j, b in enumerate("xyz"):
                full[i, j] += errors.get(f"{sensor}_misalign_{a}{b}", 0.0)
        return full

    squares = rate**2
    sensed = force - of("inner_lever") * (squares.sum(axis=1, keepdims=True) - squares)
    gyro = rate @ matrix("gyro").T + of("gyro_bias")
    accel = sensed @ matrix("accel").T + of("accel_quadratic") * sensed**2 + of("accel_bias")
    return np.hstack([gyro, accel])


@pytest.mark.parametrize("protocol", UNITS)
def test_output_is_the_true_motion_if_registers_contain_the_true_errors(protocol):
    profile = shipped(protocol)
    entries = RegisterMap(tuple(profile.registers))
    registers = {n: v for n, v in ERRORS.items() if n in entries.parameters}
    unit = UNITS[protocol](BenchConfig(serial="SN-7"))
    unit.scale = np.repeat([1e-7, 1e-6], 3)
    unit.increments = False
    write_directly(unit, profile, {**dict.fromkeys(entries.parameters, 0.0), **registers})
    rng = np.random.default_rng(4)
    rate, force = rng.normal(size=(40, 3)), 9.8 * rng.normal(size=(40, 3))
    counts = measured(entries.rounded(registers), rate, force) / unit.scale
    values = unit.correction().apply(counts * unit.scale)
    np.testing.assert_allclose(values[:, :3], rate, atol=2e-6)
    np.testing.assert_allclose(values[:, 3:], force, atol=2e-5)


def test_increments_accumulate_no_rounding_error():
    unit = UNITS["framed"](BenchConfig(serial="SN-7"))
    unit.scale = np.repeat([1e-6 * 200, 1e-5 * 200], 3)
    unit.answer(WRITE, struct.pack("<HBf", 0, 1, 0.3e-6 * 200), 1.0)
    unit.answer(STREAM, bytes([CORRECTED]), 1.0)
    counts = np.ones((1000, 6))
    ends = 2.0 + np.arange(1000) / 200
    frames = np.frombuffer(unit.frames(StreamOutput(counts, np.zeros(1000, bool)), ends), dtype="V34")
    channels = np.array([np.frombuffer(f.tobytes()[4:28], "<i4") for f in frames])
    assert channels[:, 0].sum() == pytest.approx(700, abs=1)
    assert channels[:, 1].sum() == 1000


def test_carried_rounding_error_does_not_depend_on_the_resolution():
    requantiser, scale = Requantiser(), np.ones(6)
    values = np.full((40_000, 6), 1e9 + 0.3)
    counts = requantiser.counts(values, scale, carry=True) - 1e9
    assert requantiser.counts(values[:0], scale, carry=True).shape == (0, 6)
    drift = np.cumsum(counts[:, 0]) - 0.3 * np.arange(1, len(counts) + 1)
    assert np.abs(drift).max() < 0.51


@pytest.mark.parametrize("protocol", UNITS)
def test_driver_switches_the_stream_type_without_reading_old_samples(start_bench, protocol):
    profile = shipped(protocol).with_commands(timeout_s=2.0)
    settings = {"grade": "mems", "imu_protocol": protocol, "output": profile.stream.output}
    with start_bench(serial="SN-000042", clock_drift_ppm=0.0, **settings) as bench:
        imu = open_imu(SerialLink(bench.endpoints["imu"], profile.link, "imu"), profile, "")

        def means(**kind):
            imu.start(**kind)
            report = bench.advance(3.0)
            for _ in range(500):
                if imu.received >= report["bytes"][0]:
                    break
                bench.ask(now=None)
            batch = imu.read()
            assert len(batch) > 300
            assert np.all(np.diff(batch.seq) == 1)
            scale = np.repeat([profile.stream.gyro_lsb, profile.stream.accel_lsb], 3)
            return batch.counts.mean(axis=0) * scale * (200.0 if profile.stream.output == "increment" else 1.0)

        try:
            imu.identify()
            raw = means()
            imu.write_registers({n: 0.25 if n == "accel_bias_x" else 0.0 for n in imu.read_registers()})
            assert means()[3] == pytest.approx(raw[3], abs=0.01)
            assert means(corrected=True)[3] == pytest.approx(raw[3] - 0.25, abs=0.01)
            assert means()[3] == pytest.approx(raw[3], abs=0.01)
            means(corrected=True)
            imu.reset()
            bench.advance(2.0)
            assert means()[3] == pytest.approx(raw[3], abs=0.01), "a restart falls back"
        finally:
            imu.close()


def test_unknown_stream_type_is_rejected(start_bench):
    profile = load_imu_profile(IMUS / "bench_mems.toml")
    other = profile.model_copy(update={"corrected": profile.corrected.model_copy(update={"stream": 7})})
    with start_bench(grade="mems") as bench:
        imu = open_imu(SerialLink(bench.endpoints["imu"], other.link, "imu"), other, "")
        try:
            with pytest.raises(ImuRefusalError, match="the value is refused"):
                imu.start(corrected=True)
        finally:
            imu.close()
