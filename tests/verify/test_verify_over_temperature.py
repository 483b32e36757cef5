"""The second opinion on a calibration over temperature agrees with calstation, and finds planted errors."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calstation.estimation.navigation import temperature_stage
from calstation.estimation.temperature import fit
from calstation.records import open_log
from calstation.reports import build_certificate, write_dcc
from calstation.results import load_result, resolve_log, write_json
from calstation.verify import samples, verify
from tests.helpers import sampled
from tests.verify.compare import write_log
from tests.verify.test_compare import SHORT_OVER_TEMPERATURE

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result JSON of a short log, beside the log."""
    path = tmp_path_factory.mktemp("verify_over_temperature") / "log.h5"
    write_log(SHORT_OVER_TEMPERATURE, path)
    return solved(path, path.with_suffix(".json"))


@pytest.fixture(scope="module")
def solution(result: Path) -> Any:
    log = samples.read_log(result.with_suffix(".h5"))
    return verify.Solution(log, json.loads(result.read_text(encoding="utf-8")))


@pytest.fixture
def solved_once(solution: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verify, "Solution", lambda *_: solution)


def solved(log: Path, target: Path) -> Path:
    """Solve a log and write its result."""
    opened = open_log(log)
    write_json(target, resolve_log(opened, opened.meta).result.to_json())
    return target


def found(source: Path, log: Path) -> set[str]:
    return {row["code"] for row in verify.verify(source, log)["findings"]}


@pytest.mark.usefixtures("solved_once")
def test_result_agrees(result: Path) -> None:
    report = verify.verify(result)
    assert report["findings"] == []
    assert {"gyro_bias_x", "gyro_bias_x[0]", "gyro_bias_x[1]", "gyro_bias_x[rate]"} <= report["parameters"].keys()


def test_digital_certificate_agrees(result: Path, tmp_path: Path, solution: Any) -> None:
    dcc, own = tmp_path / "certificate.xml", solution.table()
    dcc.write_bytes(write_dcc(build_certificate(load_result(result), open_log(result.with_suffix(".h5")).meta)))
    stated = {key: value for claim in verify.read_claims(dcc) for key, value in claim.table.items()}
    assert {("value", "gyro_bias_x[0]"), ("sigma", "gyro_bias_x[rate]"), ("value", "gyro_bias_x")} <= stated.keys()
    for key in own.keys() & stated.keys():
        _, low, high = own[key]
        assert low <= stated[key] <= high, key


def _sign(over: dict[str, Any]) -> None:
    over["coefficients"]["gyro_bias_y"]["values"][1] *= -1.0


def _rate(over: dict[str, Any]) -> None:
    rate = over["coefficients"]["gyro_bias_y"]["rate"]
    rate["value"] += 0.2 * rate["sigma"]


def _sigma(over: dict[str, Any]) -> None:
    over["covariance"] = (0.9 * np.array(over["covariance"])).tolist()


def _missing(over: dict[str, Any]) -> None:
    del over["coefficients"]["accel_scale_z"]
    over["covariance"] = np.array(over["covariance"])[:-1, :-1].tolist()


@pytest.mark.usefixtures("solved_once")
@pytest.mark.parametrize(
    ("change", "code"),
    [
        (_sign, "value"),
        pytest.param(_rate, "value", marks=pytest.mark.exhaustive),
        pytest.param(_sigma, "sigma", marks=pytest.mark.exhaustive),
        pytest.param(_missing, "missing", marks=pytest.mark.exhaustive),
    ],
)
def test_an_error_planted_in_the_coefficients_is_found(
    result: Path, tmp_path: Path, change: Callable[[dict[str, Any]], None], code: str
) -> None:
    planted, target = json.loads(result.read_text(encoding="utf-8")), tmp_path / "planted.json"
    change(planted["temperature"])
    target.write_text(json.dumps(planted), encoding="utf-8")
    assert code in found(target, result.with_suffix(".h5"))


#: Errors in calstation: object, its attribute, and what takes its place.
ERRORS: dict[str, tuple[Any, str, Any]] = {
    "forgotten bias instability": (temperature_stage, "_instability", lambda _: np.zeros(30)),
    "forgotten hysteresis": (fit, "_MIN_OF_WAY", 100),
    "forgotten offset of the axes": (temperature_stage.TemperatureStage, "_completed", lambda _, point, __: point),
    "samples not converted": (temperature_stage._Part, "at_mean", lambda part, *_: part.data),
}


@pytest.mark.usefixtures("solved_once")
@pytest.mark.parametrize("name", sampled(4, [*ERRORS]))
def test_an_error_of_calstation_is_found(
    result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(*ERRORS[name])
    log = result.with_suffix(".h5")
    assert "sigma" in found(solved(log, tmp_path / "planted.json"), log)


@pytest.mark.exhaustive
@pytest.mark.usefixtures("solved_once")
def test_a_wrong_reference_of_calstation_is_found(result: Path, tmp_path: Path) -> None:
    log = result.with_suffix(".h5")
    opened = open_log(log)
    assert opened.meta.temperature is not None
    over = opened.meta.temperature.model_copy(update={"reference_c": 26.0})
    target = tmp_path / "planted.json"
    write_json(target, resolve_log(opened, opened.meta.model_copy(update={"temperature": over})).result.to_json())
    assert "value" in found(target, log)
