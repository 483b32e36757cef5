"""IMUs on one body, followed: off at first, calibrated and kept, and within the threshold the next time."""

import re
from collections.abc import Callable
from pathlib import Path

from calstation.records.meta import load_pair
from tests.cli.conftest import Done, six_position_rows, write_log

Run = Callable[..., Done]


def test_what_was_off_is_calibrated_kept_and_good_the_next_time(calstation: Run, tmp_path: Path) -> None:
    log, pairs = tmp_path / "pair.h5", tmp_path / "pairs"
    assert calstation("record", "pair", "-o", log, "--seed", 3).code == 0
    first = calstation("watch", log, "--pairs", pairs)
    assert first.code == 0, first.out
    assert "imu2 calibrated; the result is stored" in first.out
    assert "Out of tolerance: imu2; waiting for motion" in first.out
    assert re.search(r"imu2 gyro: [\d.]+ °/[sh] at rest \(threshold [\d.]+ °/[sh]\)", first.out)
    assert re.search(r"imu2 accel: [\d.]+ (µg|m/s²) at rest", first.out)
    kept = load_pair(pairs, "BENCH-mems", "BENCH-2")
    assert len(kept.values) == 28
    again = calstation("watch", log, "--pairs", pairs)
    assert again.code == 0
    assert "calibrated" not in again.out
    assert again.out.count("within") == 2
    assert load_pair(pairs, "BENCH-mems", "BENCH-2") == kept


def test_a_log_of_one_imu_is_told(calstation: Run, tmp_path: Path) -> None:
    done = calstation("watch", write_log(tmp_path, six_position_rows()), "--pairs", tmp_path)
    assert done.code == 2
    assert "log.csv: The log holds one IMU only. Add [imu2]" in done.err
