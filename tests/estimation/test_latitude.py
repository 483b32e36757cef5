"""Latitude from gyros agrees with its sigma over many units, and is None if the rests do not determine it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated_stages import block_of, context_of, cut, prior_of, simulate

from calstation.bench import BenchConfig
from calstation.bench.truth import BenchTruth, Simulator
from calstation.estimation.common import LatitudeEstimate, Posterior, RestOutput, SampleBlock, resolves_earth_rate

UNITS = 12


def see(truth: BenchTruth, blocks: list[SampleBlock], posterior: Posterior | None = None) -> LatitudeEstimate | None:
    resting = RestOutput(context_of(truth).imu)
    for block in blocks:
        resting.feed(block)
    return resting.latitude(prior_of(truth) if posterior is None else posterior)


@cache
def six_positions(grade: str, seed: int) -> tuple[BenchTruth, SampleBlock]:
    truth = BenchConfig(grade=grade, seed=seed, sample_rate_hz=100.0).truth()
    return truth, block_of(simulate(Simulator(truth, seed), truth, "six_position", dwell_s=25.0))


@pytest.mark.parametrize("grade", ["nav", pytest.param("tactical", marks=pytest.mark.long)])
def test_latitude_agrees_with_its_sigma(grade: str) -> None:
    off = []
    for seed in range(UNITS):
        truth, block = six_positions(grade, seed)
        known = replace_gyros(truth)
        seen = see(truth, [block], known)
        assert seen is not None
        off.append((seen.value - truth.table.latitude) / seen.sigma)
    assert np.abs(off).max() < 4.0
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 1.6  # chi-square of 12, 99.9 %: 0.47 to 1.58


def replace_gyros(truth: BenchTruth) -> Posterior:
    """Return parameters known as well as after a complete calibration."""
    return Posterior(truth.imu.parameters, prior_of(truth).covariance * 1e-6)


@pytest.mark.parametrize("grade", [pytest.param("nav", marks=pytest.mark.long), "tactical"])
def test_uncertain_gyro_matrix_enlarges_the_sigma(grade: str) -> None:
    for seed in range(UNITS):
        truth, block = six_positions(grade, seed)
        seen, known = see(truth, [block]), see(truth, [block], replace_gyros(truth))
        assert seen is not None
        assert known is not None
        assert abs(seen.value - truth.table.latitude) < seen.tolerance
        assert seen.sigma > known.sigma


def test_latitude_does_not_depend_on_the_blocks() -> None:
    truth, block = six_positions("nav", 0)
    whole = see(truth, [block])
    assert whole is not None
    for places in ([1, 2, 3], [99, 100, 101, 250], list(range(7, len(block), 7))):
        assert see(truth, cut(block, places)) == whole


def test_seconds_with_invalid_or_missing_samples_are_excluded() -> None:
    truth, block = six_positions("nav", 1)
    counts, valid = block.counts.copy(), block.valid.copy()
    counts[1000:1010] *= 50.0
    valid[1000:1010] = False
    spoilt = replace(block, counts=counts, valid=valid)
    torn = [block.part(0, 2000), block.part(2050, len(block))]
    for blocks in ([spoilt], torn):
        seen = see(truth, blocks, replace_gyros(truth))
        assert seen is not None
        assert abs(seen.value - truth.table.latitude) < 4.0 * seen.sigma


def test_latitude_requires_rests_with_the_unit_upside_down() -> None:
    truth = BenchConfig(grade="nav", seed=3, sample_rate_hz=100.0).truth()
    assert see(truth, [block_of(simulate(Simulator(truth, 3), truth, "azimuth_flip"))]) is None
    assert see(truth, []) is None


def test_vibration_enlarges_the_sigma() -> None:
    truth, block = six_positions("nav", 4)
    calm = see(truth, [block], replace_gyros(truth))
    shaken = block.counts.copy()
    shaken[:, :3] += np.random.default_rng(1).normal(
        0.0,
        40.0 * truth.imu.gyro_arw * 10.0 / truth.imu.gyro_lsb * (0.01 if truth.imu.output == "increment" else 1.0),
        (len(block), 3),
    )
    rough = see(truth, [replace(block, counts=shaken)], replace_gyros(truth))
    assert calm is not None
    assert rough is None or rough.sigma > 5.0 * calm.sigma


def test_only_navigation_and_tactical_gyros_resolve_earth_rate() -> None:
    grades = ("nav", "tactical", "mems")
    felt = {g: resolves_earth_rate(context_of(BenchConfig(grade=g).truth()).imu) for g in grades}
    assert felt == {"nav": True, "tactical": True, "mems": False}
