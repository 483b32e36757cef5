"""`show` displays a stored result with bars of the shares of the limits."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from calstation.physics import display
from tests.cli.conftest import META, Done, six_position_rows, write_log
from tests.results.test_history import write
from tests.thermal_results import thermal_result

Run = Callable[..., Done]
LIMITS = '[product]\nname = "unit"\n[product.limits.accel_scale]\nwithin = [0.0, 1e-3]\nsigma_below = 1.0\n'


def test_result_is_shown_with_shares_of_its_limits(calstation: Run, tmp_path: Path) -> None:
    meta = META.replace("accel_lsb = 1e-6", "accel_lsb = 1.001e-6") + LIMITS
    log = write_log(tmp_path, six_position_rows(), meta=meta)
    result = tmp_path / "result.json"
    calstation("resolve", log, "--json", result)
    done = calstation("show", result)
    assert done.code == 0
    assert done.err == ""
    (row,) = (line for line in done.out.splitlines() if "accel_scale_x" in line and "#" in line)
    assert "#" * 16 in row
    assert row.rstrip().endswith("·" * 16 + "    0%")
    assert "SN-7:" in done.out.splitlines()[-1]
    assert calstation("show", log).out == done.out


@pytest.mark.parametrize(
    ("language", "mark", "note"),
    [
        ("en", "not judged", "Not judged although they have a limit: accel_scale_x."),
        ("zh_CN", "未判定", "有限差但未判定：accel_scale_x。"),
    ],
)
def test_parameters_that_a_partial_run_did_not_judge_are_named(
    calstation: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, language: str, mark: str, note: str
) -> None:
    path = tmp_path / "result.json"
    calstation("resolve", write_log(tmp_path, six_position_rows(), meta=META + LIMITS), "--json", path)
    content = json.loads(path.read_text(encoding="utf-8"))
    content |= {"partial": True, "passed": True, "not_compared": ["accel_scale_x"], "unobservable": ["accel_scale_x"]}
    content["calibration"] = {"log": "a.h5", "started_utc": "2026-01-01T00:00:00+00:00"}
    content["calibration"]["not_improved"] = ["accel_scale_x"]
    content["checks"] = [check for check in content["checks"] if "accel_scale_x" not in check["name"]]
    path.write_text(json.dumps(content), encoding="utf-8")
    monkeypatch.setattr("calstation.cli.text.LANGUAGE", language)
    done = calstation("show", path)
    (row,) = (line for line in done.out.splitlines() if "accel_scale_x" in line and "ppm" in line)
    assert row.rstrip().endswith(mark)
    assert note in " ".join(done.out.split())


def test_result_without_limits_has_no_bars(calstation: Run, tmp_path: Path) -> None:
    log = write_log(tmp_path, six_position_rows())
    done = calstation("show", log)
    assert done.code == 0
    assert "accel_scale_x" in done.out
    assert "####" not in done.out


def test_decision_rule_names_no_parameter_as_accepted_whose_sigma_is_too_large(calstation: Run, tmp_path: Path) -> None:
    limits = LIMITS.replace("sigma_below = 1.0", "sigma_below = 1e-9") + "[product.limits.accel_bias]\nwithin = 1.0\n"
    log = write_log(tmp_path, six_position_rows(), meta=META.replace("1e-6\ngyro_arw", "1.0005e-6\ngyro_arw") + limits)
    done = calstation("resolve", log, "--json", tmp_path / "result.json")
    decisions = json.loads((tmp_path / "result.json").read_text("utf-8"))["conformity"]["parameters"]
    assert decisions["accel_scale_x"]["accepted"]
    assert "The most uncertain decision: accel_bias_" in done.out


def test_missing_result_is_one_sentence(calstation: Run, tmp_path: Path) -> None:
    done = calstation("show", tmp_path / "absent.json")
    assert done.code == 2
    assert done.err.count("\n") == 1


def test_result_over_temperature_has_a_course_of_every_parameter(calstation: Run, tmp_path: Path) -> None:
    result, path = thermal_result(), tmp_path / "result.json"
    path.write_text(json.dumps(result.to_json()), encoding="utf-8")
    done = calstation("show", path)
    assert done.code == 0
    assert "worst from -40 to 85 °C" in done.out
    worst, _ = result.worst("gyro_bias_z")
    lines = [line.split() for line in done.out.splitlines() if line.strip().startswith("gyro_bias_z ")]
    first, course = lines[:2]
    assert float(first[1]) == pytest.approx(display("gyro_bias_z", worst.value)[0], abs=0.5)
    assert len(course[3]) == 16
    assert {"\u2581", "\u2588"} <= set(course[3])
    assert not any(line.strip().startswith("gyro_misalign_xy") and "\u2581" in line for line in done.out.splitlines())


def test_release_that_the_audit_trail_does_not_record_is_refused(
    calstation: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CALSTATION_HOME", str(tmp_path / "home"))
    forged = {"by": "B0002", "why": "forged", "utc": "2026-11-02T00:00:00+00:00"}
    path = write(tmp_path, "a", "SN-44", "failed", 1, override=forged)
    done = calstation("show", path)
    assert done.code == 2
    assert "released" not in done.out
    assert "the audit trail of this site does not record this release" in done.err


def test_simulated_result_is_called_simulated(calstation: Run, tmp_path: Path) -> None:
    path = write(tmp_path, "a", "SN-42", "passed", 1, simulated=True)
    assert calstation("show", path).out.splitlines()[-1] == "SN-42: PASS, simulated"
