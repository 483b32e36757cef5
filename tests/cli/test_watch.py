"""`calstation watch` calibrates IMUs on one body that are out of tolerance."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from calstation.estimation.common import StoredCrossCalibration
from calstation.records import load_pair, store_pair
from calstation.results import check_pair
from tests.cli.conftest import Done, six_position_rows, write_log

Run = Callable[..., Done]


@pytest.mark.long
def test_pair_out_of_tolerance_is_calibrated_and_stored(
    calstation: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, pairs = tmp_path / "pair.h5", tmp_path / "pairs"
    assert calstation("record", "pair", "-o", log, "--seed", 3).code == 0
    first = calstation("watch", log, "--pairs", pairs)
    assert first.code == 0, first.out
    assert "imu2 calibrated (gyro, accel)." in first.out
    window = tmp_path / "window"
    monkeypatch.setenv("CALSTATION_HOME", str(window))
    events = check_pair(lambda *_, **__: None, log).progress.events
    times = re.findall(r"^ *([\d.]+) s  ", first.out, re.MULTILINE)
    assert times == [f"{event.time:.1f}" for event in events]
    assert "Out of tolerance: imu2; waiting for motion" in first.out
    assert re.search(r"imu2 gyro: [\d.]+ °/[sh] at rest \(threshold [\d.]+ °/[sh]\)", first.out)
    assert re.search(r"imu2 accel: [\d.]+ (µg|m/s²) at rest", first.out)
    kept = load_pair(pairs, "BENCH-mems-3A", "BENCH-mems-3B")
    assert len(kept.values) == 28
    again = calstation("watch", log, "--pairs", pairs)
    assert again.code == 0
    assert "calibrated" not in again.out
    assert again.out.count("within") == 2
    assert load_pair(pairs, "BENCH-mems-3A", "BENCH-mems-3B") == kept


def test_sensor_is_not_calibrated_against_an_out_of_tolerance_primary(calstation: Run, tmp_path: Path) -> None:
    log, pairs = tmp_path / "pair.h5", tmp_path / "pairs"
    assert calstation("record", "pair", "-o", log, "--seed", 3).code == 0
    assert calstation("export", log, "-o", tmp_path / "pair.csv").code == 0
    meta = tmp_path / "pair.toml"
    text = meta.read_text()
    start = text.index("[schedule.cross_calibration.primary_gyro]")
    meta.write_text(text[:start] + text[start:].replace("fixed = 0.0002", "fixed = 1e-7", 1))
    store_pair(pairs, "BENCH-mems-3A", "BENCH-mems-3B", StoredCrossCalibration({}, 1e-4, 0.01))
    done = calstation("watch", tmp_path / "pair.csv", "--pairs", pairs)
    assert done.code == 1, done.out
    assert "imu2 calibrated (accel), but not its gyro: the primary IMU is out of tolerance." in done.out
    assert re.search(r"imu2 gyro: .* OFF", done.out)
    assert re.search(r"imu2 accel: .* calibrated", done.out)
    assert re.search(r"primary gyro: .* OFF", done.out)
    kept = load_pair(pairs, "BENCH-mems-3A", "BENCH-mems-3B")
    assert kept.accel_static is not None
    assert kept.accel_static < 5e-3
    assert "secondary_gyro_bias_x" not in kept.values


@pytest.mark.long
def test_full_disk_or_the_log_itself_as_output_file_is_reported(calstation: Run, tmp_path: Path) -> None:
    log = tmp_path / "pair.h5"
    assert calstation("record", "pair", "-o", log, "--seed", 3).code == 0
    before = log.read_bytes()
    done = calstation("watch", log, "--pairs", tmp_path / "pairs", "-o", log)
    assert done.code == 2
    assert "The target is the log itself" in done.err
    assert log.read_bytes() == before
    if Path("/dev/full").exists():
        done = calstation("watch", log, "--pairs", tmp_path / "pairs", "-o", "/dev/full")
        assert done.code == 1
        assert done.out.count("/dev/full: The file cannot be written") == 1
        assert "imu2 calibrated" in done.out


def test_log_of_one_imu_is_refused(calstation: Run, tmp_path: Path) -> None:
    done = calstation("watch", write_log(tmp_path, six_position_rows()), "--pairs", tmp_path)
    assert done.code == 2
    assert "log.csv: The log contains only one IMU. Add [imu2]" in done.err
