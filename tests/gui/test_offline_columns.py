"""The pixel columns that a log view draws, and the samples that it requests."""

from typing import Any

import numpy as np
import pytest

from calstation.gui.logs.plot_items import LogColumns, split_at_gaps, time_text
from calstation.records import LogMeta, RawLogWriter
from calstation.results.plots import Columns, LogIndex, log_index, samples
from tests.results.test_log_index import META, START, blocks


def ignore_progress(_: float, *rest: Any, **more: Any) -> None:
    """Ignore the progress of a job."""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> LogIndex:
    folder = tmp_path_factory.mktemp("columns")
    writer = RawLogWriter(folder / "log.h5", LogMeta.model_validate(META))
    for part in blocks():
        writer.append(part)
    writer.close("imported")
    return log_index(ignore_progress, folder / "log.h5", folder / "picture")


@pytest.mark.parametrize("first", [0, 8_950, 9_010, 60_000, 89_800])
@pytest.mark.parametrize("width", [12, 150, 1_500, 12_000])
@pytest.mark.parametrize("count", [100, 1_000])
def test_requested_samples_are_sufficient(log: LogIndex, first: int, width: int, count: int) -> None:
    columns = LogColumns(log)
    last = min(START + first + width, log.facts.last_seq)
    view, request = columns.view(START + first, last, count)
    if request is not None:
        columns.store_samples(
            request,
            samples(ignore_progress, log.path, log.folder, log.scale, request.start, request.stop, request.count),
        )
        view, again = columns.view(START + first, last, count)
        assert again is None
        assert view.samples < 16
    assert len(view) <= count + 4
    inside = view.seq[(view.seq >= START + first) & (view.seq <= last)]
    assert len(inside) >= min((last - START - first) / 2, count / 2) - 41  # the gap is 40 samples wide


def columns_with_gap(samples: int) -> Columns:
    seq = samples * np.arange(6, dtype=np.int64)
    seq[4:] += 1_000
    values = np.ones((6, 8), np.float32)
    return Columns(seq, values, values, samples)


def test_lines_end_at_a_gap_between_samples() -> None:
    seq, low, high = split_at_gaps(columns_with_gap(1), 10.0)
    assert np.flatnonzero(np.isnan(seq)).tolist() == [4]
    assert len(low) == len(high) == 7


def test_column_that_contains_a_gap_is_not_drawn() -> None:
    seq, low, _ = split_at_gaps(columns_with_gap(16), 10.0)
    assert np.flatnonzero(np.isnan(seq)).tolist() == [3]
    assert len(low) == 6


def test_gap_narrower_than_a_pixel_does_not_interrupt_the_line() -> None:
    assert not np.isnan(split_at_gaps(columns_with_gap(16), 2_000.0)[0]).any()


@pytest.mark.parametrize(
    ("seconds", "resolution", "text"),
    [
        (0.0, 1.0, "0:00:00"),
        (3_725.0, 60.0, "1:02:05"),
        (59.9996, 0.001, "0:01:00.000"),
        (754.25, 0.05, "0:12:34.25"),
        (-2.0, 1.0, "−0:00:02"),
    ],
)
def test_time_is_shown_as_hours_minutes_and_seconds(seconds: float, resolution: float, text: str) -> None:
    assert time_text(seconds, resolution) == text
