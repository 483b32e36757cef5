"""A received counter becomes a continuous sample count despite duplicates, swaps, resets and wraps."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.config import library
from calstation.devices.imu import SampleCount
from calstation.devices.profiles import FrameSection, load_imu_profile

FRAME = load_imu_profile(library.shipped_folder() / "imus" / "bench_nav.toml").frame
CLOCKS = {
    64: load_imu_profile(library.shipped_folder() / "imus" / "vectornav_vn100.toml").frame,
    32: load_imu_profile(library.shipped_folder() / "imus" / "xsens_mtdata2.toml").frame,
}
TICKS = {64: 5_000_000, 32: 100}


def fed(*batches: list[int], frame: FrameSection = FRAME) -> list[int]:
    count = SampleCount(frame)
    counts: list[int] = []
    for batch in batches:
        raw = np.array(batch, np.int64)
        counts += count.feed(raw[count.in_order(raw)]).tolist()
    return counts


@pytest.mark.parametrize(
    ("batches", "expected"),
    [
        (([5, 6, 6, 7],), [5, 6, 7]),
        (([5, 6], [6, 7]), [5, 6, 7]),
        (([5, 7, 6, 8],), [5, 6, 7, 8]),
        (([5, 7], [6, 8]), [5, 7, 8]),
        (([65534, 65535, 0, 1],), [65534, 65535, 65536, 65537]),
        (([65535, 65534], [0, 1]), [65535, 65536, 65537]),
        (([9000, 9001], [0, 1], [2, 3]), [9000, 9001, 9003, 9004, 9005, 9006]),
    ],
)
def test_received_counters_become_an_increasing_count(batches: tuple[list[int], ...], expected: list[int]) -> None:
    assert fed(*batches) == expected


@pytest.mark.parametrize(
    ("batches", "restarts"),
    [
        (([5, 6, 9],), 0),
        (([65534, 65535, 0, 1], [2]), 0),
        (([5, 6], [6, 5, 7]), 0),
        (([9000, 9001], [0, 1], [2, 3]), 1),
        (([9000, 0, 1, 5000], [3, 4, 5]), 2),
        (([9000, 0, 1, 2, 8999, 9000],), 1),
    ],
)
def test_a_counter_restart_is_counted(batches: tuple[list[int], ...], restarts: int) -> None:
    count = SampleCount(FRAME)
    for batch in batches:
        raw = np.array(batch, np.int64)
        count.feed(raw[count.in_order(raw)])
    assert count.restarts == restarts


def test_a_clock_restart_is_counted() -> None:
    count = SampleCount(CLOCKS[64])
    for batch in ([5, 6, 9], [1, 2], [3]):
        count.feed(np.array(batch, np.int64) * TICKS[64])
    assert (count.restarts, count.gaps) == (1, 2)


@given(st.integers(0, 65535), st.lists(st.integers(0, 2), min_size=1, max_size=60), st.randoms())
def test_duplicates_and_swapped_neighbours_lose_no_sample(first: int, kinds: list[int], drawn: object) -> None:
    raw: list[int] = []
    for i, kind in enumerate(kinds):
        raw += [(first + i) % 65536] * (2 if kind == 1 else 1)
    for i in range(2, len(raw) - 1, 3):
        raw[i], raw[i + 1] = raw[i + 1], raw[i]
    counts = fed(raw)
    assert counts == list(range(raw[0], raw[0] + len(kinds)))


@given(st.lists(st.integers(0, 65535), max_size=50), st.integers(0, 50))
def test_count_increases_for_any_counter_values(raw: list[int], cut: int) -> None:
    counts = fed(raw[:cut], raw[cut:])
    assert all(a < b for a, b in pairwise(counts))


@pytest.mark.parametrize("bits", CLOCKS)
@pytest.mark.parametrize(
    ("batches", "expected"),
    [
        (([5, 6, 6, 7],), [5, 6, 7]),
        (([5, 6], [6, 7]), [5, 6, 7]),
        (([5, 7, 6, 8],), [5, 6, 7, 8]),
        (([5, 7], [6, 8]), [5, 7, 8]),
        (([5, 9], [10]), [5, 9, 10]),
        (([9000, 9001], [0, 1], [2, 3]), [9000, 9001, 9003, 9004, 9005, 9006]),
    ],
)
def test_clock_gives_the_same_count_as_a_counter(
    bits: int, batches: tuple[list[int], ...], expected: list[int]
) -> None:
    ticks = [[sample * TICKS[bits] for sample in batch] for batch in batches]
    assert fed(*ticks, frame=CLOCKS[bits]) == expected


def test_count_continues_when_a_32_bit_clock_wraps() -> None:
    last = 2**32 - 50
    assert np.diff(fed([last - 100, last, 50, 50, 150], frame=CLOCKS[32])).tolist() == [1, 1, 1]


@pytest.mark.parametrize("bits", CLOCKS)
@given(data=st.data())
def test_count_increases_for_any_clock_values(bits: int, data: st.DataObject) -> None:
    ticks = data.draw(st.lists(st.integers(0, 2 ** min(bits, 63) - 1), max_size=40))
    cut = data.draw(st.integers(0, 40))
    counts = fed(ticks[:cut], ticks[cut:], frame=CLOCKS[bits])
    assert all(a < b for a, b in pairwise(counts))
