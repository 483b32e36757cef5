"""Runs are counted from the start of the current shift in local time."""

import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import tomli_w

from calstation.config import library
from calstation.results import ShiftCount, count_shift, shift_start
from tests.results.test_history import write

#: Comparison of a check standard with its reference.
VERDICT = {
    **{"passed": False, "e_n": {"gyro_bias_x": 3.0}, "e_n_limit": 2.0, "t_squared": 9.0, "t_squared_limit": 8.0},
    **{"degrees": 1, "false_alarm": 0.0027},
}

THREE = ("06:00", "14:00", "22:00")


@pytest.fixture(autouse=True)
def zone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Set the time zone of the computer to China."""
    monkeypatch.setenv("TZ", "Asia/Shanghai")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize(
    ("now", "starts", "began"),
    [
        ("2026-11-23 06:00", THREE, "2026-11-23 06:00"),
        ("2026-11-23 13:59", THREE, "2026-11-23 06:00"),
        ("2026-11-23 23:30", THREE, "2026-11-23 22:00"),
        ("2026-11-23 05:59", THREE, "2026-11-22 22:00"),
        ("2026-11-23 05:59", ("00:00",), "2026-11-23 00:00"),
        ("2026-11-23 05:59", ("07:30",), "2026-11-22 07:30"),
    ],
)
def test_shift_begins_at_the_latest_start_time(now: str, starts: tuple[str, ...], began: str) -> None:
    assert shift_start(starts, datetime.fromisoformat(now)) == datetime.fromisoformat(f"{began}+08:00")


def test_only_passed_or_failed_full_runs_count(tmp_path: Path) -> None:
    write(tmp_path, "early", "SN-0", "passed", 1)
    write(tmp_path, "a", "SN-1", "passed", 2)
    write(tmp_path, "b", "SN-2", "failed", 2, duration_s=300.0)
    write(tmp_path, "c", "SN-3", "stopped", 2, finished_stages=["rate"])
    write(tmp_path, "d", "SN-3", "passed", 2, resumed_from="c", duration_s=200.0)
    write(tmp_path, "e", "SN-4", "passed", 2, partial=True)
    write(tmp_path, "f", "SN-4", "failed", 2, partial=True)
    write(tmp_path, "g", "SN-5", "fault", 2, error="no answer")
    write(tmp_path, "h", "SN-6", "passed", 2, station="bench 2")
    write(tmp_path, "i", "GOLD", "failed", 2, check_standard=VERDICT)
    since = datetime(2026, 11, 2, 16, 0).astimezone()  # 08:00 UTC, when these runs began
    assert since.astimezone(UTC).hour == 8
    count = count_shift(lambda *_: None, tmp_path, "bench 1", since)
    assert count == ShiftCount(passed=2, failed=1, mean_duration=200.0, partial_failed=1)
    assert (count.done, count.passed_share) == (3, 2 / 3)
    assert count_shift(lambda *_: None, tmp_path, "bench 3", since) == ShiftCount()
    assert ShiftCount().passed_share is None


def test_earlier_runs_of_a_unit_that_is_now_a_check_standard_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    for name, serial in (("a", "SN-1"), ("b", "SN-2")):
        write(tmp_path, name, serial, "passed", 2)
    since = datetime(2026, 11, 2, 16, 0).astimezone()
    assert count_shift(lambda *_: None, tmp_path, "bench 1", since).passed == 2
    standard = {"serial": "SN-2", "interval_days": 7, "reference": {"gyro_bias_x": {"value": 0.0, "sigma": 1e-8}}}
    text = library.find("products", "nav_a").read_text(encoding="utf-8") + tomli_w.dumps(
        {"check_standards": [standard]}
    )
    (tmp_path / "home" / "products").mkdir(parents=True)
    (tmp_path / "home" / "products" / "nav_a.toml").write_text(text, encoding="utf-8")
    assert count_shift(lambda *_: None, tmp_path, "bench 1", since).passed == 1


def test_units_of_a_batch_share_the_cycle_time(tmp_path: Path) -> None:
    for name, serial, seconds in (("a", "SN-1", 400.0), ("b", "SN-2", 390.0), ("c", "SN-3", 400.0)):
        write(tmp_path, name, serial, "passed", 2, batch="B-1", slot=name, duration_s=seconds)
    write(tmp_path, "d", "SN-4", "failed", 2, duration_s=200.0)
    since = datetime(2026, 11, 2, 16, 0).astimezone()
    count = count_shift(lambda *_: None, tmp_path, "bench 1", since)
    assert count == ShiftCount(passed=3, failed=1, mean_duration=150.0)


def test_a_unit_counts_in_the_shift_in_which_it_ends(tmp_path: Path) -> None:
    write(tmp_path, "a", "SN-1", "passed", 2, duration_s=120.0)
    began = datetime(2026, 11, 2, 8, 0, tzinfo=UTC)
    one, three = began + timedelta(minutes=1), began + timedelta(minutes=3)
    assert count_shift(lambda *_: None, tmp_path, "bench 1", one) == ShiftCount(passed=1, mean_duration=120.0)
    assert count_shift(lambda *_: None, tmp_path, "bench 1", three) == ShiftCount()
