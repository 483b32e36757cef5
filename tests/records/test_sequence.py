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


def _recorded(true: np.ndarray, polled_every: int, lowest: float | None) -> np.ndarray:
    """Return angles, rad, shape (n, 1), NaN between polls, from `lowest` on modulo a turn if it is given."""
    angles = true[:, None].copy()
    angles[np.arange(len(angles)) % polled_every != 0] = np.nan
    return angles if lowest is None else (angles - lowest) % (2.0 * np.pi) + lowest


def _unwrapped(time: np.ndarray, recorded: np.ndarray, chunk: int) -> np.ndarray:
    unwrapper = AngleUnwrapper(lambda: np.ptp(recorded[np.isfinite(recorded[:, 0])], axis=0))
    parts = [slice(k, k + chunk) for k in range(0, len(time), chunk)]
    return np.concatenate([unwrapper.feed(time[part], recorded[part]) for part in parts])


@pytest.mark.parametrize("polled_every", [1, 7, 10, 100])
@pytest.mark.parametrize("chunk", [9000, 1234, 77])
@pytest.mark.parametrize("lowest", [0.0, -180.0])
def test_angles_modulo_a_turn_become_cumulative(polled_every: int, chunk: int, lowest: float) -> None:
    time = np.arange(1, 9001) * PERIOD
    recorded = _recorded(_table_angle(time), polled_every, np.deg2rad(lowest))
    expected = _recorded(_table_angle(time), polled_every, None)
    np.testing.assert_allclose(_unwrapped(time, recorded, chunk), expected, atol=1e-9)


@pytest.mark.parametrize("polled_every", [1, 10, 5000])
@pytest.mark.parametrize("chunk", [9000, 1000])
def test_cumulative_angles_remain_unchanged(polled_every: int, chunk: int) -> None:
    time = np.arange(1, 9001) * PERIOD
    true = _recorded(_table_angle(time), polled_every, None)
    np.testing.assert_array_equal(_unwrapped(time, true, chunk), true)


@pytest.mark.parametrize("chunk", [400, 50, 7, 1])
def test_angles_that_leave_a_turn_later_are_cumulative_from_the_beginning(chunk: int) -> None:
    time = np.arange(1, 401) * PERIOD
    turned = np.deg2rad(np.interp(time, [0.62, 1.2, 2.0, 3.0], [0.0, 300.0, 300.0, 700.0]))
    true = _recorded(turned, 60, None)  # 300° between two polls, before the angles leave the range of a turn
    np.testing.assert_array_equal(_unwrapped(time, true, chunk), true)
    modulo = _recorded(turned, 5, 0.0)
    np.testing.assert_array_equal(_unwrapped(time, modulo, chunk), _unwrapped(time, modulo, 400))
