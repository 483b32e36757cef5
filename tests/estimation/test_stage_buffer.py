"""Stored samples are read back unchanged, and memory does not grow with those of a long stage."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from calstation.estimation.common import ImuModel, SampleBlock, StageBuffer

IMU = ImuModel("SIM", 200.0, "increment", 1e-9, 1e-9, 1e-6, 1e-5)
COLUMNS = ("seq", "time", "counts", "angles", "step", "valid", "temperature")


def block(count, first=0):
    rng = np.random.default_rng(first)
    return SampleBlock(
        "rate",
        np.arange(first, first + count),
        rng.normal(size=count),
        rng.normal(size=(count, 6)),
        np.where(rng.random((count, 2)) < 0.5, np.nan, rng.normal(size=(count, 2))),
        np.full(count, 3),
        rng.random(count) < 0.9,
        np.full(count, np.nan),
    )


@pytest.mark.parametrize("sizes", [[], [1], [10, 0, 3], [70_000, 1, 70_000], [400_000, 1, 300_000]])
def test_stored_samples_are_read_back_unchanged(sizes):
    buffer = StageBuffer(IMU)
    parts = []
    for size in sizes:
        parts.append(block(size, sum(len(p) for p in parts)))
        buffer.append(parts[-1])
    back = buffer.block()
    assert len(back) == sum(sizes)
    for name in COLUMNS:
        if parts:
            expected = np.concatenate([getattr(p, name) for p in parts])
            assert np.array_equal(getattr(back, name), expected, equal_nan=name != "valid")


def test_samples_may_be_stored_after_reading():
    buffer = StageBuffer(IMU)
    buffer.append(block(5))
    assert len(buffer.block()) == 5
    assert buffer.block() is buffer.block()
    buffer.append(block(5, 5))
    assert buffer.block().seq.tolist() == list(range(10))


def test_memory_does_not_grow_with_samples_of_a_long_stage():
    buffer, part = StageBuffer(IMU), block(2000)
    tracemalloc.start()
    for _ in range(300):
        buffer.append(part)
    before, _ = tracemalloc.get_traced_memory()
    for _ in range(300):
        buffer.append(part)
    held, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert held < 60_000_000
    assert peak < before + 4_000_000


def test_physical_units_are_computed_once_until_more_samples_are_stored():
    buffer = StageBuffer(IMU)
    buffer.append(replace(block(400), valid=np.ones(400, dtype=bool)))
    data = buffer.data()
    assert buffer.data() is data
    buffer.append(replace(block(400, 400), valid=np.ones(400, dtype=bool)))
    assert len(buffer.data()) == 2 * len(data)
