"""A result is applied to a recording and to the connected unit: errors at rest before and after, corrected samples."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calstation as cs
from calstation.physics import RATE, normal_gravity
from calstation.results import Result
from tests.cli.conftest import META, Done, six_position_rows, write_log

Run = Callable[..., Done]
GRAVITY = normal_gravity(np.deg2rad(34.25), 400.0)
#: Specific force measured by the unit, with a scale factor error in addition to those of `six_position_rows`.
READS = 1.001 * 9.7969


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A six-position log of a unit with accelerometer scale factor errors."""
    return write_log(tmp_path, six_position_rows(), meta=META.replace("accel_lsb = 1e-6", "accel_lsb = 1.001e-6"))


@pytest.fixture
def result(calstation: Run, log: Path, tmp_path: Path) -> Path:
    """The result of that log."""
    path = tmp_path / "result.json"
    assert calstation("resolve", log, "--json", path).code == 0
    return path


def test_every_rest_is_shown_before_and_after_correction(calstation: Run, log: Path, result: Path) -> None:
    done = calstation("apply", result, log)
    assert done.code == 0, done.err
    assert "unit SN-7, at rest" in done.out
    assert done.out.count("\n") > 6
    shown = calstation("apply", result, log, "--json", "-").json
    assert (shown["serial"], shown["corrected"], len(shown["rests"])) == ("SN-7", False, 6)
    assert shown["rms"]["force_before"] == pytest.approx(READS - GRAVITY, rel=0.01)
    assert shown["max"]["force_after"] < 1e-3
    assert shown["rms"]["force_after"] <= shown["max"]["force_after"]
    # the gyros of this recording read noise only
    assert shown["rms"]["rate_after"] == pytest.approx(RATE, rel=0.2)


def test_rests_are_those_of_the_stages_with_the_numbers_of_the_checks(calstation: Run, log: Path, result: Path) -> None:
    rows = log.read_text(encoding="utf-8").splitlines()
    head, samples = rows[0], [row.split(",") for row in rows[1:]]
    loose = [[*row[:-2], "", "0"] for row in samples[:150]]  # a rest before the first stage, tilted a little
    for row in loose:
        row[head.split(",").index("accel_x")] = "2000000"
    for k, row in enumerate(both := [*loose, *samples]):
        row[:2] = [str(k), f"{(k + 1) / 50:.2f}"]
    log.write_text("\n".join([head, *(",".join(row) for row in both)]) + "\n", encoding="utf-8")
    shown = calstation("apply", result, log, "--json", "-").json
    assert [(rest["stage"], rest["rest"]) for rest in shown["rests"]] == [("six_position", k) for k in range(6)]
    assert shown["rests"][0]["start_s"] >= 3.0
    assert shown["max"]["force_after"] < 1e-3
    lines = [line.split() for line in calstation("apply", result, log).out.splitlines()]
    assert [line[0] for line in lines if len(line) == 7 and line[0].isdigit()] == [str(k) for k in range(1, 7)]
    assert ["Six", "positions"] in lines


def test_corrected_samples_are_written_in_si_units(calstation: Run, log: Path, result: Path, tmp_path: Path) -> None:
    corrected = tmp_path / "corrected.csv"
    assert calstation("apply", result, log, "-o", corrected).code == 0
    with log.open() as raw, corrected.open() as new:
        before, after = list(csv.DictReader(raw)), list(csv.DictReader(new))
    assert [row["seq"] for row in after] == [row["seq"] for row in before]
    assert after[7]["outer_deg"] == "0.0"
    force = np.array([[float(row[f"accel_{axis}"]) for axis in "xyz"] for row in after])
    for face in np.split(force, 6):
        assert np.linalg.norm(face.mean(axis=0)) == pytest.approx(GRAVITY, abs=1e-3)
    meta = corrected.with_suffix(".toml").read_text(encoding="utf-8")
    assert 'output = "rate"' in meta
    assert "accel_lsb = 1.0" in meta


def test_result_of_another_unit_gives_a_warning(calstation: Run, log: Path, result: Path) -> None:
    log.with_suffix(".toml").write_text(META.replace("SN-7", "SN-8"), encoding="utf-8")
    done = calstation("apply", result, log)
    assert done.code == 0
    assert "This recording is of SN-8; the result is for SN-7." in done.err


def test_result_over_temperature_is_applied_at_that_of_every_sample(
    calstation: Run, log: Path, result: Path, tmp_path: Path
) -> None:
    content, corrected = json.loads(result.read_text(encoding="utf-8")), tmp_path / "corrected.csv"
    bias, slope = content["parameters"]["accel_bias_x"]["value"], 1e-3
    rows = {"accel_bias_x": {"values": [bias, slope], "sigma": [0.0, 0.0], "unit": "m/s²"}}
    content["temperature"] = {"reference_c": 25.0, "range_c": [0.0, 50.0], "coefficients": rows}
    content["temperature"] |= {"covariance": [], "worst": {}, "points": []}
    result.write_text(json.dumps(content), encoding="utf-8")
    raw = _output(cs.open(log))
    with log.open() as stream:
        lines = list(csv.DictReader(stream))
    # the unit sends its temperature with every fifth sample
    heated = np.linspace(10.0, 40.0, len(lines))
    for k, (line, t) in enumerate(zip(lines, heated, strict=True)):
        line["temp_c"] = "" if k % 5 and k + 1 < len(lines) else repr(float(t))

    def write() -> None:
        with log.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, lines[0])
            writer.writeheader()
            writer.writerows(lines)

    write()
    assert calstation("apply", result, log, "-o", corrected).code == 0
    found = cs.open(corrected)
    expected = cs.apply(Result.from_json(content), *raw, heated)
    np.testing.assert_allclose(found.accel, expected[1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.gyro, expected[0], rtol=0, atol=1e-12)
    constant = cs.apply(Result.from_json({k: v for k, v in content.items() if k != "temperature"}), *raw)
    assert np.abs(constant[1] - found.accel)[:, 0].max() == pytest.approx(15.0 * slope, rel=0.01)

    lines[0]["temp_c"] = "-1.0"
    write()
    done = calstation("apply", result, log, "-o", corrected)
    assert done.code == 0
    assert f"1 sample of {len(lines)} outside" in " ".join(done.err.split())
    assert cs.open(corrected).first_seq == found.first_seq + 1
    for line in lines:
        line["temp_c"] = "60.0"
    write()
    done = calstation("apply", result, log, "-o", tmp_path / "refused.csv")
    assert done.code == 2
    assert f"{len(lines)} of {len(lines)} samples, such as that at 60.00 °C, outside" in " ".join(done.err.split())
    assert not (tmp_path / "refused.csv").exists()


def _output(log: cs.Log) -> tuple[np.ndarray, np.ndarray]:
    return log.gyro, log.accel


def test_recording_and_station_together_are_refused(calstation: Run, log: Path, result: Path) -> None:
    done = calstation("apply", result, log, "--station", "virtual_bench")
    assert done.code == 2
    assert "A recording and --station are both given. Give one of them." in done.err


@pytest.mark.parametrize("name", ["log.csv", "log.csv.gz"])
def test_recording_is_not_overwritten(calstation: Run, log: Path, result: Path, name: str) -> None:
    before = log.read_bytes(), log.with_suffix(".toml").read_bytes()
    done = calstation("apply", result, log, "-o", log.with_name(name))
    assert done.code == 2
    assert "The target is the log itself." in done.err
    assert (log.read_bytes(), log.with_suffix(".toml").read_bytes()) == before


def test_samples_corrected_by_other_registers_are_not_corrected_again(calstation: Run, log: Path, result: Path) -> None:
    corrected_log = log.rename(log.with_name("corrected_log.csv"))
    corrected_log.with_suffix(".toml").write_text(META + "[registers]\naccel_scale_x = 1e-3\n", encoding="utf-8")
    log.with_suffix(".toml").unlink()
    done = calstation("apply", result, corrected_log, "--json", corrected_log.with_name("shown.json"))
    assert "the result is not applied a second time" in done.err
    shown = json.loads(corrected_log.with_name("shown.json").read_text())
    assert shown["corrected"]
    assert shown["rms"]["force_after"] == shown["rms"]["force_before"]


def test_samples_with_the_registers_of_the_solved_log_are_corrected(calstation: Run, log: Path, tmp_path: Path) -> None:
    toml = log.with_suffix(".toml")
    toml.write_text(toml.read_text() + "[registers]\naccel_scale_x = 1e-3\n", encoding="utf-8")
    result = tmp_path / "result.json"
    assert calstation("resolve", log, "--json", result).code == 0
    shown = calstation("apply", result, log, "--json", "-").json
    assert not shown["corrected"]
    assert shown["rms"]["force_after"] < 0.01 * shown["rms"]["force_before"]


def test_corrected_log_contains_no_calibration_priors(calstation: Run, log: Path, tmp_path: Path) -> None:
    toml, result = log.with_suffix(".toml"), tmp_path / "result.json"
    prior = "[prior.accel_bias_x]\nsigma = 1e-3\n[prior_correlation.accel_bias_y]\naccel_bias_x = 0.5\n"
    toml.write_text(toml.read_text() + prior, encoding="utf-8")
    assert calstation("resolve", log, "--json", result).code == 0
    assert calstation("apply", result, log, "-o", tmp_path / "corrected.csv").code == 0
    assert "prior" not in (tmp_path / "corrected.toml").read_text(encoding="utf-8")


@pytest.mark.long
def test_result_is_applied_to_the_connected_unit(
    calstation: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    log, result, corrected = tmp_path / "hand.h5", tmp_path / "hand.json", tmp_path / "now.csv"
    assert calstation("record", "hand", "-o", log, "--grade", "tactical").code == 0
    assert calstation("resolve", log, "--stages", "multi_position", "--json", result).code == 0
    shown = calstation("apply", result, "--station", "virtual_bench", "-o", corrected, "--json", "-").json
    assert (shown["serial"], shown["corrected"]) == ("BENCH-tactical-1", False)
    assert shown["rms"]["force_after"] < 0.1 * shown["rms"]["force_before"]
    assert abs(shown["rms"]["rate_after"]) < 0.1 * shown["rms"]["rate_before"]
    with corrected.open() as stream:
        rows = list(csv.DictReader(stream))
    force = np.mean([[float(row[f"accel_{axis}"]) for axis in "xyz"] for row in rows], axis=0)
    assert np.linalg.norm(force) == pytest.approx(9.797, abs=0.01)
