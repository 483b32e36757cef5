"""The index of a log: plot data at any width, stages, steps, gaps and single samples."""

import tomllib
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.errors import InputError
from calstation.estimation.common import SampleBlock
from calstation.messages import render
from calstation.records import LogMeta, RawLogWriter, UnusedSamples, export_csv
from calstation.records.facts import FactsBuilder
from calstation.results.inspection import inspect_recording
from calstation.results.plots import BINS, CHANNELS, LogIndex, MinMaxPyramid, log_index, samples
from calstation.results.plots.index import _hold

RATE = 100.0
META = {
    "site": {"latitude_deg": 34.25, "longitude_deg": 108.9, "height_m": 400, "azimuth_deg": 12.5},
    "imu": {
        "serial": "SN-7",
        "sample_rate_hz": RATE,
        "output": "increment",
        "gyro_lsb": 1e-8,
        "accel_lsb": 1e-6,
        "gyro_arw": 1e-7,
        "accel_vrw": 5e-5,
    },
}
START = 2**33 + 12_345


def no_progress(_: float, *rest: Any, **more: Any) -> None:
    """Ignore progress reports."""


def block(stage: str, seq: np.ndarray, step: int, seed: int = 0) -> SampleBlock:
    random = np.random.default_rng([seed, int(seq[0]) % 2**32])
    angles = np.full((len(seq), 2), np.nan)
    angles[::20] = np.deg2rad([10.0, -20.0])
    return SampleBlock(
        stage,
        seq.astype(np.int64),
        (seq - START + 1) / RATE,
        random.integers(-10_000, 10_000, (len(seq), 6)).astype(np.float64),
        angles,
        np.full(len(seq), step, np.int64),
        np.ones(len(seq), np.bool_),
        np.full(len(seq), 25.0),
    )


def blocks() -> list[SampleBlock]:
    """Return two stages with a pause between them, a gap in the first and invalid samples in the second."""
    parts = [
        block("", START + np.arange(0, 500), 0),
        block("rate", START + np.arange(500, 9_000), 1),
        block("rate", START + np.arange(9_040, 20_000), 2),
        block("", START + np.arange(20_000, 21_000), 2),
        block("excitation", START + np.arange(21_000, 40_000), 3),
        block("excitation", START + np.arange(40_000, 90_001), 4),
    ]
    parts[4].valid[-10:] = False
    parts[5].valid[:5] = False
    return parts


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("overview") / "log.h5"
    writer = RawLogWriter(path, LogMeta.model_validate(META))
    for part in blocks():
        writer.append(part)
    for label in (["face_up", "+z"], []):  # the move, and the rest after it
        writer.event({"event": "StepStarted", "stage": "excitation", "step": 3, "kind": "move", "label": label})
    writer.add_result(
        {
            "schema": "calstation.result/1",
            "unit": {"serial": "SN-7"},
            "stages": [],
            "parameters": {},
            "outcome": "passed",
            "log": {"file": "log.h5"},
        }
    )
    writer.close("passed")
    return path


@pytest.fixture(scope="module", params=["raw", "csv", "csv.gz"])
def seen(request: pytest.FixtureRequest, log: Path, tmp_path_factory: pytest.TempPathFactory) -> LogIndex:
    """The index of the log in each log format."""
    path, folder = log, tmp_path_factory.mktemp("index")
    if request.param != "raw":
        path = folder / f"log.{request.param}"
        export_csv(log, path)
    return log_index(no_progress, path, folder / "picture")


def truth() -> tuple[np.ndarray, np.ndarray]:
    """Return sequence numbers, and gyro_x in °/s."""
    seq = np.concatenate([b.seq for b in blocks()])
    return seq, np.concatenate([b.counts[:, 0] for b in blocks()]) * np.rad2deg(1e-8) * RATE


@pytest.mark.long
def test_stages_steps_gaps_and_invalid_samples_are_found(seen: LogIndex) -> None:
    spans = [(s.stage, s.first_seq - START, s.last_seq - START, s.samples) for s in seen.spans]
    assert spans == [("rate", 500, 19_999, 19_460), ("excitation", 21_000, 90_000, 69_001)]
    assert (seen.steps.ranges[:, 0] - START).tolist() == [500, 9_040, 21_000, 40_000]
    assert (seen.gaps.ranges - START).tolist() == [[8_999, 9_040]]
    assert (seen.invalid.ranges - START).tolist() == [[39_990, 40_004]]
    assert (seen.steps.count, seen.gaps.count, seen.invalid.count) == (4, 1, 1)
    assert seen.invalid_samples == 15
    assert seen.step_numbers.tolist() == [0, 1, 2, 3, 4]
    assert seen.step_labels == ({3: ("face_up", "+z")} if seen.path.suffix == ".h5" else {})
    assert seen.channels == CHANNELS
    assert (seen.facts.first_seq, seen.facts.last_seq) == (START, START + 90_000)
    assert seen.facts.gaps == 1


def paused_log(folder: Path, *, arrival: bool = True) -> Path:
    """Return a log with a pause from sample 2000 to 5999, invalid samples from 7000 to 7009, and arrival times."""
    path = folder / "paused.h5"
    writer = RawLogWriter(path, LogMeta.model_validate(META), station=arrival)
    for start in range(0, 10_000, 1_500):
        part = block("rate", np.arange(start, min(start + 1_500, 10_000)), 1)
        part.valid[(part.seq >= 2_000) & (part.seq < 6_000) | (part.seq >= 7_000) & (part.seq < 7_010)] = False
        station = np.full((len(part), int(arrival)), np.nan)
        station[9::10] = 100.0 + part.seq[9::10, None] / RATE
        writer.append(replace(part, station=station))
    for state, seq in (("running", 0), ("pausing", 1_995), ("paused", 2_100), ("running", 5_800), ("done", 9_999)):
        writer.event({"event": "StateChanged", "state": state, "station_time": 100.0 + seq / RATE})
    writer.close("passed")
    return path


def test_samples_of_a_pause_are_not_called_invalid(tmp_path: Path) -> None:
    path = paused_log(tmp_path)
    seen = log_index(no_progress, path, tmp_path / "picture")
    assert (seen.paused.ranges.tolist(), seen.paused_samples) == ([[2_000, 5_999]], 4_000)
    assert (seen.invalid.ranges.tolist(), seen.invalid_samples) == ([[7_000, 7_009]], 10)
    recording = inspect_recording(path)
    assert (recording.invalid, recording.paused) == (10, 4_000)
    for words, expected in (("en", "4000 samples during a pause, not used"), ("zh_CN", "暂停期间 4000 个采样点")):
        rows = dict(recording.summary)
        assert expected in render("look.paused_are", rows["look.paused"].values, words).text  # type: ignore[arg-type]


@pytest.mark.long
def test_exported_log_distinguishes_pauses_from_invalid_samples(tmp_path: Path) -> None:
    path, exported, again = paused_log(tmp_path), tmp_path / "exported.csv", tmp_path / "again.csv"
    export_csv(path, exported)
    export_csv(exported, again)
    for file in (exported, again):
        recording = inspect_recording(file)
        assert (recording.invalid, recording.paused) == (10, 4_000)


def test_exported_pause_without_an_end_lasts_until_the_end() -> None:
    meta = LogMeta.model_validate({**META, "pauses": [[5.0, 7.0], [50.0]]})
    unused = UnusedSamples([], LogMeta.model_validate(tomllib.loads(meta.to_toml())))
    part = block("rate", np.arange(100), 1)
    part.valid[5:8] = part.valid[50:] = False
    unused.add(replace(part, station=np.arange(100.0)[:, None]))
    unused.close()
    assert (unused.paused, unused.invalid) == (53, 0)
    digests = {FactsBuilder(each).facts().sha256 for each in (meta, LogMeta.model_validate(META))}
    assert len(digests) == 1, "the digest remains that of the run"


def test_log_without_arrival_times_does_not_reveal_its_pauses(tmp_path: Path) -> None:
    seen = log_index(no_progress, paused_log(tmp_path, arrival=False), tmp_path / "picture")
    assert (seen.paused_samples, seen.invalid_samples) == (0, 4_010)


def test_run_stopped_during_a_pause_is_paused_until_its_end(tmp_path: Path) -> None:
    events = [{"event": "StateChanged", "state": "paused", "station_time": 5.0}]
    unused = UnusedSamples(events, LogMeta.model_validate(META))
    part = block("rate", np.arange(100), 1)
    part.valid[40:] = False
    assert unused.add(replace(part, station=np.arange(100.0)[:, None])).tolist() == []
    assert unused.close().tolist() == [[40, 99, 60, 1]]
    assert (unused.paused, unused.invalid) == (60, 0)


def test_pauses_are_not_sought_in_a_log_that_begins_with_another_run() -> None:
    """Its samples have the times of another clock, which may be those of a later pause."""
    run = {"stages": ["rate"], "software": "1", "started_utc": "2026-07-01T03:03:00+00:00", "resumed_from": "earlier"}
    meta = LogMeta.model_validate({**META, "run": run})
    unused = UnusedSamples([{"event": "StateChanged", "state": "paused", "station_time": 5.0}], meta)
    part = block("rate", np.arange(100), 1)
    part.valid[40:] = False
    unused.add(replace(part, station=np.arange(100.0)[:, None]))
    assert unused.close().tolist() == [[40, 99, 60, 0]]


def test_index_includes_the_result_of_the_run(log: Path, tmp_path: Path) -> None:
    seen = log_index(no_progress, log, tmp_path / "picture")
    assert seen.outcome == "passed"
    assert seen.stored is not None
    assert seen.stored.outcome == "passed"


@pytest.mark.parametrize(
    ("first", "last", "count"),
    [(0, 90_000, 100), (0, 90_000, 2_000), (8_000, 12_000, 50), (30_000, 80_000, 640), (89_990, 90_000, 9)],
)
def test_plot_columns_contain_the_extremes_of_their_samples(seen: LogIndex, first: int, last: int, count: int) -> None:
    seq, gyro = truth()
    columns = MinMaxPyramid(seen.folder).columns(START + first, START + last, count)
    assert columns.seq[0] <= START + first
    assert len(columns) <= count + 4
    edges = np.searchsorted(seq, [*columns.seq, columns.seq[-1] + 10**9])
    for k, (a, b) in enumerate(pairwise(edges)):
        if k < len(columns) - 1:
            assert b - a == columns.samples
            np.testing.assert_allclose(columns.low[k, 0], gyro[a:b].min(), rtol=1e-6)
            np.testing.assert_allclose(columns.high[k, 0], gyro[a:b].max(), rtol=1e-6)
    assert columns.seq[-1] + columns.samples > START + last


def test_number_of_plot_columns_does_not_grow_with_the_range(seen: LogIndex) -> None:
    picture = MinMaxPyramid(seen.folder)
    for width in (90_000, 20_000, 3_000):
        columns = picture.columns(START, START + width, 100)
        assert columns.samples == BINS[0] or 50 <= len(columns) <= 104


def test_single_samples_are_returned_unchanged(seen: LogIndex) -> None:
    seq, gyro = truth()
    start, stop = MinMaxPyramid(seen.folder).rows(START + 40_100, START + 40_200)
    fine = samples(no_progress, seen.path, seen.folder, seen.scale, start, stop, 1000)
    assert fine.samples == 1
    assert fine.seq[0] <= START + 40_100
    assert fine.seq[-1] >= START + 40_200
    np.testing.assert_allclose(fine.low[:, 0], gyro[np.searchsorted(seq, fine.seq)], rtol=1e-6)
    np.testing.assert_array_equal(fine.low, fine.high)


def test_angles_are_held_between_polls(seen: LogIndex) -> None:
    start, stop = MinMaxPyramid(seen.folder).rows(START + 40_105, START + 40_110)
    fine = samples(no_progress, seen.path, seen.folder, seen.scale, start, stop, 1000)
    np.testing.assert_allclose(fine.low[:, 6], 10.0, rtol=1e-6)
    np.testing.assert_allclose(MinMaxPyramid(seen.folder).columns(START, START + 90_000, 100).high[:, 7], -20.0)


def test_angles_are_not_held_across_a_gap(log: Path, tmp_path: Path) -> None:
    seen = log_index(no_progress, log, tmp_path / "picture")
    start, stop = MinMaxPyramid(seen.folder).rows(START + 8_990, START + 9_045)
    fine = samples(no_progress, seen.path, seen.folder, seen.scale, start, stop, 1000)
    known = ~np.isnan(fine.low[:, 6])
    assert known[fine.seq <= START + 8_999].all()
    assert known[fine.seq >= START + 9_040].all()  # polled at once here
    part = block("rate", START + np.arange(100, 200), 0)
    part.angles[:50] = np.nan
    held = _hold(part.angles, part.seq, np.ones(2), START + 90)
    assert np.isnan(held[:50]).all()
    assert not np.isnan(held[60:]).any()


def test_progress_reaches_100_percent(log: Path, tmp_path: Path) -> None:
    fractions: list[float] = []
    log_index(lambda fraction, *_: fractions.append(fraction), log, tmp_path / "picture")
    assert fractions == sorted(fractions)
    assert fractions[-1] > 0.95


def test_file_that_is_not_a_log_is_reported(tmp_path: Path) -> None:
    wrong = tmp_path / "notes.h5"
    wrong.write_text("not a log", encoding="utf-8")
    with pytest.raises(InputError, match="not a raw log"):
        log_index(no_progress, wrong, tmp_path / "picture")
