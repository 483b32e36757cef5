"""A short version of the study of methods without a table; the full one is `calstation study --method`."""

import json

import pytest

from calstation.errors import ConfigurationError
from calstation.simulation import grades_of, run_method_study
from calstation.simulation.method_study import RECORDING_KINDS
from tests.helpers import raises_code


@pytest.mark.exhaustive
@pytest.mark.parametrize("stage", list(RECORDING_KINDS))
def test_errors_agree_with_their_sigmas(stage: str) -> None:
    progress: list[tuple[int, int]] = []
    study = run_method_study(stage, "mems", 4, lambda *done: progress.append(done))
    assert study["passed"], study["groups"]
    assert progress[-1] == (4, 4)
    assert json.loads(json.dumps(study)) == study


@pytest.mark.parametrize(
    ("stage", "grade"),
    [
        pytest.param("temperature_ramp", "mems", marks=pytest.mark.long),
        *(
            pytest.param(stage, grade, marks=pytest.mark.exhaustive)
            for stage, grade in (("temperature", "mems"), ("temperature", "nav"), ("temperature_ramp", "nav"))
        ),
    ],
)
def test_errors_over_temperature_agree_with_their_sigmas(stage: str, grade: str) -> None:
    study = run_method_study(stage, grade, 2)
    assert study["passed"], study
    assert study["tested"] == study["within_limits"] == 2
    assert study["held_out"] < 1.5
    if stage == "temperature_ramp":
        assert study["minutes"] < 120.0
    assert json.loads(json.dumps(study)) == study


def test_a_grade_without_a_product_over_temperature_is_refused() -> None:
    assert grades_of("temperature") == ("nav", "mems")
    with raises_code(ConfigurationError, "cli.unknown_choice"):
        run_method_study("temperature", "tactical", 1)


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="Choose from: multi_position, cross_calibration, gimbal, temp"):
        run_method_study("rate", "mems", 1)
