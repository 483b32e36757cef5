"""A short version of the study of methods without a table; the full one is `calstation study --method`."""

import json

import pytest

from calstation.errors import ConfigurationError
from calstation.simulation import run_method_study
from calstation.simulation.method_study import RECORDING_KINDS


@pytest.mark.exhaustive
@pytest.mark.parametrize("stage", list(RECORDING_KINDS))
def test_errors_agree_with_their_sigmas(stage: str) -> None:
    progress: list[tuple[int, int]] = []
    study = run_method_study(stage, "mems", 4, lambda *done: progress.append(done))
    assert study["passed"], study["groups"]
    assert progress[-1] == (4, 4)
    assert json.loads(json.dumps(study)) == study


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="Choose from: multi_position, cross_calibration, gimbal"):
        run_method_study("rate", "mems", 1)
