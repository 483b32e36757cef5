"""Sample counters are unwrapped; wraps, resets and gaps are distinguished from rows out of order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calstation.errors import InputError
from calstation.estimation.common import AngleUnwrapper, SequenceUnwrapper, unwrap_counter

PERIOD = 0.01


@given(
    bits=st.sampled_from([8, 16, 32]),
    before=st.integers(0, 60),
    steps=st.lists(st.integers(1, 20), min_size=1, max_size=150),
    cut=st.integers(0, 150),
)
def test_count_is_correct_across_wraps_and_lost_samples(bits: int, before: int, steps: list[int], cut: int) -> None:
    true = (1 << bits) - 1 - before + np.concatenate(([0], np.cumsum(steps)))
    time = (true + 1) * PERIOD
    unwrapper = SequenceUnwrapper(PERIOD)
    parts = [unwrapper.feed((true % (1 << bits))[k], time[k]) for k in (slice(cut), slice(cut, None))]
    np.testing.assert_array_equal(np.concatenate([p[0] for p in parts]), true)
    np.testing.assert_array_equal(np.concatenate([p[1] for p in parts]), time)


def test_count_after_a_reset_continues_by_the_lost_time() -> None:
    seq = np.array([500, 501, 0, 1, 2])
    time = np.array([5.01, 5.02, 7.02, 7.03, 7.04])
    count, clock, restarts = SequenceUnwrapper(PERIOD).feed(seq, time)
    assert count.tolist() == [500, 501, 701, 702, 703]
    np.testing.assert_array_equal(clock, time)
    assert restarts == []


def test_time_keeps_increasing_after_a_reset_of_counter_and_clock() -> None:
    seq = np.array([498, 499, 500, 0, 1])
    count, clock, restarts = SequenceUnwrapper(PERIOD).feed(seq, (seq + 1) * PERIOD)
    assert count.tolist() == [498, 499, 500, 502, 503]
    assert np.all(np.diff(clock) > 0)
    assert restarts == [3]


@pytest.mark.parametrize(
    ("seq", "time"),
    [
        ([0, 1, 1], [0.01, 0.02, 0.03]),
        ([0, 2, 1], [0.01, 0.03, 0.02]),
        ([900, 901, 0], [9.01, 9.02, 9.03]),
        ([900, 901, 400], [9.01, 9.02, 19.03]),
        ([0, 1, 2], [0.01, 0.02, 0.02]),
        ([-1, 0, 1], [0.01, 0.02, 0.03]),
    ],
)
def test_other_non_increasing_sequences_are_refused(seq: list[int], time: list[float]) -> None:
    with pytest.raises(InputError):
        SequenceUnwrapper(PERIOD).feed(np.array(seq), np.array(time))


@given(
    bits=st.sampled_from([8, 16, 32]),
    first=st.integers(0, 2**33),
    steps=st.lists(st.integers(1, 100), max_size=200),
    cut=st.integers(0, 200),
)
def test_live_counter_continues_across_blocks(bits: int, first: int, steps: list[int], cut: int) -> None:
    true = first + np.concatenate(([0], np.cumsum(np.array(steps, np.int64))))
    raw = true % (1 << bits)
    head = unwrap_counter(raw[:cut], None, bits)
    tail = unwrap_counter(raw[cut:], int(head[-1]) if len(head) else None, bits)
    found = np.concatenate([head, tail])
    np.testing.assert_array_equal(found - found[0], true - true[0])


def test_restarted_live_counter_counts_one_lost_sample() -> None:
    assert unwrap_counter([10, 11, 0, 1], None, 16).tolist() == [10, 11, 13, 14]


def _table_angle(time: np.ndarray) -> np.ndarray:
    """Return the angle of a rest, two turns at 20 °/s, a rest, two turns and 37° back, and a rest, rad."""
    return np.deg2rad(np.interp(time, [0.0, 5.0, 41.0, 46.0, 83.85, 90.0], [10.0, 10.0, 730.0, 730.0, -27.0, -27.0]))


@pytest.mark.parametrize("polled_every", [1, 7, 10, 100])
@pytest.mark.parametrize("cut", [0, 1234, 4000])
@pytest.mark.parametrize("lowest", [0.0, -180.0])
def test_angles_modulo_a_turn_become_cumulative(polled_every: int, cut: int, lowest: float) -> None:
    time = np.arange(1, 9001) * PERIOD
    true = _table_angle(time)[:, None]
    true[np.arange(len(time)) % polled_every != 0] = np.nan
    low = np.deg2rad(lowest)
    recorded = (true - low) % (2.0 * np.pi) + low
    unwrapper = AngleUnwrapper()
    found = np.concatenate([unwrapper.feed(time[k], recorded[k]) for k in (slice(cut), slice(cut, None))])
    np.testing.assert_allclose(found, true, atol=1e-9)


@pytest.mark.parametrize("polled_every", [1, 10, 5000])
def test_cumulative_angles_remain_unchanged(polled_every: int) -> None:
    time = np.arange(1, 9001) * PERIOD
    true = _table_angle(time)[:, None]
    true[np.arange(len(time)) % polled_every != 0] = np.nan
    np.testing.assert_array_equal(AngleUnwrapper().feed(time, true), true)
