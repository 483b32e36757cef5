"""Corrected output of IMUs on one body: values, gap-free calibration changes, source changes, missing samples."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.estimation.common import SampleBlock, StoredCrossCalibration
from calstation.estimation.pairs import RestDeviation, StaticCheck, Verdict, WatchEvent
from calstation.records import Log, open_log
from calstation.results import CorrectedOutput, CorrectedStream, CorrectedTraceBuilder, PairSession, PairWatchResult
from calstation.simulation import make_recording

Lines = list[dict[str, Any]]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Log:
    """Two IMUs on one body with a lever arm and a clock offset; the secondary is out of tolerance."""
    path = tmp_path_factory.mktemp("pair") / "pair.h5"
    make_recording("pair", path, "mems", 3)
    return open_log(path)


def unchanged(block: SampleBlock) -> SampleBlock:
    return block


def watched(
    log: Log, folder: Path, change: Callable[[SampleBlock], SampleBlock] = unchanged, again: tuple[float, ...] = ()
) -> Lines:
    """Return the lines of a watch in blocks of 0.1 s; `again` are the times of requested checks."""
    lines: list[str] = []
    session = PairSession(log.meta, folder, "log")
    session.watch.command()

    def blocks() -> Iterator[SampleBlock]:
        asked = list(again)
        for whole in log.blocks():
            for start in range(0, len(whole), 10):
                block = change(whole.part(start, min(start + 10, len(whole))))
                if asked and block.time[0] >= asked[0]:
                    asked.pop(0)
                    session.watch.command()
                yield block

    session.run(blocks(), [CorrectedOutput(log.meta, [lines.append])])
    return [json.loads(line) for line in lines]


@pytest.fixture(scope="module")
def first_watch(recording: Log, tmp_path_factory: pytest.TempPathFactory) -> tuple[Lines, Path]:
    """The lines during the calibration of the secondary, and the folder with the result."""
    folder = tmp_path_factory.mktemp("pairs")
    return watched(recording, folder), folder


def data(lines: Lines) -> Lines:
    return [line for line in lines if line["type"] == "data"]


def events(lines: Lines, kind: str) -> Lines:
    return [line for line in lines if line["type"] == "event" and line["kind"] == kind]


def column(lines: Lines, imu: str, sensor: str) -> np.ndarray:
    return np.array([row or [np.nan] * 3 for line in lines for row in line[imu][sensor]])


def assert_continuous(lines: Lines, log: Log) -> None:
    facts, expected = log.facts(), None
    for line in data(lines):
        assert expected is None or line["seq"] == expected
        expected = line["seq"] + line["count"]
        assert len(line["time_s"]) == line["count"] == len(line["primary"]["gyro"]) == len(line["imu2"]["accel"])
    assert (data(lines)[0]["seq"], expected) == (facts.first_seq, facts.last_seq + 1)


@pytest.mark.long
def test_calibration_is_replaced_without_a_gap(first_watch: tuple[Lines, Path], recording: Log) -> None:
    lines, _ = first_watch
    assert (lines[0]["type"], lines[-1]["type"]) == ("start", "end")
    assert lines[0]["schema"] == "calstation.corrected/1"
    assert lines[0]["imu2"] == {"serial": "BENCH-mems-3B"}
    assert_continuous(lines, recording)
    calibrations = [(line["calibration"], bool(line["values"])) for line in events(lines, "calibration")]
    assert calibrations == [(0, False), (1, True)]
    used = [line["imu2"]["calibration"] for line in data(lines)]
    assert used == sorted(used)
    assert set(used) == {0, 1}
    assert all(line["imu2"]["aligned"] for line in data(lines))
    # the calibration is reported before the first samples corrected by it
    assert lines.index(events(lines, "calibration")[1]) < lines.index(data(lines)[used.index(1)])


@pytest.mark.long
def test_corrected_secondary_agrees_with_the_primary(first_watch: tuple[Lines, Path], recording: Log) -> None:
    after = [line for line in data(first_watch[0]) if line["imu2"]["calibration"] == 1]
    before = [line for line in data(first_watch[0]) if line["imu2"]["calibration"] == 0]
    noise = recording.meta.imu.gyro_arw * np.sqrt(100.0), recording.meta.imu.accel_vrw * np.sqrt(100.0)
    for sensor, white in zip(("gyro", "accel"), noise, strict=True):
        for lines, agree in ((before, False), (after, True)):
            apart = column(lines, "imu2", sensor) - column(lines, "primary", sensor)
            at_rest = np.linalg.norm(column(lines, "primary", "gyro"), axis=1) < 0.02
            mean = np.abs(apart[at_rest].mean(axis=0)).max()
            assert (mean < 5.0 * white / np.sqrt(np.count_nonzero(at_rest)) + 1e-4) == agree


@pytest.mark.long
def test_lever_arm_effect_is_removed(first_watch: tuple[Lines, Path], recording: Log) -> None:
    _, folder = first_watch
    lines = data(watched(recording, folder))
    assert all(line["imu2"]["calibration"] == 0 for line in lines)  # that of the first watch
    time = np.array([t for line in lines for t in line["time_s"]])
    offset = lines[0]["imu2"]["clock_offset_s"]
    assert abs(offset) > 1e-3
    primary, force = column(lines, "primary", "accel"), column(lines, "imu2", "accel")
    moving = np.linalg.norm(column(lines, "primary", "gyro"), axis=1) > 0.5
    shifted = np.column_stack([np.interp(time + offset, time, axis) for axis in primary.T])
    assert np.sqrt(np.mean((force - shifted)[moving] ** 2)) < 0.2
    (path,) = folder.glob("*.toml")
    bare = folder / "bare"
    bare.mkdir()
    text = [row for row in path.read_text().splitlines() if "lever" not in row]
    (bare / path.name).write_text("\n".join(text))
    without = column(data(watched(recording, bare)), "imu2", "accel")
    assert np.sqrt(np.mean((without - shifted)[moving] ** 2)) > 1.5 * np.sqrt(np.mean((force - shifted)[moving] ** 2))


@pytest.mark.long
def test_silent_primary_is_replaced_by_the_secondary_and_reported(
    first_watch: tuple[Lines, Path], recording: Log
) -> None:
    def silent(block: SampleBlock) -> SampleBlock:
        gone = (block.time > 20.0) & (block.time < 30.0)
        return replace(block, counts=np.where(gone[:, None], np.nan, block.counts), valid=block.valid & ~gone)

    lines = watched(recording, first_watch[1], silent)
    assert_continuous(lines, recording)
    overs = events(lines, "switch_over")
    assert [(e["from"], e["to"], e["reason"]) for e in overs] == [
        ("primary", "imu2", "primary_silent"),
        ("imu2", "primary", "primary_valid"),
    ]
    assert 21.0 < overs[0]["time_s"] < 21.3
    assert 30.0 <= overs[1]["time_s"] < 30.2
    within = [line for line in data(lines) if overs[0]["time_s"] < line["time_s"][0] < 29.9]
    assert {(line["source"], line["switch_overs"]) for line in within} == {("imu2", 1)}
    assert all(row is None for line in within for row in line["primary"]["gyro"])
    assert np.isfinite(column(within, "imu2", "gyro")).all()
    assert data(lines)[-1]["switch_overs"] == 2


def test_secondary_is_the_source_only_after_a_check_and_while_it_sends(recording: Log, tmp_path: Path) -> None:
    stream, watch = CorrectedStream(recording.meta), PairSession(recording.meta, tmp_path, "log").watch
    watch.silent = frozenset({0})
    stream.update(watch)
    assert stream.source is None
    watch.verdicts[2] = {"gyro": "within", "accel": "calibrated"}
    stream.update(watch)
    assert stream.source == "imu2"
    watch.silent = frozenset({0, 2})
    stream.update(watch)
    assert stream.source is None


def test_watch_succeeds_only_if_every_secondary_is_checked_and_sends_until_the_end() -> None:
    sound = {"gyro": RestDeviation(1e-5, 1e-4), "accel": RestDeviation(1e-3, 1e-2)}
    check = StaticCheck(sound, sound)
    within: Verdict = "within"
    verdicts = {2: {"gyro": within, "accel": within}}
    stored = {2: StoredCrossCalibration()}
    assert PairWatchResult((), {2: check}, verdicts, stored, frozenset()).within
    assert not PairWatchResult((), {2: check}, verdicts, {**stored, 3: StoredCrossCalibration()}, frozenset()).within
    assert not PairWatchResult((), {2: check}, verdicts, stored, frozenset({2})).within
    lost = (WatchEvent("not_stored", 1.0, 2),)
    assert not PairWatchResult(lost, {2: check}, verdicts, stored, frozenset()).within


def test_nothing_is_calibrated_after_a_stop(recording: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = PairSession(recording.meta, tmp_path, "log")
    monkeypatch.setattr(session.watch, "finish", lambda: pytest.fail("the watch was stopped"))
    lines: list[str] = []
    block = next(iter(recording.blocks())).part(0, 10)
    session.run([block], [CorrectedOutput(recording.meta, [lines.append])], lambda: True)
    assert json.loads(lines[-1]) == {"type": "end"}


def test_last_minute_is_kept_for_the_plots(first_watch: tuple[Lines, Path], recording: Log) -> None:
    session = PairSession(recording.meta, first_watch[1], "log")
    builder = CorrectedTraceBuilder(recording.meta)
    session.run(recording.blocks(), [builder])
    trace = builder.trace()
    assert (trace.source, trace.switch_overs) == ("primary", 0)
    assert (len(trace.time), trace.time[-1]) == (len(trace.rate["imu2"]), 0.0)
    assert set(trace.force) == {"primary", "imu2"}


@pytest.mark.long
def test_out_of_tolerance_primary_is_replaced_until_it_passes_a_check(
    first_watch: tuple[Lines, Path], recording: Log
) -> None:
    """The primary gyros read 0.01 rad/s too high for some seconds; checks are due during and after this time."""
    size = recording.meta.imu.gyro_lsb * (100.0 if recording.meta.imu.output == "increment" else 1.0)

    def off(block: SampleBlock) -> SampleBlock:
        wrong = (block.time > 3.0) & (block.time < 15.0)
        return replace(block, counts=block.counts + np.outer(wrong, np.eye(6)[0] * 0.01 / size))

    lines = watched(recording, first_watch[1], off, again=(4.0, 16.0))
    overs = events(lines, "switch_over")
    assert [(e["to"], e["reason"], e["count"]) for e in overs[:2]] == [
        ("imu2", "primary_off", 1),
        ("primary", "primary_valid", 2),
    ]
    assert events(lines, "primary_off")
    assert lines.index(events(lines, "primary_off")[0]) < lines.index(overs[0])


@pytest.mark.long
def test_source_is_none_without_a_valid_imu(recording: Log, tmp_path: Path) -> None:
    size = recording.meta.imu.gyro_lsb * (100.0 if recording.meta.imu.output == "increment" else 1.0)
    lines = watched(recording, tmp_path, lambda block: replace(block, counts=block.counts + np.eye(6)[0] * 0.01 / size))
    assert events(lines, "switch_over")[0]["to"] is None
    assert data(lines)[-1]["source"] is None
