"""The decision rule of a product applies to runs, partial runs and re-solved logs alike."""

from pathlib import Path

import pytest

from calstation.config.library import shipped_folder

RULE = """
[conformity]
rule = "guard_band"

[conformity.spread]
gyro_bias = 0.002
"""


@pytest.mark.long
def test_guard_band_applies_to_a_run_and_its_re_solved_log(calstation, tmp_path: Path) -> None:
    product = tmp_path / "guarded.toml"
    text = (shipped_folder() / "products" / "mems_c_fast.toml").read_text(encoding="utf-8")
    product.write_text(text.replace("within = 3.0e-05", "within = 9e-06") + RULE, encoding="utf-8")
    options = ("--product", product, "--serial", "SN-000012", "--speed", "0", "--yes", "--out", tmp_path / "runs")
    run = calstation("run", *options, "--json", "-")
    found = run.json["conformity"]
    assert found["rule"] == "guard_band"
    gyro, quadratic = found["parameters"]["gyro_bias_x"], found["parameters"]["accel_quadratic_x"]
    assert gyro["acceptance"][1] == pytest.approx(0.0052 - 2.0 * run.json["parameters"]["gyro_bias_x"]["sigma"])
    assert 0.0 < gyro["false_accept"] < gyro["false_reject"] < 0.01
    assert not quadratic["accepted"]
    assert (run.code, run.json["outcome"]) == (1, "failed")
    assert "guard_band" in {check.get("cause") for check in run.json["checks"]}
    log = next((tmp_path / "runs").glob("*.h5"))
    again = calstation("resolve", log, "--json", "-")
    assert (again.code, again.json["conformity"]) == (1, found)
    shown = calstation("resolve", log).out
    assert "FAILED: outside the acceptance limits." in shown
    rows = {line.split()[0]: line.split() for line in shown.splitlines() if line.startswith("  ") and line.strip()}
    assert rows["accel_quadratic_x"][-3] == "–"  # no value can be accepted
    assert rows["accel_quadratic_x"][-1] == "OUTSIDE"
    assert "Acceptance limit: the limit of the product less a guard band of 2 σ." in shown
    assert "Decision rule guard_band." in shown


@pytest.mark.long
def test_guard_band_applies_to_a_partial_run(calstation, tmp_path: Path) -> None:
    product = tmp_path / "guarded.toml"
    text = (shipped_folder() / "products" / "nav_a.toml").read_text(encoding="utf-8")
    product.write_text(text + '\n[conformity]\nrule = "guard_band"\n', encoding="utf-8")
    options = ("--product", product, "--serial", "SN-000013", "--speed", "0", "--yes", "--out", tmp_path / "runs")
    found = calstation("run", "--stages", "rate", *options, "--json", "-").json
    assert found["partial"]
    checks = {check["name"]: check for check in found["checks"]}
    check, sigma = checks["gyro_scale_x within"], found["parameters"]["gyro_scale_x"]["sigma"]
    assert check["acceptance"][1] == pytest.approx(check["limit"][1] - 2.0 * sigma)
    assert found["conformity"]["parameters"]["gyro_scale_x"]["accepted"]
