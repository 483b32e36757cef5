"""Recordings and runs with invalid samples fail, and the output names the cause."""

import pytest

from calstation.config.library import shipped_folder
from tests.cli.conftest import META, six_position_rows, write_log

LIMITS = """
[product]
name = "unit"
limits = { accel_bias = { within = 1.0 } }
"""


def failed(done, kind):
    return {c["cause"]: c["values"] for c in done.json["checks"] if c["name"].endswith(kind) and not c["passed"]}


@pytest.mark.long
def test_recording_with_clipped_rows_and_a_wrong_sample_rate_fails_with_causes(calstation, tmp_path):
    rows = [row.split(",") for row in six_position_rows()]
    sound = write_log(tmp_path, [",".join(row) for row in rows], meta=META + LIMITS)
    done = calstation("resolve", sound, "--json", "-")
    assert not failed(done, "clipping")
    assert not failed(done, "sample clock")
    for row in rows:
        row[1] = f"{float(row[1]) * 1.0008:.6f}"
        row[7] = str(min(int(row[7]), 9796400))
    unsound = write_log(tmp_path, [",".join(row) for row in rows], meta=META + LIMITS)
    done = calstation("resolve", unsound, "--json", "-")
    assert done.code == 1
    clipped = failed(done, "clipping")["clipped"]
    assert clipped["channel"] == "accel z"
    assert clipped["level"] == pytest.approx(9.7964)
    assert failed(done, "sample clock")["sample_clock"]["ppm"] == pytest.approx(-800.0, abs=5.0)
    text = calstation("resolve", unsound)
    assert "accel z is clipped" in text.out


@pytest.mark.long
def test_unit_clock_error_of_800_ppm_against_the_station_clock_fails(calstation, tmp_path):
    station = tmp_path / "drift.toml"
    text = (shipped_folder() / "stations" / "virtual_bench.toml").read_text(encoding="utf-8")
    station.write_text(text + "\nclock_drift_ppm = 800.0\n", encoding="utf-8")
    options = ("--stages", "rate", "--serial", "SN-000001", "--yes", "--json", "-", "--out", tmp_path / "runs")
    done = calstation("run", "--station", station, *options)
    assert failed(done, "sample clock")["sample_clock"]["reference"] == "station"
    assert failed(done, "sample clock")["sample_clock"]["ppm"] == pytest.approx(800.0, abs=30.0)
    log = next((tmp_path / "runs").glob("*.h5"))
    again = calstation("resolve", log, "--json", "-")
    assert failed(again, "sample clock") == failed(done, "sample clock")
    sound = calstation("run", *options)
    assert not failed(sound, "sample clock")
    assert sound.json["details"]["rate"]["sample_clock"]["station"]["offset"] == pytest.approx(2e-5, abs=2e-5)
