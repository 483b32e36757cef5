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


def test_reversed_axis_is_named_by_check_import_and_resolve(calstation, tmp_path):
    rows = [row.split(",") for row in six_position_rows()]
    for row in rows:
        row[7] = str(-int(row[7]))
    log = write_log(tmp_path, [",".join(row) for row in rows], meta=META)
    words = "They do if accel_z is −accel_z."
    checked = calstation("check", log)
    assert "fault      Stage Six positions: The angles of the table do not agree" in checked.out
    assert words in checked.out
    imported = calstation("import", log, "-o", tmp_path / "imported.h5")
    assert imported.code == 0
    assert words in imported.err.replace("\n", " ")
    resolved = calstation("resolve", log)
    assert resolved.code == 2
    assert words in resolved.err.replace("\n", " ")


def test_spike_is_the_first_cause_of_a_failure(calstation, tmp_path):
    rows = [row.split(",") for row in six_position_rows()]
    rows[500][2] = str(int(rows[500][2]) + 50000)
    log = write_log(tmp_path, [",".join(row) for row in rows], meta=META + LIMITS)
    done = calstation("resolve", log, "--json", "-")
    assert done.code == 1
    first = next(check for check in done.json["checks"] if not check["passed"] and "cause" in check)
    assert (first["name"], first["cause"], first["values"]["channel"]) == ("six_position samples", "spikes", "gyro_x")


def test_data_that_contradict_the_prior_fail_with_the_prior_to_correct(calstation, tmp_path):
    rows = [row.split(",") for row in six_position_rows()]
    for row in rows:
        row[5] = str(int(row[5]) + 400_000)  # a bias of 0.4 m/s²
    prior = "\n[prior.accel_bias_x]\nvalue = 0.1\nsigma = 0.05\n"
    log = write_log(tmp_path, [",".join(row) for row in rows], meta=META + LIMITS + prior)
    done = calstation("resolve", log, "--json", "-")
    assert done.code == 1
    (cause,) = failed(done, "prior of the profile")
    assert cause == "prior_unlike"
    text = " ".join(calstation("resolve", log).out.split())
    assert "but the prior states 10197 µg with a sigma of 5099 µg: 6.0 sigma off" in text
    assert "correct its prior in the IMU profile" in text
    unstated = write_log(tmp_path, [",".join(row) for row in rows], meta=META + LIMITS)
    assert not failed(calstation("resolve", unstated, "--json", "-"), "prior of the profile")
